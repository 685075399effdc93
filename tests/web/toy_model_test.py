# SPDX-License-Identifier: Apache-2.0
"""Trains, evaluates, exports and draws the toy model, of which nothing stands outside its folder, and compares the
viewer's pictures with the program's.

Usage: toy_model_test.py GSAPP_TOY MODELS VIEWER. GSAPP_TOY is the program with the models of the folder MODELS beside
its own, VIEWER the source of the web viewer, which is built with the same folder. Exit status 77: no Chromium, no npx,
or the viewer's packages are not installed.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from browser import Browser, find_chromium, check
from site_server import HOLD_FRAMES, KEEP_PICTURES, PSNR, SOFTWARE_WEBGPU, Site, open_viewer

# View dependence begins at iteration 1000.
TRAIN = [
    "-s",
    "builtin:glossy",
    "-r",
    "8",
    "--eval",
    "--device",
    "cpu",
    "--quiet",
    "--appearance",
    "toy",
    "--toy-lr",
    "0.002",
    "--init-points",
    "500",
    "--cap-max",
    "800",
    "--iterations",
    "1300",
]
VIEWS = (0, 3)
LEAST_PSNR = 38


def run(*arguments, **options):
    result = subprocess.run([str(a) for a in arguments], capture_output=True, text=True, **options)
    check(result.returncode == 0, f"{arguments[0]} {arguments[1]}: {result.stdout[-2000:]} {result.stderr[-2000:]}")
    return result.stdout


def compare(browser, way):
    browser.evaluate(HOLD_FRAMES)
    pictures = [(mode, view) for mode in ("full", "residual") for view in VIEWS]
    brightnesses = browser.evaluate(KEEP_PICTURES % json.dumps(pictures))
    for k, ((mode, view), brightest) in enumerate(zip(pictures, brightnesses, strict=True)):
        check(brightest > 10, f"{way}: view {view} shows something in {mode}")
        psnr = browser.evaluate(PSNR % (f"pictures[{k}]", f"reference/{mode}/{view:05}.png"))
        print(f"toy {way} {mode:9} view {view} {psnr:6.2f} dB", flush=True)
        check(psnr > LEAST_PSNR, f"{way} {mode} {view}: PSNR above {LEAST_PSNR} dB against gsapp's own picture")
    check(browser.evaluate("gsapp.way") == way, f"{way} has drawn all of it")


def main():
    gsapp, models, viewer = (pathlib.Path(a).resolve() for a in sys.argv[1:])
    program = find_chromium()
    if program is None or shutil.which("npx") is None:
        print("skipped: no chromium or no npx on PATH")
        return 77
    if not (viewer / "node_modules").exists():
        print("skipped: the viewer's packages are not installed (scripts/build-viewer)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        trained, exported, site = folder / "run", folder / "exported", folder / "site"
        run(gsapp, "train", *TRAIN, "-m", trained)
        check("toy-lr: 0.002" in (trained / "config.yaml").read_text(), "the model's own option is stored with the run")
        run(gsapp, "eval", trained)
        results = json.loads((trained / "results.json").read_text())
        check(results["run"]["ours_1300"]["model"] == "toy", f"results name the model: {results['run']}")
        run(gsapp, "export", trained, "--format", "web", "-o", exported)
        run(gsapp, "render", trained, "--decompose", "-o", folder / "reference")
        run(
            "npx",
            "vite",
            "build",
            "--outDir",
            site,
            "--emptyOutDir",
            cwd=viewer,
            env={**os.environ, "GSAPP_MORE_MODELS": str(models)},
        )
        shutil.copy(exported / "scene.ngsplat", site)
        shutil.move(folder / "reference", site)
        served = Site(folder)
        with Browser(program, width=800, height=600, flags=SOFTWARE_WEBGPU) as browser:
            for way in ("WebGL2", "WebGPU"):
                if way == "WebGPU" and not browser.evaluate(
                    "navigator.gpu?.requestAdapter().then((adapter) => adapter !== null)"
                ):
                    print("this chromium has no WebGPU, not in software either: only WebGL2 is tested")
                    continue
                open_viewer(browser, f"{served.url}site/?gpu={'webgl' if way == 'WebGL2' else 'webgpu'}")
                compare(browser, way)
            check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


sys.exit(main())
