# SPDX-License-Identifier: Apache-2.0
"""Small models for the viewer's tests, and what those ask of its page."""

import base64
import json
import math
import random
import struct
import time
import zlib

from browser import check

BACKGROUND = (0.2, 0.4, 0.6)


def trailer(data, version=1):
    text = json.dumps({"appearance": "none", "background": BACKGROUND}).encode()
    data += b"GSAPPEXT" + struct.pack("<2I", version, len(text)) + text
    return data + struct.pack("<I", zlib.crc32(data))


def unit(v):
    length = math.hypot(*v)
    return [x / length for x in v]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def camera(position, quarters=0):
    """Looks at the origin from there: world from camera, then intrinsics. The picture lies turned by so many
    quarters."""
    forward = unit([-x for x in position])
    right = unit(cross([0, 1, 0], forward))
    down = cross(forward, right)
    for _ in range(quarters):
        right, down = down, [-x for x in right]
    rows = zip(right, down, forward, position)
    return struct.pack("<18f", *[x for row in rows for x in row], 120, 120, 50, 50, 100, 100)


def header(count, cameras, model=1, features=0, quarters=0):
    data = b"NGSPLAT\n" + struct.pack(
        "<11I", count, 2048, (count + 2047) // 2048, features, 0, 0, 0, 0, 0, 0, (model & 3) << 3 | (model & 4) << 4
    )
    data += (
        struct.pack("<2f", 1 / 255, 0) + (bytes(12) if model == 1 else b"") + struct.pack("<7f", 0, 0, 0, 0, -1, 0, 4)
    )
    return (
        data + struct.pack("<I", len(cameras)) + b"".join(camera(c, quarters) for c in cameras) + struct.pack("<I", 0)
    )


def box_ply(count=1500, stray=15, comment=None):
    """A box as other programs write it, y down, its faces red towards -z, blue towards z, white up and green down; and
    some Gaussians far away."""
    rng = random.Random(4)
    faces = [
        ((2, -1), (1, 0, 0)),
        ((2, 1), (0, 0, 1)),
        ((1, -1), (1, 1, 1)),
        ((1, 1), (0, 1, 0)),
        ((0, -1), (1, 1, 0)),
        ((0, 1), (1, 0, 1)),
    ]
    rows = b""
    for i in range(count + stray):
        (axis, side), color = faces[i % 6]
        at, size = [rng.uniform(-1, 1) for _ in range(3)], -2.5
        at[axis] = side
        if i >= count:
            at, color, size = [400 * x for x in unit([rng.gauss(0, 1) for _ in range(3)])], (0.5, 0.5, 0.5), 0
        rows += struct.pack("<14f", *at, *[(c - 0.5) / 0.28209479 for c in color], 6, *[size] * 3, 1, 0, 0, 0)
    names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *([f"comment {comment}"] if comment else []),
        f"element vertex {count + stray}",
        *[f"property float {name}" for name in names],
        "end_header",
    ]
    return "\n".join(lines).encode() + b"\n" + rows


def padded(texels, count):
    """Filled up to whole rows of 2048 texels."""
    return texels + bytes(16 * (-count % 2048))


def scene_file(count, quarters=0):
    """A ball of Gaussians with one colour each, and two test views, whose pictures lie turned by so many quarters."""
    rng = random.Random(1)
    texels = b""
    for _ in range(count):
        p = unit([rng.gauss(0, 1) for _ in range(3)])
        texels += struct.pack("<4B3e2B4B", *[int(127 * (x + 1)) for x in p], 200, *p, 128, 128, 105, 105, 105, 0)
    return trailer(header(count, [(0, 0, -4), (3.4, 0, -2.2)], quarters=quarters) + padded(texels, count))


def drop(browser, name, data):
    """Drops a file on the page."""
    browser.evaluate(
        f"""(() => {{
        const transfer = new DataTransfer();
        transfer.items.add(new File([Uint8Array.from(atob('{base64.b64encode(data).decode()}'), c => c.charCodeAt(0))], {json.dumps(name)}));
        dispatchEvent(new DragEvent('drop', {{ dataTransfer: transfer, cancelable: true }}));
    }})()"""
    )


def message(browser):
    return browser.evaluate(
        "document.getElementById('notice').hidden ? '' : document.getElementById('notice').innerText"
    )


def pixel(browser, mode="full", view=0):
    """The one in the middle of a test view."""
    return browser.evaluate(
        f"gsapp.testViewPixels({view}, '{mode}').then(v => [...v.pixels.slice(4 * (50 * 100 + 50), 4 * (50 * 100 + 50) + 3)])"
    )


class Downloads:
    """What the page saves."""

    def __init__(self, browser, folder):
        self.browser, self.folder, self.taken = browser, folder, browser.downloads
        browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder), eventsEnabled=True)

    def take(self, what, seconds=120):
        """The next file, whole."""
        deadline = time.monotonic() + seconds
        while self.browser.downloads == self.taken:
            check(
                time.monotonic() < deadline, f"within {seconds} s: {what} is saved, not {list(self.folder.iterdir())}"
            )
            time.sleep(0.05)
            self.browser.evaluate("0")  # which brings what the browser has to tell
        self.taken += 1
        (file,) = self.folder.iterdir()
        data = file.read_bytes()
        file.unlink()
        return file.name, data
