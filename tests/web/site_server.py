# SPDX-License-Identifier: Apache-2.0
"""A folder as a web site, and a Chromium that draws WebGL and WebGPU in software."""

import functools
import http.server
import threading
import time
import urllib.parse
import zlib

from browser import PATIENCE, check

# Software takes longer for more pixels, so that windows are small where models are drawn by it (from 705 pixels on the
# panel stands beside the picture), and a pixel of the device is as large as four of CSS. The page itself is drawn
# without what stands in for a GPU. What moves is where it goes to at once, as for people who ask for less motion, and
# is not drawn many times on its way: tests of motion call move_as_usual.
FEWER_PIXELS = "--force-device-scale-factor=0.5"
SOFTWARE_WEBGL = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-rasterization",
    "--force-prefers-reduced-motion",
    FEWER_PIXELS,
)
# The same with WebGPU; without Vulkan it loses its device when a canvas is shown.
SOFTWARE_WEBGPU = (
    *SOFTWARE_WEBGL,
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--use-vulkan=swiftshader",
    "--enable-features=Vulkan",
)

# The rgba pixels of a picture in a Blob (an expression).
DECODED = """(async () => {
  const picture = await createImageBitmap(%s, { colorSpaceConversion: 'none' });
  const context = new OffscreenCanvas(picture.width, picture.height).getContext('2d', { willReadFrequently: true });
  context.drawImage(picture, 0, 0);
  return context.getImageData(0, 0, picture.width, picture.height).data;
})()"""
# The rgba pixels of a file of the site.
PIXELS_OF = DECODED % "await (await fetch('%s')).blob()"

# Of rgba pixels (an expression) against a PNG file. Equal ones count as 120 dB.
PSNR = f"""(async () => {{
  const seen = %s;
  const wanted = await {PIXELS_OF};
  if (wanted.length !== seen.length) throw new Error('pictures of different size');
  let sum = 0;
  for (let i = 0; i < wanted.length; ++i) if (i %% 4 < 3) sum += ((wanted[i] - seen[i]) / 255) ** 2;
  return -10 * Math.log10(Math.max(sum / (0.75 * wanted.length), 1e-12));
}})()"""

# Keeps the viewer's pictures of a list of [mode, view] (an expression) as `pictures`, and returns the brightest value
# of each. All in one call: between two, the page would draw its own picture, which takes as long.
KEEP_PICTURES = """(async () => {
  window.pictures = [];
  for (const [mode, view] of %s) pictures.push((await gsapp.testViewPixels(view, mode)).pixels);
  return pictures.map((pixels) => pixels.reduce((most, v, i) => i %% 4 < 3 ? Math.max(most, v) : most, 0));
})()"""

# From here on the page draws where it must, but not once more after every picture that a test asks for, as in software
# each takes a second; and later it draws what it left out.
HOLD_FRAMES = "{ window.askForFrame ??= requestAnimationFrame; window.held ??= []; window.requestAnimationFrame = (draw) => held.push(draw); }"
LET_FRAMES = "{ window.requestAnimationFrame = askForFrame; held.splice(0).forEach((draw) => askForFrame(draw)); }"


class Handler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def send_broken(self):
        """A connection that breaks after 40 %, and the rest for who asks for it."""
        data = self.server.slow_file.read_bytes()
        wanted = self.headers.get("Range")
        begin = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        self.server.ranges.append(begin)
        self.send_response(206 if wanted else 200)
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Length", str(len(data) - begin))
        if wanted:
            self.send_header("Content-Range", f"bytes {begin}-{len(data) - 1}/{len(data)}")
        self.end_headers()
        self.wfile.write(data[begin:] if wanted else data[: int(0.4 * len(data))])
        if not wanted:
            time.sleep(1)  # what a browser has not handed on is lost with the connection
        self.close_connection = True

    def send_blank(self):
        page = b"<!doctype html><title>Blank</title><link rel='icon' href='data:,'>"
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(page)))
        self.end_headers()
        self.wfile.write(page)

    def do_GET(self):
        if self.path == "/blank.html":
            return self.send_blank()
        if self.path == "/broken.ngsplat":
            return self.send_broken()
        if self.path != "/slow.ngsplat":
            return super().do_GET()
        # Up to the first of these shares at once, the rest when the test says so.
        data = self.server.slow_file.read_bytes()
        packer = zlib.compressobj(wbits=31)
        self.send_response(200)
        if self.server.is_packed:
            self.send_header("Content-Encoding", "gzip")
        else:
            self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        begin = 0
        for share in (*self.server.slow_shares, 1):
            part, begin = data[begin : int(share * len(data))], int(share * len(data))
            self.wfile.write(packer.compress(part) + packer.flush(zlib.Z_SYNC_FLUSH) if self.server.is_packed else part)
            if share < 1:
                self.server.go_on.wait(120)
                self.server.go_on.clear()
        if self.server.is_packed:
            self.wfile.write(packer.flush())


class Site:
    """Serves `folder` from this machine until the end of the program."""

    def __init__(self, folder):
        self.folder = folder
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=folder))
        self.server.slow_file, self.server.go_on = folder / "scene.ngsplat", threading.Event()
        self.server.slow_shares, self.server.is_packed, self.server.ranges = (0.5,), False, []
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server.server_port}/"


# What a page of the viewer says of itself.
STATE = """[document.title, ...['notice', 'meter', 'info'].map((id) => document.getElementById(id)?.innerText),
  (c => `canvas ${c?.width} x ${c?.height} in ${innerWidth} x ${innerHeight} at density ${devicePixelRatio}`)(
    document.getElementById('canvas'))]"""


def wait_for(browser, expression, what, seconds=PATIENCE):
    """Until a JavaScript expression is true."""
    deadline = time.monotonic() + seconds
    while not browser.evaluate(f"!!({expression})"):
        if time.monotonic() > deadline:
            check(
                False,
                f"within {seconds} s: {what}. The page says {browser.evaluate(STATE)}, its console {browser.errors}",
            )
        time.sleep(0.05)


def open_viewer(browser, url):
    """Until the first model is shown, or could not be."""
    browser.open(url)
    wait_for(browser, "window.gsapp", f"{url} is loaded")


def fresh(browser, url):
    """Another page in between, as browsers do not load again what differs in its fragment alone: one of the same site,
    for another site the browser would start another process."""
    browser.open(urllib.parse.urljoin(url, "/blank.html"))
    open_viewer(browser, url)


def move_as_usual(browser, motion="no-preference"):
    """From here on what moves glides; with "" no more."""
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": motion}])
