# SPDX-License-Identifier: Apache-2.0
# Which GPUs a build is for unless CMAKE_CUDA_ARCHITECTURES names them.

# gs_cuda_architectures(OUT NVCC): sets OUT to machine code for the GPUs in this machine, as nvidia-smi lists them. A GPU that
# NVCC does not know yet gets the newest PTX that it does. Without a GPU that gsapp supports OUT is 80: machine code for the
# oldest, and PTX that the drivers of all later ones compile when the program starts.
function(gs_cuda_architectures out nvcc)
  set(found "")
  execute_process(COMMAND nvidia-smi --query-gpu=compute_cap --format=csv,noheader
    TIMEOUT 30 OUTPUT_VARIABLE capabilities RESULT_VARIABLE failed ERROR_QUIET)
  if(failed EQUAL 0)
    execute_process(COMMAND ${nvcc} --list-gpu-arch OUTPUT_VARIABLE known ERROR_QUIET)
    string(REGEX MATCHALL "[0-9]+" known "${known}")
    string(REGEX MATCHALL "[0-9]+\\.[0-9]" capabilities "${capabilities}")
    foreach(capability ${capabilities})
      string(REPLACE "." "" architecture ${capability})
      if(architecture LESS 80)
        continue()
      endif()
      set(newest 80)
      foreach(one ${known})
        if(one GREATER newest AND one LESS_EQUAL architecture)
          set(newest ${one})
        endif()
      endforeach()
      if(newest EQUAL architecture)
        list(APPEND found ${architecture}-real)
      else()
        list(APPEND found ${newest}-virtual)
      endif()
    endforeach()
    list(REMOVE_DUPLICATES found)
  endif()
  if(NOT found)
    set(found 80)
  endif()
  set(${out} "${found}" PARENT_SCOPE)
endfunction()
