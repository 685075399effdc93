// SPDX-License-Identifier: Apache-2.0
// The page of a site: its title, the view that it begins with, and what services show of a link to it.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "lib/io/image.h"
#include "lib/scene/scene.h"

namespace gs {

/// How a page begins.
struct StartView {
    std::string fragment;  ///< of the page's address (apps/viewer/README.md#the-address); empty: the page's own choice
    View view;             ///< the same for the renderer, upright
};

/// The views of a scene that a start view may name.
struct NamedViews {
    const std::vector<View>& shown;  ///< those of the page's list
    const Scene& scene;              ///< all photographs
    Eigen::Vector3d up, center;      ///< direction that is up, and middle of the model
};

/// Finds the view that `text` names: the name of a photograph, with or without folder and extension; the number of a
/// view in the page's list, counted from 1; or a link that the page copied, of which the part behind the # counts.
/// Empty is `first`. Throws UsageError for anything else.
StartView find_start_view(const std::string& text, const NamedViews& views, const View& first);

/// Returns a camera for a picture of this size: its middle shows what the middle of `camera` does, and all of the
/// picture is within what that sees.
Camera preview_camera(const Camera& camera, int width, int height);

/// Texts of a page that are there before its program runs.
struct PageHead {
    std::string title, description;
    bool own_title = false;  ///< whether the page shows the title in the place of the scene's name
    std::string start;       ///< StartView::fragment
    std::string preview;     ///< picture in the page's folder, of kPreviewWidth x kPreviewHeight pixels
    std::string url;         ///< the address of the folder, which some services need; empty: unknown
};

/// The size that services show beside a link.
inline constexpr int kPreviewWidth = 1200, kPreviewHeight = 630;

/// Returns the address of a folder without what may follow it: a slash, index.html. Throws UsageError for anything but
/// http and https addresses without a query.
std::string folder_url(const std::string& url);

/// Returns the HTML of the viewer's page with another head. Throws DataError if it has no title to replace.
std::string with_head(const std::string& html, const PageHead& head);

}  // namespace gs
