// SPDX-License-Identifier: Apache-2.0
// The weights of learned metrics, as written by scripts/export_metric_weights.py, and the convolutional parts of VGG16
// and AlexNet, divided into five stages whose outputs these metrics compare.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "kernels/tensors/tensor_engine.h"
#include "lib/io/image.h"
#include "lib/io/safetensors.h"

namespace gs {

/// A file of float tensors with known names and shapes.
class MetricWeights {
  public:
    /// Opens the file. Throws DataError naming it if it cannot be read.
    explicit MetricWeights(const std::filesystem::path& path) : path_(path), file_(path) {}

    /// Returns the values of a tensor, row-major. Throws DataError naming file and tensor if the tensor is missing, has
    /// another shape or type, or contains a value that is not finite.
    std::vector<float> read(const std::string& name, const std::vector<std::int64_t>& shape) const;

    /// Loads `name`.weight and `name`.bias into `engine` for `layer`, whose sizes must be set. Throws as read() does.
    ConvLayer read_layer(const TensorEngine& engine, const std::string& name, ConvLayer layer) const;

  private:
    std::filesystem::path path_;
    SafetensorsFile file_;
};

/// The pooling that shrinks feature maps between stages.
enum class Pooling {
    kMax2,  ///< maximum of 2x2, stride 2
    kMax3,  ///< maximum of 3x3, stride 2
    kL2     ///< TensorEngine::l2_pool
};

/// Convolutions, each followed by a ReLU; preceded by pooling if `pools`.
struct NetStage {
    bool pools = false;
    std::vector<ConvLayer> layers;

    int channels() const { return layers.back().out; }
    Tensor run(const TensorEngine& engine, Tensor in, Pooling pooling) const;
};

/// The stages of one net, with weights on the engine.
struct FeatureNet {
    std::shared_ptr<const TensorEngine> engine;  ///< holds the weights
    std::vector<NetStage> stages;
};

/// Loads VGG16. Its stages end with relu1_2, relu2_2, relu3_3, relu4_3, relu5_3 (64, 128, 256, 512, 512 channels); the
/// pooling between them depends on the metric. The file (59 MB) contains features.N.{weight,bias} in torchvision's
/// numbering. An image of 800x800 pixels takes 196 billion multiply-adds. Throws DataError as MetricWeights does.
/// Source: Simonyan and Zisserman 2015, configuration D.
std::shared_ptr<const FeatureNet> load_vgg16(std::shared_ptr<const TensorEngine> engine,
                                             const std::filesystem::path& file);

/// Loads AlexNet. Its stages end with the five ReLUs (64, 192, 384, 256, 256 channels); its pooling is kMax3. File
/// format and errors are those of load_vgg16. Source: Krizhevsky 2014, "One weird trick for parallelizing convolutional
/// neural networks", in torchvision's layout.
std::shared_ptr<const FeatureNet> load_alexnet(std::shared_ptr<const TensorEngine> engine,
                                               const std::filesystem::path& file);

/// Returns (value - offset) / scale of an image as a tensor (3,H,W), with one offset and scale per channel. Throws
/// UsageError unless the image has 3 channels.
Tensor normalized_input(const TensorEngine& engine, const Image& image, const std::array<double, 3>& offset,
                        const std::array<double, 3>& scale);

/// Throws UsageError unless both images have the same size, with at least `min_side` pixels in each direction.
void require_net_size(const Image& a, const Image& b, int min_side);

}  // namespace gs
