// SPDX-License-Identifier: Apache-2.0
// Holds the table of protocols and describes a protocol in words.
#include "eval/runs/protocol.h"

#include <fmt/format.h>

#include <algorithm>

#include "kernels/base/error.h"

namespace gs {
namespace {

constexpr Vec3<float> kBlack{0, 0, 0};

const char* short_ssim(SsimBorder border) {
    if (border == SsimBorder::kValid) return "windows inside the image";
    return border == SsimBorder::kReflect ? "mirrored borders" : "zero padding";
}

bool same(const Vec3<float>& a, const Vec3<float>& b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

std::string colour_name(const Vec3<float>& c) {
    if (same(c, kBlack)) return "black";
    return same(c, {1, 1, 1}) ? "white" : fmt::format("{:g},{:g},{:g}", c.x, c.y, c.z);
}

}  // namespace

const std::vector<Protocol>& protocols() {
    static const std::vector<Protocol> table = {
        // NeRFICG is the paper's framework. It does not pin torchmetrics, which up to 1.4.1 averages SSIM over windows
        // inside the image only.
        {"paper", "images_N as shipped, else area resize", true, SsimBorder::kValid, LpipsNet::kVgg,
         LpipsRange::kSymmetric, kBlack, ""},
        // 3DGS's metrics.py reads the PNGs of render.py and leaves LPIPS's inputs in [0,1]. The white background of
        // NeRF-synthetic comes from -w.
        {"inria", "images_N as shipped by -i, else at most 1600 px wide", true, SsimBorder::kZero, LpipsNet::kVgg,
         LpipsRange::kUnit, std::nullopt, "area resize where 3DGS resizes with PIL bicubic"},
        // gsplat's simple_trainer keeps renders as float. Current torchmetrics mirrors borders.
        {"gsplat", "images_N", false, SsimBorder::kReflect, LpipsNet::kAlex, LpipsRange::kSymmetric, kBlack,
         "images_N as shipped, else area resize, where gsplat resizes the full photographs with PIL bicubic (easier "
         "targets)"},
    };
    return table;
}

bool is_protocol(const std::string& name) {
    return std::any_of(protocols().begin(), protocols().end(), [&](const Protocol& p) { return p.name == name; });
}

const Protocol& find_protocol(const std::string& name) {
    std::vector<std::string> names;
    for (const Protocol& p : protocols()) {
        if (p.name == name) return p;
        names.push_back(p.name);
    }
    throw UsageError(fmt::format("--protocol: '{}' is not one of {}", name, fmt::join(names, ", ")));
}

const char* lpips_metric(LpipsNet net) { return net == LpipsNet::kVgg ? "LPIPS-VGG" : "LPIPS-Alex"; }

std::string protocol_line(const Protocol& protocol, const Vec3<float>& background) {
    const Protocol& original = find_protocol(protocol.name);
    std::string line = fmt::format("protocol {}: {}; {}; SSIM {}", protocol.name, protocol.images,
                                   protocol.eight_bit ? "8 bits" : "float in [0,1]", short_ssim(protocol.ssim_border));
    if (protocol.ssim_border != original.ssim_border)
        line += fmt::format(" (--ssim-border, instead of {})", short_ssim(original.ssim_border));
    line += fmt::format("; {}, inputs in {}", lpips_metric(protocol.lpips_net),
                        protocol.lpips_range == LpipsRange::kSymmetric ? "[-1,1]" : "[0,1]");
    if (!protocol.background) {
        line += "; background as trained";
    } else {
        line += "; background " + colour_name(background);
        // Renders over a background that the model was not trained on would score the background, not the model.
        if (!same(background, *protocol.background))
            line += fmt::format(" as trained (instead of {})", colour_name(*protocol.background));
    }
    line += "; mean over images";
    return protocol.instead.empty() ? line : line + fmt::format("; deviation: {}", protocol.instead);
}

}  // namespace gs
