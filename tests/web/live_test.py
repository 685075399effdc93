# SPDX-License-Identifier: Apache-2.0
"""Watches a training in the browser: the picture and the curves change, the buttons pause, save and stop it, and the
page outlives it.

Usage: live_test.py GSAPP. Exit status 77: no Chromium, or GSAPP has no viewer.
"""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time

from browser import PATIENCE, Browser, check, check_accessible, find_chromium
from site_server import SOFTWARE_WEBGPU, wait_for

STATE = "document.getElementById('live-state').textContent"
MIDDLE = "gsapp.testViewPixels(0, 'full').then(v => [...v.pixels.slice(4 * v.width * (v.height >> 1), 4 * v.width * ((v.height >> 1) + 1))])"


class Program:
    """gsapp with its lines of output as they come."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen(
            [str(a) for a in arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.lines = []
        self.reader = threading.Thread(
            target=lambda: self.lines.extend(iter(self.process.stdout.readline, "")), daemon=True
        )
        self.reader.start()

    def address(self):
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            for line in list(self.lines):
                if found := re.search(r"http://127\.0\.0\.1:\d+/\S*", line):
                    return found[0].rstrip('"}')
            if self.process.poll() is not None:
                break
            time.sleep(0.05)
        raise AssertionError(f"gsapp prints an address, not {self.lines}")

    def exit_code(self):
        code = self.process.wait(60)
        self.reader.join()
        return code


def points_of(name):
    """How many points a curve has, as an expression."""
    return (
        f"(document.querySelector('#{name} polyline')?.getAttribute('points') ?? '').split(' ').filter(p => p).length"
    )


def press(browser, button):
    browser.evaluate(f"document.getElementById('{button}').click()")


def check_curves_grow(browser):
    counts = {name: browser.evaluate(points_of(name)) for name in ("live-loss", "live-psnr")}
    for name, count in counts.items():
        wait_for(browser, f"{points_of(name)} > {count}", f"{name} grows beyond {count} points")


def check_training(browser, run):
    wait_for(
        browser, f"{STATE}.includes('Iteration') && document.body.classList.contains('loaded')", "the training is shown"
    )
    check("token" not in browser.evaluate("location.href"), "the address bar does not show the token")
    check(browser.evaluate("document.getElementById('name').textContent") == "glossy", "with the scene's name")
    first = browser.evaluate(MIDDLE)
    wait_for(browser, f"{points_of('live-loss')} > 2", "the loss is a curve")
    wait_for(browser, f"{points_of('live-psnr')} > 1", "and so is the PSNR")
    check(
        "test views" in browser.evaluate("document.querySelector('#live-psnr figcaption').textContent"),
        "which says of what it is",
    )
    # A picture comes every few seconds, so the curves may grow for a while before it does.
    deadline = time.monotonic() + PATIENCE
    while browser.evaluate(MIDDLE) == first:
        check(time.monotonic() < deadline, "the picture changes")
        time.sleep(0.2)
    # Frames wait until the next picture has come: a comparison leaves WebGPU when it draws that one, and the picture
    # must come again.
    browser.evaluate(
        "{ window.frame = requestAnimationFrame; window.waiting = []; window.requestAnimationFrame = (draw) => waiting.push(draw); }"
    )
    browser.evaluate("document.getElementById('next').click()")
    browser.evaluate("document.getElementById('compare-on').click()")
    check(
        browser.evaluate("document.getElementById('compare-right').value") == "photograph",
        "a test view can be compared with its photograph",
    )
    wait_for(browser, "gsapp.way === 'WebGL2'", "comparisons are drawn by WebGL2")
    browser.evaluate("{ window.requestAnimationFrame = frame; waiting.forEach((draw) => frame(draw)); }")
    wait_for(browser, "document.getElementById('label-right').textContent === 'Photograph'", "which is shown beside it")
    version = "document.getElementById('live-info').innerText.match(/iteration\\s+([\\d,]+)/)[1]"
    before = browser.evaluate(version)
    wait_for(browser, f"{version} !== '{before}'", "a newer picture comes")
    check(
        browser.evaluate("document.getElementById('camera').value") == "1",
        "the camera stays where it is while pictures come",
    )
    check(
        browser.evaluate("document.getElementById('label-right').textContent") == "Photograph",
        "and so does the comparison",
    )
    browser.evaluate("document.getElementById('compare-on').click()")
    check_curves_grow(browser)
    check_accessible(browser, "while it trains")

    browser.evaluate("document.getElementById('live-pause').click()")
    wait_for(browser, f"{STATE}.startsWith('Paused')", "it pauses")
    paused = browser.evaluate(STATE)
    time.sleep(1.5)
    check(browser.evaluate(STATE) == paused, "and stays where it is")
    check_accessible(browser, "while it pauses")
    browser.evaluate("document.getElementById('live-save').click(); document.getElementById('live-pause').click()")
    wait_for(browser, f"{STATE}.startsWith('Iteration')", "it goes on")
    wait_for(browser, "/Saved\\s*iteration [\\d,]+00/.test(document.getElementById('live-info').innerText)", "it saves")
    check(
        list((run / "checkpoints").glob("*00.safetensors")) and list((run / "point_cloud").glob("*00/point_cloud.ply")),
        "a checkpoint and a point cloud",
    )

    # Without a clock, as the question goes away while the page is looked at.
    browser.evaluate(
        "{ const clock = setTimeout; window.setTimeout = () => 0; document.getElementById('live-stop').click(); window.setTimeout = clock; }"
    )
    check(
        browser.evaluate("document.getElementById('live-stop').textContent") == "Really stop?",
        "it asks before it stops",
    )
    check_accessible(browser, "while it asks")
    # Once it stops, the page may ask when nobody answers any more, which the console reports.
    check(browser.errors == [], f"the console is silent while it trains: {browser.errors}")
    press(browser, "live-stop")
    wait_for(browser, f"{STATE}.startsWith('Stopped') || {STATE}.includes('does not answer')", "it stops")


def check_after(browser, gsapp, run, port):
    wait_for(browser, f"{STATE}.includes('gsapp view')", "the page says what shows the run now")
    check(
        browser.evaluate("document.body.classList.contains('loaded')") and max(browser.evaluate(MIDDLE)) > 0,
        "its picture stays",
    )
    check(browser.evaluate("document.getElementById('live-buttons').hidden"), "without buttons")
    check_accessible(browser, "after the training")
    saved = Program(gsapp, "view", run, "--port", port)
    saved.address()
    wait_for(
        browser,
        f"{STATE}.startsWith('Saved at iteration')",
        "and it goes on with the program that serves the run again",
    )
    check(browser.evaluate(points_of("live-loss")) > 2, "with the curve that was")
    wait_for(
        browser,
        "document.getElementById('live-info').innerText.includes('Picture of iteration')",
        "whose picture is shown, too",
    )
    browser.evaluate(
        "fetch('live/status.json').then(r => r.json()).then(s => fetch(s.model.url)).then(r => r.blob()).then(b => { keptModel = b; })"
    )
    saved.process.terminate()
    check(saved.exit_code() == 0, "which Ctrl-C ends")
    before = browser.evaluate(MIDDLE)
    browser.evaluate(
        """{ const input = document.getElementById('file'), transfer = new DataTransfer();
        transfer.items.add(new File([keptModel], 'kept.ngsplat'));
        input.files = transfer.files;
        input.dispatchEvent(new Event('change')); }"""
    )
    wait_for(
        browser,
        "document.getElementById('camera').value === '0' && document.getElementById('notice').hidden",
        "a file is opened at its first view",
    )
    check(browser.evaluate(MIDDLE) == before, "and is drawn, although nobody serves the page any more")


def check_point_cloud(browser, gsapp, run):
    ply = next(run.glob("point_cloud/*/point_cloud.ply"))
    program = Program(gsapp, "view", ply, "--port", 0)
    browser.open(program.address())
    wait_for(browser, "document.body.classList.contains('loaded') && window.gsapp", "a bare point cloud is shown")
    check(browser.evaluate("document.getElementById('name').textContent") == "point_cloud", "by its name")
    check(browser.evaluate("document.getElementById('camera').disabled"), "without test views")
    program.process.terminate()
    check(program.exit_code() == 0, "until Ctrl-C")


def check_killed(browser, gsapp, run):
    """A training that ends without a word."""
    training = Program(gsapp, *train_arguments(run), "--view", 0)
    try:
        browser.open(training.address())
        wait_for(
            browser,
            f"{STATE}.includes('Iteration') && document.body.classList.contains('loaded')",
            "another training is shown",
        )
        check(not browser.evaluate("document.getElementById('live-buttons').hidden"), "with buttons")
    finally:
        training.process.kill()
        training.exit_code()
    wait_for(
        browser, f"{STATE}.includes('does not answer')", "when it is killed, the page says that it does not answer"
    )
    check(f"gsapp view {run}" in browser.evaluate(STATE), f"and what shows the run: {browser.evaluate(STATE)}")
    check(browser.evaluate("document.getElementById('live-buttons').hidden"), "the buttons are gone")
    left = browser.evaluate(MIDDLE)
    time.sleep(2.5)  # the page looks again and again
    check(
        browser.evaluate("document.body.classList.contains('loaded')")
        and max(left) > 0
        and browser.evaluate(MIDDLE) == left,
        "the picture stays",
    )


def check_normal_end(browser, gsapp, run):
    """A training that ends by itself, while the page looks."""
    training = Program(
        gsapp,
        "train",
        "-s",
        "builtin:glossy",
        "-m",
        run,
        "--device",
        "cpu",
        "--threads",
        1,
        "-r",
        8,
        "--time-limit",
        "8s",
        "--init-points",
        500,
        "--cap-max",
        1000,
        "--eval",
        "--view",
        0,
    )
    try:
        browser.open(training.address())
        wait_for(browser, f"{STATE}.startsWith('Finished after')", "the page says that the training has finished")
        check(training.exit_code() == 0, f"it ends by itself: {training.lines[-3:]}")
    finally:
        training.process.kill()
    wait_for(browser, f"{STATE}.includes('gsapp view {run}')", "and then what shows the run")
    check(
        browser.evaluate(STATE).startswith("Finished after"),
        f"and still that it has finished: {browser.evaluate(STATE)}",
    )


def check_finished(browser, gsapp, run):
    """A run of which nobody looked at the training."""
    subprocess.run(
        [
            gsapp,
            "train",
            "-s",
            "builtin:glossy",
            "-m",
            run,
            "--device",
            "cpu",
            "-r",
            "8",
            "--init-points",
            "500",
            "--iterations",
            "200",
            "--eval",
            "--quiet",
        ],
        check=True,
        capture_output=True,
    )
    program = Program(gsapp, "view", run, "--port", 0)
    browser.open(program.address())
    wait_for(
        browser,
        f"{STATE} === 'Saved at iteration 200' && document.body.classList.contains('loaded')",
        "a finished run is shown",
    )
    check(
        browser.evaluate("document.getElementById('name').textContent") == "glossy"
        and max(browser.evaluate(MIDDLE)) > 0,
        "with its scene",
    )
    check(browser.evaluate("document.getElementById('live-buttons').hidden"), "nothing can be paused")
    check(not browser.evaluate("document.getElementById('camera').disabled"), "there are test views")
    check_accessible(browser, "a finished run")
    program.process.terminate()
    check(program.exit_code() == 0, "until Ctrl-C")


def train_arguments(run):
    """The arguments of a training that does not end by itself."""
    return [
        "train",
        "-s",
        "builtin:glossy",
        "-m",
        run,
        "--device",
        "cpu",
        "--threads",
        1,
        "--iterations",
        1000000,
        "--init-points",
        500,
        "--cap-max",
        1000,
        "--eval",
    ]


def main():
    chromium, gsapp = find_chromium(), sys.argv[1]
    if chromium is None:
        print("skipped: no chromium on PATH")
        return 77
    with tempfile.TemporaryDirectory() as name:
        run = pathlib.Path(name) / "run"
        training = Program(gsapp, *train_arguments(run), "--view", 0)
        try:
            try:
                address = training.address()
            except AssertionError:
                if any("viewer is not built" in line for line in training.lines):
                    print("skipped: the viewer is not built (scripts/build-viewer)")
                    return 77
                raise
            with Browser(chromium, width=800, height=600, flags=SOFTWARE_WEBGPU) as browser:
                browser.open(address)
                if browser.evaluate("navigator.gpu?.requestAdapter().then((adapter) => adapter !== null)"):
                    browser.open(address + "&gpu=webgpu")  # which the comparison leaves
                check_training(browser, run)
                check(training.exit_code() == 130, f"as Ctrl-C would: {training.lines[-3:]}")
                others = [e for e in browser.errors if "ERR_CONNECTION_REFUSED" not in e]
                check(others == [], f"and while it stops: {others}")
                elsewhere = [
                    r for r in browser.requests if not r.startswith((address.split("?")[0], "blob:", "about:"))
                ]
                check(elsewhere == [], f"the page asks gsapp alone: {elsewhere}")
                check_after(browser, gsapp, run, re.search(r":(\d+)/", address)[1])
                check_point_cloud(browser, gsapp, run)
                check_killed(browser, gsapp, run.with_name("killed"))
                check_normal_end(browser, gsapp, run.with_name("ended"))
                check_finished(browser, gsapp, run.with_name("finished"))
        finally:
            training.process.kill()
    print("passed")
    return 0


sys.exit(main())
