#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares the learned metrics of gsapp with PyTorch on random weights. Needs only torch and numpy; takes less than a
minute.

Writes seeded weights in the layouts of VGG16, AlexNet, the LPIPS heads, DISTS and MILO, and pairs of PNGs. Runs
`gsapp metrics --json` on them and computes the same metrics with plain functional operations in double precision,
written independently of gsapp's code. Prints the largest relative differences as a Markdown table. --device says where
gsapp computes; with both names the table has two columns. Exit status: 0 all within the tolerance, 1 otherwise, 77
PyTorch is not installed.

usage: scripts/lab/check_metric_engine.py GSAPP [--device cpu cuda] [--torch-device cpu|cuda] [--seed N]
                                          [--tolerance 1e-4] [--keep FOLDER] [--verbose]
"""
import argparse
import json
import math
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import zlib

try:
    import torch
    import torch.nn.functional as F
except ImportError:
    print("skipped: PyTorch is not installed")
    sys.exit(77)

sys.dont_write_bytecode = True  # the import below leaves nothing in the checkout
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from export_metric_weights import ALEXNET_LAYERS, VGG16_LAYERS, write_safetensors  # noqa: E402

VGG16_CHANNELS = (64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512)
VGG16_STAGES = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))


# Weights --------------------------------------------------------------------------------------------------------------


def random_convolution(generator, out, inputs, kernel):
    """Returns weight and bias of a size that keeps activations near one through many layers."""
    weight = torch.randn(out, inputs, kernel, kernel, generator=generator) * math.sqrt(2 / (inputs * kernel * kernel))
    return weight, 0.1 * torch.randn(out, generator=generator)


def random_net(generator, prefix, specification):
    state = {}
    for index, out, inputs, kernel in specification:
        state[f"{prefix}{index}.weight"], state[f"{prefix}{index}.bias"] = random_convolution(
            generator, out, inputs, kernel
        )
    return state


def random_weights(seed):
    generator = torch.Generator().manual_seed(seed)
    inputs = (3,) + VGG16_CHANNELS[:-1]
    files = {
        "vgg16": random_net(
            generator, "features.", [(i, o, n, 3) for i, o, n in zip(VGG16_LAYERS, VGG16_CHANNELS, inputs)]
        ),
        "alexnet": random_net(
            generator,
            "features.",
            zip(ALEXNET_LAYERS, (64, 192, 384, 256, 256), (3, 64, 192, 384, 256), (11, 5, 3, 3, 3)),
        ),
        "milo": random_net(
            generator,
            "mask_finder_1.netBasic.",
            zip((0, 2, 4, 6, 8), (32, 64, 32, 16, 1), (7, 32, 64, 32, 16), (3,) * 5),
        ),
        "dists": {name: torch.rand(1, 1475, 1, 1, generator=generator) for name in ("alpha", "beta")},
    }
    for net, channels in (("vgg", (64, 128, 256, 512, 512)), ("alex", (64, 192, 384, 256, 256))):
        files["lpips_" + net] = {
            f"lin{i}.weight": torch.rand(1, c, 1, 1, generator=generator) for i, c in enumerate(channels)
        }
    return files


# Images ---------------------------------------------------------------------------------------------------------------


def write_png(path, image):
    """Writes an (H,W,3) uint8 image."""
    height, width, _ = image.shape
    rows = b"".join(b"\0" + bytes(row.flatten().tolist()) for row in image)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    with open(path, "wb") as file:
        file.write(
            b"\x89PNG\r\n\x1a\n"
            + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows))
            + chunk(b"IEND", b"")
        )


def gradient(height, width):
    y = torch.linspace(0, 255, height)[:, None].expand(height, width)
    x = torch.linspace(0, 255, width)[None, :].expand(height, width)
    return torch.stack((x, y, (x + y) / 2), dim=2)


def image_pairs(seed):
    """Returns (name, image, image), images (H,W,3) uint8; their sides have every remainder that pooling can meet."""
    generator = torch.Generator().manual_seed(seed + 1)
    pairs = []
    for height, width in ((64, 64), (67, 93), (31, 50), (128, 97)):
        base = gradient(height, width)
        noise = torch.rand(height, width, 3, generator=generator) * 255
        other = torch.rand(height, width, 3, generator=generator) * 255
        near = (base + 12 * torch.randn(height, width, 3, generator=generator)).clamp(0, 255)
        for name, a, b in (("noise", noise, other), ("gradient", base, near), ("mixed", base, noise)):
            pairs.append((f"{name} {width}x{height}", a.round().to(torch.uint8), b.round().to(torch.uint8)))
    return pairs


# The metrics, from their papers ---------------------------------------------------------------------------------------


def by_channel(values, like):
    return torch.tensor(values, dtype=like.dtype, device=like.device).view(1, 3, 1, 1)


def convolved(x, state, name, stride=1, padding=1):
    return F.relu(F.conv2d(x, state[name + ".weight"], state[name + ".bias"], stride=stride, padding=padding))


def vgg16_stages(x, state, pool):
    outputs = []
    for number, indices in enumerate(VGG16_STAGES):
        if number > 0:
            x = pool(x)
        for index in indices:
            x = convolved(x, state, f"features.{index}")
        outputs.append(x)
    return outputs


def alexnet_stages(x, state):
    one = convolved(x, state, "features.0", 4, 2)
    two = convolved(F.max_pool2d(one, 3, 2), state, "features.3", 1, 2)
    three = convolved(F.max_pool2d(two, 3, 2), state, "features.6")
    four = convolved(three, state, "features.8")
    return [one, two, three, four, convolved(four, state, "features.10")]


def lpips(a, b, stages, heads, symmetric):
    def features(x):
        x = 2 * x - 1 if symmetric else x
        return stages((x - by_channel((-0.030, -0.088, -0.188), x)) / by_channel((0.458, 0.448, 0.450), x))

    total = 0
    for i, (fa, fb) in enumerate(zip(features(a), features(b))):
        fa = fa / (fa.pow(2).sum(1, keepdim=True).sqrt() + 1e-10)
        fb = fb / (fb.pow(2).sum(1, keepdim=True).sqrt() + 1e-10)
        total = total + F.conv2d((fa - fb) ** 2, heads[f"lin{i}.weight"]).mean()
    return total.item()


def dists(a, b, state, weights):
    window = torch.hann_window(4, periodic=True, dtype=a.dtype, device=a.device)[1:]  # (1/2, 1, 1/2)
    window = window[:, None] * window[None, :]
    window = window / window.sum()

    def pool(x):
        kernel = window.expand(x.shape[1], 1, 3, 3)
        return (F.conv2d(x**2, kernel, stride=2, padding=1, groups=x.shape[1]) + 1e-12).sqrt()

    def maps(x):
        normalized = (x - by_channel((0.485, 0.456, 0.406), x)) / by_channel((0.229, 0.224, 0.225), x)
        return [x] + vgg16_stages(normalized, state, pool)

    similarities = [[], []]
    for fa, fb in zip(maps(a), maps(b)):
        fa, fb = fa.flatten(2)[0], fb.flatten(2)[0]
        ma, mb = fa.mean(1), fb.mean(1)
        covariance = (fa * fb).mean(1) - ma * mb
        similarities[0].append((2 * ma * mb + 1e-6) / (ma**2 + mb**2 + 1e-6))
        similarities[1].append((2 * covariance + 1e-6) / (fa.var(1, unbiased=False) + fb.var(1, unbiased=False) + 1e-6))
    alpha, beta = weights["alpha"].flatten(), weights["beta"].flatten()
    agreement = (alpha * torch.cat(similarities[0])).sum() + (beta * torch.cat(similarities[1])).sum()
    return (1 - agreement / (alpha.sum() + beta.sum())).item()


def milo(render, truth, state):
    pyramid = [(truth, render)]
    for _ in range(3):
        pyramid.append(tuple(F.avg_pool2d(image, 2) for image in pyramid[-1]))
    height, width = pyramid[-1][0].shape[2:]
    mask = torch.zeros(1, 1, height // 2, width // 2, dtype=truth.dtype, device=truth.device)
    for t, r in reversed(pyramid):
        mask = F.interpolate(mask, scale_factor=2, mode="bilinear", align_corners=True)
        mask = F.pad(mask, (0, t.shape[3] - mask.shape[3], 0, t.shape[2] - mask.shape[2]), mode="replicate")
        x = torch.cat((t, r, mask), 1)
        for index in (0, 2, 4, 6):
            x = convolved(x, state, f"mask_finder_1.netBasic.{index}")
        name = "mask_finder_1.netBasic.8"
        mask = mask + torch.sigmoid(F.conv2d(x, state[name + ".weight"], state[name + ".bias"], padding=1))
    return (mask * (truth - render).abs()).mean().item()


def expected_scores(render, truth, files, symmetric):
    def vgg(x):
        return vgg16_stages(x, files["vgg16"], lambda y: F.max_pool2d(y, 2))

    return {
        "LPIPS-VGG": lpips(render, truth, vgg, files["lpips_vgg"], symmetric),
        "LPIPS-Alex": lpips(
            render, truth, lambda x: alexnet_stages(x, files["alexnet"]), files["lpips_alex"], symmetric
        ),
        "DISTS": dists(render, truth, files["vgg16"], files["dists"]),
        "MILO": milo(render, truth, files["milo"]),
    }


# The comparison -------------------------------------------------------------------------------------------------------


def gsapp_scores(gsapp, paths, folder, lpips_range, device):
    command = [
        gsapp,
        "metrics",
        *paths,
        "--metrics",
        "lpips-vgg,lpips-alex,dists,milo",
        "--metric-weights",
        folder,
        "--lpips-range",
        lpips_range,
        "--device",
        device,
        "--json",
    ]
    output = subprocess.run(command, capture_output=True, text=True)
    if output.returncode != 0:
        sys.exit(f"{' '.join(command)}\n{output.stderr}")
    return json.loads(output.stdout)["scores"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("gsapp")
    parser.add_argument("--device", nargs="+", choices=("cpu", "cuda"), default=["cpu"], help="where gsapp computes")
    parser.add_argument("--torch-device", default="cpu", help="where torch computes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tolerance", type=float, default=1e-4, help="relative")
    parser.add_argument("--keep", metavar="FOLDER", help="leave weights and images here")
    parser.add_argument("--verbose", action="store_true", help="also print every score")
    arguments = parser.parse_args()
    gsapp = os.path.abspath(arguments.gsapp)
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or temporary
        os.makedirs(folder, exist_ok=True)
        files = random_weights(arguments.seed)
        for name, state in files.items():
            write_safetensors(os.path.join(folder, name + ".safetensors"), state)
        files = {
            name: {key: value.double().to(arguments.torch_device) for key, value in state.items()}
            for name, state in files.items()
        }
        worst, count = {}, 0
        for name, render, truth in image_pairs(arguments.seed):
            paths = [os.path.join(folder, side + ".png") for side in ("render", "truth")]
            write_png(paths[0], render)
            write_png(paths[1], truth)
            tensors = [
                image.permute(2, 0, 1)[None].to(arguments.torch_device).double() / 255 for image in (render, truth)
            ]
            # The range concerns only the first layer of LPIPS, so one kind of images is enough for the other range.
            for lpips_range in ("symmetric", "unit") if name.startswith("mixed") else ("symmetric",):
                count += 1
                with torch.no_grad():
                    expected = expected_scores(*tensors, files, lpips_range == "symmetric")
                for device in arguments.device:
                    scores = gsapp_scores(gsapp, paths, folder, lpips_range, device)
                    for metric, value in expected.items():
                        error = abs(scores[metric] - value) / abs(value) if metric in scores else math.inf
                        worst[metric, device] = max(worst.get((metric, device), 0), error)
                        if arguments.verbose:
                            print(
                                f"{name:<18} {lpips_range:<10} {device:<5} {metric:<11} {value:>12.8f} {scores.get(metric, math.nan):>12.8f} {error:>9.1e}"
                            )
    print(
        f"Largest relative difference to torch {torch.__version__} in double on {arguments.torch_device}, {count} pairs of images, random weights of "
        f"seed {arguments.seed}; tolerance {arguments.tolerance:g}\n"
    )
    print("| metric |" + "".join(f" gsapp on {device} |" for device in arguments.device))
    print("|---|" + "---:|" * len(arguments.device))
    for metric in expected:
        print(f"| {metric} |" + "".join(f" {worst[metric, device]:.1e} |" for device in arguments.device))
    return 0 if all(error <= arguments.tolerance for error in worst.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
