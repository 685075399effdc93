# SPDX-License-Identifier: Apache-2.0
# Which GPUs a build is for, with programs in place of nvidia-smi and nvcc. Run as: cmake -DSOURCE=... -DFOLDER=... -P this
cmake_minimum_required(VERSION 3.25)
include(${SOURCE}/cmake/cuda_architectures.cmake)
file(MAKE_DIRECTORY ${FOLDER})

function(program name text)
  file(WRITE ${FOLDER}/${name} "#!/bin/sh\n${text}\n")
  file(CHMOD ${FOLDER}/${name} PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
endfunction()

function(expect smi wanted)
  program(nvidia-smi "${smi}")
  gs_cuda_architectures(got ${FOLDER}/nvcc)
  if(NOT got STREQUAL wanted)
    message(SEND_ERROR "nvidia-smi: ${smi}: got '${got}' instead of '${wanted}'")
  endif()
endfunction()

set(ENV{PATH} "${FOLDER}:/usr/bin:/bin")
program(nvcc "printf 'compute_75\\ncompute_80\\ncompute_86\\ncompute_89\\ncompute_90\\n'")
expect("echo 8.6" "86-real")
expect("printf '8.9\\n8.9\\n'" "89-real")
expect("printf '9.0\\n8.0\\n'" "90-real;80-real")
expect("echo 12.0" "90-virtual")              # newer than nvcc
expect("printf '7.5\\n8.6\\n'" "86-real")     # the older one is no GPU that gsapp supports
expect("echo 7.5" "80")
expect("echo '[N/A]'" "80")
expect("echo 'No devices were found'; exit 6" "80")
expect("exit 127" "80")
