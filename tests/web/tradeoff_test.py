# SPDX-License-Identifier: Apache-2.0
"""Opens the page of `gsapp tradeoff` in a headless Chromium.

Usage: tradeoff_test.py GSAPP [SCREENSHOT.png FOLDER]
Without a folder it makes a tiny trade-off; with one it shows that and saves what it saw. Exit status 77: no Chromium here.
"""

import pathlib
import subprocess
import sys
import tempfile

from browser import Browser, check, check_stands_alone, find_chromium


def make_tradeoff(gsapp, folder):
    subprocess.run(
        [
            gsapp,
            "tradeoff",
            "-s",
            "builtin:glossy",
            "--device",
            "cpu",
            "-r",
            "8",
            "--axes",
            "appearance=none,sv",
            "iterations=2,20",
            "--quiet",
            "-m",
            folder,
        ],
        check=True,
        capture_output=True,
    )


def check_page(browser, url):
    browser.open(url)
    check(browser.evaluate("document.querySelectorAll('table tbody tr').length") >= 2, "the table has the runs")
    check(browser.evaluate("document.querySelectorAll('svg').length") >= 3, "there is a plot for each cost")
    words = browser.evaluate("[...document.querySelectorAll('li strong')].map(e => e.textContent).join()")
    check(words == "best,smallest,fastest", f"the three recommendations are there, not {words}")
    check(browser.evaluate("document.querySelectorAll('svg .front').length") >= 3, "each plot has its front")
    outside = browser.evaluate(
        """[...document.querySelectorAll('svg')].flatMap(s => {
        const frame = s.getBoundingClientRect();
        return [...s.querySelectorAll('g text')].filter(t => {
            const box = t.getBoundingClientRect();
            return box.left < frame.left || box.right > frame.right || box.bottom > frame.bottom;
        }).map(t => t.textContent);
    })"""
    )
    check(outside == [], f"labels lie inside their plot: {outside}")
    grey = "getComputedStyle(document.querySelector('svg .dominated') || document.body).color"
    if browser.evaluate("!!document.querySelector('svg .dominated')"):
        check(
            browser.evaluate(grey)
            != browser.evaluate("getComputedStyle(document.querySelector('svg .series0')).color"),
            "dominated points are grey",
        )


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    gsapp, screenshot, folders = sys.argv[1], sys.argv[2:3], sys.argv[3:]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(folders[0] if folders else name)
        if not folders:
            make_tradeoff(gsapp, folder)
        url = (folder / "tradeoff.html").resolve().as_uri()
        with Browser(program, width=1600) as browser:
            check_page(browser, url)
            if screenshot:
                browser.screenshot(screenshot[0], 0.58)
            check_stands_alone(browser, url)
    print("passed")
    return 0


sys.exit(main())
