// SPDX-License-Identifier: Apache-2.0
#include "appearance/expression.h"

#include <cctype>
#include <cmath>
#include <string_view>
#include <vector>

#include "kernels/base/error.h"

namespace gs {
namespace {

/// The binary operators by how tightly they bind. Of two where one begins the other, the longer stands first.
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

}  // namespace

double evaluate_expression(const std::string& text, const std::map<std::string, double>& values) {
    return Parser(text, values).whole();
}

}  // namespace gs
