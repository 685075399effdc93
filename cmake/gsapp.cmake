# SPDX-License-Identifier: Apache-2.0
# Helpers shared by the rooms.

# Flags of every target: warnings, sanitizers, include root.
add_library(gsapp_flags INTERFACE)
target_include_directories(gsapp_flags INTERFACE ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR}/generated)
# -march is the same everywhere, because headers with inline mathematics are shared and the linker keeps one copy of
# each. -Wno-restrict: GCC 12 reports overlaps in string concatenation that are not there (GCC bug 105651).
target_compile_options(gsapp_flags INTERFACE "$<$<COMPILE_LANGUAGE:CXX>:-Wall;-Wextra;-Wno-psabi;-Wno-restrict;-march=${GSAPP_CPU_ARCH};-fno-math-errno;-fopenmp-simd;-fno-trapping-math>")
if(GSAPP_CPU_ARCH STREQUAL "native" OR GSAPP_CPU_ARCH STREQUAL "x86-64-v4")
  target_compile_options(gsapp_flags INTERFACE "$<$<COMPILE_LANGUAGE:CXX>:-mprefer-vector-width=512>")
endif()
if(GSAPP_WERROR)
  target_compile_options(gsapp_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-Werror>)
endif()
if(GSAPP_SANITIZE)
  target_compile_options(gsapp_flags INTERFACE -fsanitize=${GSAPP_SANITIZE} -fno-sanitize-recover=undefined -fno-omit-frame-pointer -g)
  target_link_options(gsapp_flags INTERFACE -fsanitize=${GSAPP_SANITIZE})
endif()
if(GSAPP_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID MATCHES "Clang")
    message(FATAL_ERROR "GSAPP_FUZZ needs clang 16 or later with its compiler-rt: apt-get install clang-16 libclang-rt-16-dev, and the preset fuzz")
  endif()
  # libFuzzer sees which branches of the libraries an input takes. Casts of numbers that do not fit are undefined, too, but
  # belong to no group. Clang 16 cannot capture structured bindings where it reads OpenMP, and warns of GCC's flags.
  target_compile_options(gsapp_flags INTERFACE -fsanitize=fuzzer-no-link,float-cast-overflow -fno-sanitize-recover=float-cast-overflow
    -gline-tables-only -fno-openmp-simd -Wno-unknown-warning-option -Wno-source-uses-openmp)
endif()

include(cmake/precompile.cmake)

# gs_add_library(NAME [PRECOMPILE kind] LINK target...): makes one static library of every .cpp in the current folder.
function(gs_add_library name)
  cmake_parse_arguments(ARG "" "PRECOMPILE" "LINK;SOURCES" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  add_library(${name} STATIC ${sources} ${ARG_SOURCES})
  target_link_libraries(${name} PUBLIC gsapp_flags ${ARG_LINK})
  if(ARG_PRECOMPILE)
    gs_precompile(${name} ${ARG_PRECOMPILE})
  endif()
endfunction()

# gs_add_tests(LABEL [SERIAL] [QUICK] [CASES] [SLOW suite...] LINK target...): makes one test program of every *_test.cpp
# in the current folder. ctest lists its suites under LABEL, or with CASES each case, where these take seconds. SERIAL ones
# never run beside others; QUICK ones compute little themselves. Suites of the label unit have the label quick, too, but
# for SLOW ones.
function(gs_add_tests label)
  cmake_parse_arguments(ARG "SERIAL;QUICK;CASES" "" "LINK;SOURCES;SLOW" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*_test.cpp)
  if(NOT sources AND NOT ARG_SOURCES)
    return()
  endif()
  file(RELATIVE_PATH relative ${CMAKE_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR})
  string(REPLACE "/" "_" name ${relative})
  add_executable(${name} ${CMAKE_SOURCE_DIR}/tests/main.cpp ${sources} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE gsapp_flags ${ARG_LINK} GTest::gtest)
  cmake_path(GET CMAKE_CURRENT_BINARY_DIR PARENT_PATH beside)
  gs_link_program_files(${beside}) # cmake/install.cmake
  if(ARG_QUICK)
    gs_precompile(${name} quick_tests)
  else()
    gs_precompile(${name} tests)
  endif()
  if(ARG_CASES)
    gtest_discover_tests(${name} DISCOVERY_MODE PRE_TEST PROPERTIES LABELS ${label} RUN_SERIAL ${ARG_SERIAL})
    return()
  endif()
  file(GENERATE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.cmake CONTENT
    "set(name ${name})
set(program [=[$<TARGET_FILE:${name}>]=])
set(label ${label})
set(slow [=[${ARG_SLOW}]=])
set(serial ${ARG_SERIAL})
set(list [=[${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.txt]=])
include([=[${CMAKE_SOURCE_DIR}/cmake/list_suites.cmake]=])
")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${CMAKE_CURRENT_BINARY_DIR}/${name}_suites.cmake)
endfunction()
