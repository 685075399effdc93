# SPDX-License-Identifier: Apache-2.0
"""Compares two pictures in the web viewer: what stands left and right of the divider, and what cannot be shown.

Usage: viewer_compare_test.py GSAPP. Exit status 77: no Chromium, or a gsapp without the viewer.
"""

import base64
import json
import pathlib
import subprocess
import sys
import tempfile
import time

from browser import PATIENCE, Browser, find_chromium, check, check_accessible
from site_server import DECODED, FEWER_PIXELS, PIXELS_OF, SOFTWARE_WEBGL, Site, open_viewer, wait_for

SCENE = [
    "-s",
    "builtin:glossy",
    "--eval",
    "--device",
    "cpu",
    "--quiet",
    "--init-points",
    "500",
    "--cap-max",
    "800",
    "--iterations",
    "200",
]
WIDTH, HEIGHT = 160, 120  # of a test view
VIEW = 3
TAB, LEFT, RIGHT, END, HOME, PAGE_DOWN = (
    ("Tab", 9),
    ("ArrowLeft", 37),
    ("ArrowRight", 39),
    ("End", 35),
    ("Home", 36),
    ("PageDown", 34),
)
FRAME = "new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(resolve)))"
# Bytes of a promise of an array, as text.
TEXT = "(async () => { let text = ''; for (const byte of %s) text += String.fromCharCode(byte); return btoa(text); })()"


def run_gsapp(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, capture_output=True)


def build_site(gsapp, folder):
    for model in ("sh", "none"):
        run_gsapp(gsapp, "train", *SCENE, "--appearance", model, "-m", folder / model)
    run_gsapp(gsapp, "export", folder / "sh", folder / "none", "--photographs", "-o", folder / "site")
    return folder / "site"


class Picture:
    """Rgba bytes of the size of a test view."""

    def __init__(self, browser, expression):
        self.data = base64.b64decode(browser.evaluate(TEXT % f"(await {expression})"))
        check(
            len(self.data) == 4 * WIDTH * HEIGHT, f"a picture of {WIDTH} x {HEIGHT}, not of {len(self.data) / 4} pixels"
        )

    def difference(self, other, first=0, end=WIDTH):
        """The largest and the mean one between two pictures in some columns."""
        all_of_them = [
            abs(self.data[i] - other.data[i])
            for y in range(HEIGHT)
            for i in range(4 * (WIDTH * y + first), 4 * (WIDTH * y + end))
            if i % 4 < 3
        ]
        return max(all_of_them), sum(all_of_them) / len(all_of_them)


def mode_picture(browser, mode):
    return Picture(browser, f"gsapp.testViewPixels({VIEW}, '{mode}').then(v => v.pixels)")


def screen_picture(browser):
    """What the canvas shows, without what lies over it."""
    browser.evaluate(FRAME)
    browser.evaluate("document.querySelectorAll('#divider, .side, #meter').forEach(e => e.style.visibility = 'hidden')")
    shot = browser.call(
        "Page.captureScreenshot", format="png", clip={"x": 0, "y": 0, "width": WIDTH, "height": HEIGHT, "scale": 1}
    )["data"]
    browser.evaluate("document.querySelectorAll('#divider, .side, #meter').forEach(e => e.style.visibility = '')")
    return Picture(browser, DECODED % f"new Blob([Uint8Array.from(atob('{shot}'), c => c.charCodeAt(0))])")


def fit_canvas(browser):
    """Makes the canvas as large as a test view, as it can be where the page is the picture alone (?embed)."""
    browser.evaluate("document.body.classList.add('embedded')")
    browser.call("Emulation.setDeviceMetricsOverride", width=WIDTH, height=HEIGHT, deviceScaleFactor=1, mobile=False)
    wait_for(
        browser,
        f"document.getElementById('canvas').width === {WIDTH} && document.getElementById('canvas').height === {HEIGHT}",
        "the canvas has the test view's size",
    )


def choose(browser, **values):
    """Changes selects and the checkbox as a person does: with events."""
    for name, value in values.items():
        browser.evaluate(
            f"""(() => {{
            const control = document.getElementById('{name.replace("_", "-")}');
            if (control.type === 'checkbox') {{ if (control.checked !== {json.dumps(value)}) control.click(); return; }}
            control.value = {json.dumps(value)};
            control.dispatchEvent(new Event('change', {{ bubbles: true }}));
        }})()"""
        )


def label(browser, side):
    return browser.evaluate(f"document.getElementById('label-{side}').textContent")


def wait_for_label(browser, side, text):
    wait_for(
        browser,
        f"document.getElementById('label-{side}').textContent.includes({json.dumps(text)})",
        f"the label at the {side} says '{text}'",
    )


def divider(browser):
    return int(browser.evaluate("document.getElementById('divider').ariaValueNow"))


def open_site(browser, site, query=""):
    open_viewer(browser, site.url + query)
    fit_canvas(browser)
    choose(browser, camera=str(VIEW), compare_on=True)


def check_sides(browser, site):
    """Pixels left and right of the divider, for every kind of picture."""
    open_viewer(browser, site.url + "?model=scene-2.ngsplat")
    fit_canvas(browser)
    wanted = {"other": mode_picture(browser, "full")}
    open_site(browser, site)
    for mode in ("full", "base", "residual", "depth"):
        wanted[mode] = mode_picture(browser, mode)
    wanted["photograph"] = Picture(browser, PIXELS_OF % f"photographs/{VIEW:05}.png")
    pairs = [
        ("full", "base"),
        ("residual", "depth"),
        ("full", "other"),
        ("photograph", "other"),
        ("depth", "photograph"),
    ]
    for left, right in pairs:
        half = WIDTH // 2
        apart = [wanted[left].difference(wanted[right], *columns)[0] for columns in ((0, half), (half, WIDTH))]
        check(min(apart) > 5, f"{left} and {right} differ in both halves, or nothing is tested: {apart}")
        choose(browser, compare_left=left, compare_right=right)
        wait_for_label(browser, "right", {"other": "none", "photograph": "Photograph"}.get(right, "sh: " + right))
        wait_for(
            browser,
            "![...document.querySelectorAll('.side')].some(e => e.textContent.includes('. '))",
            f"{left} and {right} are there",
        )
        deadline = time.monotonic() + PATIENCE
        while True:  # the second model may still be sorted
            shown = screen_picture(browser)
            at_left, at_right = shown.difference(wanted[left], 0, half), shown.difference(wanted[right], half, WIDTH)
            if max(at_left[0], at_right[0]) <= 1 or time.monotonic() > deadline:
                break
        print(f"{left:10} | {right:10} largest differences {at_left[0]} and {at_right[0]} of 255", flush=True)
        check(at_left[0] <= 1 and at_right[0] <= 1, f"left of the divider is {left}, right of it {right}")
    help_text = browser.evaluate("document.getElementById('compare-help').textContent")
    choose(browser, compare_left="full", compare_right="other")
    browser.evaluate(FRAME)
    both = browser.evaluate("document.getElementById('compare-help').textContent")
    check("Both models are in memory" in both and both.count("MB") == 2, f"the memory of two models is told: {both}")
    check("memory" not in help_text, f"that of one is not: {help_text}")
    return wanted


def check_divider(browser, wanted):
    choose(browser, compare_left="full", compare_right="depth")

    def check_at(column, what):
        shown = screen_picture(browser)
        check(
            shown.difference(wanted["full"], 0, column)[0] <= 1, f"{what}: left of column {column} is the left picture"
        )
        check(shown.difference(wanted["depth"], column, WIDTH)[0] <= 1, f"{what}: right of it the right one")

    for kind, x in (("mousePressed", 80), ("mouseMoved", 60), ("mouseMoved", 40), ("mouseReleased", 40)):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=20, button="left", buttons=1, clickCount=1)
    check(divider(browser) == 25, f"dragged to a quarter, not {divider(browser)} %")
    check_at(40, "with the mouse")
    for kind, points in (("touchStart", [40]), ("touchMove", [80]), ("touchMove", [120]), ("touchEnd", [])):
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": 100} for x in points])
    check(divider(browser) == 75, f"dragged to three quarters with a finger, not {divider(browser)} %")
    check_at(120, "with a finger")
    check(browser.evaluate("document.getElementById('camera').value") == str(VIEW), "the camera stays where it is")

    browser.evaluate("document.activeElement.blur()")
    for _ in range(60):
        browser.press(*TAB)
        if browser.evaluate("document.activeElement.id") == "divider":
            break
    check(browser.evaluate("document.activeElement.id") == "divider", "the divider is reached by keyboard")
    positions = []
    for key in (HOME, RIGHT, END, LEFT, PAGE_DOWN):
        browser.press(*key)
        positions.append(divider(browser))
    check(positions == [0, 1, 100, 99, 89], f"keys move it: {positions}")
    check_at(round(0.89 * WIDTH), "with keys")
    check(
        browser.evaluate("document.getElementById('camera').value") == str(VIEW),
        "keys of the divider do not turn the camera",
    )
    role = browser.evaluate(
        "(e => [e.role, e.ariaValueMin, e.ariaValueMax, e.ariaValueText, e.ariaLabel])(document.getElementById('divider'))"
    )
    check(
        role == ["slider", "0", "100", "89 % of the width", "Divider between the pictures"], f"it is a slider: {role}"
    )
    check(
        browser.evaluate("document.getElementById('modes').closest('fieldset').disabled"),
        "the choice of one picture is out of use meanwhile",
    )
    choose(browser, compare_on=False)
    check(
        not browser.evaluate(
            "document.getElementById('modes').closest('fieldset').disabled || document.getElementById('divider').checkVisibility()"
        ),
        "and back after it",
    )
    check(screen_picture(browser).difference(wanted["full"])[0] <= 1, "then one picture is shown")


def check_link(browser, site):
    """A copied link holds the comparison."""
    open_site(browser, site)
    choose(browser, compare_left="residual", compare_right="photograph")
    browser.evaluate("document.getElementById('divider').focus()")
    for key in (END, PAGE_DOWN, PAGE_DOWN, LEFT):
        browser.press(*key)
    wait_for(browser, "document.getElementById('label-right').textContent === 'Photograph'", "the photograph is there")
    wanted = screen_picture(browser)
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    browser.evaluate("document.getElementById('copy-link').click()")
    wait_for(browser, "document.getElementById('picture-message').textContent === 'Copied.'", "the link is copied")
    link = browser.evaluate("navigator.clipboard.readText()")
    check(
        link == f"{site.url}#view={VIEW + 1}&compare=residual,photograph&split=79",
        f"it names sides and divider: {link}",
    )

    browser.open("about:blank")
    open_viewer(browser, link)
    fit_canvas(browser)
    wait_for(
        browser, "document.getElementById('label-right').textContent === 'Photograph'", "the link shows the photograph"
    )
    sides = browser.evaluate("['left', 'right'].map(side => document.getElementById('compare-' + side).value)")
    check(
        sides == ["residual", "photograph"] and divider(browser) == 79,
        f"the same sides and divider: {sides}, {divider(browser)} %",
    )
    check(screen_picture(browser).difference(wanted)[0] <= 1, "and the same picture")
    browser.evaluate("location.hash = '#compare=full,nothing&split=20'")
    wait_for(browser, "!document.getElementById('compare-on').checked", "what is no comparison is none")
    check(
        divider(browser) == 79 and not browser.evaluate("document.getElementById('divider').checkVisibility()"),
        "and shows no divider",
    )


def check_accessibility(browser, site):
    open_viewer(browser, site.url + "#compare=full,other")
    wait_for_label(browser, "right", "none")
    check_accessible(browser, "with a comparison")
    browser.become_phone()
    browser.evaluate(FRAME)
    browser.evaluate("document.body.classList.contains('folded') && document.getElementById('toggle').click()")
    check_accessible(browser, "with a comparison on a phone")
    browser.evaluate("document.getElementById('toggle').click()")
    check_accessible(browser, "with a comparison on a phone, settings hidden")
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_obstacles(browser, site):
    """What cannot be shown says why, and the other side is drawn."""
    open_site(browser, site)
    full = mode_picture(browser, "full")
    choose(browser, compare_left="full", compare_right="photograph")
    wait_for(
        browser,
        "document.getElementById('label-right').textContent === 'Photograph'",
        "the photograph of a test view is shown",
    )
    browser.evaluate("document.getElementById('canvas').focus()")
    browser.press(*LEFT)
    wait_for_label(browser, "right", "Choose a test view")
    shown = screen_picture(browser)
    check(max(shown.data[4 * (60 * WIDTH + 120) :][:3]) == 0, "where there is no photograph, the picture is black")
    check(
        max(shown.data[i] for i in range(4 * 60 * WIDTH, 4 * (60 * WIDTH + 70)) if i % 4 < 3) > 0,
        "and beside it the model",
    )
    open_site(browser, site, "?model=scene.ngsplat")  # as a file from anywhere
    for side, words in (("photograph", "no photographs here"), ("other", "one model here")):
        choose(browser, compare_left="full", compare_right=side)
        wait_for_label(browser, "right", words)
    check(screen_picture(browser).difference(full, 0, WIDTH // 2)[0] <= 1, "beside it the model")


def check_phone(browser, site):
    open_viewer(browser, site.url)
    browser.become_phone()
    browser.evaluate(FRAME)
    choose(browser, compare_on=True)
    browser.evaluate("document.body.classList.contains('folded') && document.getElementById('toggle').click()")
    browser.evaluate("document.getElementById('compare-left').scrollIntoView()")
    check(browser.evaluate("document.documentElement.scrollWidth") <= 360, "a phone's width suffices")
    for name in ("compare-on", "compare-left", "compare-right"):
        box = browser.evaluate(f"(b => [b.left, b.right])(document.getElementById('{name}').getBoundingClientRect())")
        check(0 <= box[0] < box[1] <= 360, f"{name} lies within it: {box}")
    for side in ("left", "right"):
        box = browser.evaluate(
            f"(b => [b.left, b.right])(document.getElementById('label-{side}').getBoundingClientRect())"
        )
        check(0 <= box[0] < box[1] <= 360, f"so does the label at the {side}: {box}")
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_broken_sites(browser, site, folder):
    """A site.json (more of them: apps/viewer/test/site.test.ts) or a file it names that is damaged or hostile gives a
    message, and the page goes on."""
    good = (folder / "site.json").read_text()
    message = "document.getElementById('notice').hidden ? '' : document.getElementById('notice').innerText"

    def altered(**changes):
        return json.dumps({**json.loads(good), **changes})

    first = {"file": "scene.ngsplat", "name": "a"}
    bad = {
        "no JSON": (good[:-1], "not JSON"),
        "newer": (altered(version=2), "version 2"),
        "elsewhere": (
            altered(models=[first, {"file": "https://example.com/a.ngsplat", "name": "b"}]),
            "no .ngsplat file of this site",
        ),
        "photographs of other views": (altered(photographs=[None] * 3), "list of 8 photographs"),
    }
    browser.call("Network.setCacheDisabled", cacheDisabled=True)
    for name, (text, words) in bad.items():
        (folder / "site.json").write_text(text)
        open_viewer(browser, site.url)
        seen = browser.evaluate(message)
        check("site.json cannot be read" in seen and words in seen, f"a site.json that is {name} is said to be: {seen}")
        browser.evaluate("document.getElementById('dismiss').click()")
        check(
            browser.evaluate("gsapp.testViewPixels(0, 'full').then(v => Math.max(...v.pixels.slice(0, 4000)))") > 10,
            "the page goes on",
        )
    elsewhere = [r for r in browser.requests if not r.startswith((site.url, "blob:", "about:"))]
    check(elsewhere == [], f"nothing is asked of other sites: {elsewhere}")
    check(browser.errors == [], f"the console is silent: {browser.errors}")

    (folder / "site.json").unlink()
    open_viewer(browser, site.url)
    check("404" in browser.evaluate(message), f"one that is missing is said to be: {browser.evaluate(message)}")
    (folder / "site.json").write_text(altered(models=[first, {"file": "scene-2.ngsplat", "name": "<b>b</b>"}]))
    packed = (folder / "scene-2.ngsplat").read_bytes()
    (folder / "scene-2.ngsplat").write_bytes(packed[: len(packed) // 2])
    (folder / f"photographs/{VIEW:05}.png").write_bytes((folder / "photographs/00000.png").read_bytes()[:100])
    open_site(browser, site)
    choose(browser, compare_left="full", compare_right="other")
    wait_for_label(browser, "right", "scene-2.ngsplat cannot be shown: the file is truncated")
    check(label(browser, "right").startswith("<b>b</b>"), "a name with markup is shown as text")
    choose(browser, compare_right="photograph")
    wait_for_label(browser, "right", f"photographs/{VIEW:05}.png cannot be shown")
    check(
        screen_picture(browser).difference(mode_picture(browser, "full"), 0, WIDTH // 2)[0] <= 1,
        "beside it the model is drawn",
    )


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = build_site(sys.argv[1], pathlib.Path(name))
        if not (folder / "index.html").exists():
            print("skipped: the viewer is not built (scripts/build-viewer)")
            return 77
        site = Site(folder)
        # A pixel of the device is one of CSS throughout, as in fit_canvas: Chromium may send no event for an emulated
        # density that changes after the size.
        flags = [flag for flag in SOFTWARE_WEBGL if flag != FEWER_PIXELS]
        with Browser(program, width=400, height=300, flags=flags) as browser:
            wanted = check_sides(browser, site)
            check_divider(browser, wanted)
            check_link(browser, site)
            check_obstacles(browser, site)
            check_accessibility(browser, site)
            check_phone(browser, site)
            check_broken_sites(browser, site, folder)
    print("passed")
    return 0


sys.exit(main())
