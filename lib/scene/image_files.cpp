// SPDX-License-Identifier: Apache-2.0
// Finds the image files that datasets name, even if names and extensions in the folder differ slightly.
#include "lib/scene/image_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <compare>
#include <deque>
#include <set>
#include <system_error>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/utf8.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

std::string with_slashes(std::string name) {
    std::replace(name.begin(), name.end(), '\\', '/');
    return name;
}

/// Returns whether a name with '/' is absolute: "/data/a.jpg", "C:/a.jpg", "~/a.jpg".
bool is_absolute(const std::string& name) {
    const bool drive = name.size() > 2 && std::isalpha(static_cast<unsigned char>(name[0])) && name[1] == ':';
    return name.starts_with('/') || name.starts_with("~/") || (drive && name[2] == '/');
}

/// Returns the components of a path, without ".", ".." and the root.
std::vector<std::string> parts_of(const std::string& name) {
    std::vector<std::string> parts;
    for (const fs::path& part : fs::path(name).lexically_normal())
        if (part != "." && part != ".." && part != "/" && !part.empty()) parts.push_back(part.string());
    return parts;
}

std::string without_image_extension(const std::string& name) {
    return has_image_extension(name) || is_unread_photograph(name) ? without_extension(name) : name;
}

/// The difference of a candidate from a name, compared member by member; less is better.
struct Difference {
    int parts = 0;      ///< minus the number of equal components at the end
    int folders = 0;    ///< 1 = one of the two has more folders in front
    int extension = 0;  ///< 0 = same last component, 1 = another extension, 2 = one has an additional extension
    int letters = 0;    ///< 1 = case differs
    auto operator<=>(const Difference&) const = default;
};

/// Returns the number of equal components directly before the last one.
std::size_t common_folders(const std::vector<std::string>& a, const std::vector<std::string>& b) {
    std::size_t n = 0;
    while (n + 1 < std::min(a.size(), b.size()) && a[a.size() - 2 - n] == b[b.size() - 2 - n]) ++n;
    return n;
}

/// Returns the kind of difference between two last components (Difference::extension), or nothing if the names differ.
std::optional<int> compare_last(const std::string& a, const std::string& b) {
    if (a == b) return 0;
    const std::string stem_a = without_image_extension(a), stem_b = without_image_extension(b);
    if (stem_a == stem_b) return stem_a == a || stem_b == b ? 2 : 1;
    return a == stem_b || stem_a == b ? std::optional(2) : std::nullopt;
}

bool is_sibling(const std::vector<std::string>& a, const std::vector<std::string>& b) {
    return a.size() == b.size() && common_folders(a, b) + 1 == a.size();
}

/// Counts pairs of name and file, and stores the first pair.
struct Tally {
    std::size_t count = 0;
    std::string first;
    void add(const std::string& name, const std::string& file) {
        if (count++ == 0) first = fmt::format("'{}' is {}", name, file);
    }
};

/// Returns the name of the file with exactly this name, or this name plus an image extension, with '/'. The result is
/// relative to the folder if the name was.
std::optional<std::string> exact_name(const fs::path& folder, const std::string& name, OutsideNames outside) {
    for (const std::string& spelled : {name, with_slashes(name)}) {
        const std::string normal = fs::path(spelled).lexically_normal().generic_string();
        const bool leaves = is_absolute(normal) || normal == ".." || normal.starts_with("../");
        if (normal.empty() || (leaves && outside == OutsideNames::kForeign)) continue;
        if (names_file(folder / normal)) return normal;
        for (const std::string_view extension : kImageExtensions)
            if (std::string longer = normal + std::string(extension); names_file(folder / longer)) return longer;
    }
    return {};
}

}  // namespace

namespace {

std::string folded_extension(const fs::path& path) { return case_folded(path.extension().string()); }

constexpr std::string_view kUnreadExtensions[] = {
    ".heic", ".heif", ".hif", ".avif", ".jxl", ".jp2", ".gif", ".tga", ".psd",  // phones, web, programs
    ".dng",  ".cr2",  ".cr3", ".crw",  ".nef", ".nrw", ".arw", ".srf", ".sr2",  // raw data of cameras
    ".orf",  ".rw2",  ".raf", ".pef",  ".srw", ".x3f", ".3fr", ".iiq", ".rwl", ".raw"};

bool is_litter(const fs::path& path) {
    const std::string name = path.filename().string();
    return name.starts_with('.') || name == "__MACOSX" || name == "@eaDir" || name == "#recycle" ||
           name == "$RECYCLE.BIN";
}

}  // namespace

bool has_image_extension(const fs::path& path) {
    return std::ranges::find(kImageExtensions, folded_extension(path)) != std::end(kImageExtensions);
}

bool is_unread_photograph(const fs::path& path) {
    return std::ranges::find(kUnreadExtensions, folded_extension(path)) != std::end(kUnreadExtensions);
}

bool names_file(const fs::path& path) {
    std::error_code error;
    const fs::file_type type = fs::status(path, error).type();
    return error != std::errc::filename_too_long && type != fs::file_type::not_found &&
           type != fs::file_type::directory;
}

std::vector<fs::path> entries_named(const fs::path& folder, const std::string& name) {
    std::vector<fs::path> found;
    for (const fs::path& entry : list_folder(folder))
        if (case_folded(entry.filename().string()) == case_folded(name)) found.push_back(entry);
    std::stable_partition(found.begin(), found.end(), [&](const fs::path& entry) { return entry.filename() == name; });
    return found;
}

std::string without_extension(const std::string& name) {
    const std::string extension = fs::path(name).extension().string();
    return name.substr(0, name.size() - extension.size());
}

ImageFolder::ImageFolder(const fs::path& folder) : folder_(folder) {
    if (!folder_exists(folder)) return;
    list_folder(folder);  // throws if the folder cannot be opened; unreadable sub-folders are skipped
    std::set<fs::path> listed;
    // Links come last, so that a folder is listed under its own name and not under the name of a link to it.
    std::deque<fs::path> folders{folder}, links;
    while (!folders.empty() || !links.empty()) {
        std::deque<fs::path>& queue = folders.empty() ? links : folders;
        const fs::path next = queue.front();
        queue.pop_front();
        std::error_code error;
        if (!listed.insert(fs::canonical(next, error)).second || error) continue;
        fs::directory_iterator it(next, fs::directory_options::skip_permission_denied, error);
        for (const fs::directory_iterator end; !error && it != end; it.increment(error)) {
            const fs::path& entry = it->path();
            std::error_code ignored;
            if (is_litter(entry)) continue;
            if (it->is_directory(ignored))
                (it->is_symlink(ignored) ? links : folders).push_back(entry);
            else if (has_image_extension(entry) || is_unread_photograph(entry))
                (has_image_extension(entry) ? names_ : unread_)
                    .push_back(entry.lexically_relative(folder).generic_string());
        }
        if (error) throw DataError(fmt::format("{}: cannot be listed: {}", next.string(), error.message()));
    }
    std::ranges::sort(names_);
    std::ranges::sort(unread_);
}

void ImageFolder::tell_unread(std::vector<std::string>& notes, std::vector<std::string>& facts) const {
    if (unread_.empty()) return;
    std::set<std::string> stems;
    for (const std::string& name : names_) stems.insert(without_extension(name));
    const auto alone = std::ranges::find_if(
        unread_, [&](const std::string& name) { return !stems.contains(without_extension(name)); });
    const std::string line =
        fmt::format("{}: {} photographs are in formats that are not read: passed over (first: {})", folder_.string(),
                    unread_.size(), alone == unread_.end() ? unread_[0] : *alone);
    if (alone == unread_.end())
        facts.push_back(line + ", because each has a file beside it that is read");
    else
        notes.push_back(fmt::format("{}; {}", line, kConvertPhotographs));
}

void require_image_folder(const fs::path& scene, const std::string& images) {
    if (folder_exists(scene / images)) return;
    std::vector<std::string> others;
    for (const fs::path& folder : list_folder(scene.empty() ? "." : scene))
        if (folder_exists(folder) && !ImageFolder(folder).names().empty()) others.push_back(folder.filename().string());
    throw DataError(fmt::format("{}: image folder '{}' does not exist; {} (choose another with --images)",
                                scene.string(), images,
                                others.empty() ? "no folder here holds images"
                                               : fmt::format("folders with images are {}", fmt::join(others, ", "))));
}

NameIndex::Entry NameIndex::entry(std::size_t index, std::string text, const std::string& encoding) {
    Entry entry{index, encoding, parts_of(with_slashes(std::move(text))), {}};
    for (std::string& part : entry.parts) {
        part = composed(part);
        entry.folded.push_back(case_folded(part));
    }
    return entry;
}

NameIndex::NameIndex(const std::vector<std::string>& names) {
    const auto add = [&](Entry entry) {
        if (entry.parts.empty()) return;
        const std::string &last = entry.folded.back(), stem = without_image_extension(last);
        by_last_part_.emplace(last, entries_.size());
        if (stem != last) by_last_part_.emplace(stem, entries_.size());
        entries_.push_back(std::move(entry));
    };
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (!by_name_.emplace(names[i], i).second) continue;
        add(entry(i, names[i], ""));
        for (Reading& reading : readings(names[i])) add(entry(i, std::move(reading.text), reading.encoding));
    }
}

std::optional<NameIndex::Match> NameIndex::find(const std::string& name, bool& ambiguous) const {
    ambiguous = false;
    if (const auto exact = by_name_.find(name); exact != by_name_.end()) return Match{exact->second, true, ""};
    std::vector<Entry> wanted{entry(0, name, "")};
    for (Reading& reading : readings(name)) wanted.push_back(entry(0, std::move(reading.text), reading.encoding));
    const bool absolute = is_absolute(with_slashes(name));
    Match match;
    for (const Entry& want : wanted) {
        if (want.parts.empty()) continue;
        std::optional<Difference> least;
        const Entry* best = nullptr;
        bool several = false;
        for (const std::string& key : std::set{want.folded.back(), without_image_extension(want.folded.back())})
            for (auto [it, end] = by_last_part_.equal_range(key); it != end; ++it) {
                const Entry& entry = entries_[it->second];
                const std::optional<int> extension = compare_last(want.folded.back(), entry.folded.back());
                const std::size_t agree = 1 + common_folders(want.folded, entry.folded);
                const bool whole = agree == want.parts.size(), all_of_it = agree == entry.parts.size();
                if (!extension || !(whole || all_of_it || absolute)) continue;
                const bool same_letters = common_folders(want.parts, entry.parts) + 1 == agree &&
                                          compare_last(want.parts.back(), entry.parts.back()) == extension;
                const Difference difference{-int(agree), whole && all_of_it ? 0 : 1, *extension, same_letters ? 0 : 1};
                if (least && (difference > *least || (difference == *least && entry.index == best->index))) continue;
                // Files that differ only in their extension are one photograph in several formats: use the first.
                if (least == difference && *extension > 0 && is_sibling(entry.folded, best->folded)) continue;
                several = least == difference;
                least = difference;
                best = &entry;
                match = {entry.index, whole && all_of_it, want.encoding.empty() ? entry.encoding : want.encoding};
            }
        ambiguous = ambiguous || several;
        if (least && !several) {
            ambiguous = false;
            return match;
        }
    }
    return {};
}

FoundImages find_images(const fs::path& folder, const std::vector<std::string>& names, OutsideNames outside) {
    FoundImages out;
    std::map<std::string, std::set<std::string>> claims;  // names of each file
    std::vector<std::size_t> missing;
    for (std::size_t i = 0; i < names.size(); ++i) {
        const std::optional<std::string> exact = exact_name(folder, names[i], outside);
        out.images.push_back({exact ? std::optional(folder / *exact) : std::nullopt, exact.value_or(names[i])});
        if (exact)
            claims[*exact].insert(names[i]);
        else
            missing.push_back(i);
    }
    std::map<std::size_t, NameIndex::Match> matches;
    // Searches the folder that usually holds the images first: other folders, such as mask folders, may hold files of
    // equal names.
    for (const char* part : {"images", ""}) {
        if (missing.empty()) break;
        const std::string prefix = *part ? std::string(part) + "/" : "";
        const ImageFolder files(*part ? folder / part : folder.empty() ? fs::path(".") : folder);
        if (files.names().empty()) continue;
        const NameIndex index(files.names());
        for (const std::size_t i : missing) {
            FoundImage& image = out.images[i];
            if (image.file || image.is_contested) continue;
            const std::optional<NameIndex::Match> match = index.find(names[i], image.is_contested);
            if (!match) continue;
            image.name = prefix + files.names()[match->index];
            image.file = folder / image.name;
            matches[i] = *match;
            bool ignored = false;
            const auto whole = NameIndex({image.name}).find(names[i], ignored);  // with the folder "images"
            matches[i].same_place = whole && whole->same_place;
            claims[image.name].insert(names[i]);
        }
    }

    Tally elsewhere, encoded, spelled;
    for (std::size_t i = 0; i < names.size(); ++i) {
        FoundImage& image = out.images[i];
        if (!image.file || fs::path(names[i]).lexically_normal() == image.name) continue;
        if (claims[image.name].size() > 1) {
            image = {std::nullopt, names[i], true};
            continue;
        }
        if (!matches.contains(i)) continue;
        const NameIndex::Match& match = matches.at(i);
        (!match.encoding.empty() ? encoded : match.same_place ? spelled : elsewhere).add(names[i], image.name);
        if (!match.encoding.empty() && encoded.count == 1) encoded.first += " in " + match.encoding;
    }
    if (elsewhere.count > 0)
        out.notes.push_back(
            fmt::format("{} images lie in another place than their names say and were found by the end "
                        "of the name (first: {})",
                        elsewhere.count, elsewhere.first));
    if (encoded.count > 0)
        out.notes.push_back(fmt::format("{} image names are in another encoding than those of their files (first: {})",
                                        encoded.count, encoded.first));
    if (spelled.count > 0)
        out.facts.push_back(fmt::format("{} image names are spelled differently from their files (first: {})",
                                        spelled.count, spelled.first));
    return out;
}

}  // namespace gs
