# SPDX-License-Identifier: Apache-2.0
"""Compares pictures of the web viewer, by WebGL2 and by WebGPU, with gsapp's own, for every appearance model.

Usage: viewer_models_test.py GSAPP. Exit status 77: no Chromium, or a gsapp without the viewer.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import urllib.parse

from browser import Browser, find_chromium, check
from site_server import HOLD_FRAMES, KEEP_PICTURES, PSNR, SOFTWARE_WEBGPU, Site, open_viewer, wait_for
from viewer_scenes import drop

# Arguments of gsapp train. All degrees of sh and neural have joined at a tenth of a run.
GLOSSY = ["-s", "builtin:glossy", "-r", "4", "--init-points", "500", "--cap-max", "800", "--iterations", "600"]
SHORT = [*GLOSSY[:-1], "300"]  # a network shows something sooner than bands and lobes, and takes longer
CASES = {
    "none": [*GLOSSY[:-1], "100"],
    "sh": GLOSSY,
    "sv": GLOSSY,
    "nasg": GLOSSY,
    "nasgabor": GLOSSY,
    "neural": SHORT,
    "neural_wide": SHORT,
    "neural_3layers": SHORT,
    "sh, mixed": GLOSSY + ["--appearance-share", "0.3"],
    "neural, mixed": SHORT + ["--appearance-share", "0.3"],
    "none, antialiased": [*GLOSSY[:-1], "300", "--antialiasing", "on"],
    "none, photometric": [
        "-s",
        "builtin:exposure",
        "-r",
        "4",
        "--init-points",
        "500",
        "--cap-max",
        "800",
        "--iterations",
        "600",
        "--ppisp",
        "on",
        "--controller-iterations",
        "60",
    ],
}
VIEWS = {"webgl": (0, 3, 7), "webgpu": (3,)}
MODES = ("full", "base", "residual")
# 48.4 and more were measured after 1200 iterations with 5000 Gaussians; 38 would still look the same.
LEAST_PSNR = 45


def run_gsapp(*arguments):
    subprocess.run(arguments, check=True, capture_output=True)


def forget_vignetting(run):
    """Which gsapp renders, and a file for viewers does not hold."""
    path = run / "ppisp.json"
    if path.exists():
        state = json.loads(path.read_text())
        for camera in state["cameras"]:
            camera["vignetting"] = [[0] * 5] * 3
        path.write_text(json.dumps(state))


def export(gsapp, case, folder):
    run, site = folder / (case + " run"), folder / case
    run_gsapp(
        gsapp,
        "train",
        *CASES[case],
        "--eval",
        "--device",
        "cpu",
        "--quiet",
        "--appearance",
        case.split(",")[0],
        "-m",
        run,
    )
    forget_vignetting(run)
    run_gsapp(gsapp, "export", run, "--format", "web", "-o", site)
    run_gsapp(gsapp, "render", run, "--decompose", "-o", site / "reference")


def show(browser, site, case, way):
    """Opens the page of each model by WebGL2, and that of the first one by WebGPU, where the others are dropped: a page
    that draws by WebGPU in software makes its pipelines for seconds."""
    if way == "webgl" or browser.evaluate("gsapp.way") != "WebGPU":
        return open_viewer(browser, f"{site.url}{urllib.parse.quote(case)}/?gpu={way}")
    browser.evaluate("document.title = ''")
    drop(browser, case + ".ngsplat", (site.folder / case / "scene.ngsplat").read_bytes())
    wait_for(browser, "document.title !== ''", f"{case} is shown")


def compare(browser, site, case, way):
    show(browser, site, case, way)
    check(browser.evaluate("gsapp.way") == {"webgl": "WebGL2", "webgpu": "WebGPU"}[way], f"{case}: {way} draws it")
    browser.evaluate(HOLD_FRAMES)
    pictures = [(mode, view) for mode in MODES for view in VIEWS[way]]
    brightest = browser.evaluate(KEEP_PICTURES % json.dumps(pictures))
    for (mode, view), seen in zip(pictures, brightest, strict=True):
        check(
            seen > 10 or (case.startswith("none") and mode == "residual"),
            f"{case}: view {view} shows something in {mode}",
        )
    for mode in MODES:
        references = [
            (k, f"/{urllib.parse.quote(case)}/reference/{mode}/{view:05}.png")
            for k, (of, view) in enumerate(pictures)
            if of == mode
        ]
        values = [browser.evaluate(PSNR % (f"pictures[{k}]", reference)) for k, reference in references]
        print(f"{case:17} {way} {mode:9} " + " ".join(f"{v:6.2f}" for v in values) + " dB", flush=True)
        check(
            min(values) >= LEAST_PSNR,
            f"{case} {mode} by {way}: PSNR of at least {LEAST_PSNR} dB against gsapp's own picture",
        )


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    known = subprocess.run([sys.argv[1], "options", "--markdown"], check=True, capture_output=True, text=True).stdout
    cases = [case for case in CASES if f" {case.split(',')[0]}," in known]  # a build without GSAPP_VARIANTS lacks some
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for case in cases:
            export(sys.argv[1], case, folder)
            if not (folder / case / "index.html").exists():
                print("skipped: the viewer is not built (scripts/build-viewer)")
                return 77
        site = Site(folder)
        with Browser(
            program, width=400, height=300, flags=SOFTWARE_WEBGPU
        ) as browser:  # which draws its own picture besides
            ways = ["webgl"]
            open_viewer(browser, site.url + urllib.parse.quote(cases[0]) + "/")
            if browser.evaluate("navigator.gpu?.requestAdapter().then((adapter) => adapter !== null)"):
                ways.append("webgpu")
            for way in ways:
                for case in cases:
                    compare(browser, site, case, way)
            check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
