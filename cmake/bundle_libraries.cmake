# SPDX-License-Identifier: Apache-2.0
# Run at installation: copies the shared libraries that bin/gsapp and its module for images need into lib/gsapp, and
# their Debian packages' names, versions and licences into share/doc/gsapp/libraries. glibc and libgcc stay the system's,
# because a GPU's driver uses them as well.
set(root $ENV{DESTDIR}${CMAKE_INSTALL_PREFIX})
file(GET_RUNTIME_DEPENDENCIES EXECUTABLES ${root}/bin/gsapp MODULES ${root}/lib/gsapp/libgsapp_images.so
  RESOLVED_DEPENDENCIES_VAR libraries
  PRE_EXCLUDE_REGEXES "^ld-linux" "^lib(c|m|dl|rt|pthread|resolv|util|mvec|anl|gcc_s)\\.so")
file(MAKE_DIRECTORY ${root}/lib/gsapp ${root}/share/doc/gsapp/libraries)
set(paths "")
foreach(library ${libraries})
  get_filename_component(name ${library} NAME)
  file(REAL_PATH ${library} real)
  file(COPY_FILE ${real} ${root}/lib/gsapp/${name})
  file(RPATH_REMOVE FILE ${root}/lib/gsapp/${name}) # else the folder that it names would be searched instead
  string(REGEX REPLACE "^/usr/lib" "/lib" short ${real}) # as packages name it that are older than /lib -> /usr/lib
  list(APPEND paths ${real} ${short})
endforeach()
execute_process(COMMAND dpkg-query --search ${paths} OUTPUT_VARIABLE found ERROR_QUIET)
string(REGEX MATCHALL "[^\n]+" found "${found}")
list(LENGTH libraries count)
list(LENGTH found owned)
if(owned LESS count)
  message(FATAL_ERROR "${count} libraries are packaged, of which only ${owned} belong to a Debian package and so have a known licence")
endif()
set(packages "")
foreach(line ${found})
  string(REGEX REPLACE ": /.*" "" package "${line}")
  list(APPEND packages ${package})
endforeach()
list(REMOVE_DUPLICATES packages)
list(SORT packages)
execute_process(COMMAND dpkg-query --show --showformat "\${source:Package} \${source:Version}: \${Package} \${Version}\n" ${packages}
  OUTPUT_FILE ${root}/share/doc/gsapp/libraries/packages.txt COMMAND_ERROR_IS_FATAL ANY)
foreach(package ${packages})
  string(REGEX REPLACE ":.*" "" package ${package})
  if(EXISTS /usr/share/doc/${package}/copyright)
    file(REAL_PATH /usr/share/doc/${package}/copyright copyright)
    file(COPY_FILE ${copyright} ${root}/share/doc/gsapp/libraries/${package})
  else()
    message(FATAL_ERROR "the licence of ${package}, whose libraries are packaged, is not in /usr/share/doc")
  endif()
endforeach()
message(STATUS "${count} shared libraries in ${root}/lib/gsapp")
