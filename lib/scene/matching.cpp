// SPDX-License-Identifier: Apache-2.0
// Chooses among colmap's matchers.
#include "lib/scene/matching.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <string_view>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/scene/panorama.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFewPhotographs = 300;  // gives 45,000 pairs, which take minutes to an hour
constexpr int kNeighbours = 10;               // colmap's own overlap of sequences
constexpr std::string_view kDigits = "0123456789";

/// A name split at its last number.
struct NumberedName {
    std::string before, digits, after;
};

NumberedName take_apart(const std::string& name) {
    const std::size_t last = name.find_last_of(kDigits);
    if (last == std::string::npos) return {name, "", ""};
    const std::size_t before = name.find_last_not_of(kDigits, last);
    const std::size_t first = before == std::string::npos ? 0 : before + 1;
    return {name.substr(0, first), name.substr(first, last + 1 - first), name.substr(last + 1)};
}

/// Returns whether this colmap reads vocabulary trees of colmap 3.12 and later; earlier versions have another format.
bool reads_faiss(ColmapProgram& colmap) {
    return colmap.help("vocab_tree_matcher").find("faiss") != std::string::npos ||
           colmap.option("vocab_tree_matcher", "use_gpu").find("Feature") != std::string::npos;
}

/// Returns the given vocabulary tree, or else one in the usual folders of colmap and its packages, or else an empty
/// path.
fs::path find_vocab_tree(const PrepareOptions& options, ColmapProgram& colmap) {
    if (!options.vocab_tree.empty()) {
        if (const std::string fault = input_fault(options.vocab_tree); !fault.empty())
            throw UsageError(fmt::format("--vocab-tree {}: cannot be read: {}", options.vocab_tree.string(), fault));
        return options.vocab_tree;
    }
    std::vector<fs::path> folders = {"/usr/local/share/colmap", "/usr/share/colmap"};
    if (const char* home = std::getenv("HOME")) folders.insert(folders.begin(), fs::path(home) / ".cache" / "colmap");
    const bool faiss = reads_faiss(colmap);
    for (const fs::path& folder : folders) {
        if (!folder_exists(folder)) continue;
        for (const fs::path& file : list_folder(folder)) {
            const std::string name = file.filename().string();
            const bool is_tree = name.find("vocab_tree") != std::string::npos && file.extension() == ".bin";
            if (is_tree && (name.find("faiss") != std::string::npos) == faiss) return file;
        }
    }
    return {};
}

Matching exhaustive(std::string words) { return {"exhaustive_matcher", {}, std::move(words)}; }

/// `per_photograph` is the number of colmap's images of a photograph.
Matching sequential(const fs::path& tree, ColmapProgram& colmap, int per_photograph, const std::string& why) {
    Matching matching{"sequential_matcher", {}, why + ": each is compared with its neighbours"};
    // As many photographs as otherwise; a quadratic overlap would skip faces of them.
    const auto set = [&](const char* name, int value) {
        if (const std::string option = colmap.option(matching.command, name); !option.empty())
            matching.arguments.insert(matching.arguments.end(), {option, std::to_string(value)});
    };
    if (per_photograph > 1) {
        set("overlap", kNeighbours * per_photograph);
        set("quadratic_overlap", 0);
    }
    const std::string closes = colmap.option(matching.command, "loop_detection"),
                      path = colmap.option(matching.command, "vocab_tree_path");
    if (tree.empty() || closes.empty() || path.empty()) return matching;
    matching.arguments.insert(matching.arguments.end(), {closes, "1", path, tree.string()});
    matching.words += fmt::format(", and with those that look alike ({})", tree.string());
    return matching;
}

Matching vocab_tree(const fs::path& tree, ColmapProgram& colmap) {
    Matching matching{"vocab_tree_matcher", {}, "those that look alike are compared"};
    if (tree.empty()) {
        if (!reads_faiss(colmap))
            throw UsageError(
                "--matching vocab-tree: no vocabulary tree found; --vocab-tree names its file, which is to be had at "
                "https://demuc.de/colmap");
        matching.words += " (colmap fetches its vocabulary tree)";
        return matching;
    }
    const std::string path = colmap.option(matching.command, "vocab_tree_path");
    matching.arguments = {path.empty() ? "--VocabTreeMatching.vocab_tree_path" : path, tree.string()};
    matching.words += fmt::format(" ({})", tree.string());
    return matching;
}

}  // namespace

bool numbered_in_order(const std::vector<std::string>& names) {
    for (std::size_t i = 0; i < names.size(); ++i) {
        const NumberedName name = take_apart(names[i]);
        if (name.digits.empty()) return false;
        if (i == 0) continue;
        const NumberedName before = take_apart(names[i - 1]);
        // Digit strings of equal length sort like their numbers.
        if (name.before != before.before || name.after != before.after || name.digits.size() != before.digits.size())
            return false;
    }
    return !names.empty();
}

Matching choose_matching(const PrepareOptions& options, const std::vector<std::string>& names, bool is_video,
                         ColmapProgram& colmap) {
    const std::string& asked = options.matching;
    if (asked == "exhaustive") return exhaustive("all pairs are compared");
    const fs::path tree = find_vocab_tree(options, colmap);
    const int each = options.is_panorama() ? kPanoramaFaces : 1;
    if (asked == "sequential") return sequential(tree, colmap, each, "in the order of their names");
    if (asked == "vocab-tree" || (!options.vocab_tree.empty() && !is_video)) return vocab_tree(tree, colmap);
    if (is_video) return sequential(tree, colmap, each, "frames of a video");
    if (names.size() * std::size_t(each) <= kFewPhotographs)
        return exhaustive(fmt::format("{} photographs: all pairs", names.size()));
    if (!tree.empty()) return vocab_tree(tree, colmap);
    if (numbered_in_order(names))
        return sequential(tree, colmap, each, fmt::format("{} photographs with numbered names", names.size()));
    return exhaustive(
        fmt::format("{} photographs without an order: all pairs are compared, which takes long; --vocab-tree FILE "
                    "compares those that look alike",
                    names.size()));
}

}  // namespace gs
