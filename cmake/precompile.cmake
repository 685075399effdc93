# SPDX-License-Identifier: Apache-2.0
# Large headers are compiled once for many targets: their parsing was half of the build.
#
# gs_precompile(TARGET KIND): the units of TARGET find these headers precompiled. Kinds:
#   scene        json, fmt, Eigen           libraries
#   tests        the same and GoogleTest    tests that compute
#   quick_tests  as tests, compiled -O1     tests that drive libraries or programs
#   program      the same and CLI11, -O1    the command-line program
# A unit still includes what it uses: without precompilation (GSAPP_PRECOMPILE=OFF) the tree builds as well.
option(GSAPP_PRECOMPILE "Compile large headers once" ON)
# The presets that build everything turn this on: it halves the time of the libraries and of the program, for then headers
# are parsed and templates instantiated once for eight files. While files change, units of their own are faster.
option(GSAPP_UNITY "Compile the files of lib, eval and apps in groups of eight" OFF)

set(GSAPP_PRECOMPILED_scene <algorithm> <array> <cmath> <cstdint> <filesystem> <functional> <map> <memory> <optional> <string> <vector>
  <fmt/format.h> <nlohmann/json.hpp> <Eigen/Dense>)
set(GSAPP_PRECOMPILED_tests ${GSAPP_PRECOMPILED_scene} <gtest/gtest.h>)
set(GSAPP_PRECOMPILED_quick_tests ${GSAPP_PRECOMPILED_tests})
set(GSAPP_PRECOMPILED_program ${GSAPP_PRECOMPILED_scene} <CLI/CLI.hpp>)

# Flags that all targets of a kind share; a precompiled header is only read by units with the same.
function(gs_kind_options target kind)
  if(kind MATCHES "^(quick_tests|program)$")
    target_compile_options(${target} PRIVATE $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CONFIG:Release>>:-O1>)
  endif()
  if(NOT kind STREQUAL "scene")
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE OFF) # executables: the compiler's default, which is -fPIE
  endif()
endfunction()

function(gs_precompile target kind)
  gs_kind_options(${target} ${kind})
  if(GSAPP_UNITY AND kind MATCHES "^(scene|program)$")
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  endif()
  if(NOT GSAPP_PRECOMPILE)
    return()
  endif()
  set(holder gsapp_precompiled_${kind})
  if(NOT TARGET ${holder})
    file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/generated/${holder}.cpp CONTENT "// Holds the precompiled headers.\n")
    add_library(${holder} OBJECT ${CMAKE_BINARY_DIR}/generated/${holder}.cpp)
    target_link_libraries(${holder} PRIVATE gsapp_flags Eigen3::Eigen nlohmann_json::nlohmann_json spdlog::spdlog)
    if(kind MATCHES "tests")
      target_link_libraries(${holder} PRIVATE GTest::gtest)
    elseif(kind STREQUAL "program")
      target_link_libraries(${holder} PRIVATE CLI11::CLI11)
    endif()
    gs_kind_options(${holder} ${kind})
    target_precompile_headers(${holder} PRIVATE ${GSAPP_PRECOMPILED_${kind}})
  endif()
  # The same definitions and include folders as the holder's, without which the compiler would not take its headers.
  target_link_libraries(${target} PRIVATE Eigen3::Eigen nlohmann_json::nlohmann_json spdlog::spdlog)
  target_precompile_headers(${target} REUSE_FROM ${holder})
  # Once inlined library code comes from a precompiled header, GCC 12 no longer knows it for a system's: it warns of accesses
  # out of bounds that are none, and of registers inside its own AVX-512 header (GCC bug 105593).
  target_compile_options(${target} PRIVATE
    $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:-Wno-array-bounds;-Wno-stringop-overread;-Wno-stringop-overflow;-Wno-maybe-uninitialized>)
endfunction()
