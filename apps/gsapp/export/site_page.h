// SPDX-License-Identifier: Apache-2.0
// The page of a site: its title, its first view, and its data for link previews.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs {

/// The first view of a page.
struct StartView {
    /// Fragment of the page's address (apps/viewer/README.md#the-address); empty: the page's own choice.
    std::string fragment;
    View view;  ///< the same view for the renderer, upright
};

/// The views of a scene that can be chosen as start view.
struct NamedViews {
    const std::vector<View>& shown;  ///< views in the page's list
    const Scene& scene;              ///< scene with all photographs
    Eigen::Vector3d up, center;      ///< up direction, and centre of the model
};

/// Finds the view named by `text`: the name of a photograph, with or without folder and extension; the number of a view
/// in the page's list, counted from 1; or a link copied from the page, of which the part after the # counts. An empty
/// text selects `first`. Throws UsageError for anything else.
StartView find_start_view(const std::string& text, const NamedViews& views, const View& first);

/// Returns a camera for an image of this size: its centre shows the same point as the centre of `camera`, and its whole
/// image lies within the image of `camera`.
Camera preview_camera(const Camera& camera, int width, int height);

/// Texts in the head of a page, present before its program runs.
struct PageHead {
    std::string title, description;
    bool own_title = false;  ///< whether the page shows the title instead of the scene's name
    std::string start;       ///< StartView::fragment
    /// Preview image in the page's folder, of kPreviewWidth x kPreviewHeight pixels.
    std::string preview;
    std::string url;  ///< address of the folder, required by some services; empty: unknown
};

/// Size of link previews on social services, px.
inline constexpr int kPreviewWidth = 1200, kPreviewHeight = 630;

/// Returns the address of a folder without a trailing slash or index.html. Throws UsageError for anything but http and
/// https addresses without a query.
std::string folder_url(const std::string& url);

/// Returns the HTML of the viewer's page with a new head. Throws DataError if it has no title to replace.
std::string with_head(const std::string& html, const PageHead& head);

}  // namespace gs
