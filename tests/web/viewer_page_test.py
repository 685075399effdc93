# SPDX-License-Identifier: Apache-2.0
"""Uses the web viewer as people do: good and bad files, keyboard, mouse, touch, benchmark.

Usage: viewer_page_test.py VIEWER. VIEWER is apps/viewer/dist after scripts/build-viewer. Exit status 77: no Chromium,
or no viewer there.
"""

import json
import math
import pathlib
import random
import shutil
import struct
import sys
import tempfile

from browser import Browser, find_chromium, check
from site_server import SOFTWARE_WEBGL, Site, open_viewer, wait_for
from viewer_scenes import BACKGROUND, camera, cross, drop, header, message, padded, pixel, scene_file, trailer, unit

TAB, END, ARROW_LEFT = ("Tab", 9), ("End", 35), ("ArrowLeft", 37)

# Of the lobe in lobe_file: unlike 1, as it has to be visible if the axis were special.
PEAK = 0.25


def lobe_file(angles):
    """One black Gaussian with one white NASG lobe, seen at these angles from its axis."""
    axis = unit([1, 3, 3])  # rounded to half precision it is longer than 1 by 0.0003
    side = unit(cross(axis, [0, 1, 0]))
    cameras = [[-4 * (math.cos(a) * z + math.sin(a) * x) for z, x in zip(axis, side)] for a in angles]
    geometry = struct.pack("<4B3e2B4B", 0, 0, 0, 255, 0, 0, 0, 128, 128, 146, 146, 146, 0)
    values = [*side, *axis, 1, 0.5, PEAK, 1, 1, 1]
    payload = struct.pack("<16e", *values, 0, 0, 0, 0)
    return trailer(
        header(1, cameras, model=3, features=1)
        + b"".join(padded(texel, 1) for texel in (geometry, payload[:16], payload[16:]))
    )


def spherical_harmonics(degree, d):
    """From Rodrigues' formula: m from -degree to degree, with the sign (-1)^m."""
    polynomial = {
        2 * k: math.comb(degree, k) * (-1) ** (degree - k) / (2**degree * math.factorial(degree))
        for k in range(degree + 1)
    }
    for _ in range(degree):
        polynomial = {power - 1: power * factor for power, factor in polynomial.items() if power > 0}
    values, angle = [0] * (2 * degree + 1), math.atan2(d[1], d[0])
    for m in range(degree + 1):
        legendre = (
            (-1) ** m * (1 - d[2] ** 2) ** (m / 2) * sum(factor * d[2] ** power for power, factor in polynomial.items())
        )
        scale = math.sqrt(
            (2 * degree + 1) / (4 * math.pi) * math.factorial(degree - m) / math.factorial(degree + m) * (2 if m else 1)
        )
        values[degree - m], values[degree + m] = scale * legendre * math.sin(m * angle), scale * legendre * math.cos(
            m * angle
        )
        polynomial = {power - 1: power * factor for power, factor in polynomial.items() if power > 0}
    return values


def network_file(bands, mixes, cameras):
    """One grey Gaussian whose network adds, to each channel, a mix of spherical harmonics: neurons have its positive
    and its negative part."""
    inputs, neurons = (len(mixes[0]) + 3) // 4 * 4, 8
    first = [
        [(-1 if o % 2 else 1) * mixes[o // 2][i] if o < 6 and i < len(mixes[0]) else 0 for i in range(inputs)]
        for o in range(neurons)
    ]
    last = [[(-1 if o % 2 else 1) * (o // 2 == c) for o in range(neurons)] for c in range(3)]
    texels = [
        w[4 * j + k]
        for w_layer in (first, last)
        for j in range(len(w_layer[0]) // 4)
        for w in w_layer
        for k in range(4)
    ]
    data = (
        b"NGSPLAT\n"
        + struct.pack("<11I", 1, 2048, 1, 0, 0, bands, 0, 0, neurons, 1, 4)
        + struct.pack("<2f7f", 1 / 255, 0, 0, 0, 0, 0, -1, 0, 4)
    )
    data += (
        struct.pack("<I", len(cameras))
        + b"".join(camera(c) for c in cameras)
        + struct.pack(f"<I{len(texels)}e", len(texels) // 4, *texels)
    )
    geometry = struct.pack("<4B3e2B4B", 128, 128, 128, 255, 0, 0, 0, 128, 128, 146, 146, 146, 0)
    return trailer(data + padded(geometry, 1) + padded(bytes(16), 1))


def check_bad_files(browser, good):
    newer = trailer(good[: good.rindex(b"GSAPPEXT")], version=2)
    bad = {
        "empty": (b"", "truncated"),
        "truncated": (good[:5000], "truncated"),
        "without its end": (good[:-3], "truncated"),
        "too long": (good + b"12345", "5 bytes follow"),
        "no such file": (b"PK\3\4" + good[4:], "does not begin with NGSPLAT"),
        "damaged": (good[:2000] + b"x" + good[2001:], "damaged"),
        "newer": (newer, "newer gsapp"),
        "with a count of billions": (good[:8] + struct.pack("<3I", 0xFFFFFFF0, 2048, 2097152) + good[20:], "truncated"),
    }
    for name, (data, words) in bad.items():
        drop(browser, f"{name}.ngsplat", data)
        wait_for(
            browser,
            "document.getElementById('notice-actions').checkVisibility()",
            f"a message about a file that is {name}",
        )
        check(
            words in message(browser) and name in message(browser),
            f"it says so of a file that is {name}: {message(browser)}",
        )
        browser.evaluate("document.getElementById('dismiss').click()")
        check(message(browser) == "", "the message can be closed")
        check(
            browser.evaluate("document.getElementById('name').textContent") == "scene.ngsplat",
            "the model before is still there",
        )
        check(max(pixel(browser)) > 60, "and is drawn")


def check_special_files(browser):
    drop(browser, "nothing.ngsplat", scene_file(0))
    wait_for(
        browser,
        "document.getElementById('name').textContent === 'nothing.ngsplat'",
        "a scene without Gaussians is shown",
    )
    check(pixel(browser) == [round(255 * x) for x in BACKGROUND], f"it shows its background, not {pixel(browser)}")
    check(pixel(browser, "residual") == [0, 0, 0], "and black as residual")
    name = "<img src=x onerror=alert(1)>.ngsplat"
    drop(browser, name, scene_file(10))
    wait_for(
        browser,
        f"document.getElementById('name').textContent === {json.dumps(name)}",
        "a name with markup is shown as text",
    )
    check(browser.evaluate("document.querySelectorAll('h2 img').length") == 0, "and nothing else")


def check_lobe_axis(browser):
    """In half precision an axis is not quite a unit vector: nothing may happen where its product with the direction
    passes 1."""
    degrees = (0, 0.1, 0.5, 1, 1.5, 1.8, 2, 2.5)
    drop(browser, "lobe.ngsplat", lobe_file([math.radians(d) for d in degrees]))
    wait_for(browser, "document.getElementById('name').textContent === 'lobe.ngsplat'", "a lobe is shown")
    seen = [pixel(browser, "residual", view)[0] for view in range(len(degrees))]
    check(
        all(abs(v - 255 * PEAK) <= 2 for v in seen),
        f"near the axis of a lobe its density is near its limit {255 * PEAK:.0f}: {seen}",
    )


def check_direction_degrees(browser):
    """Networks of the paper may take spherical harmonics up to degree 6, which gsapp's own do not."""
    rng = random.Random(3)
    cameras = [[4 * x for x in unit([rng.gauss(0, 1) for _ in range(3)])] for _ in range(8)]
    for degrees in ((1, 2, 3, 4, 5, 6), (1, 4, 6), (5,)):
        count = sum(2 * degree + 1 for degree in degrees)
        mixes = [[rng.gauss(0, 0.5 / math.sqrt(count)) for _ in range(count)] for _ in range(3)]
        name = f"degrees {degrees}.ngsplat"
        drop(browser, name, network_file(sum(1 << degree for degree in degrees), mixes, cameras))
        wait_for(
            browser,
            f"document.getElementById('name').textContent === {json.dumps(name)}",
            f"a network of degrees {degrees} is shown",
        )
        for view, position in enumerate(cameras):
            inputs = [y for degree in degrees for y in spherical_harmonics(degree, unit([-x for x in position]))]
            wanted = [min(max(128 + 255 * sum(a * y for a, y in zip(mix, inputs)), 0), 255) for mix in mixes]
            seen = pixel(browser, "full", view)
            check(
                all(abs(a - b) <= 2 for a, b in zip(seen, wanted)),
                f"degrees {degrees}, view {view}: {seen}, not {[round(x) for x in wanted]}",
            )


def check_loading(browser, site):
    site.server.go_on.clear()
    browser.open(site.url + "?model=slow.ngsplat")
    wait_for(browser, "document.getElementById('progress').value > 0.3", "progress is shown")
    check("slow.ngsplat" in message(browser), "with the file's name")
    site.server.go_on.set()
    wait_for(browser, "window.gsapp && document.getElementById('notice').hidden", "and goes away")
    open_viewer(browser, site.url + "?model=missing.ngsplat")
    check("404" in message(browser), f"a missing model is said to be missing: {message(browser)}")
    open_viewer(browser, site.url + "?model=http://127.0.0.1:1/x.ngsplat")
    check("x.ngsplat cannot be fetched" in message(browser), f"so is one where nobody answers: {message(browser)}")


def check_link(browser, site):
    """A link to a model that the address chooses still chooses it."""
    shutil.copy(site.folder / "scene.ngsplat", site.folder / "other.ngsplat")
    open_viewer(browser, site.url + "?model=other.ngsplat")
    browser.evaluate("document.getElementById('next').click()")
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    browser.evaluate("document.getElementById('copy-link').click()")
    wait_for(browser, "document.getElementById('picture-message').textContent === 'Copied.'", "the link is copied")
    link = browser.evaluate("navigator.clipboard.readText()")
    check(link == site.url + "?model=other.ngsplat#view=2", f"with the model and the view: {link}")
    browser.open("about:blank")
    open_viewer(browser, link)
    check(
        browser.evaluate("document.getElementById('name').textContent") == "other.ngsplat", "the link shows the model"
    )


def check_controls(browser, url):
    open_viewer(browser, url)
    browser.evaluate("document.getElementById('toggle').click()")
    controls = "[...document.querySelectorAll('button, select, input, summary, a, canvas')].filter(c => c.checkVisibility() && !c.disabled)"
    nameless = browser.evaluate(
        f"{controls}.filter(c => !c.labels?.length && !c.ariaLabel && !c.textContent.trim()).map(c => c.outerHTML)"
    )
    check(nameless == [], f"without a label: {nameless}")
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    browser.evaluate(
        f"window.reached = new Set(); window.controls = {controls}.filter(c => c.type !== 'radio' || c.checked)"
    )
    for _ in range(80):
        browser.press(*TAB)
        browser.evaluate("void reached.add(document.activeElement)")
    missed = browser.evaluate("controls.filter(c => !reached.has(c)).map(c => c.outerHTML)")
    check(missed == [], f"not reached by keyboard: {missed}")

    browser.evaluate("document.getElementById('next').click()")
    view = "document.getElementById('camera').selectedOptions[0].textContent"
    check(browser.evaluate(view) == "Test view 2", "the next test view")
    frame = "new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(resolve)))"
    browser.evaluate("document.getElementById('canvas').focus()")
    browser.press(*ARROW_LEFT)
    browser.evaluate(frame)
    check(browser.evaluate(view) == "Free", "an arrow key leaves the test view")
    browser.evaluate("document.getElementById('previous').click()")
    for kind, x in (("mousePressed", 300), ("mouseMoved", 400), ("mouseReleased", 400)):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=300, button="left", buttons=1, clickCount=1)
    browser.evaluate(frame)
    check(browser.evaluate(view) == "Free", "so does dragging")
    browser.evaluate("document.getElementById('previous').click(); document.querySelector('[value=fly]').click()")
    for kind, x in (("touchStart", 300), ("touchMove", 350), ("touchMove", 400)):
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": 300}])
    browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    browser.evaluate(frame)
    check(browser.evaluate(view) == "Free", "and a finger, flying")

    near, base, residual = pixel(browser, "depth"), pixel(browser, "base"), pixel(browser, "residual")
    check(near[0] == near[1] == near[2] > 100, f"depth is grey, and bright near by: {near}")
    check(base == pixel(browser) and residual == [0, 0, 0], f"without view dependence, base is all: {base}, {residual}")


def check_garbage(browser):
    """A file arrives also where the browser looks for garbage meanwhile."""
    # Made in the page: a file that is handed over by drop() has been read when the first collection begins.
    browser.evaluate(
        """(() => {
        const transfer = new DataTransfer();
        transfer.items.add(new File([new Uint8Array(1 << 25)], 'zeros.ngsplat'));
        dispatchEvent(new DragEvent('drop', { dataTransfer: transfer, cancelable: true }));
    })()"""
    )
    for _ in range(3):
        browser.call("HeapProfiler.collectGarbage")
    wait_for(
        browser,
        "document.getElementById('notice').innerText.includes('zeros.ngsplat cannot be read')",
        "all of a file is read while garbage is collected",
    )


def check_benchmark(browser):
    browser.evaluate("document.getElementById('repeats').value = 1; document.getElementById('benchmark').click()")
    wait_for(browser, "document.getElementById('benchmark-json').checkVisibility()", "the benchmark ends")
    check("Frame" in browser.evaluate("document.getElementById('benchmark-result').value"), "and shows a time")
    result = browser.evaluate("gsapp.benchmark(2)")
    check(
        (result["width"], result["height"], result["framesPerView"], result["gaussians"]) == (1280, 720, 2, 3000),
        f"it did what it says: {result}",
    )
    check(len(result["perView"]["frame"]) == 2 and result["frame"]["min"] > 0, "with a time for every view")
    check(result["frame"]["max"] >= result["frame"]["median"] >= result["frame"]["min"], "in order")


# Keeps the page's media queries of densities.
KEEP_DENSITY_QUERIES = """{
  const match = matchMedia;
  window.queries = [];
  window.matchMedia = (text) => {
    const query = match(text);
    if (text.includes('dppx')) queries.push(query);
    return query;
  };
}"""


def check_appearance(browser):
    colours = []
    for scheme in ("light", "dark"):
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        colours.append(browser.evaluate("getComputedStyle(document.getElementById('panel')).backgroundColor"))
    check(colours[0] != colours[1], f"dark and light differ, not {colours}")
    browser.become_phone()
    check(browser.evaluate("document.documentElement.scrollWidth") <= 360, "a phone's width suffices")
    wait_for(
        browser,
        "document.getElementById('canvas').width === 720",
        "the picture has at most two device pixels per CSS pixel",
    )
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_density(browser, url):
    """A window moves to a screen of another density, and to a third, and keeps its size: only a media query says so."""
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=KEEP_DENSITY_QUERIES)["identifier"]
    open_viewer(browser, url)
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    width = "document.getElementById('canvas').width"
    for density in (1.5, 0.25):
        browser.evaluate(
            f"Object.defineProperty(window, 'devicePixelRatio', {{ value: {density}, configurable: true }}); 0"
        )
        browser.evaluate("queries.at(-1).dispatchEvent(new Event('change'))")
        wanted = browser.evaluate(f"Math.round({density} * document.getElementById('canvas').clientWidth)")
        check(browser.evaluate(width) == wanted, f"at density {density} the canvas is {wanted} pixels wide")


def check_device_limits(browser, url):
    """What happens to devices that have too little."""
    script = browser.call(
        "Page.addScriptToEvaluateOnNewDocument",
        source="""{
        const original = WebGL2RenderingContext.prototype.getParameter;
        WebGL2RenderingContext.prototype.getParameter = function (name) { return name === this.MAX_TEXTURE_SIZE ? 1 : original.call(this, name); };
    }""",
    )["identifier"]
    open_viewer(browser, url)
    check(
        "This device holds textures of 1 rows" in message(browser),
        f"a device too small is said to be: {message(browser)}",
    )
    drop(browser, "small.ngsplat", scene_file(100))
    wait_for(
        browser, "document.getElementById('name').textContent === 'small.ngsplat'", "a smaller file is shown after that"
    )
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    script = browser.call(
        "Page.addScriptToEvaluateOnNewDocument",
        source="""{
        const original = WebGL2RenderingContext.prototype.shaderSource;
        WebGL2RenderingContext.prototype.shaderSource = function (shader, text) { original.call(this, shader, text.replace('shown_color(i, ', 'no_such_thing(i, ')); };
    }""",
    )["identifier"]
    open_viewer(browser, url)
    wait_for(browser, "!document.getElementById('notice').hidden", "a driver that does not take a shader is noticed")
    check("rejects a shader" in message(browser) and "no_such_thing" in message(browser), message(browser))
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    open_viewer(browser, url)
    browser.evaluate(
        "document.getElementById('canvas').getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()"
    )
    wait_for(browser, "!document.getElementById('notice').hidden", "a lost device is noticed")
    check("device was lost" in message(browser), message(browser))


def check_without_webgl(program, url):
    with Browser(program, flags=("--disable-gpu", "--disable-software-rasterizer", "--disable-3d-apis")) as browser:
        browser.open(url)
        wait_for(browser, "!document.getElementById('notice').hidden", "a message without WebGL2")
        check("needs WebGL2" in message(browser), message(browser))
        check(
            browser.evaluate("[...document.querySelectorAll('#open, #open-notice')].every(b => b.disabled)"),
            "where nothing can be shown, no button offers to open a file",
        )
        drop(browser, "good.ngsplat", scene_file(1))
        check("needs WebGL2" in message(browser), "and a file dropped on the page changes nothing")


def main():
    program = find_chromium()
    viewer = pathlib.Path(sys.argv[1])
    if program is None or not (viewer / "index.html").exists():
        print("skipped: no chromium on PATH, or the viewer is not built (scripts/build-viewer)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name) / "below" / "any path"
        check("three.js authors" in (viewer / "LICENSES.txt").read_text(), "the notice of what is bundled is there")
        shutil.copytree(viewer, folder)
        good = scene_file(3000)
        (folder / "scene.ngsplat").write_bytes(good)
        site = Site(folder)
        with Browser(program, width=800, height=600, flags=SOFTWARE_WEBGL) as browser:
            open_viewer(browser, site.url)
            check_bad_files(browser, good)
            check_special_files(browser)
            check_lobe_axis(browser)
            check_direction_degrees(browser)
            check_controls(browser, site.url)
            check_benchmark(browser)
            check_garbage(browser)
            check_appearance(browser)
            elsewhere = [r for r in browser.requests if not r.startswith((site.url, "blob:", "about:"))]
            check(elsewhere == [], f"the page asks only its own site: {elsewhere}")
            check(browser.errors == [], f"the console is silent: {browser.errors}")
            check_loading(browser, site)
            check_link(browser, site)
            check_density(browser, site.url)
            check_device_limits(browser, site.url)
        check_without_webgl(program, site.url)
    print("passed")
    return 0


sys.exit(main())
