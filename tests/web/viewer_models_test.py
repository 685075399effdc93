# SPDX-License-Identifier: Apache-2.0
"""Compares pictures of the web viewer with gsapp's own, for every appearance model.

Usage: viewer_models_test.py GSAPP. Exit status 77: no Chromium, no GSAPP_TEST_DATA, or a gsapp without the viewer.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

from browser import Browser, find_chromium
from site_server import PSNR, SOFTWARE_WEBGL, Site, check, open_viewer

# View dependence begins at iteration 1000; further degrees of sh and neural join at 2000 and 3000.
ITERATIONS = {"none": 300, "sh": 3200, "sv": 1200, "nasg": 1200, "nasgabor": 1200, "neural": 3200, "neural_wide": 1200, "neural_1layer": 1200,
              "neural_3layers": 1200, "neural_plain": 1200}
VIEWS = (0, 4, 8)
MODES = ("full", "base", "residual")
# 49.9 and more were measured; 38 would still look the same.
LEAST_PSNR = 45


def export(gsapp, scene, model, folder):
    run = folder / (model + "-run")
    subprocess.run([gsapp, "train", "-s", scene, "--eval", "--device", "cpu", "--quiet", "--appearance", model, "--iterations", str(ITERATIONS[model]),
                    "--init-points", "2000", "--cap-max", "2000", "-m", run], check=True, capture_output=True)
    site = folder / model
    subprocess.run([gsapp, "export", run, "--format", "web", "-o", site], check=True, capture_output=True)
    subprocess.run([gsapp, "render", run, "--decompose", "-o", site / "reference"], check=True, capture_output=True)


def compare(browser, url, model):
    open_viewer(browser, f"{url}{model}/")
    for mode in MODES:
        values = []
        for view in VIEWS:
            pixels = f"(await gsapp.testViewPixels({view}, '{mode}')).pixels"
            brightest = browser.evaluate(f"(async () => {pixels}.reduce((most, v, i) => i % 4 < 3 ? Math.max(most, v) : most, 0))()")
            check(brightest > 20 or (model, mode) == ("none", "residual"), f"{model}: view {view} shows something in {mode}")
            values.append(browser.evaluate(PSNR % (pixels, f"reference/{mode}/{view:05}.png")))
        print(f"{model:14} {mode:9} " + " ".join(f"{v:6.2f}" for v in values) + " dB", flush=True)
        check(min(values) >= LEAST_PSNR, f"{model} {mode}: PSNR of at least {LEAST_PSNR} dB against gsapp's own picture")


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    if "GSAPP_TEST_DATA" not in os.environ:
        print("skipped: GSAPP_TEST_DATA is not set")
        return 77
    gsapp, scene = sys.argv[1], pathlib.Path(os.environ["GSAPP_TEST_DATA"]) / "tiny/lego"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for model in ITERATIONS:
            export(gsapp, scene, model, folder)
        site = Site(folder)
        browser = Browser(program, flags=SOFTWARE_WEBGL)
        try:
            for model in ITERATIONS:
                compare(browser, site.url, model)
            check(browser.errors == [], f"the console is silent: {browser.errors}")
        finally:
            browser.close()
    print("passed")
    return 0


sys.exit(main())
