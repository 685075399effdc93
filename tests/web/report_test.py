# SPDX-License-Identifier: Apache-2.0
"""Opens the page of `gsapp eval --html` in a headless Chromium.

Usage: report_test.py GSAPP [SCREENSHOT.png RUN...]
Without runs it trains two tiny ones; with them it shows these and saves what it saw. Exit status 77: no Chromium here.
"""

import pathlib
import subprocess
import sys
import tempfile

from browser import Browser, check, check_stands_alone, find_chromium

ARROW_RIGHT, ARROW_DOWN, END, TAB = ("ArrowRight", 39), ("ArrowDown", 40), ("End", 35), ("Tab", 9)


def make_report(gsapp, folder, runs):
    page = folder / "report.html"
    if not runs:
        for appearance in ("none", "sv"):
            subprocess.run(
                [
                    gsapp,
                    "train",
                    "-s",
                    "builtin:glossy",
                    "--device",
                    "cpu",
                    "--eval",
                    "-r",
                    "8",
                    "--iterations",
                    "5",
                    "--init-points",
                    "500",
                    "--cap-max",
                    "1000",
                    "--appearance",
                    appearance,
                    "--quiet",
                    "-m",
                    folder / appearance,
                ],
                check=True,
                capture_output=True,
            )
        runs = [folder / "none", folder / "sv"]
        subprocess.run(
            [gsapp, "bench", "frames", runs[1], "--frame-repeat", "1", "--device", "cpu"],
            check=True,
            capture_output=True,
        )
    subprocess.run([gsapp, "eval", *runs, "--html", page], check=True, capture_output=True)
    return page


def check_page(browser, url, shown):
    browser.open(url)
    check(browser.evaluate("document.querySelectorAll('table tbody tr').length") >= 2, "the table has the runs")
    check("PSNR" in browser.evaluate("document.querySelector('table thead').textContent"), "the table has PSNR")
    check(
        browser.evaluate("document.querySelector('.protocol').textContent").startswith("protocol "),
        "the protocol stands below it",
    )
    frames = browser.evaluate("document.getElementById('frames').innerText")
    check("median ms" in frames and "1280x720" in frames, f"frame times are there, not {frames}")
    check(shown or "Not measured: none." in frames, f"runs without frame times are named, not {frames}")
    models = browser.evaluate(
        "[...new Set([...document.querySelectorAll('#stability tbody th')].map(cell => cell.textContent))]"
    )
    check(
        shown or ("relu" in models and "sv" in models and "nasg" not in models),
        f"the stability table is of the runs' models, not {models}",
    )
    check(
        browser.evaluate("document.querySelectorAll('svg circle').length") >= 4, "two plots have a point for each run"
    )
    check(not browser.evaluate("document.getElementById('views').hidden"), "the pictures are shown")
    check(
        browser.evaluate(
            "Promise.all([...document.images].map(i => i.decode())).then(() => [...document.images].every(i => i.naturalWidth > 0))"
        ),
        "the pictures can be decoded",
    )
    layers = browser.evaluate("[...document.getElementById('left-layer').options].map(o => o.value).join()")
    check(layers == "full,base,residual,reference,error", f"all five kinds of pictures are there, not {layers}")


def check_keyboard(browser):
    # Every control is reached by Tab alone, and has a name.
    browser.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(40):
        browser.press(*TAB)
        reached.add(browser.evaluate("document.activeElement.id"))
    controls = set(browser.evaluate("[...document.querySelectorAll('select, input')].map(c => c.id)"))
    check(controls <= reached, f"not reached by keyboard: {controls - reached}")
    nameless = browser.evaluate(
        "[...document.querySelectorAll('select, input')].filter(c => !c.labels.length && !c.ariaLabel).map(c => c.id)"
    )
    check(nameless == [], f"without a label: {nameless}")

    at = "getComputedStyle(document.getElementById('compare')).getPropertyValue('--at')"
    browser.evaluate("document.getElementById('slider').focus()")
    check(browser.evaluate(at) == "50%", "the slider starts in the middle")
    browser.press(*ARROW_RIGHT)
    check(browser.evaluate(at) == "51%", "an arrow key moves the picture's border")
    browser.press(*END)
    check(browser.evaluate(at) == "100%", "End moves it to the end")
    check(
        browser.evaluate("document.getElementById('slider').getAttribute('aria-valuetext')") == "100 % left picture",
        "and says so",
    )

    # From the photograph, where the page begins, to the error.
    browser.evaluate("document.getElementById('left-layer').focus()")
    before = browser.evaluate("document.getElementById('left').src")
    browser.press(*ARROW_DOWN)
    check(browser.evaluate("document.getElementById('left').src") != before, "the picture changes with the choice")
    check(
        "4 times" in browser.evaluate("document.getElementById('explain').textContent"), "the error's factor is named"
    )


def check_dark(browser):
    background = "getComputedStyle(document.body).backgroundColor"
    colours = []
    for scheme in ("light", "dark"):
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        colours.append(browser.evaluate(background))
    check(colours[0] != colours[1], f"dark and light differ, not {colours}")
    browser.call("Emulation.setEmulatedMedia", features=[])


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    gsapp, screenshot, runs = sys.argv[1], sys.argv[2:3], sys.argv[3:]
    with tempfile.TemporaryDirectory() as name:
        page = make_report(gsapp, pathlib.Path(name), runs)
        url = page.resolve().as_uri()
        with Browser(program, width=1600) as browser:
            check_page(browser, url, runs)
            if screenshot:
                browser.screenshot(screenshot[0], 0.58)
            check_keyboard(browser)
            check_dark(browser)
            check_stands_alone(browser, url)
    print("passed")
    return 0


sys.exit(main())
