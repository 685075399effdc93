// SPDX-License-Identifier: Apache-2.0
// Selects the engine of a model from the generated lists.
#include <utility>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/cuda/cuda_device.h"
#include "kernels/engine.h"
#include "kernels/reference_image.h"
#include "kernels/tensors/tensor_engine.h"

#include "engines.inc"

namespace gs {

namespace {

/// Returns the list entry for the model. Throws UsageError if there is none.
template <class List> auto of_model(const List& list, const AppearanceSpec& appearance) {
    const ModelInfo& info = appearance_model(appearance.model);  // throws for an unknown name
    for (const auto& [name, entry] : list)
        if (info.name == name) return entry;
    throw UsageError("this build cannot run appearance model '" + appearance.model + "' on this device");
}

}  // namespace

std::unique_ptr<Engine> make_cpu_engine(const AppearanceSpec& appearance, const EngineOptions& options) {
    return of_model(kCpuEngines, appearance)(options);
}

std::vector<double> render_in_double(const Gaussians& model, const RenderRequest& request) {
    return of_model(kReferences, model.appearance)(model, request);
}

std::string cuda_architectures() { return GSAPP_CUDA_ARCHITECTURES; }

#ifdef GSAPP_WITH_CUDA
std::unique_ptr<Engine> make_cuda_engine(const AppearanceSpec& appearance, const EngineOptions& options) {
    if (!cuda_available()) throw DeviceError("no CUDA device: " + cuda_unavailable_reason() + "; use --device cpu");
    return of_model(kCudaEngines, appearance)(options);
}
#else
bool cuda_available() { return false; }
int cuda_device_count() { return 0; }
std::string try_cuda_device() { return cuda_unavailable_reason(); }
void use_cuda_device(int) { throw DeviceError("no CUDA device: " + cuda_unavailable_reason()); }
std::string cuda_device_id() { return ""; }
std::string cuda_driver_description() { throw DeviceError(cuda_unavailable_reason()); }
Ceilings cuda_ceilings() { throw DeviceError(cuda_unavailable_reason()); }
std::string cuda_unavailable_reason() { return "this gsapp was built without CUDA"; }
std::unique_ptr<TensorEngine> make_cuda_tensor_engine() {
    throw DeviceError(cuda_unavailable_reason() + "; use --device cpu");
}
std::unique_ptr<Engine> make_cuda_engine(const AppearanceSpec&, const EngineOptions&) {
    throw DeviceError(cuda_unavailable_reason() + "; use --device cpu");
}
#endif

}  // namespace gs
