// SPDX-License-Identifier: Apache-2.0
// Arithmetic in text, so that one description of a model's file layout serves the program and the viewer
// (packing_description.h).
#pragma once

#include <map>
#include <string>

namespace gs {

/// Evaluates an expression of whole numbers from 0 upwards, names of `values`, parentheses and, from the loosest to the
/// tightest,
/// `? :`, `||`, `&&`, `== != < <= > >=`, `+ -`, `* / %`, `!`. Comparisons give 0 or 1; `/` rounds down. Both sides of
/// `||`, `&&` and `:` are evaluated. Numbers are doubles, as in the viewer (apps/viewer/src/format/expression.ts, the
/// same grammar). Throws DataError.
double evaluate_expression(const std::string& text, const std::map<std::string, double>& values);

}  // namespace gs
