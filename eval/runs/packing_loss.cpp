// SPDX-License-Identifier: Apache-2.0
// Scores the test views of the model and of its packed form.
#include "eval/runs/packing_loss.h"

#include "eval/runs/evaluate.h"
#include "lib/export/pack_ppisp.h"
#include "lib/export/packed_model.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"

namespace gs {

double packed_psnr(SavedRun& run, const PackedScene& scene) {
    const std::vector<View>& views = run.scene.test;
    EvalOptions options;
    options.correction = run.correction;
    Gaussians model = packed_geometry(scene);
    model.ppisp = run.backend->download_ppisp();
    const auto backend = make_backend(run.options.device, model.appearance, backend_options(run.options));
    double psnr = 0;
    for (const View& view : views) {
        set_packed_colors(scene, camera_params<double>(view.camera).position, model);
        backend->upload(model);
        psnr += evaluate_views(*backend, {view}, run.background, options).psnr / double(views.size());
    }
    return psnr;
}

PackingLoss packing_loss(SavedRun& run, const PackedScene& scene) {
    EvalOptions options;
    options.correction = run.correction;
    return {.psnr = evaluate_views(*run.backend, run.scene.test, run.background, options).psnr,
            .packed_psnr = packed_psnr(run, scene)};
}

PackedPpisp packed_correction(SavedRun& run, const std::vector<View>& views) {
    const PpispState state = run.backend->download_ppisp();
    PackedPpisp packed = pack_ppisp(state);
    for (const View& view : views) {
        RenderRequest request;
        request.camera = camera_params(view.camera);
        request.background = run.background;
        RenderedImage image;
        run.backend->render(request, image);
        packed.views.push_back(packed_frame(state, view_isp(view, run.correction), image));
    }
    return packed;
}

}  // namespace gs
