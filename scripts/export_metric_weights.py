#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the weights of the learned metrics of `gsapp eval --metrics` as safetensors.

Needs torch and the packages of the weights: torchvision (VGG16 and AlexNet, IMAGENET1K_V1), lpips (heads 'vgg' and
'alex', v0.1), DISTS_pytorch (alpha, beta), and for MILO the file weights/MILO.pth of github.com/ugurcogalan06/MILO.
Missing packages and files are skipped and named; the exit status is 1 when nothing was written. The packages may
download their weights.

usage: scripts/export_metric_weights.py FOLDER [--milo MILO.pth]
then:  gsapp eval RUN --metrics all --metric-weights FOLDER     (or: export GSAPP_METRIC_WEIGHTS=FOLDER)
"""
import argparse
import importlib.util
import json
import os
import struct
import sys

VGG16_LAYERS = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)
ALEXNET_LAYERS = (0, 3, 6, 8, 10)


def write_safetensors(path, tensors):
    """Writes a dict of torch tensors as float32, under a temporary name that is then renamed."""
    header, blobs, offset = {}, [], 0
    for name, tensor in tensors.items():
        values = tensor.detach().cpu().float().contiguous()
        blob = values.numpy().astype("<f4").tobytes()
        header[name] = {"dtype": "F32", "shape": list(values.shape), "data_offsets": [offset, offset + len(blob)]}
        blobs.append(blob)
        offset += len(blob)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)  # keeps the data aligned
    with open(path + ".tmp", "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for blob in blobs:
            file.write(blob)
    os.replace(path + ".tmp", path)


def layers(state, prefix, indices):
    return {f"{prefix}{i}.{part}": state[f"{prefix}{i}.{part}"] for i in indices for part in ("weight", "bias")}


def export_vgg16(folder):
    import torchvision

    model = torchvision.models.vgg16(weights=torchvision.models.VGG16_Weights.IMAGENET1K_V1)
    write_safetensors(os.path.join(folder, "vgg16.safetensors"), layers(model.state_dict(), "features.", VGG16_LAYERS))


def export_alexnet(folder):
    import torchvision

    model = torchvision.models.alexnet(weights=torchvision.models.AlexNet_Weights.IMAGENET1K_V1)
    write_safetensors(
        os.path.join(folder, "alexnet.safetensors"), layers(model.state_dict(), "features.", ALEXNET_LAYERS)
    )


def export_lpips(folder, net):
    import torch

    # Read only the file of the heads: the package's class would also load the features again.
    package = importlib.util.find_spec("lpips")
    if package is None:
        raise ImportError("lpips is not installed")
    state = torch.load(
        os.path.join(os.path.dirname(package.origin), "weights", "v0.1", net + ".pth"), map_location="cpu"
    )
    write_safetensors(
        os.path.join(folder, f"lpips_{net}.safetensors"),
        {f"lin{i}.weight": state[f"lin{i}.model.1.weight"] for i in range(5)},
    )


def export_dists(folder):
    import torch
    from DISTS_pytorch import DISTS_pt

    # The package installs its weights at Python's prefix; a checkout has them beside the module.
    places = [os.path.join(place, "weights.pt") for place in (os.path.dirname(DISTS_pt.__file__), sys.prefix)]
    found = [place for place in places if os.path.exists(place)]
    if not found:
        raise FileNotFoundError(" and ".join(places))
    state = torch.load(found[0], map_location="cpu")
    # gsapp's pooling has the window (1,2,1) x (1,2,1) / 16 built in.
    window = DISTS_pt.L2pooling(channels=1).filter.flatten()
    expected = torch.tensor([1.0, 2, 1, 2, 4, 2, 1, 2, 1]) / 16
    if not torch.allclose(window.float(), expected, atol=1e-6):
        raise RuntimeError(f"this DISTS_pytorch pools with another window: {window.tolist()}")
    write_safetensors(os.path.join(folder, "dists.safetensors"), {name: state[name] for name in ("alpha", "beta")})


def export_milo(folder, checkpoint):
    import torch

    state = torch.load(checkpoint, map_location="cpu")
    write_safetensors(
        os.path.join(folder, "milo.safetensors"), layers(state, "mask_finder_1.netBasic.", (0, 2, 4, 6, 8))
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--milo", metavar="MILO.pth", help="the authors' checkpoint")
    arguments = parser.parse_args()
    os.makedirs(arguments.folder, exist_ok=True)
    parts = [
        ("vgg16", export_vgg16, ()),
        ("alexnet", export_alexnet, ()),
        ("lpips_vgg", export_lpips, ("vgg",)),
        ("lpips_alex", export_lpips, ("alex",)),
        ("dists", export_dists, ()),
    ]
    if arguments.milo:
        parts.append(("milo", export_milo, (arguments.milo,)))
    else:
        print("milo: skipped; --milo names the authors' MILO.pth")
    written = 0
    for name, export, extra in parts:
        try:
            export(arguments.folder, *extra)
        except Exception as error:  # one absent package or download must not keep the others from being written
            print(f"{name}: skipped; {type(error).__name__}: {error}")
            continue
        print(f"{name}: written")
        written += 1
    return 0 if written else 1


if __name__ == "__main__":
    sys.exit(main())
