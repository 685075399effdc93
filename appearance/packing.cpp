// SPDX-License-Identifier: Apache-2.0
// Reads the descriptions of packings, and implements checks, activations and range choices shared by the packings of
// all models.
#include "appearance/packing.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string_view>

#include "appearance/model_info.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

/// The binary operators, from loosest to tightest binding. If one operator is a prefix of another, the longer one comes
/// first.
const std::vector<std::vector<std::string_view>> kOperators = {
    {"||"}, {"&&"}, {"==", "!=", "<=", ">=", "<", ">"}, {"+", "-"}, {"*", "/", "%"}};

double apply(std::string_view op, double a, double b) {
    if (op == "||") return a != 0 || b != 0;
    if (op == "&&") return a != 0 && b != 0;
    if (op == "==") return a == b;
    if (op == "!=") return a != b;
    if (op == "<=") return a <= b;
    if (op == ">=") return a >= b;
    if (op == "<") return a < b;
    if (op == ">") return a > b;
    if (op == "+") return a + b;
    if (op == "-") return a - b;
    if (op == "*") return a * b;
    if (op == "/") return std::floor(a / b);
    return a - b * std::floor(a / b);  // %
}

class Parser {
  public:
    Parser(std::string_view text, const std::map<std::string, double>& values) : text_(text), values_(values) {}

    double whole() {
        const double value = choice();
        if (skip_space() < text_.size()) fail();
        return value;
    }

  private:
    [[noreturn]] void fail() const {
        throw DataError("the expression '" + std::string(text_) + "' cannot be understood at character " +
                        std::to_string(at_ + 1));
    }

    std::size_t skip_space() {
        while (at_ < text_.size() && text_[at_] == ' ') ++at_;
        return at_;
    }

    bool take(std::string_view word) {
        skip_space();
        if (!text_.substr(at_).starts_with(word)) return false;
        at_ += word.size();
        return true;
    }

    double choice() {
        const double condition = binary(0);
        if (!take("?")) return condition;
        const double yes = choice();
        if (!take(":")) fail();
        const double no = choice();
        return condition != 0 ? yes : no;
    }

    double binary(std::size_t level) {
        if (level == kOperators.size()) return unary();
        double value = binary(level + 1);
        for (;;) {
            std::string_view found;
            for (const std::string_view op : kOperators[level]) {
                if (found.empty() && take(op)) found = op;
            }
            if (found.empty()) return value;
            value = apply(found, value, binary(level + 1));
        }
    }

    double unary() {
        if (take("!")) return unary() == 0;
        if (take("(")) {
            const double value = choice();
            if (!take(")")) fail();
            return value;
        }
        std::size_t end = skip_space();
        while (end < text_.size() && (std::isalnum(static_cast<unsigned char>(text_[end])) || text_[end] == '_')) ++end;
        const std::string word(text_.substr(at_, end - at_));
        if (word.empty()) fail();
        if (std::isdigit(static_cast<unsigned char>(word[0]))) {
            if (word.find_first_not_of("0123456789") != std::string::npos || word.size() > 15) fail();
            at_ = end;
            return std::stod(word);
        }
        const auto value = values_.find(word);
        if (value == values_.end()) fail();
        at_ = end;
        return value->second;
    }

    std::string_view text_;
    const std::map<std::string, double>& values_;
    std::size_t at_ = 0;
};

/// The largest model number that fits into its bits in the file.
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

constexpr std::int64_t kLargest = 10000, kOthers = 10000;

constexpr double kMaxTextures = 16, kMaxWeights = 1 << 24;

/// Returns the header's fields by their names in docs/formats.md, and the values that the description adds.
std::map<std::string, double> header_values(const PackingDescription& description, const PackedHeader& header) {
    std::map<std::string, double> values = {{"featureDim", header.features},
                                            {"nFrequencies", header.frequencies},
                                            {"shBandMask", header.bands},
                                            {"nNeurons", header.neurons},
                                            {"nHiddenLayers", header.hidden_layers},
                                            {"constantInput", header.constant_input},
                                            {"folded", header.folded}};
    for (const auto& [name, expression] : description.values) values[name] = evaluate_expression(expression, values);
    return values;
}

}  // namespace

double evaluate_expression(const std::string& text, const std::map<std::string, double>& values) {
    return Parser(text, values).whole();
}

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

std::vector<SampledRow> sample_rows(const GroupArrays<float>& group, int first, int count) {
    const std::int64_t n = std::int64_t(group.param.size()) / group.width;
    std::vector<float> key(static_cast<std::size_t>(n));
    for (std::int64_t i = 0; i < n; ++i) {
        const float* row = group.param.data() + i * group.width + first;
        for (int k = 0; k < count; ++k) key[std::size_t(i)] = std::max(key[std::size_t(i)], std::abs(row[k]));
    }
    std::vector<std::int64_t> rows(static_cast<std::size_t>(n));
    std::iota(rows.begin(), rows.end(), 0);
    const auto larger = [&](std::int64_t a, std::int64_t b) {
        const float x = key[std::size_t(a)], y = key[std::size_t(b)];
        return x != y ? x > y : a < b;
    };
    const auto middle = rows.begin() + std::min(n, kLargest);
    std::nth_element(rows.begin(), middle, rows.end(), larger);
    std::sort(middle, rows.end());
    std::vector<SampledRow> sample;
    for (auto row = rows.begin(); row != middle; ++row) sample.push_back({*row, 1});
    const std::int64_t rest = rows.end() - middle, others = std::min(rest, kOthers);
    for (std::int64_t k = 0; k < others; ++k)
        sample.push_back({middle[k * rest / others], double(rest) / double(others)});
    return sample;
}

std::vector<float> possible_ends(const std::vector<float>& values) {
    std::vector<float> ends = {values.front()};
    for (std::size_t outside = 1; outside < values.size() / 4; outside *= 2) ends.push_back(values[outside]);
    return ends;
}

PackedLayout packed_layout(const PackedHeader& header) {
    const PackingDescription& description = packing_description(header.model);
    const auto values = header_values(description, header);
    for (const auto& [field, condition, expected] : description.require) {
        if (evaluate_expression(condition, values) == 0)
            throw DataError(field + " is " + std::to_string(std::uint32_t(values.at(field))) + ", expected " +
                            expected);
    }
    PackedLayout layout;
    const auto size = [&](const std::string& expression, double largest) {
        const double value = evaluate_expression(expression, values);
        if (!(value >= 0 && value <= largest && value == std::floor(value)))
            throw DataError("the header asks for " + std::to_string(value) + " as '" + expression +
                            "', which is not a whole number up to " + std::to_string(std::int64_t(largest)));
        return std::int64_t(value);
    };
    const auto add = [&](std::int64_t count, int words) {
        layout.texture_words.insert(layout.texture_words.end(), std::size_t(count), words);
    };
    for (const auto& [words, count] : description.textures) add(size(count, kMaxTextures), words);
    add((size(description.halves, kMaxHalves) + kHalvesPerTexel - 1) / kHalvesPerTexel, 4);
    layout.weight_halves = size(description.weight_halves, kMaxWeights);
    return layout;
}

PackedAppearance make_packed(const PackedHeader& header, const Gaussians& gaussians) {
    const PackedLayout layout = packed_layout(header);
    // Without textures no residuals are stored, even if the model has some.
    const std::int64_t rows = layout.texture_words.empty() ? 0 : gaussians.num_rows(Group::kResidual);
    PackedAppearance packed{header, std::vector<std::uint16_t>(std::size_t(layout.weight_halves)), rows, {}};
    for (const int words : layout.texture_words) packed.textures.emplace_back(std::size_t(rows * words));
    return packed;
}

Vec3<double> packed_residual(const Packing& packing, const PackedAppearance& packed, std::int64_t row,
                             const Vec3<double>& direction) {
    return row < packed.rows ? packing.residual(packed, row, direction) : Vec3<double>{0, 0, 0};
}

Vec3<double> packed_activation(PackedResidualActivation kind, const Vec3<double>& x) {
    const auto each = [&](double v) {
        switch (kind) {
            case PackedResidualActivation::kNone:
                return v;
            case PackedResidualActivation::kTanh:
                return gs_tanh(v);
            case PackedResidualActivation::kSoftplus:
                return softplus(10 * v) / 10;
        }
        return v;
    };
    return {each(x.x), each(x.y), each(x.z)};
}

const Packing& packing_of(std::uint32_t model) {
    for (const ModelInfo* info : appearance_models()) {
        if (info->packing && info->packing->description->id == model) return *info->packing;
    }
    throw DataError("no appearance model of this program has the number " + std::to_string(model));
}

}  // namespace gs
