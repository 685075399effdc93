# SPDX-License-Identifier: Apache-2.0
"""Shows a model in a headset that an emulator of WebXR stands for: both eyes, sticks, and back to the page.

Usage: viewer_headset_test.py VIEWER. VIEWER is apps/viewer/dist after scripts/build-viewer. Exit status 77: no
Chromium, no viewer there, or no emulator.
"""

import pathlib
import shutil
import sys
import tempfile

from browser import Browser, check, check_accessible, find_chromium
from site_server import SOFTWARE_WEBGL, Site, open_viewer, wait_for
from viewer_scenes import BACKGROUND, message, scene_file

EMULATOR = pathlib.Path(__file__).resolve().parents[2] / "apps/viewer/node_modules/iwer/build/iwer.min.js"
# Pictures stay readable after they were shown.
PUT_ON = """
const contextOf = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) { return contextOf.call(this, kind, { ...options, preserveDrawingBuffer: true }); };
window.device = new IWER.XRDevice(IWER.metaQuest3);
device.installRuntime({ forceInstall: true });
device.stereoEnabled = true;
device.position.set(0, 0, 0);
const ask = XRSession.prototype.requestAnimationFrame;
XRSession.prototype.requestAnimationFrame = function (draw) { ++window.numFrames; return ask.call(this, draw); };
window.numFrames = 0;
"""
BUTTON = "document.getElementById('enter-vr')"
# Of each half of the canvas: the share that the ball covers, and its middle from left to right, from 0 to 1.
EYES = """(() => {
    const canvas = document.getElementById('canvas'), gl = canvas.getContext('webgl2'), [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight], all = new Uint8Array(4 * w * h);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
    const half = w >> 1, sums = [[0, 0], [0, 0]];
    for (let i = 0; i < w * h; ++i) {
        const x = i %% w, side = sums[Number(x >= half)];
        if (%s.every((c, k) => Math.abs(all[4 * i + k] - c) <= 1)) continue;
        side[0] += 1;
        side[1] += (x %% half) / half;
    }
    return sums.map(([count, along]) => [count / (half * h), along / count]);
})()""" % [
    round(255 * x) for x in BACKGROUND
]


def eyes(browser):
    """What the eyes see, after some frames."""
    frames = browser.evaluate("numFrames")
    wait_for(browser, f"numFrames > {frames + 5}", "the headset asks for frames")
    return browser.evaluate(EYES)


def check_without(program, site):
    with Browser(program, width=400, height=300, flags=SOFTWARE_WEBGL) as browser:
        open_viewer(browser, site.url)
        check(not browser.evaluate(f"{BUTTON}.checkVisibility()"), "without a headset there is no button")


def check_headset(program, site):
    with Browser(program, width=640, height=360, flags=SOFTWARE_WEBGL) as browser:
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=EMULATOR.read_text() + PUT_ON)
        open_viewer(browser, site.url)
        wait_for(
            browser,
            f"{BUTTON}.checkVisibility() && {BUTTON}.textContent === 'Enter VR'",
            "with a headset there is a button",
        )
        check_accessible(browser, "with a headset")
        browser.call("Runtime.evaluate", expression=f"{BUTTON}.click()", userGesture=True)
        wait_for(browser, f"{BUTTON}.textContent === 'Leave VR'", "it is entered")
        (left, at_left), (right, at_right) = first = eyes(browser)
        check(0.02 < left < 0.6 and abs(left - right) < 0.1 * left, f"both eyes see the ball: {first}")
        check(at_left > at_right + 0.01, f"the left eye has it farther to the right: {first}")
        browser.evaluate("device.position.set(0, 0, -0.7)")
        near = eyes(browser)
        check(
            near[0][0] > 1.5 * left and near[1][0] > 1.5 * right,
            f"a head that comes closer sees it larger: {near}, before {first}",
        )
        browser.evaluate("device.position.set(0, 0, 0)")
        first = eyes(browser)
        # Until it is seen: a frame that takes long moves no farther than one of a tenth of a second.
        browser.evaluate("device.controllers.left.updateAxes('thumbstick', 0, -1)")
        wait_for(browser, f"{EYES}[0][0] > {1.1 * first[0][0]}", f"a stick moves forward, before {first}")
        browser.evaluate("device.controllers.left.updateAxes('thumbstick', 0, 0)")
        moved = eyes(browser)
        browser.evaluate("device.controllers.right.updateAxes('thumbstick', 1, 0)")
        turned = eyes(browser)
        browser.evaluate("device.controllers.right.updateAxes('thumbstick', 0, 0)")
        check(turned[0][0] != moved[0][0], f"the other one turns: {turned}, before {moved}")
        browser.evaluate(f"{BUTTON}.click()")
        wait_for(browser, f"{BUTTON}.textContent === 'Enter VR'", "it is left")
        browser.evaluate("document.getElementById('reset').click()")
        whole = browser.evaluate("gsapp.testViewPixels(0, 'full').then(v => v.pixels.some(p => p > 100))")
        check(
            whole
            and message(browser) == ""
            and browser.evaluate("document.getElementById('canvas').closest('#stage') !== null"),
            "the page draws again",
        )
        check(browser.errors == [], f"the console is silent: {browser.errors}")


def main():
    program, viewer = find_chromium(), pathlib.Path(sys.argv[1])
    if program is None or not (viewer / "index.html").exists() or not EMULATOR.exists():
        print(
            "skipped: no chromium on PATH, the viewer is not built (scripts/build-viewer), or there is no emulator (npm ci in apps/viewer)"
        )
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name) / "site"
        shutil.copytree(viewer, folder)
        (folder / "scene.ngsplat").write_bytes(scene_file(1000))
        site = Site(folder)
        check_without(program, site)
        check_headset(program, site)
    print("passed")
    return 0


sys.exit(main())
