#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the viewer's benchmark over exports in a headless Chromium, and prints a table.

    scripts/lab/bench_viewer.py SITE... [--frames N] [--device gpu|software] [--chromium PROGRAM] [--json FILE]

A SITE is a folder that `gsapp export` wrote, viewer included. `gsapp bench frames RUN ...` measures the same views with
gsapp's own rasterizer. `--device gpu` asks for WebGL2 on the machine's GPU, without a screen; the table names the
device that drew, because a browser falls back to software without a word.
"""
import argparse
import json
import pathlib
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tests" / "web"))

from browser import Browser, find_chromium  # noqa: E402
from site_server import SOFTWARE_WEBGL, Site, wait_for  # noqa: E402

FLAGS = {
    "software": SOFTWARE_WEBGL,
    "gpu": (
        "--ozone-platform=headless",
        "--use-gl=angle",
        "--use-angle=gl-egl",
        "--ignore-gpu-blocklist",
        "--disable-gpu-sandbox",
    ),
}
COLUMNS = ("export", "model", "Gaussians", "frame ms", "prepass ms", "least of a view", "most of a view")


def measure(browser, folder, frames):
    site = Site(folder)
    browser.open(site.url)
    wait_for(browser, "window.gsapp", f"{folder} is loaded", 300)
    notice = browser.evaluate(
        "document.getElementById('notice').hidden ? '' : document.getElementById('notice').innerText"
    )
    if notice:
        raise SystemExit(f"{folder}: {notice}")
    # The measurement takes longer than an answer may: it is started, and asked for.
    browser.evaluate(
        f"void gsapp.benchmark({frames}).then(r => (window.result = r), e => (window.result = {{ error: e.message }}))"
    )
    wait_for(browser, "window.result", f"{folder} is measured", 3600)
    result = browser.evaluate("window.result")
    if "error" in result:
        raise SystemExit(f"{folder}: {result['error']}")
    return result


def row(folder, result):
    frame = result["frame"]
    values = (
        folder.name,
        result["appearance"],
        f"{result['gaussians']:,}",
        *(f"{x:.3f}" for x in (frame["mean"], result["prepass"]["mean"], frame["min"], frame["max"])),
    )
    return "| " + " | ".join(values) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", nargs="+", type=pathlib.Path, metavar="SITE")
    parser.add_argument("--frames", type=int, default=20, help="frames a view (default 20)")
    parser.add_argument("--device", choices=FLAGS, default="gpu")
    parser.add_argument("--chromium", default=find_chromium(), metavar="PROGRAM")
    parser.add_argument("--json", type=pathlib.Path, metavar="FILE", help="also write what the viewer measured")
    arguments = parser.parse_args()
    if not arguments.chromium:
        parser.error("no chromium on PATH; --chromium names one")
    for folder in arguments.sites:
        if not (folder / "index.html").exists() or not (folder / "scene.ngsplat").exists():
            parser.error(f"{folder}: no export with a viewer (index.html and scene.ngsplat); gsapp export writes one")
    results = {}
    print("| " + " | ".join(COLUMNS) + " |\n|" + " --- |" * len(COLUMNS), flush=True)
    with Browser(arguments.chromium, flags=FLAGS[arguments.device]) as browser:
        for folder in arguments.sites:
            results[folder.name] = measure(browser, folder, arguments.frames)
            print(row(folder, results[folder.name]), flush=True)
    print("\ndrawn by", ", ".join(sorted({f'{r["way"]} on {r["renderer"]}' for r in results.values()})))
    print(f"{arguments.frames} frames a view; {next(iter(results.values()))['protocol']}")
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1))


main()
