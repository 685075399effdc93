// SPDX-License-Identifier: Apache-2.0
#include "appearance/packing_description.h"

#include <nlohmann/json.hpp>

#include "kernels/base/error.h"

namespace gs {
namespace {

/// The largest number of a model that fits into the file's bits for it.
constexpr std::uint32_t kLargestId = 7;

PackingDescription description_of(const nlohmann::ordered_json& json) {
    PackingDescription d;
    d.id = json.at("id");
    d.name = json.at("name");
    if (d.id > kLargestId)
        throw DataError("'" + d.name + "' has the number " + std::to_string(d.id) + ", the file has room for 0 to 7");
    if (json.contains("floats")) d.floats_name = json["floats"].at("name"), d.num_floats = json["floats"].at("count");
    if (json.contains("values")) {
        for (const auto& [name, expression] : json["values"].items()) d.values.emplace_back(name, expression);
    }
    if (json.contains("require")) {
        for (const auto& r : json["require"]) d.require.push_back({r.at("field"), r.at("is"), r.at("expected")});
    }
    if (json.contains("textures")) {
        for (const auto& t : json["textures"]) d.textures.push_back({t.at("words"), t.at("count")});
    }
    d.halves = json.value("halves", d.halves);
    d.weight_halves = json.value("weightHalves", d.weight_halves);
    return d;
}

}  // namespace

std::vector<PackingDescription> parse_packings(const std::string& file, const std::string& text) {
    try {
        const auto json = nlohmann::ordered_json::parse(text);
        std::vector<PackingDescription> all;
        if (!json.is_array()) return {description_of(json)};
        for (const auto& one : json) all.push_back(description_of(one));
        return all;
    } catch (const nlohmann::json::exception& e) {
        throw DataError(file + ": " + e.what());
    } catch (const DataError& e) {
        throw DataError(file + ": " + e.what());
    }
}

const std::vector<PackingDescription>& packing_descriptions() {
    static const std::vector<PackingDescription> descriptions = [] {
        std::vector<PackingDescription> all;
        for (const auto& [file, text] : packing_texts()) {
            for (PackingDescription& d : parse_packings(file, text)) {
                for (const PackingDescription& other : all) {
                    if (other.id == d.id)
                        throw DataError(std::string(file) + ": '" + d.name + "' and '" + other.name +
                                        "' have the same number in files");
                }
                all.push_back(std::move(d));
            }
        }
        return all;
    }();
    return descriptions;
}

const PackingDescription& packing_description(const std::string& name) {
    for (const PackingDescription& d : packing_descriptions()) {
        if (d.name == name) return d;
    }
    throw DataError("no packing.json describes '" + name + "'");
}

const PackingDescription& packing_description(std::uint32_t id) {
    for (const PackingDescription& d : packing_descriptions()) {
        if (d.id == id) return d;
    }
    throw DataError("no appearance model of this program has the number " + std::to_string(id));
}

}  // namespace gs
