#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Loads a generated model in a headless Chromium and prints what memory its processes take.

    scripts/lab/viewer_memory.py [--gaussians N] [--viewer FOLDER] [--chromium PROGRAM] [--limit MIB]

The model has spherical harmonics of degree 3: 56 bytes a Gaussian. Memory is the proportional set size of
/proc/PID/smaps_rollup, summed over Chromium's pages and its graphics process. Drawing is in software, so that textures
count there, too: on a device of their own they are not in these processes. At the end Chromium is told to collect
garbage. With --limit the program fails where Chromium takes more than that at any time, beyond what it took before the
model.
"""
import argparse
import os
import pathlib
import random
import shutil
import struct
import sys
import tempfile
import threading
import time

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "web"))

from browser import Browser, find_chromium  # noqa: E402
from site_server import SOFTWARE_WEBGL, Site  # noqa: E402
from viewer_scenes import header, unit  # noqa: E402

ROW = 2048
BANDS_AT, ALL_BANDS = 28, 0b1110
PAYLOAD_WORDS = (2, 4, 4)
LOADING = 900  # seconds at most


def write_model(path, count):
    """A ball's shell whose Gaussians repeat after a row of textures."""
    rng = random.Random(1)
    geometry = b"".join(
        struct.pack(
            "<4B3e2B4B", 200, 150, 100, 200, *unit([rng.gauss(0, 1) for _ in range(3)]), 128, 128, 60, 60, 60, 0
        )
        for _ in range(ROW)
    )
    head = bytearray(header(count, [(0, 0, -4)]))
    struct.pack_into("<I", head, BANDS_AT, ALL_BANDS)
    with open(path, "wb") as file:
        file.write(head)
        rows = -(-count // ROW)
        for part in (geometry, *(bytes(4 * words * ROW) for words in PAYLOAD_WORDS)):
            for _ in range(rows):
                file.write(part)


def processes(root):
    """The ids of a process and all that it started."""
    parents = {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                parents[int(entry)] = int(pathlib.Path(f"/proc/{entry}/stat").read_text().rsplit(")", 1)[1].split()[1])
            except OSError:
                continue  # it has ended meanwhile
    found = [root]
    for parent in found:
        found += [child for child, of in parents.items() if of == parent]
    return found


def memory(root):
    """MiB of pages and of the graphics process."""
    sums = {"renderer": 0.0, "gpu-process": 0.0}
    for pid in processes(root):
        try:
            command = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
            kind = next((kind for kind in sums if f"--type={kind}" in command), None)
            rollup = pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text() if kind else ""
        except OSError:
            continue
        sums[kind or "renderer"] += (
            sum(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:")) / 1024
        )
    return sums


def is_loaded(browser):
    """False also where the page is too busy to answer."""
    try:
        return browser.evaluate(
            "document.body.classList.contains('loaded') && document.getElementById('notice').hidden && window.gsapp !== undefined"
        )
    except TimeoutError:
        return False


class Peak:
    """The most that is taken until the end of a block."""

    def __init__(self, root):
        self.root, self.most, self.stop = root, {}, threading.Event()
        self.thread = threading.Thread(target=self.watch, daemon=True)

    def watch(self):
        while not self.stop.wait(0.2):
            self.most = max(self.most, memory(self.root), key=lambda taken: sum(taken.values()))

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gaussians", type=int, default=6_000_000, metavar="N")
    parser.add_argument("--viewer", type=pathlib.Path, default=ROOT / "apps" / "viewer" / "dist", metavar="FOLDER")
    parser.add_argument("--chromium", default=find_chromium(), metavar="PROGRAM")
    parser.add_argument("--limit", type=float, metavar="MIB")
    arguments = parser.parse_args()
    if not arguments.chromium:
        parser.error("no chromium on PATH; --chromium names one")
    if not (arguments.viewer / "index.html").exists():
        parser.error(f"{arguments.viewer} has no viewer; scripts/build-viewer builds it")
    if arguments.gaussians < 1:
        parser.error(f"--gaussians={arguments.gaussians} is below 1")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name) / "site"
        shutil.copytree(arguments.viewer, folder)
        write_model(folder / "large.ngsplat", arguments.gaussians)
        size = (folder / "large.ngsplat").stat().st_size / 2**20
        site = Site(folder)
        with Browser(arguments.chromium, width=320, height=240, flags=SOFTWARE_WEBGL) as browser:
            root = browser.process.pid
            browser.open(site.url + "?embed")
            time.sleep(2)
            before = memory(root)
            with Peak(root) as peak:
                # One frame, of points from afar: what is drawn in software takes long.
                browser.call("Page.addScriptToEvaluateOnNewDocument", source="window.requestAnimationFrame = () => 0;")
                browser.open(site.url + "?embed&model=large.ngsplat#from=0,0,-400&to=0,0,0&points=on")
                deadline = time.monotonic() + LOADING
                while not is_loaded(browser):
                    if time.monotonic() > deadline:
                        sys.exit(f"viewer_memory: the model was not loaded within {LOADING} s")
                    time.sleep(0.5)
                time.sleep(5)
            loaded = memory(root)
            browser.call("HeapProfiler.collectGarbage")
            time.sleep(2)
            after = memory(root)
    print(f"{arguments.gaussians:,} Gaussians, file of {size:.0f} MiB; MiB of memory:")
    print(f"{'':24}{'pages':>8}{'graphics':>10}{'sum':>8}")
    for what, taken in (
        ("without a model", before),
        ("with it", loaded),
        ("garbage collected", after),
        ("at most while it loads", peak.most),
    ):
        print(f"{what:24}{taken['renderer']:8.0f}{taken['gpu-process']:10.0f}{sum(taken.values()):8.0f}")
    more, most = (sum(taken.values()) - sum(before.values()) for taken in (after, peak.most))
    print(f"the model: {more:.0f}, at most {most:.0f} while it loads")
    if arguments.limit is not None and max(more, most) > arguments.limit:
        sys.exit(f"viewer_memory: {max(more, most):.0f} MiB are more than --limit {arguments.limit:.0f}")


main()
