# SPDX-License-Identifier: Apache-2.0
# What `cmake --install` puts where. The program finds its files in ../share/gsapp and ../lib/gsapp (lib/core/program_files.h),
# so bin, lib and share stay side by side and the whole can be moved. The build tree has the same layout.

# gs_link_program_files(FOLDER): gives programs in the folders of FOLDER the files that an installed program has.
function(gs_link_program_files folder)
  file(MAKE_DIRECTORY ${folder}/share/gsapp ${folder}/lib)
  file(CREATE_LINK ${CMAKE_SOURCE_DIR}/apps/viewer/dist ${folder}/share/gsapp/viewer SYMBOLIC)
  if(NOT folder STREQUAL CMAKE_BINARY_DIR)
    file(CREATE_LINK ${CMAKE_BINARY_DIR}/lib/gsapp ${folder}/lib/gsapp SYMBOLIC)
  endif()
endfunction()
gs_link_program_files(${CMAKE_BINARY_DIR})

# The manual page and the completions come from the program's own table of commands.
set(share ${CMAKE_BINARY_DIR}/share)
set(completions bash-completion/completions/gsapp zsh/site-functions/_gsapp fish/vendor_completions.d/gsapp.fish)
foreach(folder man/man1 bash-completion/completions zsh/site-functions fish/vendor_completions.d)
  file(MAKE_DIRECTORY ${share}/${folder})
endforeach()
add_custom_command(TARGET gsapp POST_BUILD VERBATIM
  COMMAND gsapp manual > ${share}/man/man1/gsapp.1
  COMMAND gsapp completions bash > ${share}/bash-completion/completions/gsapp
  COMMAND gsapp completions zsh > ${share}/zsh/site-functions/_gsapp
  COMMAND gsapp completions fish > ${share}/fish/vendor_completions.d/gsapp.fish)

set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME program)
# Libraries in lib/gsapp are found if a package brings them (cmake/package.cmake). The older kind of path also counts for
# the libraries that these need themselves.
target_link_options(gsapp PRIVATE -Wl,--disable-new-dtags)
target_link_options(gsapp_images PRIVATE -Wl,--disable-new-dtags)
set_target_properties(gsapp PROPERTIES INSTALL_RPATH "$ORIGIN/../lib/gsapp")
set_target_properties(gsapp_images PROPERTIES INSTALL_RPATH "$ORIGIN")
install(TARGETS gsapp gsapp_images RUNTIME DESTINATION bin LIBRARY DESTINATION lib/gsapp)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/apps/viewer/dist/ DESTINATION share/gsapp/viewer OPTIONAL)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/scenes DESTINATION share/gsapp PATTERN procedural EXCLUDE) # those are compiled in
install(PROGRAMS ${CMAKE_SOURCE_DIR}/scripts/download ${CMAKE_SOURCE_DIR}/scripts/export_metric_weights.py DESTINATION share/gsapp/scripts)
install(FILES ${CMAKE_SOURCE_DIR}/scripts/datasets.txt DESTINATION share/gsapp/scripts)
install(FILES ${share}/man/man1/gsapp.1 DESTINATION share/man/man1)
foreach(file ${completions})
  get_filename_component(folder ${file} DIRECTORY)
  install(FILES ${share}/${file} DESTINATION share/${folder})
endforeach()
foreach(file README.md CHANGELOG.md CITATION.cff LICENSE cmake/copyright)
  install(FILES ${CMAKE_SOURCE_DIR}/${file} DESTINATION share/doc/gsapp)
endforeach()
install(DIRECTORY ${CMAKE_SOURCE_DIR}/docs DESTINATION share/doc/gsapp)
include(${CMAKE_SOURCE_DIR}/cmake/package.cmake)
