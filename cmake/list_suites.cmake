# SPDX-License-Identifier: Apache-2.0
# Tells ctest, which includes this, of the suites of a test program: each is one test, in one process. A process for each
# case would spend most of the time loading libraries. The variables name, program, label, slow and serial are set,
# and list, the file that keeps what the program listed.
if(NOT EXISTS ${program})
  add_test(${name}_NOT_BUILT ${name}_NOT_BUILT)
  return()
endif()
if(${program} IS_NEWER_THAN ${list})
  execute_process(COMMAND ${program} --gtest_list_tests OUTPUT_FILE ${list} COMMAND_ERROR_IS_FATAL ANY)
endif()
file(STRINGS ${list} suites REGEX "^[^ ]+\\.( |$)") # "Suite." and what of it is typed; its cases are indented
foreach(suite IN LISTS suites)
  string(REGEX REPLACE "\\..*" "" suite "${suite}")
  add_test(${name}.${suite} ${program} --gtest_filter=${suite}.*)
  set(labels ${label})
  list(FIND slow "${suite}" place)
  if(label STREQUAL "unit" AND place EQUAL -1)
    list(APPEND labels quick)
  endif()
  set_tests_properties(${name}.${suite} PROPERTIES LABELS "${labels}" RUN_SERIAL ${serial} SKIP_RETURN_CODE 77)
endforeach()
