// SPDX-License-Identifier: Apache-2.0
// A YAML mapping that must be understood completely: values are checked as they are read, unknown keys are errors.
#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <string>
#include <vector>

namespace gs::procedural {

class YamlSection {
  public:
    /// `where` is the section's place in messages, e.g. "builtin:glossy: shapes[2]". Throws UsageError when `node` is
    /// no mapping or holds a key that is not in `known`.
    YamlSection(const YAML::Node& node, std::string where, const std::vector<std::string>& known);

    bool has(const std::string& key) const { return node_[key].IsDefined(); }
    std::string where(const std::string& key) const { return where_ + "." + key; }
    YAML::Node node(const std::string& key) const { return node_[key]; }
    /// Elements of a list; empty when the key is absent.
    std::vector<YAML::Node> items(const std::string& key) const;

    // Each leaves `out` as it is when the key is absent and throws UsageError for a wrong type or a value outside
    // [low, high].
    void read(const std::string& key, std::string& out) const;
    void read(const std::string& key, bool& out) const;
    void read(const std::string& key, double& out, double low, double high) const;
    void read(const std::string& key, int& out, int low, int high) const;
    void read(const std::string& key, Eigen::Vector3d& out, double low, double high) const;

  private:
    template <class T>
    T convert(const YAML::Node& node, const std::string& key, const char* expected) const;

    YAML::Node node_;
    std::string where_;
};

}  // namespace gs::procedural
