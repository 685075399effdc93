// SPDX-License-Identifier: Apache-2.0
// Turns a source image with its lens into a view: a pinhole camera at the training size and a function that loads the
// pixels.
#pragma once

#include "lib/scene/source_scene.h"

namespace gs {

/// Builds views one after the other and counts which of them it undistorted or resized.
class ViewBuilder {
  public:
    /// `prescaled` is the divisor by which the image folder is already scaled; above 1, options.resolution is not
    /// applied again.
    ViewBuilder(const SceneOptions& options, int prescaled) : options_(options), prescaled_(prescaled) {}

    /// Builds one view.
    View build(const SourceView& source);

    /// Returns one line each about undistortion, and about sizes that the options did not ask for.
    std::vector<std::string> notes() const;
    /// Returns a line about images that were resized as the options ask, where there are any.
    std::vector<std::string> facts() const;
    bool has_alpha() const { return has_alpha_; }

  private:
    std::pair<int, int> training_size(int width, int height);

    SceneOptions options_;
    int prescaled_;
    std::size_t undistorted_ = 0, resized_ = 0, capped_ = 0, kept_small_ = 0;
    std::string undistorted_model_, resized_example_;
    bool has_alpha_ = false;
};

}  // namespace gs
