// SPDX-License-Identifier: Apache-2.0
// Reads the procedural scenes' YAML strictly.
#include "lib/scene/procedural_yaml.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "kernels/base/error.h"
#include "lib/core/nearest.h"

namespace gs::procedural {
namespace {

template <class T> void check_range(T value, T low, T high, const std::string& where) {
    if (!(value >= low && value <= high))
        throw UsageError(fmt::format("{}: {} is outside [{}, {}]", where, value, low, high));
}

}  // namespace

YamlSection::YamlSection(const YAML::Node& node, std::string where, const std::vector<std::string>& known)
    : node_(node), where_(std::move(where)) {
    if (!node.IsMap()) throw UsageError(fmt::format("{}: expected a mapping (key: value)", where_));
    std::set<std::string> keys;
    for (const auto& entry : node) {
        const std::string key = entry.first.Scalar();
        if (!keys.insert(key).second) throw UsageError(fmt::format("{}: key '{}' stands twice", where_, key));
        if (std::find(known.begin(), known.end(), key) == known.end())
            throw UsageError(fmt::format("{}: unknown key '{}'{}", where_, key, did_you_mean(key, known)));
    }
}

template <class T> T YamlSection::convert(const YAML::Node& node, const std::string& key, const char* expected) const {
    try {
        return node.as<T>();
    } catch (const YAML::Exception&) {
        throw UsageError(fmt::format("{}: expected {}, found '{}'", where(key), expected, YAML::Dump(node)));
    }
}

std::vector<YAML::Node> YamlSection::items(const std::string& key) const {
    if (!has(key)) return {};
    if (!node_[key].IsSequence()) throw UsageError(fmt::format("{}: expected a list", where(key)));
    return {node_[key].begin(), node_[key].end()};
}

void YamlSection::read(const std::string& key, std::string& out) const {
    if (has(key)) out = convert<std::string>(node_[key], key, "text");
}

void YamlSection::read(const std::string& key, bool& out) const {
    if (has(key)) out = convert<bool>(node_[key], key, "true or false");
}

void YamlSection::read(const std::string& key, double& out, double low, double high) const {
    if (!has(key)) return;
    out = convert<double>(node_[key], key, "a number");
    check_range(out, low, high, where(key));
}

void YamlSection::read(const std::string& key, int& out, int low, int high) const {
    if (!has(key)) return;
    out = convert<int>(node_[key], key, "an integer");
    check_range(out, low, high, where(key));
}

void YamlSection::read(const std::string& key, Eigen::Vector3d& out, double low, double high) const {
    if (!has(key)) return;
    const auto values = convert<std::vector<double>>(node_[key], key, "a list of three numbers");
    if (values.size() != 3)
        throw UsageError(fmt::format("{}: expected three numbers, found {}", where(key), values.size()));
    for (int k = 0; k < 3; ++k) {
        check_range(values[k], low, high, where(key));
        out[k] = values[k];
    }
}

}  // namespace gs::procedural
