#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains copies of a scene in other units and at other places, and prints what that costs in PSNR.

The numbers of a run must not depend on the unit and the origin of a scene: docs/stability.md has the table that this
script printed. A copy has the photographs of the original (links) and cameras and points x' = scale * x + offset.

    scripts/lab/scale_table.py build/release/bin/gsapp SCENE... -o FOLDER [--iterations N] [-- OPTIONS OF gsapp train]
"""
import argparse
import json
import os
import pathlib
import statistics
import struct
import subprocess
import sys

SCALES = (1e-6, 1e-3, 1.0, 1e3, 1e6)
OFFSETS = ((0.0, 0.0, 0.0), (1e3, 1e3, 1e3), (5e5, 4e6, 100.0))


def rotation(q):
    norm = sum(x * x for x in q) ** 0.5
    w, x, y, z = (v / norm for v in q)
    return [
        [1 - 2 * y * y - 2 * z * z, 2 * x * y - 2 * z * w, 2 * x * z + 2 * y * w],
        [2 * x * y + 2 * z * w, 1 - 2 * x * x - 2 * z * z, 2 * y * z - 2 * x * w],
        [2 * x * z - 2 * y * w, 2 * y * z + 2 * x * w, 1 - 2 * x * x - 2 * y * y],
    ]


def moved_images(data, scale, offset):
    """images.bin with t' = scale t - R offset."""
    out, at = bytearray(data), 8
    for _ in range(struct.unpack_from("<Q", data, 0)[0]):
        values = struct.unpack_from("<7d", data, at + 4)
        turn = rotation(values[:4])
        moved = [scale * t - sum(r * o for r, o in zip(row, offset)) for t, row in zip(values[4:], turn)]
        struct.pack_into("<3d", out, at + 36, *moved)
        at = data.index(b"\0", at + 64) + 1
        at += 8 + 24 * struct.unpack_from("<Q", data, at)[0]
    return bytes(out)


def moved_points(data, scale, offset):
    out, at = bytearray(data), 8
    for _ in range(struct.unpack_from("<Q", data, 0)[0]):
        point = struct.unpack_from("<3d", data, at + 8)
        struct.pack_into("<3d", out, at + 8, *(scale * p + o for p, o in zip(point, offset)))
        at += 43
        at += 8 + 8 * struct.unpack_from("<Q", data, at)[0]
    return bytes(out)


def make_copy(scene, target, scale, offset):
    """Writes the moved copy of a COLMAP or NeRF-synthetic scene."""
    target.mkdir(parents=True, exist_ok=True)
    model = scene / "sparse" / "0"
    for entry in scene.iterdir():
        if entry.name != "sparse" and entry.suffix != ".json" and not (target / entry.name).exists():
            os.symlink(entry.resolve(), target / entry.name)
    if model.exists():
        folder = target / "sparse" / "0"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "cameras.bin").write_bytes((model / "cameras.bin").read_bytes())
        (folder / "images.bin").write_bytes(moved_images((model / "images.bin").read_bytes(), scale, offset))
        (folder / "points3D.bin").write_bytes(moved_points((model / "points3D.bin").read_bytes(), scale, offset))
        return
    for file in scene.glob("transforms*.json"):
        content = json.loads(file.read_text())
        for frame in content["frames"]:
            for row, o in zip(frame["transform_matrix"], offset):
                row[3] = scale * row[3] + o
        (target / file.name).write_text(json.dumps(content))


def ply_bounds(path, share):
    """The quantiles `share` and 1 - `share` of x, y and z, with the file's offset added."""
    data = path.read_bytes()
    end = data.index(b"end_header\n") + 11
    header = data[:end].decode("latin-1").splitlines()
    count = next(int(line.split()[2]) for line in header if line.startswith("element vertex"))
    width = {"float": 4, "uchar": 1}
    row = sum(width[line.split()[1]] for line in header[: header.index("end_header")] if line.startswith("property"))
    offset = next(
        ([float(x) for x in line.split()[3:6]] for line in header if line.startswith("comment gsapp offset")),
        [0.0, 0.0, 0.0],
    )
    points = [struct.unpack_from("<3f", data, end + i * row) for i in range(count)]
    bounds, skipped = [], int(share * count)
    for axis in range(3):
        values = sorted(p[axis] for p in points)
        bounds.append((values[skipped] + offset[axis], values[count - 1 - skipped] + offset[axis]))
    return bounds


def bounds_error(original, moved, scale, offset):
    """The largest difference of bounds from the transformed original's, in parts of its size."""
    size = max(scale * (high - low) for low, high in original)
    return max(
        abs(scale * a + o - b) / size for pair, new, o in zip(original, moved, offset) for a, b in zip(pair, new)
    )


def train(arguments, scene, run, strategy):
    """Returns the PSNR of each seed, or None and what went wrong. The last seed's run stays."""
    scores = []
    for seed in range(arguments.seeds):
        command = [
            arguments.program,
            "train",
            "-s",
            str(scene),
            "-m",
            str(run),
            "--eval",
            "--strategy",
            strategy,
            "--iterations",
            str(arguments.iterations),
            "--seed",
            str(seed),
            "--overwrite",
            "-q",
            *arguments.options,
        ]
        result = subprocess.run(command, capture_output=True, text=True)
        if result.returncode != 0:
            return None, (result.stderr.strip().splitlines() or [f"exit {result.returncode}"])[-1]
        scores.append(json.loads((run / "results.json").read_text())[f"ours_{arguments.iterations}"]["PSNR"])
    return scores, ""


def clouds(arguments, run):
    """The bounds of the first points, and the middle half of the trained ones."""
    trained = run / "point_cloud" / f"iteration_{arguments.iterations}" / "point_cloud.ply"
    return ply_bounds(run / "input.ply", 0), ply_bounds(trained, 0.25)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--iterations", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=1, help="trainings whose PSNR is averaged")
    parser.add_argument("--strategies", nargs="+", default=["mcmc", "adc"])
    parser.add_argument("--scales", nargs="+", type=float, default=SCALES)
    parser.add_argument("--offsets", type=int, default=len(OFFSETS), help="how many of the offsets")
    parser.add_argument("--tolerance", type=float, default=0.15, help="dB; more is an error")
    split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    arguments = parser.parse_args(sys.argv[1:split])
    arguments.options = sys.argv[split + 1 :]
    failed = 0
    print(
        "| scene | strategy | scale | offset | PSNR | difference | first points | trained points |\n"
        "|---|---|---:|---|---:|---:|---:|---:|"
    )
    for scene in arguments.scenes:
        for strategy in arguments.strategies:
            run = arguments.output / f"run-{scene.name}-{strategy}-original"
            scores, fault = train(arguments, scene, run, strategy)
            if scores is None:
                sys.exit(f"{scene}: {fault}")
            base, original = statistics.fmean(scores), clouds(arguments, run)
            spread = f" ({min(scores):.2f} to {max(scores):.2f})" if arguments.seeds > 1 else ""
            print(f"| {scene.name} | {strategy} | original | | {base:.2f}{spread} | | | |", flush=True)
            for scale in arguments.scales:
                for offset in OFFSETS[: arguments.offsets]:
                    if scale == 1 and not any(offset):
                        continue
                    name = f"{scene.name}-{scale:g}-{offset[0]:g}"
                    where = ", ".join(f"{o:g}" for o in offset)
                    make_copy(scene, arguments.output / name, scale, offset)
                    run = arguments.output / f"run-{name}-{strategy}"
                    scores, fault = train(arguments, arguments.output / name, run, strategy)
                    if scores is None:
                        print(f"| {scene.name} | {strategy} | {scale:g} | {where} | {fault} | | | |", flush=True)
                        failed += 1
                        continue
                    psnr = statistics.fmean(scores)
                    first, trained = (
                        bounds_error(a, b, scale, offset) for a, b in zip(original, clouds(arguments, run))
                    )
                    failed += abs(psnr - base) > arguments.tolerance or first > 1e-3 or trained > 0.05
                    print(
                        f"| {scene.name} | {strategy} | {scale:g} | {where} | {psnr:.2f} | {psnr - base:+.2f} | "
                        f"{first:.1e} | {trained:.1e} |",
                        flush=True,
                    )
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
