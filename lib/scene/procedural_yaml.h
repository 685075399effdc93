// SPDX-License-Identifier: Apache-2.0
// A YAML mapping that is read strictly: values are checked as they are read, and unknown keys are errors.
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
    /// Returns the elements of a list, none when the key is absent. Throws UsageError when the value is not a list.
    std::vector<YAML::Node> items(const std::string& key) const;

    // Each `read` leaves `out` unchanged when the key is absent. It throws UsageError for a wrong type or a value
    // outside [low, high].
    void read(const std::string& key, std::string& out) const;
    void read(const std::string& key, bool& out) const;
    void read(const std::string& key, double& out, double low, double high) const;
    void read(const std::string& key, int& out, int low, int high) const;
    void read(const std::string& key, Eigen::Vector3d& out, double low, double high) const;

  private:
    template <class T> T convert(const YAML::Node& node, const std::string& key, const char* expected) const;

    YAML::Node node_;
    std::string where_;
};

}  // namespace gs::procedural
