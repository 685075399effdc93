// SPDX-License-Identifier: Apache-2.0
// Reads the splits that datasets define themselves: lists of names, and folders of images.
#include "lib/scene/split.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <sstream>
#include <string_view>

#include "lib/core/input_file.h"
#include "lib/core/utf8.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns the index of the name that an entry of a list matches, or nothing if it matches none or several.
std::optional<std::size_t> find_index(const NameIndex& index, const std::string& entry) {
    bool ambiguous = false;
    const std::optional<NameIndex::Match> match = index.find(entry, ambiguous);
    return match ? std::optional(match->index) : std::nullopt;
}

/// The frames named by one list of a transforms.json.
struct ListedFrames {
    std::string key;
    const std::optional<std::vector<std::string>>& names;
    std::set<std::size_t> frames = {};

    /// Returns the reason why the list is not used, if it names no frame.
    std::string absence() const {
        if (!names) return "there is no " + key;
        return key + (names->empty() ? " is empty" : " names no frame");
    }
};

ListedFrames frames_of_list(const TransformsFile& file, const NameIndex& index, const char* key,
                            const std::optional<std::vector<std::string>>& names, std::vector<std::string>& notes) {
    ListedFrames found{key, names};
    std::vector<std::string> unknown;
    for (const std::string& name : names.value_or(std::vector<std::string>())) {
        if (const auto frame = find_index(index, name))
            found.frames.insert(*frame);
        else
            unknown.push_back(name);
    }
    if (!unknown.empty())
        notes.push_back(fmt::format("{}: {} of {} names in {} match no frame: ignored ({})", file.path.string(),
                                    unknown.size(), names->size(), key, listed(unknown)));
    return found;
}

}  // namespace

std::vector<std::string> read_name_list(const fs::path& file) {
    std::istringstream in(read_input_text(file));
    std::vector<std::string> names;
    for (std::string line; std::getline(in, line); names.push_back(line)) {
        line.erase(line.find_last_not_of(" \t\r") + 1);
        if (line.starts_with('#')) line.clear();
    }
    return names;
}

std::vector<ViewRole> roles_of_frames(const TransformsFile& file, SourceScene& scene) {
    std::vector<std::string> names;
    for (const TransformsFrame& frame : file.frames) names.push_back(frame.file_path);
    const NameIndex index(names);
    const auto frames_of = [&](const char* key, const std::optional<std::vector<std::string>>& list) {
        return frames_of_list(file, index, key, list, scene.notes);
    };
    const ListedFrames train = frames_of("train_filenames", file.train_filenames),
                       val = frames_of("val_filenames", file.val_filenames),
                       test = frames_of("test_filenames", file.test_filenames);
    const std::string where = file.path.filename().string();
    const bool has_test = !test.frames.empty() || !file.test_frames.empty();
    if (!file.test_frames.empty())
        scene.given_split = "test_frames of " + where;
    else if (has_test)
        scene.given_split = "test_filenames of " + where;
    else if (!val.frames.empty())
        scene.given_split = fmt::format("val_filenames of {}, because {}", where, test.absence());

    std::vector<ViewRole> roles(names.size(), ViewRole::kTrain);
    std::size_t held_out = 0, unlisted = 0, twice = 0;
    for (std::size_t i = 0; i < roles.size(); ++i) {
        const bool in_test = test.frames.contains(i) || (!has_test && val.frames.contains(i)),
                   in_val = !in_test && val.frames.contains(i), in_train = train.frames.contains(i);
        twice += in_train && (in_test || in_val);
        const bool in_none = !train.frames.empty() && !in_train && !in_test && !in_val;
        held_out += in_val;
        unlisted += in_none;
        if (in_test) roles[i] = ViewRole::kTest;
        if (in_val || in_none) roles[i] = ViewRole::kLeftOut;
    }
    const auto note = [&](const std::string& text) { scene.notes.push_back(file.path.string() + ": " + text); };
    if (twice > 0)
        note(fmt::format("{} frames of train_filenames are in test_filenames or val_filenames, too: held out", twice));
    if (held_out > 0) note(fmt::format("{} frames of val_filenames neither train nor test", held_out));
    if (unlisted > 0) note(fmt::format("{} frames are in no list: they neither train nor test", unlisted));
    return roles;
}

void leave_out_bad(const std::vector<TransformsFrame>& frames, const std::string& where, std::vector<ViewRole>& roles,
                   std::vector<std::string>& notes) {
    std::vector<std::string> bad;
    for (std::size_t i = 0; i < frames.size(); ++i) {
        if (!frames[i].is_bad) continue;
        bad.push_back(frames[i].file_path);
        roles[i] = ViewRole::kLeftOut;
    }
    if (!bad.empty())
        notes.push_back(fmt::format("{}: {} are marked is_bad: left out ({})", where, bad.size(), listed(bad)));
}

void apply_test_file(const fs::path& file, SourceScene& scene) {
    if (!scene.given_split.empty() || !path_exists(file)) return;
    std::vector<std::string> names, unknown;
    for (const SourceView& view : scene.views) names.push_back(view.name);
    const NameIndex index(names);
    std::size_t found = 0;
    for (const std::string& line : read_name_list(file)) {
        if (line.empty()) continue;
        if (const auto view = find_index(index, line)) {
            scene.views[*view].role = ViewRole::kTest;
            ++found;
        } else {
            unknown.push_back(line);
        }
    }
    if (!unknown.empty())
        scene.notes.push_back(fmt::format("{}: {} of {} lines name no image: ignored ({})", file.string(),
                                          unknown.size(), unknown.size() + found, listed(unknown)));
    if (found == 0) return;
    scene.given_split = file.filename().string() + " of the model";
    scene.test_views_train = true;
}

void apply_folder_split(SourceScene& scene) {
    if (!scene.given_split.empty()) return;
    // Uses the first folder level at which the images differ, because all names may begin with "images/".
    std::vector<fs::path> folders;
    for (const SourceView& view : scene.views) folders.push_back(fs::path(view.name).parent_path());
    std::size_t depth = 0;
    const auto at_depth = [&](const fs::path& folder) {
        auto it = folder.begin();
        for (std::size_t i = 0; i < depth && it != folder.end(); ++i) ++it;
        return it == folder.end() ? std::string() : case_folded(it->string());
    };
    std::set<std::string> found;
    for (;; ++depth) {
        found.clear();
        for (const fs::path& folder : folders) found.insert(at_depth(folder));
        if (found.size() != 1 || found.contains("")) break;
    }
    const bool has_test = found.contains("test"), has_val = found.contains("val");
    if (!found.contains("train") || found.size() != std::size_t(1 + has_test + has_val) || found.size() == 1) return;
    std::size_t held_out = 0;
    for (std::size_t i = 0; i < folders.size(); ++i) {
        const std::string name = at_depth(folders[i]);
        if (name == "train") continue;
        const bool is_test = name == "test" || !has_test;
        scene.views[i].role = is_test ? ViewRole::kTest : ViewRole::kLeftOut;
        held_out += !is_test;
    }
    scene.given_split = has_test ? "the image folders train and test" : "the image folders train and val";
    scene.test_views_train = true;
    if (held_out > 0)
        scene.notes.push_back(fmt::format("{} images of the folder val neither train nor test", held_out));
}

}  // namespace gs
