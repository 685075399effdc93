# SPDX-License-Identifier: Apache-2.0
"""Uses what stands around the viewer's picture: links, settings, keys, files to save.

Usage: viewer_controls_test.py VIEWER. VIEWER is apps/viewer/dist after scripts/build-viewer. Exit status 77: no
Chromium, or no viewer there.
"""

import json
import math
import pathlib
import shutil
import struct
import sys
import tempfile
import time

from browser import Browser, check, check_accessible, find_chromium
from site_server import SOFTWARE_WEBGL, Site, fresh, move_as_usual, wait_for
from viewer_scenes import BACKGROUND, Downloads, box_ply, drop, message, pixel, scene_file, unit

OWN = [round(255 * x) for x in BACKGROUND]
COUNT = 500


def click(browser, button):
    browser.evaluate(f"document.getElementById('{button}').click()")


def set_input(browser, name, value):
    """What a person does to a slider or a colour."""
    browser.evaluate(
        f"{{ const i = document.getElementById('{name}'); i.value = '{value}'; i.dispatchEvent(new Event('input', {{ bubbles: true }})); }}"
    )


def fragment(browser):
    """The fragment of the address, when it and the controls are up to date: the page writes it 400 ms after a picture,
    and what is to happen later does happen later however busy the machine is."""
    return browser.evaluate(
        "new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(() => resolve(location.hash), 420))))"
    )


def hash_to(browser, text):
    browser.evaluate(
        f"new Promise(resolve => {{ addEventListener('hashchange', () => requestAnimationFrame(() => requestAnimationFrame(resolve)), {{ once: true }}); location.hash = '{text}'; }})"
    )


def key(browser, name, text=None, modifiers=0):
    """Presses a key that the picture gets."""
    browser.evaluate("document.getElementById('canvas').focus()")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key=name, text=text or "", modifiers=modifiers)
    browser.call("Input.dispatchKeyEvent", type="keyUp", key=name, modifiers=modifiers)


def value(browser, name):
    return browser.evaluate(f"document.getElementById('{name}').value")


def shown(browser):
    return browser.evaluate("document.getElementById('camera').selectedOptions[0].textContent")


def check_link(browser, site):
    fresh(browser, site.url)
    check(fragment(browser) == "", "at the beginning the address is bare")
    click(browser, "next")
    check((at := fragment(browser)) == "#view=2", f"a test view is in the address: {at}")
    key(browser, "ArrowLeft")
    browser.evaluate("document.querySelector('[value=depth]').click()")
    set_input(browser, "background", "#ff8000")
    moved = fragment(browser)
    check(
        moved.startswith("#from=") and "&to=" in moved and moved.endswith("&mode=depth&background=ff8000"),
        f"so are a pose and settings: {moved}",
    )
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    click(browser, "copy-link")
    wait_for(
        browser, "document.getElementById('picture-message').textContent === 'Copied.'", "copying is said to be done"
    )
    check(browser.evaluate("navigator.clipboard.readText()") == site.url + moved, "the link is the address")

    fresh(browser, site.url + moved)
    check((at := fragment(browser)) == moved, f"opening the link shows the same: {at}")
    check(
        browser.evaluate("document.querySelector('[value=depth]').checked")
        and value(browser, "background") == "#ff8000",
        "and sets the controls",
    )
    hash_to(browser, "view=2&mode=base")
    check(
        ((at := fragment(browser)), shown(browser)) == ("#view=2&mode=base", "Test view 2"),
        f"another fragment is followed: {at}",
    )
    hash_to(browser, "from=1,2&to=x&mode=nothing&fov=1e9&view=99&size=-3&background=zzzzzz&near=NaN&=&%25&points=on")
    check(
        ((at := fragment(browser)), shown(browser)) == ("#points=on", "Test view 1"),
        f"nonsense in it is left out: {at}",
    )
    check(message(browser) == "", "without a word")
    hash_to(browser, "from=0,0,-4&to=0,0,0&fov=45.2397")  # of the first test view
    check(shown(browser) == "Free", "a pose belongs to no test view")
    drop(browser, "mine.ngsplat", scene_file(10))
    wait_for(browser, "document.getElementById('name').textContent === 'mine.ngsplat'", "a file is shown")
    click(browser, "copy-link")
    wait_for(
        browser,
        "document.getElementById('picture-message').textContent.includes('cannot hold the file')",
        "a link to it says what it lacks",
    )


def check_settings(browser, site, downloads):
    fresh(browser, site.url)
    check(value(browser, "background") == "#" + bytes(OWN).hex(), "the background is the file's own")
    corner = "gsapp.testViewPixels(0, 'full').then(v => [...v.pixels.slice(0, 3)])"
    covered = f"gsapp.testViewPixels(0, 'full').then(v => {{ let n = 0; for (let i = 0; i < v.pixels.length; i += 4) n += v.pixels[i] !== {OWN[0]}; return n; }})"
    check(browser.evaluate(corner) == OWN, "and drawn")
    plain = browser.evaluate(covered)
    set_input(browser, "splat-size", 2)
    large = browser.evaluate(covered)
    set_input(browser, "splat-size", 0.3)
    small = browser.evaluate(covered)
    browser.evaluate("document.getElementById('points').click()")
    points = browser.evaluate(covered)
    check(
        large > plain + 300 and plain > small + 300 and small > points > 100,
        f"smaller splats and points cover less: {large}, {plain}, {small}, {points} pixels",
    )
    check(browser.evaluate("document.getElementById('splat-size').disabled"), "points have no size")
    browser.evaluate("document.getElementById('points').click()")
    set_input(browser, "splat-size", 1)
    check(browser.evaluate(covered) == plain, "and back")

    near = pixel(browser, "depth")
    set_input(browser, "near", 4)  # the ball reaches from 3 to 5
    far = pixel(browser, "depth")
    check(near[0] > far[0] + 30, f"without its front, the back of the ball is seen: depth {near[0]}, then {far[0]}")
    set_input(browser, "near", 6)
    check(pixel(browser) == OWN, "and nothing behind all")
    set_input(browser, "near", 0)
    set_input(browser, "background", "#00ff80")
    check(browser.evaluate(corner) == [0, 255, 128], "another background is drawn")
    check(not browser.evaluate("document.getElementById('own-background').disabled"), "the file's own is offered")
    click(browser, "own-background")
    check(browser.evaluate(corner) == OWN, "and drawn again")

    set_input(browser, "background", "#102030")
    click(browser, "save-picture")
    name, data = downloads.take("the picture")
    size = browser.evaluate("[document.getElementById('canvas').width, document.getElementById('canvas').height]")
    check(
        (name, data[:8], list(struct.unpack(">2I", data[16:24]))) == ("scene.ngsplat.png", b"\x89PNG\r\n\x1a\n", size),
        f"a PNG of the canvas's size: {name}, {data[:24]}",
    )
    (site.folder / "saved.png").write_bytes(data)
    picture = f"""(async () => {{
        const image = await createImageBitmap(await (await fetch('saved.png')).blob()), [w, h] = [image.width, image.height];
        const context = new OffscreenCanvas(w, h).getContext('2d');
        context.drawImage(image, 0, 0);
        const data = context.getImageData(0, 0, w, h).data;
        return [w + 1, w * (h >> 1) + (w >> 1)].map(i => [...data.slice(4 * i, 4 * i + 4)]);
    }})()"""
    outside, middle = browser.evaluate(picture)
    check(outside == [16, 32, 48, 255], f"with its background: {outside}")
    check(
        max(abs(a - b) for a, b in zip(middle, pixel(browser))) < 40 and middle[:3] != outside[:3],
        f"and the model: {middle}, {pixel(browser)}",
    )


def check_frame(browser, site):
    fresh(browser, site.url + "#from=0,0,-1.5&to=0,0,9")
    # The part of the canvas that the ball reaches, by a picture read at once after it was drawn: left, right, low, high
    # from 0 to 1.
    reach = f"""(() => {{
        const canvas = document.getElementById('canvas'), gl = canvas.getContext('webgl2'), [w, h] = [canvas.width, canvas.height], all = new Uint8Array(4 * w * h);
        dispatchEvent(new Event('resize')); // draws
        gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
        let [left, right, low, high] = [w, -1, h, -1];
        for (let i = 0; i < w * h; ++i) if ({OWN}.some((c, k) => all[4 * i + k] !== c)) {{
            const x = i % w, y = i / w | 0;
            [left, right, low, high] = [Math.min(left, x), Math.max(right, x), Math.min(low, y), Math.max(high, y)];
        }}
        return [left / w, right / w, low / h, high / h];
    }})()"""
    is_outside = f"(([left, right, low, high]) => low === 0 && high > 0.99)({reach})"
    fits = f"(([left, right, low, high]) => Math.min(left, low) > 0 && Math.max(right, high) < 0.995 && high - low > 0.75)({reach})"
    wait_for(browser, is_outside, "the ball does not fit the view")
    click(browser, "frame")
    wait_for(browser, fits, "by a button all of it is seen, and fills the view")
    hash_to(browser, "from=0,0,-1.5&to=0,0,8")
    wait_for(browser, is_outside, "the ball does not fit the view again")
    key(browser, "f", "f")
    wait_for(browser, fits, "so it is by key")
    check("&to=" in fragment(browser), "from a pose of its own")
    click(browser, "reset")
    check((fragment(browser), shown(browser)) == ("", "Test view 1"), "the first view is there again")
    click(browser, "next")
    key(browser, "r", "r")
    check(fragment(browser) == "", "also by key")


# The middle of the picture as it is drawn, and the share of the picture that is not black.
SEEN = """(() => {
    const canvas = document.getElementById('canvas'), gl = canvas.getContext('webgl2'), [w, h] = [canvas.width, canvas.height], all = new Uint8Array(4 * w * h);
    dispatchEvent(new Event('resize')); // draws
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
    const at = (x, y) => [...all.subarray(4 * (w * y + x), 4 * (w * y + x) + 3)].map((v) => v > 128);
    let covered = 0, edge = 0;
    for (let i = 0; i < w * h; ++i) if (Math.max(...all.subarray(4 * i, 4 * i + 3)) > 64) {
        ++covered;
        edge += i < w || i >= w * (h - 1) || i % w === 0 || i % w === w - 1;
    }
    return { colours: [0.4, 0.45, 0.5, 0.55, 0.6].map((y) => at(w >> 1, Math.round(h * y)).map(Number).join('')), covered: covered / (w * h), edge };
})()"""


def check_first_view(browser, site):
    """Photographs that lie are shown upright; a model without cameras opens on its front, the whole in sight, whatever
    axis is up."""
    fresh(browser, site.url)
    for quarters, lies in ((0, False), (1, True), (3, True), (2, True)):
        name = f"turned {quarters}.ngsplat"
        drop(browser, name, scene_file(300, quarters))
        wait_for(browser, f"document.getElementById('name').textContent === '{name}'", f"{name} is shown")
        check(
            fragment(browser) == "" and (shown(browser) == "Free") == lies,
            f"{name}: what lies is shown upright: {shown(browser)}",
        )
    click(browser, "next")
    check(shown(browser) == "Test view 1", "the photograph as it is can be chosen")

    majority = lambda seen: max(seen["colours"], key=seen["colours"].count)
    drop(browser, "box.ply", box_ply())
    wait_for(browser, "document.getElementById('name').textContent === 'box.ply'", "a box without cameras is shown")
    fragment(browser)
    seen = browser.evaluate(SEEN)
    check(majority(seen) == "100", f"from its front: {seen}")
    check(seen["covered"] > 0.15 and seen["edge"] == 0, f"the whole, and not as a speck: {seen}")
    choose = lambda axis: browser.evaluate(
        f"{{ const up = document.getElementById('up'); up.value = '{axis}'; up.dispatchEvent(new Event('change')); }}"
    )
    for axis, colour in (("y", "001"), ("z", "111"), ("-z", "010"), ("", "100")):
        choose(axis)
        link, seen = fragment(browser), browser.evaluate(SEEN)
        check(majority(seen) == colour, f"with {axis or 'the own axis'} up it shows another front: {seen}")
        check(link == (f"#up={axis}" if axis else ""), f"the link says so: {link}")
    click(browser, "frame")
    fragment(browser)
    seen = browser.evaluate(SEEN)
    check(seen["covered"] > 0.15 and seen["edge"] == 0, f"the whole scene is not a speck, either: {seen}")
    check(max(abs(x) for x in pose(browser)[1]) < 0.2, f"and the camera turns about its middle: {pose(browser)}")
    drop(browser, "z.ply", box_ply(comment="Vertical Axis: z"))
    wait_for(browser, "document.getElementById('name').textContent === 'z.ply'", "a box that says which axis is up")
    fragment(browser)
    seen = browser.evaluate(SEEN)
    check(majority(seen) == "111", f"the axis that a file names is up: {seen}")


def check_own_page(browser, site):
    """What gsapp export writes into the page: a title, and how it begins."""
    browser.call("Network.setCacheDisabled", cacheDisabled=True)  # the page changes within a second
    page = site.folder / "index.html"
    as_it_was = page.read_text()
    for start, link, view in (
        ("view=2", "", "Test view 2"),
        ("from=0,1,-5&amp;to=0,0,0&amp;fov=40&amp;mode=base", "#mode=base", "Free"),
    ):
        page.write_text(
            as_it_was.replace(
                "</title>",
                f'</title><meta name="gsapp:title" content="My &amp; ball" /><meta name="gsapp:start" content="{start}" />',
            )
        )
        fresh(browser, site.url)
        name = "document.getElementById('name').textContent"
        check(
            (browser.evaluate("document.title"), browser.evaluate(name)) == ("My & ball", "My & ball"),
            "the page has its title",
        )
        check(
            ((at := fragment(browser)), shown(browser)) == (link, view),
            f"it begins with its view: {at}, {shown(browser)}",
        )
        click(browser, "previous" if view == "Test view 2" else "next")
        check("#view=1" in fragment(browser), f"from which another view differs: {browser.evaluate('location.hash')}")
        click(browser, "reset")
        check(
            ((at := fragment(browser)), shown(browser)) == (link, view),
            f"and which is the first one: {at}, {shown(browser)}",
        )
        drop(browser, "mine.ngsplat", scene_file(10))
        wait_for(browser, f"{name} === 'mine.ngsplat'", "another file has its own name")
        check(shown(browser) == "Test view 1", "and its own first view")
    page.write_text(as_it_was)
    browser.call("Network.setCacheDisabled", cacheDisabled=False)


def check_keys(browser, site):
    fresh(browser, site.url)
    check(
        browser.evaluate("[...document.querySelectorAll('h1')].filter(h => h.checkVisibility()).length") == 1,
        "the page has one h1",
    )
    is_open = "document.getElementById('help').open"
    browser.evaluate("document.body.focus()")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="?", text="?")
    check(browser.evaluate(is_open), "? opens the keys")
    missing = [
        k
        for k in "FRXPKWASDQE"
        if k not in browser.evaluate("[...document.querySelectorAll('#help kbd')].map(k => k.textContent)")
    ]
    check(missing == [], f"all of them: {missing}")
    browser.press("Escape", 27)
    wait_for(browser, f"!{is_open}", "Escape closes them")
    click(browser, "open-help")
    check(browser.evaluate(is_open), "so does the button")
    browser.press("Escape", 27)
    wait_for(browser, f"!{is_open}", "Escape closes them again")
    drop(browser, "bad.ngsplat", b"x")
    wait_for(browser, "document.getElementById('dismiss').checkVisibility()", "a message")
    browser.press("Escape", 27)
    check(message(browser) == "", "Escape closes messages")
    click(browser, "toggle")
    browser.evaluate(
        "{ const field = document.getElementById('repeats'); field.closest('details').open = true; field.focus(); }"
    )
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="?", text="?")
    check(not browser.evaluate(is_open), "in a field, ? is a character")
    check(browser.evaluate("document.fullscreenEnabled"), "this browser can fill the screen")
    browser.call("Runtime.evaluate", expression="document.getElementById('fullscreen').click()", userGesture=True)
    wait_for(browser, "document.fullscreenElement?.id === 'stage'", "the picture fills the screen")
    browser.call("Runtime.evaluate", expression="document.exitFullscreen()", awaitPromise=True)
    key(browser, "x", "x")
    wait_for(browser, "document.fullscreenElement?.id === 'stage'", "also by key")
    key(browser, "x", "x")
    wait_for(browser, "!document.fullscreenElement", "and back")


CLOCK = """{
    window.clockTime = 1000; window.waiting = [];
    performance.now = () => clockTime;
    window.requestAnimationFrame = (action) => waiting.push(action);
    window.cancelAnimationFrame = (id) => { waiting[id - 1] = () => undefined; };
    window.pass = (milliseconds) => { clockTime += milliseconds; waiting.splice(0).forEach((action) => action(clockTime)); };
}"""


def stop_clock(browser):
    """From here on time passes in the page when `passes` says so, a frame at a time."""
    browser.evaluate(CLOCK)


def passes(browser, *milliseconds):
    browser.evaluate(f"{list(milliseconds)}.forEach(pass)")


def pose(browser):
    """From where to what point the camera looks, as it is now."""
    click(browser, "copy-link")  # which brings the address up to date at once
    pairs = dict(pair.split("=") for pair in browser.evaluate("location.hash.slice(1)").split("&") if pair)
    return tuple([float(x) for x in pairs[name].split(",")] for name in ("from", "to"))


def mouse(browser, *events, button="left"):
    """Events of a mouse: its kind and where it is."""
    for kind, x, y in events:
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=1, clickCount=1)


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def check_visitor(browser, site):
    """What someone sees who follows a link: the picture, without the tools of research, and keys that work at once."""
    fresh(browser, site.url)
    visible = lambda: browser.evaluate(
        "['controls', 'meter', 'toggle', 'open-help', 'name'].filter(id => document.getElementById(id).checkVisibility())"
    )
    check(visible() == ["toggle", "open-help", "name"], f"the settings and the counters are closed: {visible()}")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
    browser.call("Input.dispatchKeyEvent", type="keyUp", key="ArrowLeft")
    check(
        (at := fragment(browser)).startswith("#from=") and "panel" not in at,
        f"a key moves the camera before anything is clicked: {at}",
    )
    click(browser, "toggle")
    check(visible() == ["controls", "meter", "toggle", "open-help", "name"], f"a click opens them: {visible()}")
    check((at := fragment(browser)).endswith("&panel=open"), f"the link remembers it: {at}")
    fresh(browser, site.url + at)
    check("controls" in visible() and fragment(browser) == at, "and opens them elsewhere")
    click(browser, "toggle")
    check("panel" not in fragment(browser) and "controls" not in visible(), "closed again, it says nothing")


def check_every_key(browser, site, downloads):
    """Presses every key that the help names, and sees what it does."""
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=400, height=300, deviceScaleFactor=0.5, mobile=False
    )  # drawn in software, small pictures save time
    move_as_usual(browser)
    fresh(browser, site.url)
    documented = {
        part: set(browser.evaluate(f"[...document.querySelectorAll('#help-{part} kbd')].map(k => k.textContent)"))
        for part in ("keys", "orbit", "fly")
    }
    start = "from=0,0,-4&to=0,0,0"  # up is -y, and right x

    def from_start(action, more=""):
        hash_to(browser, "mode=base")
        hash_to(browser, start + more)
        action()
        passes(browser, 1000, 100)
        at, to = pose(browser)
        return [minus(at, [0, 0, -4]), to], math.dist(at, to) - 4

    names = {"←": "ArrowLeft", "→": "ArrowRight", "↑": "ArrowUp", "↓": "ArrowDown", "−": "-"}
    stop_clock(browser)
    browser.evaluate("{ const draw = setInterval(() => pass(0), 20); }")  # frames come, while no time passes
    orbit = {"←": (0, -1), "→": (0, 1), "↑": (1, -1), "↓": (1, 1)}
    check(
        documented["orbit"] == {*orbit, "+", "−", "Shift"}, f"the test knows the keys of orbit: {documented['orbit']}"
    )
    for name, (axis, sign) in orbit.items():
        (at, to), farther = from_start(lambda: key(browser, names[name]))
        check(
            at[axis] * sign > 0.1 and to == [0, 0, 0] and abs(farther) < 0.01,
            f"{name} turns the camera around the model: {at}, {to}",
        )
        (at, to), _ = from_start(lambda: key(browser, names[name], modifiers=8))
        check(
            at[axis] * sign > 0.05 and math.dist(at, to) < 0.01,
            f"Shift with {name} moves camera and model along: {at}, {to}",
        )
    for name, sign in (("+", -1), ("=", -1), ("-", 1)):
        (_, to), farther = from_start(lambda: key(browser, name, name))
        check(
            0.1 < sign * farther < 0.5 and to == [0, 0, 0],
            f"{name} comes {'closer' if sign < 0 else 'less close'}: by {farther}",
        )

    def hold(name):
        browser.call("Input.dispatchKeyEvent", type="keyDown", key=names.get(name, name))
        passes(browser, *[50] * 4)
        browser.call("Input.dispatchKeyEvent", type="keyUp", key=names.get(name, name))

    fly = {"W": (2, 1), "S": (2, -1), "A": (0, -1), "D": (0, 1), "Q": (1, 1), "E": (1, -1)}
    check(documented["fly"] == {*fly, *orbit}, f"the test knows the keys of flying: {documented['fly']}")
    browser.evaluate("document.getElementById('canvas').focus()")
    for name, (axis, sign) in fly.items():
        (at, to), _ = from_start(lambda: hold(name.lower()), "&move=fly")
        check(
            at[axis] * sign > 0.1 and all(abs(at[k]) < 1e-3 for k in range(3) if k != axis),
            f"{name} moves the camera: {at}",
        )
    for name, (axis, sign) in orbit.items():
        (at, to), _ = from_start(lambda: hold(name), "&move=fly")
        check(at == [0, 0, 0] and to[axis] * sign > 0.1, f"{name} looks around: {at}, {to}")

    browser.call("Emulation.setEmulatedMedia", features=[])
    fresh(browser, site.url)
    keyframes = "document.getElementById('keyframes').children.length"
    effects = {
        "?": lambda: wait_for(browser, "document.getElementById('help').open", "? opens the help"),
        "F": lambda: check((at := fragment(browser)).startswith("#from="), f"F shows the whole scene: {at}"),
        "R": lambda: check((at := fragment(browser)) == "", f"R shows the first view: {at}"),
        "X": lambda: wait_for(browser, "document.fullscreenElement?.id === 'stage'", "X fills the screen"),
        "P": lambda: check(downloads.take("the picture")[1][:4] == b"\x89PNG", "P saves the picture"),
        "K": lambda: check(browser.evaluate(keyframes) == 1, "K adds a keyframe"),
    }
    check(documented["keys"] == set(effects), f"the test knows the other keys: {documented['keys']}")
    for name in "FRKPX?":
        key(browser, name.lower(), name.lower())
        effects[name]()
    browser.press("Escape", 27)
    browser.call("Runtime.evaluate", expression="document.exitFullscreen()", awaitPromise=True)
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_drag(browser, site):
    """A drag goes on for a moment, unless less motion is asked for; either way it goes as far."""
    ends = []
    for motion in ("no-preference", "reduce"):
        move_as_usual(browser, motion)
        for move in ("orbit", "fly"):
            fresh(browser, site.url)
            hash_to(browser, f"from=0,0,-4&to=0,0,0&move={move}")
            stop_clock(browser)
            mouse(browser, ("mousePressed", 300, 300), ("mouseMoved", 340, 300), ("mouseMoved", 380, 300))
            passes(browser, 20)
            mouse(browser, ("mouseReleased", 380, 300))
            at = [pose(browser)]
            for _ in range(2):
                passes(browser, *[50] * 30)
                at.append(pose(browser))
            glided, later = math.dist(*[a[0] + a[1] for a in at[:2]]), math.dist(*[a[0] + a[1] for a in at[1:]])
            check(later == 0, f"{move}, {motion}: it comes to rest")
            check(
                glided > 0.1 if motion == "no-preference" else glided == 0,
                f"{move}, {motion}: it goes on by {glided} after the mouse is released",
            )
            ends.append(at[-1])
    browser.call("Emulation.setEmulatedMedia", features=[])
    check(
        all(math.dist(a, b) < 0.02 for first, second in zip(ends[:2], ends[2:]) for a, b in zip(first, second)),
        f"as far with less motion: {ends}",
    )


def wait_for_picture(browser):
    """Until nothing else needs the model as it is: then its pixels can be had."""
    browser.evaluate(
        """(async () => {
        while (!(await gsapp.testViewPixels(0, 'depth').catch(() => undefined))) await new Promise(requestAnimationFrame);
    })()"""
    )


def check_focus(browser, site):
    """A double click turns to what is there, and the camera moves around it from then on."""
    move_as_usual(browser)
    fresh(browser, site.url + "#from=0,0,-4&to=0,0,0")
    middle = browser.evaluate(
        "(({ clientWidth, clientHeight }) => [clientWidth / 2, clientHeight / 2])(document.getElementById('canvas'))"
    )
    twice = lambda x, y: [
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=2)
        for kind in ("mousePressed", "mouseReleased")
    ]
    twice(5, 5)
    check(
        fragment(browser) == "#from=0,0,-4&to=0,0,0&fov=45.24",
        f"there is nothing to turn to: {browser.evaluate('location.hash')}",
    )
    wait_for_picture(browser)  # what looks there may not be finished, and leaves out other clicks until it is
    twice(middle[0] + 90, middle[1] - 60)
    wait_for(browser, "!location.hash.includes('&to=0,0,0&')", "it turns")
    before = None
    while before != (before := pose(browser)):  # until it has come to rest
        browser.evaluate(  # a busy machine may draw nothing for a second
            "new Promise((done, _, left = 20) => requestAnimationFrame(function next() {"
            " left-- ? requestAnimationFrame(next) : done(); }))"
        )
    at, to = before
    check(
        at == [0, 0, -4] and abs(math.hypot(*to) - 1) < 0.15,
        f"to the surface of the ball, from where it is: {at}, {to}",
    )
    check(to[0] > 0.2 and to[1] < -0.1 and to[2] < -0.5, f"where the click was: {to}")
    key(browser, "ArrowLeft")
    fragment(browser)
    turned, same = pose(browser)
    check(
        math.dist(to, same) < 1e-3
        and math.dist(turned, at) > 0.1
        and abs(math.dist(turned, to) - math.dist(at, to)) < 1e-2,
        f"keys turn around it: {turned}, {same}",
    )
    browser.call("Emulation.setEmulatedMedia", features=[])


def check_speed(browser, site):
    fresh(browser, site.url + "#from=0,0,-4&to=0,0,0&move=fly")
    stop_clock(browser)
    ways = []
    for notches in (0, 3):
        for _ in range(notches):
            browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=300, y=300, deltaX=0, deltaY=-100)
        before, _ = pose(browser)
        browser.evaluate("document.getElementById('canvas').focus()")
        browser.call("Input.dispatchKeyEvent", type="keyDown", key="s")
        passes(browser, *[50] * 4)
        browser.call("Input.dispatchKeyEvent", type="keyUp", key="s")
        passes(browser, 50)
        ways.append(math.dist(before, pose(browser)[0]))
    check(abs(ways[1] / ways[0] - 1.25**3) < 0.01, f"the wheel makes flying faster: {ways}")
    check(browser.evaluate("document.getElementById('said').textContent") == "Speed × 2", "and says by how much")


def check_help_on_phone(browser, site):
    """On a phone, every line of the help has room for its words."""
    browser.call("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=1, mobile=True)
    fresh(browser, site.url)
    click(browser, "open-help")
    narrow = browser.evaluate(
        "[...document.querySelectorAll('#help :is(p, dd)')].filter(e => e.clientWidth < 180).map(e => e.textContent)"
    )
    check(narrow == [], f"narrower than they are long: {narrow}")
    check(
        browser.evaluate(
            "(({ left, right }) => left >= 0 && right <= 390)(document.getElementById('help').getBoundingClientRect())"
        ),
        "it is within the screen",
    )
    check(
        browser.evaluate("(h => h.scrollWidth <= h.clientWidth)(document.getElementById('help'))"),
        "and needs no scrolling aside",
    )
    check(browser.evaluate("document.getElementById('help').scrollTop") == 0, "it begins at its beginning")
    browser.call("Emulation.clearDeviceMetricsOverride")


def check_embedded(browser, site):
    fresh(browser, site.url + "?embed#view=2&background=ffffff")
    visible = browser.evaluate(
        "[...document.querySelectorAll('button, select, input, a')].filter(c => c.checkVisibility()).map(c => c.id)"
    )
    check(visible == [], f"embedded, there are no controls: {visible}")
    check(
        browser.evaluate(
            "document.getElementById('canvas').clientWidth === innerWidth && document.getElementById('canvas').clientHeight === innerHeight"
        ),
        "the picture is all",
    )
    key(browser, "ArrowLeft")
    check(fragment(browser).startswith("#from="), "keys move the camera")
    browser.evaluate("location.hash = ''")
    for kind, x in (("mousePressed", 300), ("mouseMoved", 400), ("mouseReleased", 400)):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=300, button="left", buttons=1, clickCount=1)
    check(fragment(browser).startswith("#from="), "and the mouse")
    (site.folder / "page.html").write_text(
        "<iframe src='index.html?embed#mode=base' width='640' height='480' title='A scene'></iframe>"
    )
    browser.open(site.url + "page.html")
    wait_for(
        browser,
        "frames[0].gsapp && frames[0].document.body.matches('.embedded.loaded')",
        "another page shows it in a frame",
    )


def check_film(browser, site, downloads):
    fresh(browser, site.url)
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    said = "document.getElementById('film-message').textContent"
    add = lambda: click(browser, "add-keyframe")
    add()
    click(browser, "next")
    key(browser, "k", "k")
    check(
        browser.evaluate("document.getElementById('keyframes').children.length") == 2,
        "a button and a key add keyframes",
    )
    click(browser, "reset")
    browser.evaluate("document.querySelector('[aria-label=\"Go to keyframe 2\"]').click()")
    check((at := fragment(browser)).startswith("#from=3.4,0,-2.2&to="), f"a keyframe is gone to: {at}")
    add()
    browser.evaluate("document.querySelector('[aria-label=\"Remove keyframe 3\"]').click()")
    check(browser.evaluate("document.getElementById('keyframes').children.length") == 2, "a keyframe can be removed")

    set_input(browser, "seconds", 2)
    set_input(browser, "frame-rate", 10)
    click(browser, "save-cameras")
    name, data = downloads.take("a path")
    cameras = json.loads(data)
    check(
        (name, len(cameras), [c["keyframe"] for c in cameras].count(True)) == ("cameras.json", 20, 2),
        f"it has all pictures: {name}, {len(cameras)}",
    )
    first, last = cameras[0], cameras[-1]
    close = lambda a, b: all(abs(x - y) < 1e-5 for x, y in zip(a, b, strict=True))
    check(
        close(first["position"], [0, 0, -4]) and close(last["position"], [3.4, 0, -2.2]),
        "from the first test view to the second",
    )
    columns = list(zip(*last["rotation"]))  # right, down, forward
    check(
        close(columns[2], unit([-3.4, 0, 2.2])) and close(columns[1], [0, 1, 0]),
        f"rotations are from camera to world: {columns}",
    )
    check((first["width"], first["height"], first["fx"], first["fy"]) == (100, 100, 120, 120), "with the lens")
    click(browser, "save-nerfstudio")
    name, path = downloads.take("a path for nerfstudio")
    check(
        (name, len(json.loads(path)["camera_path"]), json.loads(path)["seconds"]) == ("camera_path.json", 20, 2),
        "the other form as well",
    )

    for text in (data, path):
        fresh(browser, site.url)
        load = f"""{{ const input = document.getElementById('path-file'), transfer = new DataTransfer();
            transfer.items.add(new File([{json.dumps(text.decode())}], 'path.json'));
            input.files = transfer.files;
            input.dispatchEvent(new Event('change')); }}"""
        browser.evaluate(load)
        wait_for(browser, "document.getElementById('keyframes').children.length === 2", "the keyframes are read again")
        check((at := fragment(browser)).startswith("#from=0,0,-4&"), f"and the first is shown: {at}")
    browser.evaluate(load.replace("camera_to_world", "something"))
    wait_for(
        browser,
        f"{said}.includes('camera 1: camera_to_world is not 16 numbers')",
        "a bad path is refused with a reason",
    )
    check(browser.evaluate("document.getElementById('keyframes').children.length") == 2, "the keyframes stay")

    set_input(browser, "seconds", 1)
    click(browser, "play-path")
    check(
        browser.evaluate(
            "document.getElementById('record-path').disabled && !document.getElementById('stop-film').disabled"
        ),
        "while it plays there is a way to stop it",
    )
    wait_for(browser, "document.getElementById('stop-film').disabled", "it ends")
    check((at := fragment(browser)).startswith("#from=3.4,0,-2.2&"), f"where the path does: {at}")
    check(browser.evaluate(said) == "", "without complaint")
    set_input(browser, "seconds", 600)
    click(browser, "play-path")
    browser.press("Escape", 27)
    wait_for(browser, "document.getElementById('stop-film').disabled", "Escape stops it")


def record_films(browser, site, downloads, seconds):
    """A turntable and a path of so many seconds: the bytes, in how many seconds they were recorded, and the canvas's
    size."""
    fresh(browser, site.url)
    for button in ("add-keyframe", "next", "add-keyframe"):
        click(browser, button)
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=360, height=480, deviceScaleFactor=0.5, mobile=False
    )  # drawn in software, more pictures of it fit into a second
    set_input(browser, "seconds", seconds)
    wait_for(browser, "document.getElementById('canvas').width === 180", "the canvas is smaller")
    size = browser.evaluate("[document.getElementById('canvas').width, document.getElementById('canvas').height]")
    said, films = "document.getElementById('film-message').textContent", {}
    for button in ("record-turntable", "record-path"):
        start = time.monotonic()
        click(browser, button)
        name, film = downloads.take("a video", 600)
        films[button] = film, time.monotonic() - start
        check(name == "video.webm" and film[:4] == b"\x1a\x45\xdf\xa3", f"it is WebM: {name}, {film[:8]}")
    check("Saved" in browser.evaluate(said), "saving is said")
    browser.evaluate("window.MediaRecorder = undefined")
    click(browser, "record-turntable")
    wait_for(browser, f"{said}.includes('cannot record')", "a browser without a recorder says so")
    browser.call("Emulation.clearDeviceMetricsOverride")
    return films, size


# Width, height, seconds and the number of different pictures of a film. It stops at each, lest a busy machine leaves
# some out. If it does not open, what the browser says of it.
PLAY = """new Promise(resolve => {
    const video = document.querySelector('video'), context = new OffscreenCanvas(64, 64).getContext('2d', { willReadFrequently: true }), pictures = new Set();
    const look = () => {
        video.pause();
        context.drawImage(video, 0, 0, 64, 64);
        pictures.add(context.getImageData(0, 0, 64, 64).data.join());
        video.requestVideoFrameCallback(look);
        if (!video.ended) video.play().catch(() => undefined); // which the next pause refuses
    };
    video.requestVideoFrameCallback(look);
    video.onerror = () => resolve([video.error.message]);
    video.onended = () => resolve([video.videoWidth, video.videoHeight, video.currentTime, pictures.size]);
    video.src = '%s.webm?%d';
    video.play().catch(() => undefined);
})"""


def check_recording(browser, site, downloads):
    """Films play, in motion. A busy machine draws few pictures a second, and gets longer films until there are some."""
    (site.folder / "player.html").write_text("<video muted></video>")
    for seconds in (1, 2, 4, 8, 16, 32, 64):
        films, size = record_films(browser, site, downloads, seconds)
        browser.open(site.url + "player.html")
        enough = True
        for button, (film, took) in films.items():
            (site.folder / f"{button}.webm").write_bytes(film)
            seen = browser.evaluate(PLAY % (button, seconds))
            print(f"{button} of {seconds} s: {seen}, recorded in {took:.1f} s", flush=True)
            if len(seen) == 1:  # nothing was drawn while it was recorded: a film without pictures does not open
                enough = False
                continue
            width, height, length, pictures = seen
            check(
                abs(width - size[0]) <= 1 and abs(height - size[1]) <= 1 and length < took + 1,
                f"{button}: it plays: {seen}, canvas {size}, recorded in {took:.1f} s",
            )
            enough &= pictures > 3 and length > 0.5 * seconds
        if enough:
            return
    check(False, "they play, in motion")


def check_lost_device(browser, site):
    pixels = "gsapp.testViewPixels(1, 'full').then(v => v.pixels.join())"
    lose = """(async () => {
        const device = document.getElementById('canvas').getContext('webgl2').getExtension('WEBGL_lose_context');
        const lost = new Promise(resolve => document.getElementById('canvas').addEventListener('webglcontextlost', () => setTimeout(resolve)));
        device.loseContext();
        await lost;
        const words = document.getElementById('notice').innerText;
        device.restoreContext();
        return words;
    })()"""
    for how in ("from the site", "of the user"):
        fresh(browser, site.url)
        if how == "of the user":
            drop(browser, "mine.ngsplat", scene_file(500))
            wait_for(browser, "document.getElementById('name').textContent === 'mine.ngsplat'", "a file is shown")
        before = browser.evaluate(pixels)
        key(browser, "ArrowLeft")
        browser.evaluate("document.querySelector('[value=base]').click()")
        moved, name = fragment(browser), browser.evaluate("document.getElementById('name').textContent")
        check("device was lost" in browser.evaluate(lose), "a lost device is noticed")
        wait_for(
            browser,
            "document.body.matches('.loaded') && document.getElementById('notice').hidden",
            f"a model {how} comes back with the device",
        )
        check(
            ((at := fragment(browser)), browser.evaluate("document.getElementById('name').textContent"))
            == (moved, name),
            f"seen as before: {at}, {moved}",
        )
        check(browser.evaluate(pixels) == before, "with the same pictures")
    fresh(browser, site.url)
    browser.call("Network.setCacheDisabled", cacheDisabled=True)
    (site.folder / "scene.ngsplat").rename(site.folder / "elsewhere.ngsplat")
    browser.evaluate(lose)
    wait_for(
        browser, "document.getElementById('notice').innerText.includes('404')", "a model that is gone is said to be"
    )
    (site.folder / "elsewhere.ngsplat").rename(site.folder / "scene.ngsplat")
    browser.errors = [e for e in browser.errors if "404" not in e]


def check_accessibility(browser, site):
    """In every state that shows other controls."""
    fresh(browser, site.url)
    states = {
        "the page": "",
        "the settings": "document.getElementById('toggle').click()",
        "all settings": "document.querySelectorAll('details').forEach(d => d.open = true); document.getElementById('add-keyframe').click()",
        "the keys": "document.getElementById('open-help').click()",
        "a message": "document.querySelector('#help button').click(); document.getElementById('notice').hidden = false; document.getElementById('notice-title').textContent = 'A message'",
        "a folded panel": "document.getElementById('notice').hidden = true; document.getElementById('toggle').click()",
        "embedded": "document.body.classList.add('embedded')",
    }
    for state, action in states.items():
        browser.evaluate(f"{{ {action} }}")
        check_accessible(browser, state)


def main():
    program = find_chromium()
    viewer = pathlib.Path(sys.argv[1])
    if program is None or not (viewer / "index.html").exists():
        print("skipped: no chromium on PATH, or the viewer is not built (scripts/build-viewer)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder, saved = pathlib.Path(name) / "site", pathlib.Path(name) / "saved"
        shutil.copytree(viewer, folder)
        saved.mkdir()
        (folder / "scene.ngsplat").write_bytes(scene_file(COUNT))
        site = Site(folder)
        with Browser(program, width=800, height=600, flags=SOFTWARE_WEBGL) as browser:
            downloads = Downloads(browser, saved)
            check_link(browser, site)
            check_settings(browser, site, downloads)
            check_frame(browser, site)
            check_first_view(browser, site)
            check_visitor(browser, site)
            check_own_page(browser, site)
            check_keys(browser, site)
            check_every_key(browser, site, downloads)
            check_drag(browser, site)
            check_focus(browser, site)
            check_speed(browser, site)
            check_help_on_phone(browser, site)
            check_film(browser, site, downloads)
            check_recording(browser, site, downloads)
            check_lost_device(browser, site)
            check_embedded(browser, site)
            check_accessibility(browser, site)
            check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


sys.exit(main())
