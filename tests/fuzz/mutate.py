#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Gives damaged files to the whole program, built with sanitizers, and prints a table of how it ended.

    cmake --preset fuzz && cmake --build --preset fuzz --target fuzz gsapp_server
    tests/fuzz/mutate.py --count 10000 --seed 1

Each trial takes a small valid dataset or run, damages one of its files (bits, lengths, numbers, sections, images'
sizes, another file's content, no file at all) and runs a subcommand on it. Trial I of seed S is always the same. A
trial is a finding when the program
  crashes        ends by a signal, or a sanitizer stops it
  unexpected     ends with exit code 1, or one that docs/formats.md does not know
  slow           computes for longer than --seconds, or waits for ten times as long
  memory         needs more than 1 GiB (its inputs are far below 1 MiB), or more than there is (exit code 4)
  leaves         leaves a temporary file behind
Messages of exit codes 2 and 3 that do not name the damaged file are counted as "unnamed"; they are no findings.
The folder and the command of each finding and of the first unnamed messages are kept under --keep.
Exit code: 0 nothing found; 1 findings; 2 wrong usage, or a valid input that is refused.
"""
import argparse
import collections
import json
import os
import pathlib
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import zlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
MOST_KILOBYTES = 1 << 20
SANITIZED = 99  # exit code that the sanitizers are told
TRAIN = "train -s scene -m out --device cpu --threads 1 --iterations 2 --cap-max 20 --eval --test-every 3"


class Server:
    """gsapp_server: forks the program for every command."""

    def __init__(self, program, seconds):
        self.seconds = seconds
        environment = dict(os.environ)
        environment["ASAN_OPTIONS"] = (
            f"detect_leaks=0:exitcode={SANITIZED}:quarantine_size_mb=16:"
            "max_allocation_size_mb=1024:allocator_may_return_null=0"
        )
        environment["UBSAN_OPTIONS"] = f"exitcode={SANITIZED}:print_stacktrace=1"
        symbolizer = shutil.which("llvm-symbolizer-16") or shutil.which("llvm-symbolizer")
        if symbolizer:
            environment["ASAN_SYMBOLIZER_PATH"] = os.path.realpath(symbolizer)
        environment.pop("GSAPP_METRIC_WEIGHTS", None)
        self.process = subprocess.Popen(
            [program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="surrogateescape",
            env=environment,
        )

    def run(self, folder, command):
        """Returns ("exit" | "signal", number, KiB, milliseconds, stderr)."""
        err = folder / "stderr.txt"
        fields = [str(folder / "work"), str(folder / "stdout.txt"), str(err), str(self.seconds)] + command.split()
        self.process.stdin.write("\x1f".join(fields) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        if len(answer) != 4:
            sys.exit("the server ended")
        return answer[0], int(answer[1]), int(answer[2]), int(answer[3]), err.read_bytes().decode("utf-8", "replace")


class Kind:
    """One kind of input: a valid folder, commands that read it, and the files that are damaged for each of them."""

    def __init__(self, name, files, commands):
        self.name = name
        self.files = files  # bytes by relative path
        self.commands = [(command, sorted(damaged)) for command, damaged in commands]


# ---------------------------------------------------------------- damage

NUMBERS = """0 -0 -1 1 2147483647 2147483648 -2147483649 4294967296 9223372036854775807 9223372036854775808
-9223372036854775809 18446744073709551616 99999999999999999999999 1e308 1e309 -1e309 1e-320 1e39 nan inf -inf NaN
Infinity 0x10 1.5 1e5 1000000 65536 1_0""".split()
WORDS = [
    "null",
    "true",
    "[]",
    "{}",
    '""',
    "''",
    "~",
    "[[]]",
    '{"a": 1}',
    r'"\u0000"',
    r'"\ud800"',
    "&a [*a]",
    "*a",
    "!!binary x",
    "<<",
    "- ",
    ": ",
    "#",
    "\t",
    "\0",
    "\xff",
    "..",
    "/",
    "/dev/null",
    "a" * 300,
    "a/" * 3000,
    "%s%n",
    "*?[a]",
    "\xe9",
]
INTEGERS = [
    0,
    1,
    2,
    0x7F,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x10000,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    1 << 32,
    1 << 40,
    1 << 60,
    (1 << 63) - 1,
    1 << 63,
    (1 << 64) - 1,
    22000,
    1000000,
]
FLOATS = [
    float("nan"),
    float("inf"),
    float("-inf"),
    1e300,
    -1e300,
    3.5e38,
    1e38,
    -1e38,
    1e-310,
    1e-45,
    0.0,
    -0.0,
    -1.0,
    1e9,
    1e19,
]
SINGLES = [f for f in FLOATS if not 3.4e38 < abs(f) < float("inf")]
SIDES = [0, 1, 3, 15, 17, 65535, 65536, 22000, 100000, 0x7FFFFFFF, 0xFFFFFFFF, 40, 4000]
NODES = [
    None,
    True,
    False,
    "",
    "x",
    [],
    {},
    0,
    -1,
    1.5,
    2**31,
    2**53,
    2**63,
    2**64,
    -(2**63),
    1e308,
    1e-320,
    float("nan"),
    float("inf"),
    "nan",
    "\0",
    "\xe9" * 200,
    [[[]]],
    {"a": {}},
]
KEYS = ["", "ours_1", "ours_-1", "ours_99999999999999999999", "a" * 300, "\0"]


def damage_bits(r, data):
    out = bytearray(data)
    for _ in range(r.choice([1, 1, 2, 4, 16])):
        if out:
            out[r.randrange(len(out))] ^= 1 << r.randrange(8)
    return bytes(out)


def damage_header_bytes(r, data):
    out = bytearray(data)
    for _ in range(r.choice([1, 2, 3])):
        if out:
            out[r.randrange(min(len(out), 128))] = r.choice([0, 1, 0x7F, 0x80, 0xFF, r.randrange(256)])
    return bytes(out)


def truncate(r, data):
    size = len(data)
    return data[: r.choice([0, 1, 4, r.randrange(size + 1), max(0, size - 1), max(0, size - r.randrange(1, 64))])]


def extend(r, data):
    return data + r.choice([b"\0", b"\n", b"x", data, b"\0" * 70000, r.randbytes(r.choice([3, 100, 5000]))])


def damage_number_bytes(r, data):
    """A binary number at any place becomes an extreme one, of 1 to 8 bytes, either byte order, or a float."""
    out = bytearray(data)
    if len(out) < 8:
        return damage_bits(r, data)
    for _ in range(r.choice([1, 1, 2])):
        order = r.choice("<<<>")
        value = r.choice(
            [
                lambda: struct.pack(order + "Q", r.choice(INTEGERS)),
                lambda: struct.pack(order + "I", r.choice(INTEGERS) & 0xFFFFFFFF),
                lambda: struct.pack(order + "H", r.choice(INTEGERS) & 0xFFFF),
                lambda: struct.pack(order + "d", r.choice(FLOATS)),
                lambda: struct.pack(order + "f", r.choice(SINGLES)),
            ]
        )()
        places = range(0, len(out) - len(value) + 1)
        at = r.choice([r.choice(places), min(places[-1], 4 * r.randrange(24)), 0])
        out[at : at + len(value)] = value
    return bytes(out)


def cut_piece(r, data):
    at = r.randrange(len(data) + 1)
    return data[:at] + data[at + r.choice([1, 4, 8, 24, 100, 1000]) :]


def repeat_piece(r, data):
    at = r.randrange(len(data) + 1)
    piece = data[at : at + r.choice([1, 4, 8, 24, 100, 1000])]
    return data[:at] + piece * r.choice([1, 2, 50]) + data[at:]


def insert_text(r, data):
    at = r.randrange(len(data) + 1)
    return data[:at] + r.choice(WORDS + NUMBERS).encode("latin-1") + data[at:]


def damage_text_number(r, data):
    """Numbers of a text, the header of a PLY or safetensors file included, become extreme ones."""
    places = list(re.finditer(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?", data[:20000]))
    if not places:
        return damage_bits(r, data)
    for place in sorted(r.sample(places, min(len(places), r.choice([1, 1, 1, 3]))), key=lambda p: -p.start()):
        data = data[: place.start()] + r.choice(NUMBERS).encode() + data[place.end() :]
    return data


def damage_text_word(r, data):
    places = list(re.finditer(rb"\"[^\"\n]{0,100}\"|[A-Za-z_][\w.-]*", data[:20000]))
    if not places:
        return damage_bits(r, data)
    place = r.choice(places)
    other = r.choice([r.choice(WORDS).encode("latin-1"), r.choice(places).group(), r.choice(NUMBERS).encode(), b""])
    return data[: place.start()] + other + data[place.end() :]


def damage_lines(r, data):
    lines = data.split(b"\n")
    for _ in range(r.choice([1, 1, 2, 5])):
        at = r.randrange(len(lines))
        what = r.randrange(5)
        if what == 0:
            del lines[at]
        elif what == 1:
            lines.insert(at, lines[r.randrange(len(lines))])
        elif what == 2:
            lines[at] = b"  " + lines[at]
        elif what == 3:
            lines[at] = lines[at][: r.randrange(len(lines[at]) + 1)]
        else:
            lines[at] += b" " + r.choice(WORDS + NUMBERS).encode("latin-1")
        if not lines:
            return b""
    return b"\n".join(lines)


def damage_json(r, data):
    """One node of a JSON text (or of one of its lines) is replaced, removed, repeated or nested."""
    try:
        tree = json.loads(data)
    except ValueError:
        return damage_lines(r, data)
    nodes = []

    def walk(node):
        for key in list(node) if isinstance(node, dict) else range(len(node)):
            nodes.append((node, key))
            if isinstance(node[key], (dict, list)):
                walk(node[key])

    if not isinstance(tree, (dict, list)):
        return b"[" * r.choice([1, 100, 100000])
    walk(tree)
    if not nodes:
        return b"[" * r.choice([1, 100, 100000])
    for _ in range(r.choice([1, 1, 2])):
        parent, key = r.choice(nodes)
        what = r.randrange(8)
        try:
            if what == 0:
                del parent[key]
            elif what == 1:
                parent[key] = [parent[key]]
            elif what == 2 and isinstance(parent, list):
                parent.extend([parent[key]] * r.choice([1, 100]))
            elif what == 3:
                parent[key] = r.choice(nodes)[0]
            elif what == 4 and isinstance(parent, dict):
                parent[r.choice(KEYS)] = parent.pop(key)
            else:
                parent[key] = r.choice(NODES)
        except (KeyError, IndexError):
            pass
    try:
        return json.dumps(tree).encode()
    except ValueError:  # a node that holds itself
        return data[: len(data) // 2] + data


def damage_image_size(r, data):
    """The size that an image's header declares becomes another one, with the header's checksum where it has one."""
    size = [r.choice(SIDES) for _ in range(2)]
    if r.random() < 0.3:
        size[r.randrange(2)] = r.choice([12, 16])
    out = bytearray(data)
    if data.startswith(b"\x89PNG"):
        out[16:24] = struct.pack(">II", *(s & 0xFFFFFFFF for s in size))
        out[24:29] = bytes(r.choice([out[24 + k], out[24 + k], r.choice([0, 1, 2, 3, 4, 6, 8, 16])]) for k in range(5))
        out[29:33] = struct.pack(">I", zlib.crc32(bytes(out[12:29])))
    elif data.startswith(b"\xff\xd8"):
        at = next((i for i in range(2, len(out) - 9) if out[i] == 0xFF and out[i + 1] in (0xC0, 0xC1, 0xC2)), None)
        if at:
            out[at + 5 : at + 9] = struct.pack(">HH", *(s & 0xFFFF for s in size))
            if r.random() < 0.3:
                out[at + 1] = r.choice([0xC0, 0xC1, 0xC2, 0xC3])
    elif data.startswith(b"BM"):
        out[18:26] = struct.pack("<II", *(s & 0xFFFFFFFF for s in size))
        if r.random() < 0.3:
            out[28:34] = struct.pack("<HI", r.choice([1, 4, 8, 16, 24, 32, 0, 5]), r.choice([0, 1, 2, 3, 4]))
    elif data[:2] in (b"II", b"MM"):  # width and height are the tags 256 and 257
        order = "<" if data[:2] == b"II" else ">"
        start = struct.unpack(order + "I", data[4:8])[0]
        if start + 2 <= len(data):
            for entry in range(struct.unpack(order + "H", data[start : start + 2])[0]):
                at = start + 2 + 12 * entry
                if at + 12 > len(out):
                    break
                tag = struct.unpack(order + "H", data[at : at + 2])[0]
                if tag in (256, 257):
                    out[at + 2 : at + 12] = struct.pack(order + "HII", 4, 1, size[tag - 256] & 0xFFFFFFFF)
                elif r.random() < 0.05:
                    out[at + 8 : at + 12] = struct.pack(order + "I", r.choice(INTEGERS) & 0xFFFFFFFF)
    elif data.startswith(b"\x76\x2f\x31\x01"):
        for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
            at = data.find(name)
            if at >= 0 and r.random() < 0.7:
                at += len(name) + 4
                out[at : at + 16] = struct.pack("<iiii", 0, 0, *((s - 1) & 0x7FFFFFFF for s in size))
    else:
        return damage_header_bytes(r, data)
    return bytes(out)


IMAGES = (".png", ".jpg", ".tif", ".exr", ".webp", ".bmp")
ANY = [damage_bits, truncate, extend, damage_number_bytes, cut_piece, repeat_piece]
TEXT = [
    damage_text_number,
    damage_text_number,
    damage_text_word,
    damage_lines,
    insert_text,
    truncate,
    cut_piece,
    repeat_piece,
    damage_bits,
]


def damage(r, name, data, others):
    """Returns the damaged bytes of a file, or the word that says what stands in its place."""
    chance = r.random()
    if chance < 0.015:
        return r.choice(["missing", "folder", "link to itself"])
    if chance < 0.05:
        return r.choice(others)  # another file's content
    if chance < 0.10:
        other = r.choice(others)
        return data[: r.randrange(len(data) + 1)] + other[r.randrange(len(other) + 1) :]
    if name.endswith(IMAGES):
        how = r.choice(ANY + [damage_header_bytes] * 3 + [damage_image_size] * 4)
    elif name.endswith(".json"):
        how = r.choice(TEXT + [damage_json] * 9)
    elif name.endswith((".txt", ".yaml", ".jsonl")) or name == "cfg_args":
        how = r.choice(TEXT)
    elif name.endswith((".ply", ".safetensors")):
        how = r.choice(ANY + TEXT + [damage_header_bytes])
    else:
        how = r.choice(ANY + [damage_number_bytes] * 3)
    out = how(r, data)
    return damage_bits(r, out) if r.random() < 0.05 else out


# ---------------------------------------------------------------- valid inputs


def read_tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def write_tree(folder, files):
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def valid_inputs(seeds, make):
    """Returns all kinds. `make(files, commands)` runs commands in a folder of these files and returns what is there."""

    def seed(name, number=0):
        return (seeds / name / f"seed{number}").read_bytes()

    png, rgba = seed("image.png"), seed("image.png", 1)
    photos = {f"scene/images/{name}.png": png for name in "abc"}
    binary = {f"scene/sparse/0/{part}.bin": seed(f"colmap_{part}.bin") for part in ("cameras", "images", "points3D")}
    text = {f"scene/sparse/0/{part}.txt": seed(f"colmap_{part}.txt") for part in ("cameras", "images", "points3D")}
    colmap = {**photos, **binary}

    def pose(k):
        return [[1, 0, 0, 0.1 * k], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]

    transforms = {
        "fl_x": 20,
        "fl_y": 20,
        "cx": 8,
        "cy": 6,
        "w": 16,
        "h": 12,
        "k1": -0.1,
        "k2": 0.01,
        "camera_model": "OPENCV",
        "ply_file_path": "points.ply",
        "test_filenames": ["images/c"],
        "frames": [{"file_path": f"images/{n}", "transform_matrix": pose(k)} for k, n in enumerate("abc")],
    }
    blender = {}
    for split in ("train", "test"):
        views = [{"file_path": f"./{split}/r_{k}", "rotation": 0.1, "transform_matrix": pose(k)} for k in range(3)]
        blender[f"scene/transforms_{split}.json"] = json.dumps({"camera_angle_x": 0.7, "frames": views}).encode()
        blender.update({f"scene/{split}/r_{k}.png": rgba for k in range(3)})
    small = b"{width: 16, height: 12, fov: 48, radius: 4.4, look_at: [0, 0, 0.2], train: 3, test: 1}"
    builtin = re.sub(rb"cameras: .*", b"cameras: " + small, seed("scene.yaml").replace(b"points: 5000", b"points: 50"))
    builtin += b"""pixel_grid: 1
violations:
  moved: {shape: red ball, offset: [0.35, -0.3, 0], every: 2}
  exposure: {stops: 1, white_balance: 0.2, vignetting: 0.15, seed: 1}
  shadow: {from: [2.2, -2.0, 2.2], to: [-1.0, -0.4, 2.2], radius: 0.35, every: 2}
"""
    few = TRAIN.replace("--iterations 2", "--iterations 1")
    kinds = [
        Kind("colmap", colmap, [(few, binary)]),
        Kind("colmap_text", {**photos, **text}, [(few, text)]),
        Kind(
            "transforms",
            {
                **photos,
                "scene/transforms.json": json.dumps(transforms).encode(),
                "scene/points.ply": seed("points.ply"),
            },
            [(few, ["scene/transforms.json", "scene/transforms.json", "scene/points.ply"])],
        ),
        Kind("blender", blender, [(few + " --init-points 20", [n for n in blender if n.endswith(".json")])]),
    ]
    pictures = {
        "scene/images/a.png": png,
        "scene/images/b.jpg": seed("image.jpg"),
        "scene/images/c.tif": seed("image.tif"),
    }
    others = {
        "scene/images/a.exr": seed("image.exr"),
        "scene/images/b.webp": seed("image.webp"),
        "scene/images/c.bmp": seed("image.bmp"),
    }
    exif = " --ppisp on --ppisp-exif --controller-iterations 0"
    kinds += [
        Kind("images", {**binary, **pictures}, [(few, pictures), (few + exif, pictures)]),
        Kind("images_2", {**binary, **others}, [(few, others)]),
        Kind(
            "masks",
            {**colmap, "scene/masks/a.png": png, "scene/masks/b.png.png": rgba},
            [
                (few, ["scene/masks/a.png", "scene/masks/b.png.png"]),
                (few + " --mask-mode transparent", ["scene/masks/a.png"]),
            ],
        ),
        Kind(
            "two_images",
            {"a.png": png, "b.png": rgba, **{f"c.{form}": seed(f"image.{form}") for form in ("jpg", "exr", "tif")}},
            [(f"metrics {a} b.png", [a]) for a in ("a.png", "c.jpg", "c.exr", "c.tif")],
        ),
        Kind(
            "test_list",
            {**colmap, "list.txt": b"# held out\nb.png\n\nc\n"},
            [(few + " --test-list list.txt", ["list.txt"])],
        ),
        Kind("builtin", {"scene.yaml": builtin}, [(few.replace("-s scene", "-s builtin:scene.yaml"), ["scene.yaml"])]),
    ]
    run = make(colmap, [TRAIN + " --checkpoint-iterations 1 --save-iterations 1 --test-iterations 1"])
    corrected = make(colmap, [TRAIN + " --ppisp on --controller-iterations 0"])
    config = {
        "config.yaml": b"parent: parent.yaml\n" + run["out/config.yaml"],
        "parent.yaml": b"sh-degree: 2\nlambda-dssim: 0.3\n",
    }
    kinds.append(Kind("config", {**colmap, **config}, [(few + " --config config.yaml", list(config))]))
    run["out/auto.json"] = json.dumps(
        {"model": "sh", "lines": ["because"], "explained": {"direction": 0.5}, "trials": [], "seconds": 1.5}
    ).encode()

    def named(ending):
        return [n for n in run if n.startswith("out/") and n.endswith(ending)]

    pair = {**run, **{n.replace("out/", "two/"): data for n, data in run.items() if n.startswith("out/")}}
    model, checkpoint = named("iteration_2/point_cloud.ply"), named("iteration_2.safetensors")
    plan, results, ppisp = ["out/config.yaml"], ["out/results.json", "out/per_view.json"], ["out/ppisp.json"]
    kinds += [
        Kind(
            "run",
            run,
            [
                ("eval out", plan + model * 3 + results + ["out/auto.json"]),
                ("eval out --skip-render --html page.html", plan + results + named(".png")),
                ("render out --views all", plan + model),
                ("render out --path out/cameras.json", ["out/cameras.json"]),
                ("export out -o site.ply --format ply", model),
                ("export out -o site.splat --format splat", model),
                ("export out -o site", model + plan),
                ("bench frames out --frame-repeat 1", plan + model + results),
            ],
        ),
        Kind(
            "two_runs",
            pair,
            [
                (f"eval out two --skip-render --format {form}", plan + results * 2)
                for form in ("markdown", "csv", "latex", "json")
            ],
        ),
        Kind(
            "resume",
            run,
            [("train -m out --resume latest --iterations 3", plan + checkpoint * 4 + named(".jsonl") * 2 + results)],
        ),
        Kind(
            "ppisp",
            corrected,
            [
                ("eval out", ppisp),
                ("export out -o site", ppisp),
                (few.replace("out", "two") + " --ppisp-from out/ppisp.json --controller-iterations 0", ppisp),
            ],
        ),
    ]
    return kinds


# ---------------------------------------------------------------- trials


def judge(outcome, folder, damaged):
    """Returns the finding's name, or "", and whether the message names the damaged file."""
    how, number, kilobytes, _, text = outcome
    leftovers = [p for p in (folder / "work").rglob("*") if re.search(r"\.tmp$", p.name)]
    named = number not in (2, 3) or how != "exit" or any(part in text for part in (damaged, pathlib.Path(damaged).name))
    if how == "signal" and number in (signal.SIGALRM, signal.SIGXCPU, signal.SIGKILL):
        return "slow", named
    if how == "signal" or number == SANITIZED or "AddressSanitizer" in text or "runtime error:" in text:
        return "crashes", named
    if number not in (0, 2, 3, 4, 5):
        return "unexpected", named
    if number == 4 or kilobytes > MOST_KILOBYTES:
        return "memory", named
    return ("leaves" if leftovers else ""), named


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--build", type=pathlib.Path, default=ROOT / "build/fuzz", help="folder with bin/gsapp_server and bin/fuzz"
    )
    parser.add_argument("--count", type=int, default=10000, help="number of trials")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first trial")
    parser.add_argument("--kinds", help="these kinds alone, separated by commas")
    parser.add_argument("--seconds", type=int, default=20, help="longest processor time of one trial")
    parser.add_argument("--keep", type=pathlib.Path, help="folder for findings (default: BUILD/hostile)")
    arguments = parser.parse_args()
    keep = arguments.keep or arguments.build / "hostile"
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    top = pathlib.Path(tempfile.mkdtemp(prefix="gsapp-hostile-", dir=memory))
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the table of what was done is printed, then
    try:
        return run(arguments, keep, top)
    finally:
        shutil.rmtree(top, ignore_errors=True)


def run(arguments, keep, top):
    server = Server(arguments.build / "bin/gsapp_server", arguments.seconds)
    work = top / "work"

    def fresh(files):
        shutil.rmtree(work, ignore_errors=True)
        write_tree(work, files)

    def make(files, commands):
        fresh(files)
        for command in commands:
            outcome = server.run(top, command)
            if outcome[:2] != ("exit", 0):
                sys.exit(f"{command}: valid input ended with {outcome}")
        return read_tree(work)

    subprocess.run(
        [arguments.build / "bin/fuzz", f"--seeds={top / 'seeds'}"],
        check=True,
        env={**os.environ, "TMPDIR": str(top), "ASAN_OPTIONS": "detect_leaks=0"},
    )
    kinds = valid_inputs(top / "seeds", make)
    if arguments.kinds:
        chosen = arguments.kinds.split(",")
        unknown = set(chosen) - {kind.name for kind in kinds}
        if unknown:
            sys.exit(f"--kinds: {', '.join(unknown)}: known are {', '.join(kind.name for kind in kinds)}")
        kinds = [kind for kind in kinds if kind.name in chosen]
    for kind in kinds:
        for command, _ in kind.commands:
            make(kind.files, [command])

    table = collections.defaultdict(collections.Counter)
    totals, kept_unnamed = collections.Counter(), 0
    most_memory, longest = (0, ""), (0, "")
    shutil.rmtree(keep, ignore_errors=True)
    done = 0
    try:
        for number in range(arguments.first, arguments.first + arguments.count):
            r = random.Random(f"{arguments.seed}:{number}")
            kind = kinds[number % len(kinds)]
            command, candidates = r.choice(kind.commands)
            damaged = r.choice(candidates)
            content = damage(r, damaged, kind.files[damaged], list(kind.files.values()))
            fresh({name: data for name, data in kind.files.items() if name != damaged})
            place = work / damaged
            place.parent.mkdir(parents=True, exist_ok=True)
            if content == "folder":
                place.mkdir()
            elif content == "link to itself":
                place.symlink_to(place.name)
            elif content != "missing":
                place.write_bytes(content)
            outcome = server.run(top, command)
            finding, named = judge(outcome, top, damaged)
            name = f"{kind.name}-{arguments.seed}-{number}"
            table[kind.name][f"exit {outcome[1]}" if outcome[0] == "exit" else f"signal {outcome[1]}"] += 1
            most_memory, longest = max(most_memory, (outcome[2], name)), max(longest, (outcome[3], name))
            if finding:
                totals[finding] += 1
            if not named:
                totals["unnamed"] += 1
            if finding or (not named and kept_unnamed < 200):
                kept_unnamed += not finding
                place = keep / (finding or "unnamed") / name
                place.mkdir(parents=True, exist_ok=True)
                record = f"{command}\ndamaged: {damaged}: {content if isinstance(content, str) else len(content)}\n"
                (place / "command.txt").write_text(f"{record}{outcome[:4]}\n{outcome[4]}", errors="replace")
                if content not in ("missing", "folder", "link to itself"):
                    (place / pathlib.Path(damaged).name).write_bytes(content)
                if finding:
                    print(f"{finding}: {name}: {command}: {damaged}: {outcome[:4]}", flush=True)
            done += 1
    except KeyboardInterrupt:
        print("stopped")
    endings = sorted({ending for row in table.values() for ending in row})
    print(f"{'kind':14}" + "".join(f"{ending:>10}" for ending in endings))
    for name, row in table.items():
        print(f"{name:14}" + "".join(f"{row[ending]:10}" for ending in endings))
    print(
        f"{done} inputs; most memory {most_memory[0] / 1024:.0f} MiB ({most_memory[1]}), "
        f"longest {longest[0] / 1000:.1f} s ({longest[1]})"
    )
    print(
        "findings: "
        + (", ".join(f"{name} {n}" for name, n in sorted(totals.items()) if name != "unnamed") or "none")
        + f"; messages that do not name the file: {totals['unnamed']}"
    )
    return 1 if any(n for name, n in totals.items() if name != "unnamed") else 0


if __name__ == "__main__":
    sys.exit(main())
