# SPDX-License-Identifier: Apache-2.0
# What `cpack` makes of an installation: a .deb, which takes the shared libraries from Debian's packages, and a .tar.gz,
# which brings them along.
install(SCRIPT ${CMAKE_SOURCE_DIR}/cmake/bundle_libraries.cmake COMPONENT libraries EXCLUDE_FROM_ALL)

set(CPACK_PACKAGE_NAME gsapp)
# A name without an address, which apt and dpkg accept: the project has none that could be given.
set(CPACK_PACKAGE_CONTACT "the gsapp maintainers")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Trains, evaluates and shows 3D Gaussian splatting scenes")
set(CPACK_PACKAGE_DESCRIPTION "gsapp makes a 3D Gaussian splatting model of photographs, on the CPU or on an NVIDIA GPU,
measures it, and shows it in a browser.")
set(CPACK_RESOURCE_FILE_LICENSE ${CMAKE_SOURCE_DIR}/LICENSE)
set(CPACK_GENERATOR DEB TGZ)
set(CPACK_STRIP_FILES ON)
set(CPACK_THREADS 0)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SUGGESTS "colmap, ffmpeg, libnccl2, python3, curl, unzip")
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)

# Read once for each generator: the libraries are a component of the .tar.gz alone.
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/package_options.cmake @ONLY CONTENT [[
set(CPACK_INSTALL_CMAKE_PROJECTS "@CMAKE_BINARY_DIR@;gsapp;program;/")
if(CPACK_GENERATOR STREQUAL "TGZ")
  list(APPEND CPACK_INSTALL_CMAKE_PROJECTS "@CMAKE_BINARY_DIR@;gsapp;libraries;/")
endif()
if("@GSAPP_CPU_ARCH@" STREQUAL "native")
  message(WARNING "this gsapp was built for CPUs like this machine's; the preset release-multi builds for others")
endif()
]])
set(CPACK_PROJECT_CONFIG_FILE ${CMAKE_BINARY_DIR}/package_options.cmake)
include(CPack)
