# SPDX-License-Identifier: Apache-2.0
# gs_embed_text(OUT FILE HEADER NAME): writes a .cpp that defines `const char* const NAME`, declared in HEADER, as the
# text of FILE, and returns its path in OUT. So the program needs no files beside it.
function(gs_embed_text out source header name)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${source})
  file(READ ${source} text)
  get_filename_component(stem ${header} NAME_WE)
  get_filename_component(folder ${header} DIRECTORY)
  set(file ${CMAKE_BINARY_DIR}/generated/${folder}/${stem}_embedded.cpp)
  file(CONFIGURE OUTPUT ${file} @ONLY CONTENT [[
// SPDX-License-Identifier: Apache-2.0
// Generated from @source@.
#include "@header@"

namespace gs {

const char* const @name@ = R"text(@text@)text";

}  // namespace gs
]])
  set(${out} ${file} PARENT_SCOPE)
endfunction()
