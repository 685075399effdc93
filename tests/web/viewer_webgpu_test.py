# SPDX-License-Identifier: Apache-2.0
"""Draws by WebGPU: the page beside that by WebGL2, the order by depth, and what happens where WebGPU ends.

Usage: viewer_webgpu_test.py VIEWER. VIEWER is apps/viewer/dist after scripts/build-viewer. Exit status 77: no Chromium
with WebGPU, or no viewer there.
"""

import base64
import math
import pathlib
import random
import shutil
import struct
import sys
import tempfile
import zlib

from browser import Browser, find_chromium, check
from site_server import FEWER_PIXELS, HOLD_FRAMES, LET_FRAMES, SOFTWARE_WEBGPU, Site, open_viewer, wait_for
from viewer_scenes import BACKGROUND, drop, header, message, padded, scene_file, trailer, unit

# 56.3 and more were measured. A dilation of 0.28 in place of 0.3 in one way gives 44.7, a sort that leaves out the
# highest digits 21.6.
LEAST_PSNR = 52

# A device that does not take the shader of the colours.
REFUSE_SHADER = """(() => {
  const create = globalThis.GPUDevice?.prototype.createShaderModule;
  if (!create) return;
  GPUDevice.prototype.createShaderModule = function ({ code }) { return create.call(this, { code: code.replace('shown_color_(i32', 'no_such_thing(i32') }); };
})()"""

# The colours in the middle of a saved picture, and of what a film would record.
SAVED_AND_FILMED = """(async () => {
  const middle = (image, width, height) => {
    const context = new OffscreenCanvas(width, height).getContext('2d', { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    return [...context.getImageData(width >> 1, height >> 1, 1, 1).data.slice(0, 3)];
  };
  const saved = await new Promise((found) => {
    const create = URL.createObjectURL;
    URL.createObjectURL = (blob) => (found(blob), create(blob));
    document.getElementById('save-picture').click();
  });
  const picture = await createImageBitmap(saved);
  const [track] = document.getElementById('webgpu-canvas').captureStream().getVideoTracks(), reader = new MediaStreamTrackProcessor({ track }).readable.getReader();
  const next = reader.read();
  dispatchEvent(new Event('resize'));
  const { value: frame } = await next, colors = [middle(picture, picture.width, picture.height), middle(frame, frame.displayWidth, frame.displayHeight)];
  frame.close();
  track.stop();
  return colors;
})()"""

# Counts what is compiled.
COUNT_PIPELINES = """(() => {
  window.compiled = 0;
  for (const name of ['createShaderModule', 'createComputePipeline', 'createRenderPipeline']) {
    const create = globalThis.GPUDevice?.prototype[name];
    if (create) GPUDevice.prototype[name] = function (...given) { ++window.compiled; return create.apply(this, given); };
  }
})()"""

# next.ngsplat, dropped after this, arrives when window.letGo() is called.
HOLD_FILES = """(() => {
  const { stream } = Blob.prototype, go = new Promise((resolve) => (window.letGo = resolve));
  Blob.prototype.stream = function () { return this.name !== 'next.ngsplat' ? stream.call(this) : stream.call(this).pipeThrough(new TransformStream({ transform: async (part, to) => (await go, to.enqueue(part)) })); };
})()"""

# A browser that says less of its device.
HIDE_DEVICE = """if (globalThis.GPUAdapter) {
  delete GPUAdapter.prototype.info;
  delete GPUDevice.prototype.adapterInfo;
}"""

# Keeps the page's device, so that a test can take it away.
KEEP_DEVICE = """(() => {
  const request = globalThis.GPUAdapter?.prototype.requestDevice;
  if (request) GPUAdapter.prototype.requestDevice = async function (...given) { return (window.device = await request.apply(this, given)); };
})()"""


def pixels(browser, call):
    """The bytes of a picture."""
    return base64.b64decode(
        browser.evaluate(
            f"""gsapp.{call}.then(({{ pixels }}) => {{
        let text = '';
        for (let i = 0; i < pixels.length; i += 8192) text += String.fromCharCode(...pixels.subarray(i, i + 8192));
        return btoa(text);
    }})"""
        )
    )


def psnr(a, b):
    """Of rgba bytes. Equal ones count as 120 dB."""
    check(len(a) == len(b), "the pictures have one size")
    error = sum((x - y) ** 2 for x, y in zip(a, b)) / (0.75 * len(a) * 255**2)
    return -10 * math.log10(max(error, 1e-12))


def open_by(browser, url, way, file):
    open_viewer(browser, f"{url}?gpu={way}&model={file}")
    check(message(browser) == "", f"{file} is shown by {way}: {message(browser)}")
    expected = {"webgpu": "WebGPU", "webgl": "WebGL2"}[way]
    check(browser.evaluate("gsapp.way") == expected, f"{file} is drawn by {expected}")


def cloud_file(count, position):
    """Small Gaussians everywhere, each twice in a row, and the camera there. Returns the file, and the means as it
    rounds them."""
    rng = random.Random(2)
    texels, means = b"", []
    parts = []
    for _ in range(count // 2):
        mean = struct.pack("<3e", *[rng.uniform(-6, 6) for _ in range(3)])
        parts.append((struct.pack("<4B", 90, 120, 150, 200) + mean + struct.pack("<2B4B", 128, 128, 60, 60, 60, 0)) * 2)
        means += [struct.unpack("<3e", mean)] * 2
    texels = b"".join(parts)
    return trailer(header(count, [position]) + padded(texels, count)), means


def check_order(browser, url, folder):
    """By depth, equally far ones as in the file, and all whose centre is in the picture."""
    position, clouds, orders, pictures = (1, 0.5, -3), {}, {}, {}
    for count in (2, 5000, 70_000):
        data, clouds[count] = cloud_file(count, position)
        (folder / f"cloud{count}.ngsplat").write_bytes(data)
    for way in ("webgl", "webgpu"):
        for count in clouds:
            name = f"cloud{count}.ngsplat"
            if count == 2 and way == "webgl":
                open_by(browser, url, way, name)
            elif count == 2:  # by WebGPU without being told to, as nothing says that it draws in software
                script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=HIDE_DEVICE)["identifier"]
                open_viewer(browser, f"{url}?model={name}")
                browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
                check(
                    message(browser) == "",
                    f"{name} is shown where the browser says less of its device: {message(browser)}",
                )
            else:  # on the same page, which has its pipelines
                drop(browser, name, (folder / name).read_bytes())
                wait_for(
                    browser, f"document.querySelector('#info dd')?.textContent === '{count:,}'", f"{name} is there"
                )
                check(message(browser) == "", f"{name} is shown by {way}: {message(browser)}")
            browser.evaluate(HOLD_FRAMES)
            packed = browser.evaluate(
                """gsapp.testViewOrder(0).then((order) => {
                const bytes = new Uint8Array(order.buffer, order.byteOffset, order.byteLength);
                let text = '';
                for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
                return btoa(text);
            })"""
            )
            check(
                browser.evaluate("gsapp.way") == {"webgl": "WebGL2", "webgpu": "WebGPU"}[way],
                f"{name}: {way} has ordered it",
            )
            orders[way, count] = [i for (i,) in struct.iter_unpack("<I", base64.b64decode(packed))]
            if count == 5000:
                pictures[way] = pixels(browser, "testViewPixels(0, 'full')")
    check(
        psnr(*pictures.values()) >= LEAST_PSNR, f"the cloud is the same by both ways: {psnr(*pictures.values()):.1f} dB"
    )
    for count, means in clouds.items():
        order, forward = orders["webgpu", count], unit([-x for x in position])
        depths = [sum(f * (x - p) for f, x, p in zip(forward, mean, position)) for mean in means]
        check(len(set(order)) == len(order), f"{count}: each Gaussian is drawn once")
        check(set(order) <= set(orders["webgl", count]), f"{count}: none is drawn that WebGL2's wider picture lacks")
        check(
            all(depths[b] <= depths[a] * (1 + 1e-5) for a, b in zip(order, order[1:])),
            f"{count}: the farthest come first",
        )
        place = {index: k for k, index in enumerate(order)}
        check(
            all(place[i] + 1 == place[i + 1] for i in order if i % 2 == 0),
            f"{count}: equally far ones keep their order",
        )
        right = unit([forward[2], 0, -forward[0]])  # of camera(): down is y where it looks along z
        across = [sum(r * (x - p) for r, x, p in zip(right, mean, position)) for mean in means]
        height = [
            math.sqrt(max(sum((x - p) ** 2 for x, p in zip(mean, position)) - depths[i] ** 2 - across[i] ** 2, 0))
            for i, mean in enumerate(means)
        ]
        inside = {
            i for i in range(count) if depths[i] > 0.2 and max(abs(across[i]), height[i]) < 0.41 * depths[i]
        }  # 50 of 120 pixels
        check(inside <= set(order), f"{count}: all whose centre is in the picture are drawn")
        check(
            count == 2 or (len(inside) > 100 and len(order) < 0.8 * count),
            f"{count}: {len(inside)} are inside, {len(order)} drawn: the rest is left out",
        )
        print(f"order of {count}: {len(order)} drawn, {len(inside)} with their centre in the picture", flush=True)


def middle(browser):
    """The colour in the middle of the window's left 400 pixels, as the screen shows it."""
    shot = base64.b64decode(
        browser.call(
            "Page.captureScreenshot", format="png", clip={"x": 200, "y": 200, "width": 1, "height": 1, "scale": 1}
        )["data"]
    )
    data, at = b"", 8
    while at < len(shot):
        (length,) = struct.unpack_from(">I", shot, at)
        data += shot[at + 8 : at + 8 + length] if shot[at + 4 : at + 8] == b"IDAT" else b""
        at += 12 + length
    return tuple(zlib.decompress(data)[1:4])


def check_compiled_once(browser):
    """A second model, and the first again, take the pipelines that are there, and show what they hold."""
    first = pixels(browser, "testViewPixels(0, 'full')")
    compiled = browser.evaluate("compiled")
    for name, count in (("two.ngsplat", 2), ("ball.ngsplat", 3000)):
        drop(browser, name, scene_file(count))
        wait_for(
            browser,
            f"document.title.startsWith('{name}') && /(^|· ){count:,} drawn/.test(document.getElementById('meter').textContent)",
            f"{name} is drawn",
        )
        shown = pixels(browser, "testViewPixels(0, 'full')")
        check((shown == first) == (count == 3000), f"{name}: the picture is its own")
    check(
        compiled > 10 and browser.evaluate("compiled") == compiled,
        f"shaders are compiled once: {compiled} before, then {browser.evaluate('compiled')}",
    )


def check_page(browser, url, folder):
    """The picture on the screen, other sizes, the benchmark, other models on the same page, no Gaussians."""
    (folder / "ball.ngsplat").write_bytes(scene_file(3000))
    (folder / "nothing.ngsplat").write_bytes(scene_file(0))
    shown, other = {}, {}
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=COUNT_PIPELINES)["identifier"]
    for way in ("webgl", "webgpu"):
        open_by(browser, url, way, "ball.ngsplat&embed")
        shown[way] = []
        for width, height in ((400, 400), (640, 400), (400, 401)):
            browser.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            canvas = "canvas" if way == "webgl" else "webgpu-canvas"
            wait_for(
                browser,
                f"document.getElementById('{canvas}').width === {width} && document.getElementById('{canvas}').height === {height}",
                "the picture has the window's size",
            )
            browser.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            shown[way].append(middle(browser))
        browser.call("Emulation.clearDeviceMetricsOverride")
        if way == "webgpu":
            wait_for(
                browser,
                "document.getElementById('meter').textContent.includes('3,000 drawn · sorted on the GPU')",
                "the meter says what is drawn",
            )
        browser.evaluate(HOLD_FRAMES)
        view = "{ right: [1, 0, 0], down: [0, 1, 0], forward: [0, 0, 1], position: [0.2, 0.1, -3], fx: 90, fy: 80, cx: 33, cy: 20, width: 67, height: 41 }"
        other[way] = pixels(browser, f"viewPixels({view}, 'full')"), pixels(
            browser, "testViewPixels(1, 'full', 'byte')"
        )
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    differences = [abs(a - b) for one, two in zip(*shown.values()) for a, b in zip(one, two)]
    check(max(differences) <= 3, f"the screen shows the same by both ways: {shown}")
    check(
        all(max(abs(c - round(255 * b)) for c, b in zip(color, BACKGROUND)) > 10 for color in shown["webgpu"]),
        f"the screen shows the ball: {shown}",
    )
    for a, b in zip(*other.values()):
        check(
            psnr(a, b) >= LEAST_PSNR, f"the same by both ways at another size and with eight bits: {psnr(a, b):.1f} dB"
        )
    result = browser.evaluate("gsapp.benchmark(1)")
    check(
        result["way"] == "WebGPU" and "sorting and colours" in result["protocol"] and result["frame"]["mean"] > 0,
        f"the benchmark says how it was drawn: {result}",
    )
    colors = browser.evaluate(SAVED_AND_FILMED)
    check(
        all(max(abs(c - round(255 * b)) for c, b in zip(color, BACKGROUND)) > 10 for color in colors),
        f"saved pictures and films show the ball: {colors}",
    )
    check(
        max(abs(a - b) for a, b in zip(*colors)) <= 12, f"saved pictures and films show the same: {colors}"
    )  # films hold colours as YUV
    check_compiled_once(browser)
    browser.evaluate(LET_FRAMES)
    check_goes_on(browser, "the device is lost", "device.destroy()")
    open_by(browser, url, "webgpu", "nothing.ngsplat")
    check(
        all(abs(c - 255 * b) < 1 for c, b in zip(pixels(browser, "testViewPixels(0, 'full')"), BACKGROUND)),
        "without Gaussians there is the background",
    )


PICTURE = "testViewPixels(0, 'full')"


def check_goes_on(browser, end, how):
    """Where WebGPU ends on a page that shows the ball, WebGL2 goes on, and what the user opened comes, too. Returns the
    picture by WebGPU."""
    meter = "document.getElementById('meter').textContent"
    is_coming = "document.getElementById('notice').innerText.includes('next.ngsplat')"
    before = pixels(browser, PICTURE)
    browser.evaluate(HOLD_FILES)
    drop(browser, "next.ngsplat", scene_file(20))
    wait_for(browser, is_coming, "a file is on its way")
    browser.evaluate(how)
    wait_for(
        browser,
        f"gsapp.way === 'WebGL2' && !document.getElementById('webgpu-canvas') && document.body.classList.contains('loaded') && document.title.startsWith('ball.ngsplat') && {meter}.includes('3,000 drawn · sorted in')",
        f"{end}: WebGL2 draws the model before",
    )
    check(psnr(before, pixels(browser, PICTURE)) >= LEAST_PSNR, f"{end}: the picture is as before")
    wait_for(browser, is_coming, f"{end}: the file is still on its way")
    browser.evaluate("letGo()")
    wait_for(
        browser,
        f"document.title.startsWith('next.ngsplat') && /(^|· )20 drawn/.test({meter})",
        f"{end}: the file is shown when it is there",
    )
    check(message(browser) == "", f"{end}: nothing is left to say: {message(browser)}")
    return before


def check_end(browser, url):
    """Also where pictures are compared, and where a device refuses a shader; what the address says has to be there."""
    open_by(browser, url, "webgpu", "ball.ngsplat")
    before = check_goes_on(browser, "pictures are compared", "document.getElementById('compare-on').click()")
    check(not browser.evaluate("document.getElementById('divider').hidden"), "the comparison is shown")
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=REFUSE_SHADER)["identifier"]
    open_viewer(browser, url + "?gpu=webgpu&model=ball.ngsplat")
    wait_for(
        browser,
        "gsapp.way === 'WebGL2' && document.getElementById('meter').textContent.includes('sorted in')",
        "a device that refuses a shader is not used",
    )
    check(
        psnr(before, pixels(browser, PICTURE)) >= LEAST_PSNR, "a device that refuses a shader: WebGL2 draws the picture"
    )
    browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)
    check(
        all(
            "WGSL" in error or "ShaderModule" in error or "Pipeline" in error or "CommandBuffer" in error
            for error in browser.errors
        ),
        f"the browser says of what it refused, and of no more: {browser.errors}",
    )
    browser.errors.clear()
    browser.open(url + "?gpu=metal")
    wait_for(
        browser,
        "document.getElementById('notice').innerText.includes('gpu=metal; it can be webgl or webgpu')",
        "a way that is not known is named",
    )


def main():
    viewer, program = pathlib.Path(sys.argv[1]), find_chromium()
    if program is None:
        print("skipped: no chromium on PATH (apt-get install chromium)")
        return 77
    if not (viewer / "index.html").exists():
        print("skipped: the viewer is not built (scripts/build-viewer)")
        return 77
    # At one pixel for one of CSS: with fewer, a window cannot have an odd height.
    flags = [flag for flag in SOFTWARE_WEBGPU if flag != FEWER_PIXELS]
    with tempfile.TemporaryDirectory() as name, Browser(program, width=500, height=500, flags=flags) as browser:
        folder = pathlib.Path(name)
        shutil.copytree(viewer, folder / "site")
        site = Site(folder / "site")
        open_viewer(browser, site.url)  # has no model beside it, which is an error in the console
        if not browser.evaluate("navigator.gpu?.requestAdapter().then((adapter) => adapter !== null)"):
            print("skipped: this chromium has no WebGPU, not in software either")
            return 77
        browser.errors.clear()
        browser.call("Page.addScriptToEvaluateOnNewDocument", source=KEEP_DEVICE)
        check_page(browser, site.url, folder / "site")
        check_end(browser, site.url)
        check_order(browser, site.url, folder / "site")
        check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


sys.exit(main())
