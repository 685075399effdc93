// SPDX-License-Identifier: Apache-2.0
// Reads options from YAML files with parents, and writes resolved options.
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"
#include "lib/core/nearest.h"
#include "lib/core/options.h"
#include "lib/core/utf8.h"
#include "lib/core/version.h"
#include "lib/core/yaml_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr const char* kParentKey = "parent";

std::string place(const fs::path& file, const YAML::Node& node) {
    return node.Mark().is_null() ? file.string() : fmt::format("{}:{}", file.string(), node.Mark().line + 1);
}

YAML::Node parse_file(const fs::path& file) {
    try {
        return parse_yaml(read_input(file));
    } catch (const YAML::Exception& e) {
        throw UsageError(fmt::format("{}:{}: not valid YAML: {}", file.string(), e.mark.line + 1, e.msg));
    }
}

/// The options of earlier versions, which their runs' config.yaml files contain, and their values without effect.
constexpr std::pair<std::string_view, std::string_view> kFormerOptions[] = {
    {"hostile-start", "0"}, {"separate-appearance", "false"}, {"log-level", "info"}};

/// Returns whether `key` is a former option, which is ignored. Warns if its value had an effect.
bool is_former(const std::string& key, const YAML::Node& value, const std::string& where) {
    for (const auto& [former, nothing] : kFormerOptions) {
        if (key != former) continue;
        if (!value.IsScalar() || value.Scalar() != nothing)
            log_warning("{}: {} is an option of earlier versions, which is ignored", where, key);
        return true;
    }
    return false;
}

const Option& find_option(const std::string& key, const std::string& where) {
    const auto& table = train_option_table();
    const auto found = std::find_if(table.begin(), table.end(), [&](const Option& o) { return o.key == key; });
    if (found != table.end()) return *found;
    std::vector<std::string> keys = {kParentKey};
    for (const Option& option : table) keys.push_back(option.key);
    const std::string nearest = nearest_key(key, keys);
    throw UsageError(fmt::format("{}: unknown key '{}'{}", where, key,
                                 nearest.empty() ? "" : fmt::format("; the nearest known key is '{}'", nearest)));
}

const char* kind_of(const YAML::Node& node) {
    switch (node.Type()) {
        case YAML::NodeType::Sequence:
            return "a list";
        case YAML::NodeType::Map:
            return "a mapping";
        case YAML::NodeType::Null:
            return "empty";
        default:
            return "a single value";
    }
}

void apply_entry(TrainOptions& options, const fs::path& file, const std::string& key, const YAML::Node& key_node,
                 const YAML::Node& value) {
    const std::string where = fmt::format("{}: {}", place(file, key_node), key);
    if (is_former(key, value, place(file, key_node))) return;
    const Option& option = find_option(key, place(file, key_node));
    const bool wants_list = std::holds_alternative<std::vector<std::int64_t> TrainOptions::*>(option.field);
    std::vector<std::string> texts;
    if (wants_list && value.IsSequence()) {
        for (const YAML::Node& element : value) {
            if (!element.IsScalar())
                throw UsageError(fmt::format("{}: an element is {}, not a number", where, kind_of(element)));
            texts.push_back(element.Scalar());
        }
    } else if (value.IsScalar()) {
        texts.push_back(value.Scalar());
    } else {
        throw UsageError(fmt::format("{}: the value is {}, but {} is needed", where, kind_of(value),
                                     wants_list ? "a list" : "a single value"));
    }
    set_option(options, option, texts, where);
    try {
        check_option(option, options);
    } catch (const UsageError& e) {
        throw UsageError(fmt::format("{}: {}", place(file, key_node), e.what()));
    }
}

void apply_file(TrainOptions& options, const fs::path& file, std::vector<fs::path>& chain) {
    if (const std::string fault = input_fault(file); !fault.empty())
        throw UsageError(fmt::format("cannot read the configuration file {}: {}", file.string(), fault));
    const fs::path canonical = canonical_path(file);
    if (std::find(chain.begin(), chain.end(), canonical) != chain.end()) {
        throw UsageError(fmt::format("{}: the file is its own parent", file.string()));
    }
    chain.push_back(canonical);
    const YAML::Node root = parse_file(file);
    if (root.IsNull()) return;
    if (!root.IsMap())
        throw UsageError(fmt::format("{}: the file is {}, but a mapping of option names to values is needed",
                                     file.string(), kind_of(root)));
    if (const YAML::Node parent = root[kParentKey]) {
        if (!parent.IsScalar())
            throw UsageError(fmt::format("{}: parent: the value is {}, but a file name is needed", place(file, parent),
                                         kind_of(parent)));
        apply_file(options, file.parent_path() / parent.Scalar(), chain);
    }
    std::set<std::string> keys;
    for (const auto& entry : root) {
        if (!entry.first.IsScalar())
            throw UsageError(
                fmt::format("{}: a key is {}, not a name", place(file, entry.first), kind_of(entry.first)));
        const std::string key = entry.first.Scalar();
        if (!keys.insert(key).second)
            throw UsageError(fmt::format("{}: key '{}' stands twice", place(file, entry.first), key));
        if (key != kParentKey) apply_entry(options, file, key, entry.first, entry.second);
    }
}

/// Returns the quoted text with its bytes unchanged. yaml-cpp's emitter replaces bytes that are not UTF-8, so a file of
/// that name would not be found again; its reader preserves them.
std::string raw_scalar(const std::string& text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') out += '\\';
        if (static_cast<unsigned char>(c) < 0x20)
            out += fmt::format("\\x{:02x}", c);
        else
            out += c;
    }
    return out + '"';
}

}  // namespace

TrainOptions load_options_yaml(const fs::path& path) {
    TrainOptions options;
    std::vector<fs::path> chain;
    apply_file(options, path, chain);
    return options;
}

std::string options_to_yaml(const TrainOptions& options) {
    YAML::Emitter out;
    std::vector<std::pair<std::string, std::string>> raw;  // placeholder of a text, and the text
    out << YAML::BeginMap;
    std::string group;
    for (const Option& option : train_option_table()) {
        if (option.group != group) {
            group = option.group;
            out << YAML::Newline << YAML::Comment(group);
        }
        out << YAML::Key << option.key << YAML::Value;
        if (const auto* list = std::get_if<std::vector<std::int64_t> TrainOptions::*>(&option.field))
            out << YAML::Flow << options.**list;
        else if (const std::string text = option_text(option, options); is_utf8(text))
            out << text;
        else
            out << raw.emplace_back(fmt::format("not-utf-8-{}", option.key), raw_scalar(text)).first;
    }
    out << YAML::EndMap;
    std::string yaml = "# " + version_text() + "\n" + out.c_str() + "\n";
    for (const auto& [mark, text] : raw) yaml.replace(yaml.find(": " + mark) + 2, mark.size(), text);
    return yaml;
}

}  // namespace gs
