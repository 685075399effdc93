# SPDX-License-Identifier: Apache-2.0
"""Loads models slowly: what the viewer shows of the part that has arrived, and what becomes of it when the rest is
damaged.

Usage: viewer_loading_test.py GSAPP. Exit status 77: no Chromium, a gsapp without the viewer, or no data
(GSAPP_TEST_DATA).
"""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from browser import Browser, find_chromium, check
from site_server import SOFTWARE_WEBGL, Site, open_viewer, wait_for

TRAINING = [
    "--iterations",
    "300",
    "--init-points",
    "20000",
    "--cap-max",
    "14000",
    "--device",
    "cpu",
    "--eval",
    "--quiet",
]
# Scene, further arguments of gsapp train, and the least PSNR at the first share.
CASES = {
    "lego": ("lego", [], 20),
    "bonsai": ("bonsai", [], 20),
    "lego, mixed": ("lego", ["--appearance-share", "0.33"], 20),
    "bonsai, mixed": ("bonsai", ["--appearance-share", "0.33"], 20),
}
SHARES = (0.1, 0.25)
VIEWS = (0, 5)

# The PSNR of two lists of rgba pixels. Equal ones count as 120 dB.
PSNR_OF_PIXELS = """(a, b) => {
  const sum = a.reduce((sum, v, i) => i % 4 < 3 ? sum + ((v - b[i]) / 255) ** 2 : sum, 0);
  return -10 * Math.log10(Math.max(sum / (0.75 * a.length), 1e-12));
}"""


def remember(browser, hooks, key):
    """Keeps the pixels of the test views in the page. All in one call: between two, the page would draw its own
    picture."""
    browser.evaluate(
        f"""(async () => {{
        const pictures = ((window.seen ??= {{}})['{key}'] ??= []);
        for (const view of {list(VIEWS)}) pictures.push((await {hooks}.testViewPixels(view, 'full')).pixels);
    }})()"""
    )


def arrived(browser, share):
    wait_for(
        browser,
        f"document.getElementById('progress').value > {share - 0.005} && !document.getElementById('notice').hidden",
        f"{share} of the file have arrived",
    )


def message(browser):
    return browser.evaluate(
        "document.getElementById('notice').hidden ? '' : document.getElementById('notice').innerText"
    )


def is_shown(browser):
    return browser.evaluate("document.getElementById('canvas').checkVisibility({ visibilityProperty: true })")


def check_parts(browser, site, case, least):
    """A recognisable picture of a small part."""
    site.server.slow_shares = SHARES
    browser.open(site.url + "?model=slow.ngsplat")
    for share in SHARES:
        arrived(browser, share)
        check(is_shown(browser), f"{case}: a picture of {share} of the file")
        check("slow.ngsplat" in message(browser), "and how much there is")
        check(browser.evaluate("document.getElementById('notice').classList.contains('aside')"), "beside the picture")
        remember(browser, "gsappLoading", share)
        site.server.go_on.set()
    wait_for(browser, "window.gsapp", "the rest arrives")
    check(message(browser) == "", "and the message goes away")
    remember(browser, "gsapp", "end")
    for share in SHARES:
        values = browser.evaluate(f"seen[{share}].map((pixels, i) => ({PSNR_OF_PIXELS})(pixels, seen.end[i]))")
        print(
            f"{case:14} {100 * share:3.0f} % of the bytes "
            + " ".join(f"{v:6.2f}" for v in values)
            + " dB to the whole file",
            flush=True,
        )
        check(max(values) < 60, f"{case}: {share} of the file is not all of it")
        check(
            share > SHARES[0] or min(values) >= least, f"{case}: PSNR of at least {least} dB with {share} of the bytes"
        )


def check_packed(browser, site):
    """Compressed on the way, the size is known from the file's own header; and a transfer that ends early is
    no model."""
    site.server.slow_shares, site.server.is_packed = (0.3,), True
    browser.open(site.url + "?model=slow.ngsplat")
    arrived(browser, 0.3)
    check(
        " of " in message(browser) and is_shown(browser),
        f"a compressed file has a size and a picture too: {message(browser)}",
    )
    site.server.go_on.set()
    wait_for(browser, "window.gsapp", "it is shown")
    check(message(browser) == "" and is_shown(browser), f"all of it: {message(browser)}")


def check_damage(browser, site, name, data, words):
    """What was shown of a file that is not what it should be is taken away."""
    whole = site.server.slow_file.read_bytes()
    site.server.slow_file.write_bytes(data)
    site.server.slow_shares, site.server.is_packed = (0.2 * len(whole) / len(data),), True  # no length beforehand
    browser.open(site.url + "?model=slow.ngsplat")
    arrived(browser, 0.2)
    check(is_shown(browser), f"a part of a file that is {name} is shown")
    site.server.go_on.set()
    wait_for(browser, "window.gsapp", f"a file that is {name} ends")
    check(
        words in message(browser) and "cannot be read" in message(browser),
        f"the message about a file that is {name}: {message(browser)}",
    )
    check(not is_shown(browser), f"the part of a file that is {name} is taken away")
    site.server.slow_file.write_bytes(whole)


def check_broken(browser, site):
    """A connection that breaks is taken up where it stopped."""
    open_viewer(browser, site.url + "?model=scene.ngsplat")
    remember(browser, "gsapp", "whole")
    pixels = browser.evaluate("seen.whole.map(p => p.join()).join('|')")
    open_viewer(browser, site.url + "?model=broken.ngsplat")
    check(
        message(browser) == "" and is_shown(browser),
        f"a file over a connection that broke is shown: {message(browser)}",
    )
    begins, size = site.server.ranges, site.server.slow_file.stat().st_size
    check(
        len(begins) == 2 and begins[0] == 0 and 0 < begins[1] <= 0.4 * size,
        f"the rest alone was asked for: {begins} of {size}",
    )
    remember(browser, "gsapp", "broken")
    check(browser.evaluate("seen.broken.map(p => p.join()).join('|')") == pixels, "it is the same picture")
    browser.errors.clear()  # the browser tells of the connection


def main():
    program, data = find_chromium(), pathlib.Path(os.environ.get("GSAPP_TEST_DATA", "")) / "tiny"
    if program is None or not (data / "lego").exists():
        print(
            "skipped: no chromium on PATH (apt-get install chromium), or no tiny/lego and tiny/bonsai in GSAPP_TEST_DATA"
        )
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for case, (scene, arguments, _) in CASES.items():
            for command in (
                ["train", "-s", data / scene, *TRAINING, *arguments, "-m", folder / "runs" / case],
                ["export", folder / "runs" / case, "-o", folder / case],
            ):
                subprocess.run([sys.argv[1], *command], check=True, capture_output=True)
            if not (folder / case / "index.html").exists():
                print("skipped: the viewer is not built (scripts/build-viewer)")
                return 77
        root = folder / "site"
        shutil.copytree(folder / "lego", root)
        site = Site(root)
        with Browser(program, width=500, height=400, flags=SOFTWARE_WEBGL) as browser:
            for case, (_, _, least) in CASES.items():
                shutil.copy(folder / case / "scene.ngsplat", root)
                check_parts(browser, site, case, least)
            check_packed(browser, site)
            check(browser.errors == [], f"the console is silent: {browser.errors}")
            check_broken(browser, site)
            good = site.server.slow_file.read_bytes()
            damaged = bytearray(good)
            damaged[len(good) // 2] ^= 1
            check_damage(browser, site, "damaged", bytes(damaged), "damaged")
            check_damage(browser, site, "truncated", good[: len(good) * 4 // 5], "truncated")
            check_damage(browser, site, "too long", good + bytes(8), "8 bytes follow")
            site.server.slow_shares, site.server.is_packed = (0.5,), False
            site.server.go_on.set()
            open_viewer(browser, site.url + "?model=slow.ngsplat")
            check(message(browser) == "" and is_shown(browser), "a good file is shown after that")
    print("passed")
    return 0


sys.exit(main())
