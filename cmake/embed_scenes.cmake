# SPDX-License-Identifier: Apache-2.0
# gs_embed_scenes(OUT): writes a .cpp with the text of scenes/procedural/*.yaml and returns its path in OUT. So the
# program needs no files beside it.
function(gs_embed_scenes out)
  file(GLOB scenes CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/scenes/procedural/*.yaml)
  list(SORT scenes)
  set(entries "")
  foreach(scene ${scenes})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${scene})
    get_filename_component(name ${scene} NAME_WE)
    file(READ ${scene} text)
    string(APPEND entries "    {\"${name}\", R\"yaml(${text})yaml\"},\n")
  endforeach()
  set(file ${CMAKE_BINARY_DIR}/generated/lib/scene/procedural_embedded.cpp)
  file(CONFIGURE OUTPUT ${file} @ONLY CONTENT [[
// SPDX-License-Identifier: Apache-2.0
// The built-in procedural scenes (generated from scenes/procedural/).
#include "lib/scene/procedural_description.h"

namespace gs::procedural {
namespace {
struct Entry {
    const char* name;
    const char* text;
};
constexpr Entry kScenes[] = {
@entries@};
}  // namespace

const char* embedded_scene(const std::string& name) {
    for (const Entry& entry : kScenes) {
        if (name == entry.name) return entry.text;
    }
    return nullptr;
}

const std::vector<std::string>& embedded_scene_names() {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> all;
        for (const Entry& entry : kScenes) all.emplace_back(entry.name);
        return all;
    }();
    return names;
}

}  // namespace gs::procedural
]])
  set(${out} ${file} PARENT_SCOPE)
endfunction()
