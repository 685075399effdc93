# SPDX-License-Identifier: Apache-2.0
"""Lets the reading of one file after another fail half way (failing_reads.cpp): each time the program has to end with
exit code 3 and to name the file, instead of taking the part that came for the whole.

Usage: read_test.py GSAPP LIBRARY
"""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

SMALL = [
    "--device",
    "cpu",
    "--iterations",
    "4",
    "--init-points",
    "300",
    "--cap-max",
    "300",
    "--threads",
    "1",
    "--quiet",
]
MATRIX = "[[1,0,0,{}],[0,1,0,0],[0,0,1,4],[0,0,0,1]]"


def check(condition, message):
    if not condition:
        raise SystemExit(f"FAILED: {message}")


def write_scenes(folder, photographs):
    """Writes the same four images as a COLMAP scene and as a transforms.json."""
    names = [f"{i}.png" for i in range(4)]
    (folder / "colmap/sparse/0").mkdir(parents=True)
    for scene in ("colmap", "transforms"):
        (folder / scene / "images").mkdir(parents=True, exist_ok=True)
        for name, photograph in zip(names, photographs):
            shutil.copy(photograph, folder / scene / "images" / name)
    model = folder / "colmap/sparse/0"
    (model / "cameras.txt").write_text("1 PINHOLE 48 48 50 50 24 24\n")
    (model / "images.txt").write_text("".join(f"{i + 1} 1 0 0 0 {i} 0 4 1 {name}\n\n" for i, name in enumerate(names)))
    (model / "points3D.txt").write_text("".join(f"{i + 1} {i * 0.1} 0 0 9 9 9 0.5\n" for i in range(40)))
    frames = ",".join(
        f'{{"file_path": "images/{name}", "transform_matrix": {MATRIX.format(i)}}}' for i, name in enumerate(names)
    )
    (folder / "transforms/transforms.json").write_text(f'{{"fl_x": 50, "frames": [{frames}]}}')
    (folder / "list.txt").write_text("1.png\n2.png\n")
    (folder / "path.json").write_text(
        f'{{"camera_path": [{{"fov": 50, "camera_to_world": {MATRIX.format(0).replace("],[", ",")[1:-1]}}}],'
        ' "render_width": 48, "render_height": 48}'
    )


def main():
    gsapp, library = (str(pathlib.Path(file).resolve()) for file in sys.argv[1:3])
    with tempfile.TemporaryDirectory(prefix="gsapp-faults-") as name:
        folder = pathlib.Path(name).resolve()

        def run(words, **faults):
            environment = dict(
                os.environ, ASAN_OPTIONS="verify_asan_link_order=0:" + os.environ.get("ASAN_OPTIONS", ""), **faults
            )
            return subprocess.run(
                [gsapp, *words],
                env=environment,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=120,
            )

        made = run(
            [
                "train",
                "-s",
                "builtin:diffuse",
                "-r",
                "48",
                "--eval",
                "--test-every",
                "2",
                "--checkpoint-iterations",
                "4",
                *SMALL,
                "-m",
                "run",
            ]
        )
        check(made.returncode == 0, made.stderr)
        write_scenes(folder, sorted((folder / "run/test/ours_4/gt").glob("*.png"))[:4])
        checkpoint = next((folder / "run").rglob("*.safetensors")).relative_to(folder)
        colmap, transforms = (
            ["train", "-s", scene, *SMALL, "-m", "new", "--overwrite"] for scene in ("colmap", "transforms")
        )
        cases = [(colmap, f"colmap/sparse/0/{file}.txt") for file in ("cameras", "images", "points3D")]
        cases += [
            (colmap + ["--eval", "--test-list", "list.txt"], "list.txt"),
            (transforms, "transforms/transforms.json"),
            (["train", "-c", "run/config.yaml", "-m", "new", "--overwrite"], "run/config.yaml"),
            (
                [
                    "train",
                    "-s",
                    "builtin:diffuse",
                    "-r",
                    "48",
                    "--eval",
                    "--test-every",
                    "2",
                    *SMALL[:2],
                    "--iterations",
                    "6",
                    *SMALL[4:],
                    "-m",
                    "run",
                    "--resume",
                    "latest",
                ],
                str(checkpoint),
            ),
            (["eval", "--skip-render", "run"], "run/results.json"),
            (["render", "run", "--path", "path.json", "-o", "pictures"], "path.json"),
        ]
        for words, file in cases:
            size = (folder / file).stat().st_size
            for at in (0, size // 2):
                done = run(words, LD_PRELOAD=library, GSAPP_FAULT_FILE=str(folder / file), GSAPP_FAULT_AT=str(at))
                what = f"{' '.join(words)}, {file} fails at byte {at} of {size}: exit code {done.returncode}\n{done.stderr}"
                check(done.returncode == 3 and pathlib.Path(file).name in done.stderr, what)
        print(f"{len(cases)} files: as it should be")


if __name__ == "__main__":
    sys.exit(main())
