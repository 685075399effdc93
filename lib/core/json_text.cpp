// SPDX-License-Identifier: Apache-2.0
// The one place where the parser and the writer of JSON are instantiated.
#include "lib/core/json_text.h"

#include <fmt/format.h>

#include <set>
#include <vector>

namespace gs {
namespace {

template <class Json> std::string text_of(const Json& json, int indent) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

/// What is valid JSON but not taken. It is caught where the library's own errors are.
struct JsonFault : nlohmann::json::exception {
    explicit JsonFault(const std::string& what) : exception(0, what.c_str()) {}
};

// The library writes and copies values by recursion: a deep one would exhaust the stack. No file nests ten levels.
constexpr int kMaxDepth = 100;

/// Walks through a text before it becomes a value. It knows the library's callbacks by their names. (A filter given to
/// the parser itself would take a time that grows with the square of a list's length.)
class Walk {
  public:
    bool start_object(std::size_t) {
        keys_.emplace_back();
        return enter();
    }
    bool end_object() {
        keys_.pop_back();
        --depth_;
        return true;
    }
    bool start_array(std::size_t) { return enter(); }
    bool end_array() {
        --depth_;
        return true;
    }
    bool key(std::string& name) {
        if (keys_.back().insert(name).second) return true;
        return refuse(fmt::format("the key {} stands twice in one object", json_text(nlohmann::json(name))));
    }
    bool null() { return true; }
    bool boolean(bool) { return true; }
    bool number_integer(std::int64_t) { return true; }
    bool number_unsigned(std::uint64_t) { return true; }
    bool number_float(double, const std::string&) { return true; }
    bool string(std::string&) { return true; }
    bool binary(nlohmann::json::binary_t&) { return true; }
    bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) { return false; }

    /// What is wrong with the text although it is JSON; empty if nothing is.
    const std::string& fault() const { return fault_; }

  private:
    bool enter() {
        return ++depth_ <= kMaxDepth || refuse(fmt::format("it is nested deeper than {} levels", kMaxDepth));
    }
    bool refuse(std::string fault) {
        fault_ = std::move(fault);
        return false;
    }

    int depth_ = 0;
    std::vector<std::set<std::string>> keys_;  ///< of the objects that are open
    std::string fault_;
};

template <class Json> Json parsed(const std::string& text, bool comments) {
    Walk walk;
    // What is no JSON is left to the parser below, which says where.
    nlohmann::json::sax_parse(text, &walk, nlohmann::json::input_format_t::json, true, comments);
    if (!walk.fault().empty()) throw JsonFault(walk.fault());
    return Json::parse(text, nullptr, true, comments);
}

template <class Json> Json parsed_or_discarded(const std::string& text) {
    try {
        return parsed<Json>(text, false);
    } catch (const nlohmann::json::exception&) {
        return Json(Json::value_t::discarded);
    }
}

}  // namespace

std::string json_text(const nlohmann::json& json, int indent) { return text_of(json, indent); }
std::string json_text(const nlohmann::ordered_json& json, int indent) { return text_of(json, indent); }

nlohmann::json parse_json(const std::string& text, bool comments) { return parsed<nlohmann::json>(text, comments); }

nlohmann::json try_parse_json(const std::string& text) { return parsed_or_discarded<nlohmann::json>(text); }
nlohmann::ordered_json try_parse_ordered_json(const std::string& text) {
    return parsed_or_discarded<nlohmann::ordered_json>(text);
}

}  // namespace gs
