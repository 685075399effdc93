// SPDX-License-Identifier: Apache-2.0
// Writes and cleans up the folder of an exported site.
#include "lib/export/site.h"

#include <fmt/format.h>

#include <algorithm>
#include <regex>
#include <set>

#include "kernels/base/error.h"
#include "lib/core/program_files.h"
#include "lib/io/atomic_file.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

std::vector<fs::path> files_of(const fs::path& folder) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        if (entry.is_regular_file() && !entry.is_symlink()) files.push_back(entry.path().lexically_relative(folder));
    }
    return files;
}

/// Returns a file name without its hash (eight characters after a hyphen), or an empty string if it has none. A hash is
/// not all lower case, but a word is.
std::string unversioned(const fs::path& name) {
    constexpr std::size_t kHash = 8;
    const std::string stem = name.stem().string();
    if (stem.size() <= kHash + 1 || stem[stem.size() - kHash - 1] != '-') return {};
    const auto is_lower = [](char c) { return c >= 'a' && c <= 'z'; };
    if (std::all_of(stem.end() - kHash, stem.end(), is_lower)) return {};
    return stem.substr(0, stem.size() - kHash) + name.extension().string();
}

template <class Action> void on_disk(Action&& action) {
    try {
        action();
    } catch (const fs::filesystem_error& e) {
        const fs::path& path = e.path2().empty() ? e.path1() : e.path2();  // the target of a rename
        throw DataError(fmt::format("cannot write '{}': {}", path.string(), e.code().message()));
    }
}

}  // namespace

Staging::Staging(const fs::path& target)
    : target_(target.has_filename() ? target : target.parent_path()), work_(target_) {}

std::vector<fs::path> Staging::files() const {
    std::vector<fs::path> files;
    on_disk([&] { files = files_of(path()); });
    return files;
}

void Staging::publish() {
    on_disk([&] {
        std::vector<fs::path> files = files_of(path());
        // The page comes last: until then the earlier page's files still exist.
        std::stable_partition(files.begin(), files.end(), [](const fs::path& file) { return file != "index.html"; });
        std::set<fs::path> folders;
        for (const fs::path& file : files) {
            const fs::path to = target_ / file;
            create_folders(to.parent_path(), to);
            fs::rename(path() / file, to);
            folders.insert(to.parent_path());
        }
        for (const fs::path& folder : folders) sync_folder(folder, folder);
    });
}

void require_free(const fs::path& folder, const std::vector<std::string>& names, bool overwrite) {
    std::error_code ignored;
    if (fs::exists(folder, ignored) && !fs::is_directory(folder, ignored))
        throw UsageError(fmt::format("'{}' is a file; give a folder with -o", folder.string()));
    if (overwrite) return;
    for (const std::string& name : names) {
        if (fs::exists(folder / name, ignored))
            throw UsageError(fmt::format("'{}' exists; --overwrite replaces it", (folder / name).string()));
    }
}

std::string site_file::level(std::size_t k) { return fmt::format("scene-level-{}.ngsplat", k); }

std::string site_file::photograph(std::size_t index) { return fmt::format("{}/{:05}.png", kPhotographs, index); }

void remove_earlier_site(const fs::path& folder, const std::vector<fs::path>& written) {
    on_disk([&] {
        const auto remove = [&](const fs::path& name) {
            const fs::path path = folder / name;
            if (std::find(written.begin(), written.end(), name) == written.end() && fs::is_regular_file(path))
                fs::remove(path);
        };
        remove(site_file::kDescription);  // first, because it names the other files
        remove(site_file::kSecondScene);
        remove(site_file::kPreview);
        for (std::size_t k = 1; fs::exists(folder / site_file::level(k)); ++k) remove(site_file::level(k));
        const fs::path photographs = folder / site_file::kPhotographs;
        if (!fs::is_directory(photographs)) return;
        static const std::regex ours("[0-9]{5,}\\.png");
        for (const fs::path& file : files_of(photographs)) {
            if (std::regex_match(file.string(), ours)) remove(site_file::kPhotographs / file);
        }
        if (fs::is_empty(photographs)) fs::remove(photographs);
    });
}

fs::path viewer_folder() { return shared_file("viewer/index.html").parent_path(); }

void copy_folder(const fs::path& from, const fs::path& to) {
    on_disk([&] {
        for (const fs::path& file : files_of(from)) copy_file_atomic(from / file, to / file);
    });
}

void remove_other_versions(const fs::path& viewer, const fs::path& folder) {
    on_disk([&] {
        for (const fs::path& file : files_of(viewer)) {
            const std::string name = unversioned(file.filename());
            if (name.empty()) continue;
            for (const auto& entry : fs::directory_iterator(folder / file.parent_path())) {
                const fs::path other = entry.path().filename();
                if (unversioned(other) == name && entry.is_regular_file() && !entry.is_symlink() &&
                    !fs::exists(viewer / file.parent_path() / other))
                    fs::remove(entry.path());
            }
        }
    });
}

}  // namespace gs
