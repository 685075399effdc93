# SPDX-License-Identifier: Apache-2.0
"""Uses what stands around the viewer's picture: links, settings, keys, files to save.

Usage: viewer_controls_test.py VIEWER. VIEWER is apps/viewer/dist after scripts/build-viewer. Exit status 77: no Chromium, or no viewer there.
"""

import json
import pathlib
import shutil
import struct
import sys
import tempfile

from browser import Browser, check, check_accessible, find_chromium
from site_server import SOFTWARE_WEBGL, Site, open_viewer, wait_for
from viewer_scenes import BACKGROUND, Downloads, drop, message, pixel, scene_file, unit

OWN = [round(255 * x) for x in BACKGROUND]
COUNT = 3000


def click(browser, button):
    browser.evaluate(f"document.getElementById('{button}').click()")


def fresh(browser, url):
    """Another page in between, as browsers do not load again what differs in its fragment alone."""
    browser.open("about:blank")
    open_viewer(browser, url)


def set_input(browser, name, value):
    """What a person does to a slider or a colour."""
    browser.evaluate(f"{{ const i = document.getElementById('{name}'); i.value = '{value}'; i.dispatchEvent(new Event('input', {{ bubbles: true }})); }}")


def fragment(browser):
    """The fragment of the address, when it and the controls are up to date."""
    return browser.evaluate("new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(() => resolve(location.hash), 600))))")


def hash_to(browser, text):
    browser.evaluate(f"new Promise(resolve => {{ addEventListener('hashchange', () => requestAnimationFrame(() => requestAnimationFrame(resolve)), {{ once: true }}); location.hash = '{text}'; }})")


def key(browser, name, text=None):
    """Presses a key that the picture gets."""
    browser.evaluate("document.getElementById('canvas').focus()")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key=name, text=text or "")
    browser.call("Input.dispatchKeyEvent", type="keyUp", key=name)


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
    check(moved.startswith("#from=") and "&to=" in moved and moved.endswith("&mode=depth&background=ff8000"), f"so are a pose and settings: {moved}")
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    click(browser, "copy-link")
    wait_for(browser, "document.getElementById('picture-message').textContent === 'Copied.'", "copying is said to be done")
    check(browser.evaluate("navigator.clipboard.readText()") == site.url + moved, "the link is the address")

    fresh(browser, site.url + moved)
    check((at := fragment(browser)) == moved, f"opening the link shows the same: {at}")
    check(browser.evaluate("document.querySelector('[value=depth]').checked") and value(browser, "background") == "#ff8000", "and sets the controls")
    hash_to(browser, "view=2&mode=base")
    check(((at := fragment(browser)), shown(browser)) == ("#view=2&mode=base", "Test view 2"), f"another fragment is followed: {at}")
    hash_to(browser, "from=1,2&to=x&mode=nothing&fov=1e9&view=99&size=-3&background=zzzzzz&near=NaN&=&%25&points=on")
    check(((at := fragment(browser)), shown(browser)) == ("#points=on", "Test view 1"), f"nonsense in it is left out: {at}")
    check(message(browser) == "", "without a word")
    hash_to(browser, "from=0,0,-4&to=0,0,0&fov=45.2397")  # of the first test view
    check(shown(browser) == "Free", "a pose belongs to no test view")
    drop(browser, "mine.ngsplat", scene_file(10))
    wait_for(browser, "document.getElementById('name').textContent === 'mine.ngsplat'", "a file is shown")
    click(browser, "copy-link")
    wait_for(browser, "document.getElementById('picture-message').textContent.includes('cannot hold the file')", "a link to it says what it lacks")


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
    check(large > plain + 300 and plain > small + 300 and small > points > 100, f"smaller splats and points cover less: {large}, {plain}, {small}, {points} pixels")
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
    check((name, data[:8], list(struct.unpack(">2I", data[16:24]))) == ("scene.ngsplat.png", b"\x89PNG\r\n\x1a\n", size), f"a PNG of the canvas's size: {name}, {data[:24]}")
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
    check(max(abs(a - b) for a, b in zip(middle, pixel(browser))) < 40 and middle[:3] != outside[:3], f"and the model: {middle}, {pixel(browser)}")


def check_frame(browser, site):
    fresh(browser, site.url + "#from=0,0,-1.5&to=0,0,9")
    # The part of the canvas that the ball reaches, by a picture read at once after it was drawn: left, right, low, high from 0 to 1.
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
    fits = f"(([left, right, low, high]) => Math.min(left, low) > 0 && Math.max(right, high) < 0.995 && right - left > 0.75)({reach})"
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


def check_keys(browser, site):
    fresh(browser, site.url)
    check(browser.evaluate("[...document.querySelectorAll('h1')].filter(h => h.checkVisibility()).length") == 1, "the page has one h1")
    is_open = "document.getElementById('help').open"
    browser.evaluate("document.body.focus()")
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="?", text="?")
    check(browser.evaluate(is_open), "? opens the keys")
    missing = [k for k in "FRXPKWASDQE" if k not in browser.evaluate("[...document.querySelectorAll('#help kbd')].map(k => k.textContent)")]
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
    browser.evaluate("{ const field = document.getElementById('repeats'); field.closest('details').open = true; field.focus(); }")
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


def check_embedded(browser, site):
    fresh(browser, site.url + "?embed#view=2&background=ffffff")
    visible = browser.evaluate("[...document.querySelectorAll('button, select, input, a')].filter(c => c.checkVisibility()).map(c => c.id)")
    check(visible == [], f"embedded, there are no controls: {visible}")
    check(browser.evaluate("document.getElementById('canvas').clientWidth === innerWidth && document.getElementById('canvas').clientHeight === innerHeight"), "the picture is all")
    key(browser, "ArrowLeft")
    check(fragment(browser).startswith("#from="), "keys move the camera")
    browser.evaluate("location.hash = ''")
    for kind, x in (("mousePressed", 300), ("mouseMoved", 400), ("mouseReleased", 400)):
        browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=300, button="left", buttons=1, clickCount=1)
    check(fragment(browser).startswith("#from="), "and the mouse")
    (site.folder / "page.html").write_text("<iframe src='index.html?embed#mode=base' width='640' height='480' title='A scene'></iframe>")
    browser.open(site.url + "page.html")
    wait_for(browser, "frames[0].gsapp && frames[0].document.body.matches('.embedded.loaded')", "another page shows it in a frame")


def check_film(browser, site, downloads):
    fresh(browser, site.url)
    browser.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    said = "document.getElementById('film-message').textContent"
    add = lambda: click(browser, "add-keyframe")
    add()
    click(browser, "next")
    key(browser, "k", "k")
    check(browser.evaluate("document.getElementById('keyframes').children.length") == 2, "a button and a key add keyframes")
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
    check((name, len(cameras), [c["keyframe"] for c in cameras].count(True)) == ("cameras.json", 20, 2), f"it has all pictures: {name}, {len(cameras)}")
    first, last = cameras[0], cameras[-1]
    close = lambda a, b: all(abs(x - y) < 1e-5 for x, y in zip(a, b, strict=True))
    check(close(first["position"], [0, 0, -4]) and close(last["position"], [3.4, 0, -2.2]), "from the first test view to the second")
    columns = list(zip(*last["rotation"]))  # right, down, forward
    check(close(columns[2], unit([-3.4, 0, 2.2])) and close(columns[1], [0, 1, 0]), f"rotations are from camera to world: {columns}")
    check((first["width"], first["height"], first["fx"], first["fy"]) == (100, 100, 120, 120), "with the lens")
    click(browser, "save-nerfstudio")
    name, path = downloads.take("a path for nerfstudio")
    check((name, len(json.loads(path)["camera_path"]), json.loads(path)["seconds"]) == ("camera_path.json", 20, 2), "the other form as well")

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
    wait_for(browser, f"{said}.includes('camera 1: camera_to_world is not 16 numbers')", "a bad path is refused with a reason")
    check(browser.evaluate("document.getElementById('keyframes').children.length") == 2, "the keyframes stay")

    set_input(browser, "seconds", 1)
    click(browser, "play-path")
    check(browser.evaluate("document.getElementById('record-path').disabled && !document.getElementById('stop-film').disabled"), "while it plays there is a way to stop it")
    wait_for(browser, "document.getElementById('stop-film').disabled", "it ends")
    check((at := fragment(browser)).startswith("#from=3.4,0,-2.2&"), f"where the path does: {at}")
    check(browser.evaluate(said) == "", "without complaint")
    set_input(browser, "seconds", 600)
    click(browser, "play-path")
    browser.press("Escape", 27)
    wait_for(browser, "document.getElementById('stop-film').disabled", "Escape stops it")

    browser.call("Emulation.setDeviceMetricsOverride", width=360, height=480, deviceScaleFactor=1, mobile=False)  # drawn in software, more pictures of it fit into a second
    set_input(browser, "seconds", 4)
    wait_for(browser, "document.getElementById('canvas').width === 360", "the canvas is smaller")
    size = browser.evaluate("[document.getElementById('canvas').width, document.getElementById('canvas').height]")
    films = {}
    for button in ("record-turntable", "record-path"):
        click(browser, button)
        name, films[button] = downloads.take("a video", 60)
        check(name == "video.webm" and films[button][:4] == b"\x1a\x45\xdf\xa3", f"it is WebM: {name}, {films[button][:8]}")
    check("Saved" in browser.evaluate(said), "saving is said")
    browser.evaluate("window.MediaRecorder = undefined")
    click(browser, "record-turntable")
    wait_for(browser, f"{said}.includes('cannot record')", "a browser without a recorder says so")

    browser.call("Emulation.clearDeviceMetricsOverride")
    (site.folder / "player.html").write_text("<video muted></video>")
    browser.open(site.url + "player.html")
    for button, film in films.items():
        (site.folder / f"{button}.webm").write_bytes(film)
        seen = browser.evaluate(f"""new Promise((resolve, reject) => {{
            const video = document.querySelector('video'), context = new OffscreenCanvas(64, 64).getContext('2d', {{ willReadFrequently: true }}), pictures = new Set();
            const look = () => {{
                context.drawImage(video, 0, 0, 64, 64);
                pictures.add(context.getImageData(0, 0, 64, 64).data.join());
                video.requestVideoFrameCallback(look);
            }};
            video.requestVideoFrameCallback(look);
            video.onerror = () => reject(video.error);
            video.onended = () => resolve([video.videoWidth, video.videoHeight, video.currentTime, pictures.size]);
            video.src = '{button}.webm';
            video.play();
        }})""")
        check(all(abs(a - b) <= 1 for a, b in zip(seen, size)) and 2 < seen[2] < 12 and seen[3] > 3, f"{button}: it plays, in motion: {seen}, canvas {size}")


def check_lost_device(browser, site):
    pixels = "gsapp.testViewPixels(1, 'full').then(v => v.pixels.join())"
    lose = """(async () => {
        const device = document.getElementById('canvas').getContext('webgl2').getExtension('WEBGL_lose_context');
        device.loseContext();
        await new Promise(resolve => setTimeout(resolve, 300));
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
        wait_for(browser, "document.body.matches('.loaded') && document.getElementById('notice').hidden", f"a model {how} comes back with the device")
        check(((at := fragment(browser)), browser.evaluate("document.getElementById('name').textContent")) == (moved, name), f"seen as before: {at}, {moved}")
        check(browser.evaluate(pixels) == before, "with the same pictures")
    fresh(browser, site.url)
    browser.call("Network.setCacheDisabled", cacheDisabled=True)
    (site.folder / "scene.ngsplat").rename(site.folder / "elsewhere.ngsplat")
    browser.evaluate(lose)
    wait_for(browser, "document.getElementById('notice').innerText.includes('404')", "a model that is gone is said to be")
    (site.folder / "elsewhere.ngsplat").rename(site.folder / "scene.ngsplat")
    browser.errors = [e for e in browser.errors if "404" not in e]


def check_accessibility(browser, site):
    """In every state that shows other controls."""
    fresh(browser, site.url)
    states = {
        "the page": "",
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
            check_keys(browser, site)
            check_film(browser, site, downloads)
            check_lost_device(browser, site)
            check_embedded(browser, site)
            check_accessibility(browser, site)
            check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


sys.exit(main())
