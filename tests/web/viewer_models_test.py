# SPDX-License-Identifier: Apache-2.0
"""Compares pictures of the web viewer with gsapp's own, for every appearance model.

Usage: viewer_models_test.py GSAPP SCENE. Exit status 77: no Chromium here.
"""

import pathlib
import subprocess
import sys
import tempfile

from browser import Browser, find_chromium
from site_server import SOFTWARE_WEBGL, Site, check, open_viewer

# Degrees of sh and neural join at iterations 1000, 2000 and 3000.
ITERATIONS = {"none": 300, "sv": 1200, "nasg": 1200, "nasgabor": 1200, "sh": 3200, "neural": 3200}
VIEWS = (0, 4, 8)
MODES = ("full", "base", "residual")
LEAST_PSNR = 38

PSNR = """(async () => {
  const seen = await gsapp.testViewPixels(%d, '%s');
  const reference = await createImageBitmap(await (await fetch('reference/%s/%05d.png')).blob(), { colorSpaceConversion: 'none' });
  const context = new OffscreenCanvas(seen.width, seen.height).getContext('2d');
  context.drawImage(reference, 0, 0);
  const wanted = context.getImageData(0, 0, seen.width, seen.height).data;
  let sum = 0, n = 0;
  for (let i = 0; i < wanted.length; ++i) if (i %% 4 < 3) { sum += ((wanted[i] - seen.pixels[i]) / 255) ** 2; ++n; }
  return [reference.width === seen.width && reference.height === seen.height, 10 * Math.log10(n / Math.max(sum, 1e-12)), wanted.some((v, i) => i %% 4 < 3 && v > 8)];
})()"""


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
            same_size, psnr, visible = browser.evaluate(PSNR % (view, mode, mode, view))
            check(same_size, f"{model}: view {view} has its own size")
            check(visible or (model, mode) == ("none", "residual"), f"{model}: view {view} shows something in {mode}")
            values.append(psnr)
        print(f"{model:9} {mode:9} " + " ".join(f"{v:6.2f}" for v in values) + " dB", flush=True)
        check(min(values) >= LEAST_PSNR, f"{model} {mode}: PSNR of at least {LEAST_PSNR} dB against gsapp's own picture")


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    gsapp, scene = sys.argv[1:3]
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
