# SPDX-License-Identifier: Apache-2.0
"""Shows coarser levels of a model in the web viewer: as told, where memory is short, where frames are slow, and where
the device was lost.

Usage: viewer_levels_test.py GSAPP. Exit status 77: no Chromium, or a gsapp without the viewer.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import time

from browser import PATIENCE, Browser, find_chromium, check, check_accessible
from site_server import SOFTWARE_WEBGL, Site, open_viewer, wait_for


def scene(*options):
    """Flags of a training of a built-in scene on the CPU."""
    return ["-s", "builtin:glossy", "--device", "cpu", "--quiet", "--appearance", "none", *options]


SCENE = scene(
    *("-r", "4", "--iterations", "200", "--cap-max", "17000"),
    *("--densification-interval", "5", "--densify-until-iter", "190"),
)
# Enough for the names of its views.
SMALL_SCENE = scene("-r", "8", "--iterations", "20", "--init-points", "500")
PIXELS = "gsapp.testViewPixels(2, 'full').then(v => v.pixels.join())"


def state(browser):
    return browser.evaluate("document.getElementById('detail-state').textContent")


def count(browser):
    """The Gaussians of the model that is shown."""
    return browser.evaluate("Number(document.querySelector('#info dd').textContent.replaceAll(',', ''))")


def message(browser):
    return browser.evaluate(
        "document.getElementById('notice').hidden ? '' : document.getElementById('notice').innerText"
    )


def choose(browser, name, value):
    browser.evaluate(
        f"{{ const list = document.getElementById('{name}'); list.value = '{value}'; list.dispatchEvent(new Event('change')); }}"
    )


def wait_for_state(browser, words):
    wait_for(
        browser,
        f"document.getElementById('detail-state').textContent.includes('{words}')",
        f"what is shown is said to be so '{words}'",
    )


def fresh(browser, url, script=""):
    """Opens a page after another, which runs `script` before anything else."""
    browser.open("about:blank")
    number = browser.call("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
    open_viewer(browser, url)
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=number)


def memory_of(gibibytes):
    return f"Object.defineProperty(navigator, 'deviceMemory', {{ value: {gibibytes} }});"


def without_memory(length):
    """The first array of so many numbers finds no memory."""
    return f"""{{ let failures = 0;
        window.Uint32Array = new Proxy(Uint32Array, {{ construct(array, given) {{
            if (given[0] === {length} && failures++ === 0) throw new RangeError('Array buffer allocation failed');
            return Reflect.construct(array, given);
        }} }}); }}"""


def move(browser, frames):
    """Turns the camera, a step in every frame."""
    browser.evaluate(
        f"""(async () => {{
        const canvas = document.getElementById('canvas');
        canvas.focus();
        for (let i = 0; i < {frames}; ++i) {{
            canvas.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'ArrowLeft', code: 'ArrowLeft', bubbles: true }}));
            await new Promise(resolve => requestAnimationFrame(resolve));
        }}
    }})()"""
    )


def move_until(browser, frames, is_over):
    """Turns the camera by so many frames again and again."""
    deadline = time.monotonic() + PATIENCE
    while not is_over() and time.monotonic() < deadline:
        move(browser, frames)


def check_choice(browser, site, levels):
    fresh(browser, site.url)
    wait_for_state(browser, "all of them")
    check(
        count(browser) == levels[0]["num_gaussians"] and f"{levels[0]['psnr']:.2f} dB" in state(browser),
        f"all of it is shown first: {state(browser)}",
    )
    names = browser.evaluate("[...document.getElementById('detail').options].map(o => o.textContent)")
    check(
        names[0] == "Automatic"
        and names[1].startswith("All: ")
        and names[3].startswith("1/4: ")
        and len(names) == 1 + len(levels),
        f"the choices: {names}",
    )
    check(
        all(f"{level['psnr']:.2f} dB" in name for level, name in zip(levels, names[1:])), f"each with its PSNR: {names}"
    )
    whole = browser.evaluate(PIXELS)
    choose(browser, "camera", 2)
    choose(browser, "detail", 2)
    wait_for_state(browser, "as you chose")
    check(count(browser) == levels[2]["num_gaussians"], f"a quarter is shown: {count(browser)}")
    check(f"{levels[2]['psnr']:.2f} dB" in state(browser), f"with its PSNR: {state(browser)}")
    check(browser.evaluate("document.getElementById('camera').value") == "2", "the camera stays")
    quarter = browser.evaluate(PIXELS)
    check(quarter != whole, "it is another picture")
    check_accessible(browser, "with a choice of levels")
    address = browser.evaluate("new Promise(resolve => setTimeout(() => resolve(location.hash), 600))")
    check(address == "#view=3&detail=2", f"the address says so: {address}")
    choose(browser, "detail", "")
    wait_for_state(browser, "all of them")
    check(browser.evaluate(PIXELS) == whole, "what the page chooses is all of it again")

    fresh(browser, site.url + "#view=3&detail=2")
    wait_for_state(browser, "as you chose")
    check(browser.evaluate(PIXELS) == quarter, "the address shows it")
    fresh(browser, site.url + "?model=scene-level-2.ngsplat")
    check(browser.evaluate(PIXELS) == quarter, "it is the picture of its file")
    check(browser.evaluate("document.getElementById('detail-box').hidden"), "a file by its address has no levels")
    check(browser.errors == [], f"the console is silent: {browser.errors}")


def check_memory(browser, site, levels):
    need = [level["bytes"] + 38 * level["num_gaussians"] for level in levels]
    fresh(browser, site.url, memory_of(8 * 1.01 * need[1] / 2**30))
    wait_for_state(browser, "little memory")
    check(count(browser) == levels[1]["num_gaussians"], f"the finest that fits: {count(browser)} Gaussians")
    fresh(browser, site.url, memory_of(1e-6))
    wait_for_state(browser, "little memory")
    check(count(browser) == levels[-1]["num_gaussians"], f"at worst the coarsest: {count(browser)} Gaussians")
    choose(browser, "detail", 0)
    wait_for_state(browser, "as you chose")
    check(count(browser) == levels[0]["num_gaussians"], "who chooses all of it gets it")
    check(browser.errors == [], f"the console is silent: {browser.errors}")


def check_full_memory(browser, site, levels):
    """An array that finds no memory while a file is read."""
    fresh(browser, site.url, without_memory(levels[0]["num_gaussians"]))
    wait_for_state(browser, "little memory")
    check(
        count(browser) == levels[1]["num_gaussians"] and message(browser) == "",
        f"a coarser level is shown without a word: {count(browser)}, '{message(browser)}'",
    )
    fresh(browser, site.url + "?model=scene.ngsplat", without_memory(levels[0]["num_gaussians"]))
    check(
        "scene.ngsplat cannot be shown" in message(browser)
        and "The memory does not suffice for this file." in message(browser),
        f"where there is none, a message says so: {message(browser)}",
    )
    check(
        "allocation" not in message(browser) and not browser.evaluate("document.body.classList.contains('loaded')"),
        f"in plain words, and nothing is half there: {message(browser)}",
    )
    check(browser.errors == [], f"the console is silent: {browser.errors}")


CLOCK = """{ const now = performance.now.bind(performance); let at = now(), shown = at; window.rate = 1;
             performance.now = () => { const time = now(); shown += rate * (time - at); at = time; return shown; }; }"""


def be_fast(browser):
    """A small picture beside the scene, in software, and a clock that takes it for one on a fast device."""
    browser.call("Emulation.setDeviceMetricsOverride", width=120, height=90, deviceScaleFactor=0.5, mobile=False)
    browser.evaluate("location.hash = '#from=9,9,9&to=18,18,18'")
    browser.evaluate("window.rate = 0.01")


def check_speed(browser, site, levels):
    fresh(browser, site.url, CLOCK)
    wait_for_state(browser, "all of them")
    browser.evaluate("window.rate = 20")
    move_until(browser, 1, lambda: "all of them" not in state(browser))
    wait_for_state(browser, "too slow")
    check(count(browser) == levels[1]["num_gaussians"], f"slow frames bring a coarser level: {count(browser)}")
    be_fast(browser)
    move_until(browser, 20, lambda: "too slow" not in state(browser))
    wait_for_state(browser, "all of them")
    check(count(browser) == levels[0]["num_gaussians"], "frames that stay fast bring all of it back")
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_lost_device(browser, site, levels):
    fresh(browser, site.url, CLOCK)
    wait_for_state(browser, "all of them")
    browser.evaluate(
        "window.lost = document.getElementById('canvas').getContext('webgl2').getExtension('WEBGL_lose_context'); lost.loseContext()"
    )
    wait_for(
        browser,
        "document.getElementById('notice-text').textContent.includes('coarser level')",
        "the message says what comes back",
    )
    browser.evaluate("lost.restoreContext()")
    wait_for(
        browser,
        "document.body.classList.contains('loaded') && document.getElementById('notice').hidden",
        "a model is there again",
    )
    wait_for_state(browser, "little memory")
    check(count(browser) == levels[1]["num_gaussians"], f"a coarser one: {count(browser)}")
    be_fast(browser)
    move(browser, 320)  # after 300 fast frames a finer level is shown where only speed counts
    check(
        "little memory" in state(browser) and count(browser) == levels[1]["num_gaussians"],
        f"what it could not hold stays away: {state(browser)}",
    )
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_obstacles(browser, site, folder, levels):
    """A level that cannot be read, and a site without any."""
    browser.call("Network.setCacheDisabled", cacheDisabled=True)
    fresh(browser, site.url)
    wait_for_state(browser, "all of them")
    whole = browser.evaluate(PIXELS)
    good = (folder / "scene-level-1.ngsplat").read_bytes()
    (folder / "scene-level-1.ngsplat").write_bytes(good[:5000])
    choose(browser, "detail", 1)
    wait_for_state(browser, "cannot be shown: the file is truncated")
    check(browser.evaluate(PIXELS) == whole, "what was shown stays")
    (folder / "scene-level-1.ngsplat").write_bytes(good)
    browser.errors.clear()
    (folder / "site.json").unlink()
    fresh(browser, site.url, memory_of(1e-6))
    check(browser.evaluate(PIXELS) == whole, "without levels all of it is shown, whatever the memory")
    fresh(browser, site.url, without_memory(levels[0]["num_gaussians"]))
    check(
        "does not suffice for this file. gsapp export --lod" in message(browser),
        f"and where that is too little, it is said: {message(browser)}",
    )


def check_training_views(browser, gsapp, folder):
    """A run without test views offers its training views."""
    run_gsapp(gsapp, "train", *SMALL_SCENE, "-m", folder / "all")
    run_gsapp(gsapp, "export", folder / "all", "-o", folder / "all-site")
    site = Site(folder / "all-site")
    fresh(browser, site.url)
    names = browser.evaluate("[...document.getElementById('camera').options].map(o => o.textContent)")
    check(names[:2] == ["Free", "Training view 1"] and len(names) > 5, f"views to jump to: {names}")
    info = browser.evaluate("document.getElementById('info').innerText")
    check("Training views" in info and "Test views" not in info, f"they are called what they are: {info}")
    check(
        "Training view 1" == browser.evaluate("document.getElementById('camera').selectedOptions[0].textContent"),
        "the first of them is shown first",
    )


def run_gsapp(*arguments):
    subprocess.run([str(a) for a in arguments], check=True, capture_output=True)


def main():
    program = find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run_gsapp(sys.argv[1], "train", *SCENE, "--eval", "-m", folder / "run")
        run_gsapp(sys.argv[1], "export", folder / "run", "--lod", "-o", folder / "site")
        if not (folder / "site" / "index.html").exists():
            print("skipped: the viewer is not built (scripts/build-viewer)")
            return 77
        levels = json.loads((folder / "site" / "site.json").read_text())["levels"]
        check(len(levels) == 4, f"more than 16,384 Gaussians have three coarser levels: {levels}")
        site = Site(folder / "site")
        with Browser(program, width=700, height=400, flags=SOFTWARE_WEBGL) as browser:
            check_choice(browser, site, levels)
            check_memory(browser, site, levels)
            check_full_memory(browser, site, levels)
            check_speed(browser, site, levels)
            check_lost_device(browser, site, levels)
            check_training_views(browser, sys.argv[1], folder)
            check_obstacles(browser, site, folder / "site", levels)
    print("passed")
    return 0


sys.exit(main())
