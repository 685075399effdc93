// SPDX-License-Identifier: Apache-2.0
// Parses YAML and rejects text that yaml-cpp would leave unread.
#include "lib/core/yaml_text.h"

#include <vector>

namespace gs {

YAML::Node parse_yaml(const std::string& text) {
    const std::vector<YAML::Node> documents = YAML::LoadAll(text);
    for (std::size_t i = 1; i < documents.size(); ++i)
        if (!documents[i].IsNull())
            throw YAML::ParserException(
                documents[i].Mark(), "the document ends before this line, which may be indented less than the first");
    return documents.empty() ? YAML::Node() : documents[0];
}

}  // namespace gs
