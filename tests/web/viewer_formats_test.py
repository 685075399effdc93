# SPDX-License-Identifier: Apache-2.0
"""Opens a run's .ply, .splat and .spz in the web viewer and compares their pictures with those of its .ngsplat and with
gsapp's own.

Usage: viewer_formats_test.py GSAPP VIEWER. VIEWER is apps/viewer/dist after scripts/build-viewer. Exit status 77: no
Chromium, or no viewer there.
"""

import gzip
import json
import math
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile

from browser import Browser, find_chromium, check
from site_server import PSNR, SOFTWARE_WEBGL, Site, open_viewer, wait_for
from viewer_scenes import Downloads

# All three degrees of sh are active at the end.
TRAIN = [
    "-s",
    "builtin:glossy",
    "-r",
    "4",
    "--init-points",
    "500",
    "--cap-max",
    "800",
    "--iterations",
    "600",
    "--eval",
    "--device",
    "cpu",
    "--quiet",
]
VIEWS = (0, 3, 7)
# 51 and more were measured; 38 would still look the same.
LEAST_PSNR = 45
# Pictures along a camera path that goes through a file have at least this.
LEAST_PSNR_OF_PATH = 40

# Between pictures of this page, the first of which is an expression for rgba pixels.
PSNR_OF_PIXELS = """(async () => {
  const seen = (await %s).pixels, wanted = wantedPixels[%d];
  if (wanted.length !== seen.length) throw new Error('pictures of different size');
  let sum = 0;
  for (let i = 0; i < wanted.length; ++i) if (i %% 4 < 3) sum += ((wanted[i] - seen[i]) / 255) ** 2;
  return -10 * Math.log10(Math.max(sum / (0.75 * wanted.length), 1e-12));
})()"""


def run_gsapp(*arguments):
    subprocess.run(arguments, check=True, capture_output=True)


def make_files(gsapp, folder):
    run = folder / "run"
    run_gsapp(gsapp, "train", *TRAIN, "--appearance", "sh", "-m", run)
    run_gsapp(gsapp, "render", run, "--decompose", "-o", folder / "reference")
    for form in ("web", "ply", "splat"):
        run_gsapp(gsapp, "export", run, "--format", form, "-o", folder / form)
    shutil.copy(folder / "web/scene.ngsplat", folder)
    shutil.copy(folder / "ply/point_cloud.ply", folder / "model.ply")
    shutil.copy(folder / "splat/point_cloud.splat", folder / "model.splat")
    (folder / "model.spz").write_bytes(spz_of((folder / "model.ply").read_bytes()))
    return json.loads((run / "cameras.json").read_text())


def ply_rows(data):
    end = data.index(b"end_header\n") + len(b"end_header\n")
    names = [line.split()[2] for line in data[:end].decode().splitlines() if line.startswith("property float")]
    count = (len(data) - end) // (4 * len(names))
    return [
        dict(zip(names, struct.unpack_from(f"<{len(names)}f", data, end + 4 * len(names) * i))) for i in range(count)
    ]


def spz_of(ply):
    """Version 3, whose axes are right, up and back: y and z change their sign, and so do some of the basis
    functions."""
    turned = [-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1]
    byte = lambda x: min(max(round(x), 0), 255)
    rows = ply_rows(ply)
    out = struct.pack("<3I4B", 0x5053474E, 3, len(rows), 3, 12, 0, 0)
    for row in rows:
        for name, sign in zip("xyz", (1, -1, -1)):
            out += struct.pack("<i", round(4096 * sign * row[name]))[:3]
    out += bytes(byte(255 / (1 + math.exp(-row["opacity"]))) for row in rows)
    out += bytes(byte(255 * (0.15 * row[f"f_dc_{c}"] + 0.5)) for row in rows for c in range(3))
    out += bytes(byte(16 * (row[f"scale_{k}"] + 10)) for row in rows for k in range(3))
    for row in rows:
        w, x, y, z = [row[f"rot_{k}"] for k in range(4)]
        quaternion = (w, -z, y, -x)  # x, y, z, w after half a turn about x
        largest = max(range(4), key=lambda k: abs(quaternion[k]))
        word = largest
        for k in range(4):
            if k != largest:
                value = quaternion[k] * math.copysign(1, quaternion[largest]) / math.hypot(*quaternion)
                word = word << 10 | (value < 0) << 9 | int(511 * abs(value) * math.sqrt(2) + 0.5)
        out += struct.pack("<I", word)
    out += bytes(
        byte(128 * turned[k] * row[f"f_rest_{15 * c + k}"] + 128) for row in rows for k in range(15) for c in range(3)
    )
    return gzip.compress(out)


def pose(entry):
    """A camera of cameras.json as the page takes it."""
    columns = list(zip(*entry["rotation"]))
    return json.dumps(
        {
            "right": columns[0],
            "down": columns[1],
            "forward": columns[2],
            "position": entry["position"],
            "fx": entry["fx"],
            "fy": entry["fy"],
            "cx": entry["width"] / 2,
            "cy": entry["height"] / 2,
            "width": entry["width"],
            "height": entry["height"],
        }
    )


# Drops a file of the site, under a name.
DROP = """(async () => {
  const transfer = new DataTransfer();
  transfer.items.add(new File([await (await fetch('%s')).arrayBuffer()], %s));
  dispatchEvent(new DragEvent('drop', { dataTransfer: transfer, cancelable: true }));
})()"""


def drop(browser, name, path, title=None):
    browser.evaluate(DROP % (path, json.dumps(name)))
    wait_for(
        browser, f"document.getElementById('name').textContent === {json.dumps(title or name)}", f"{name} is shown"
    )


def message(browser):
    return browser.evaluate(
        "document.getElementById('notice').hidden ? '' : document.getElementById('notice').innerText"
    )


def compare(browser, cameras, name, mode, least):
    """With the pictures of scene.ngsplat, and with gsapp's own."""
    close, own = [], []
    for index, view in enumerate(VIEWS):
        browser.evaluate(
            f"(async () => {{ window.seenPicture = await gsapp.viewPixels({pose(cameras[view])}, '{mode}'); }})()"
        )
        close.append(browser.evaluate(PSNR_OF_PIXELS % ("seenPicture", index)))
        own.append(browser.evaluate(PSNR % ("seenPicture.pixels", f"reference/{mode}/{view:05}.png")))
    print(
        f"{name:12} {mode:5} against .ngsplat "
        + " ".join(f"{v:6.2f}" for v in close)
        + ", against gsapp "
        + " ".join(f"{v:6.2f}" for v in own)
        + " dB",
        flush=True,
    )
    check(min(close) >= least, f"{name}: PSNR of at least {least} dB against scene.ngsplat")
    check(min(own) >= least, f"{name}: PSNR of at least {least} dB against gsapp's own picture")


def keep(browser, mode):
    """The pictures of the model that is shown."""
    for index, view in enumerate(VIEWS):
        browser.evaluate(
            f"(async () => {{ (window.wantedPixels ??= [])[{index}] = (await gsapp.testViewPixels({view}, '{mode}')).pixels; }})()"
        )


def check_remarks(browser, folder):
    """Gaussians that are not finite are left out, and the page says how many."""
    data = bytearray((folder / "model.ply").read_bytes())
    rows = data.index(b"end_header\n") + len(b"end_header\n")
    count = len(ply_rows(data))
    stride = (len(data) - rows) // count
    for i in (0, 7, count - 1):
        struct.pack_into("<f", data, rows + stride * i, math.nan)
    (folder / "broken.ply").write_bytes(data)
    drop(browser, "broken.ply", "broken.ply")
    check(f"3 of {count} Gaussians are left out" in message(browser), f"and counted: {message(browser)}")
    check(f"{count - 3:,}" in browser.evaluate("document.getElementById('info').textContent"), "the others are there")
    browser.evaluate("document.getElementById('dismiss').click()")
    check(message(browser) == "", "the remark can be closed")


def check_refused(browser, folder):
    """What cannot be read is said; the model before stays."""
    ply = (folder / "model.ply").read_bytes()
    bad = {
        "cut.ply": (ply[:-1], "truncated"),
        "cut.splat": ((folder / "model.splat").read_bytes()[:-1], "multiple of 32"),
        "cut.spz": ((folder / "model.spz").read_bytes()[:-20], "truncated"),
        "bundle.sog": (b"PK\3\4" + bytes(100), "splat-transform in.sog out.ply"),
        "other.ksplat": (bytes(100), "splat-transform in.ksplat out.ply"),
        "mesh.ply": (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
            + bytes(12),
            "no property scale_0",
        ),
    }
    for name, (data, words) in bad.items():
        (folder / name).write_bytes(data)
        browser.evaluate(DROP % (name, json.dumps(name)))
        wait_for(
            browser,
            "document.getElementById('notice-title').textContent === " + json.dumps(f"{name} cannot be read"),
            f"a message about {name}",
        )
        check(words in message(browser), f"it says what is wrong with {name}: {message(browser)}")
        check(
            browser.evaluate("document.getElementById('name').textContent") == "broken.ply",
            "the model before is still there",
        )
        browser.evaluate("document.getElementById('dismiss').click()")


def check_chosen(browser, folder):
    """Files that are chosen by the buttons, of which one stands beside what could not be read."""
    count = len(ply_rows((folder / "model.ply").read_bytes()))
    for suffix in ("ply", "splat", "spz"):
        for button in ("open", "open-notice"):
            name = f"{button}.{suffix}"
            shutil.copy(folder / f"model.{suffix}", folder / name)
            if button == "open-notice":
                browser.evaluate(DROP % ("mesh.ply", json.dumps("mesh.ply")))
                wait_for(
                    browser, "document.getElementById('open-notice').checkVisibility()", "another file is asked for"
                )
            browser.choose_file(button, folder / name)
            wait_for(
                browser,
                f"document.getElementById('name').textContent === '{name}' && document.getElementById('notice').hidden",
                f"{name} is shown",
            )
            check(f"{count:,}" in browser.evaluate("document.getElementById('info').textContent"), f"all of {name}")


def check_path(browser, gsapp, folder):
    """Keyframes that the page saves, in both forms, as gsapp renders them: a test view, and a pose that belongs to
    none."""
    saved = folder / "saved"
    saved.mkdir()
    downloads = Downloads(browser, saved)
    press = lambda button: browser.evaluate(f"document.getElementById('{button}').click()")
    for name, value in (("seconds", 1), ("frame-rate", 3)):
        browser.evaluate(f"document.getElementById('{name}').value = {value}")
    press("add-keyframe")
    browser.evaluate("document.getElementById('canvas').focus()")
    for _ in range(3):
        browser.press("ArrowLeft", 37)
    wait_for(
        browser, "document.getElementById('camera').selectedOptions[0].textContent === 'Free'", "the camera has moved"
    )
    press("add-keyframe")
    files = {}
    for button in ("save-cameras", "save-nerfstudio"):
        press(button)
        name, files[button] = downloads.take("a path")
        (folder / name).write_bytes(files[button])
        run_gsapp(gsapp, "render", folder / "run", "--path", folder / name, "-o", folder / button)
    cameras = json.loads(files["save-cameras"])
    own = ("testViewPixels(0, 'full')", f"viewPixels({pose(cameras[-1])}, 'full')")
    for button in files:
        pictures = sorted((folder / button).rglob("*.png"))
        check(len(pictures) == len(cameras) == 3, f"{button}: every picture is rendered: {pictures}")
        seen = [
            browser.evaluate(PSNR % (f"(await gsapp.{pixels}).pixels", picture.relative_to(folder)))
            for pixels, picture in zip(own, (pictures[0], pictures[-1]))
        ]
        print(f"{button:15} against gsapp " + " ".join(f"{v:6.2f}" for v in seen) + " dB", flush=True)
        check(
            min(seen) >= LEAST_PSNR_OF_PATH,
            f"{button}: PSNR of at least {LEAST_PSNR_OF_PATH} dB against gsapp's pictures",
        )


def check_address(browser, url, name):
    open_viewer(browser, f"{url}?model={name}")
    check(browser.evaluate("document.getElementById('name').textContent") == name, f"?model={name} is shown")
    check(message(browser) == "", f"nothing is remarked on: {message(browser)}")


def main():
    program = find_chromium()
    gsapp, viewer = sys.argv[1], pathlib.Path(sys.argv[2])
    if program is None or not (viewer / "index.html").exists():
        print("skipped: no chromium on PATH, or the viewer is not built (scripts/build-viewer)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        shutil.copytree(viewer, folder, dirs_exist_ok=True)
        check(
            all(name in (viewer / "LICENSES.txt").read_text() for name in ("three.js authors", "fzstd")),
            "the notice of what is bundled is there",
        )
        cameras = make_files(gsapp, folder)
        site = Site(folder)
        with Browser(program, width=800, height=600, flags=SOFTWARE_WEBGL) as browser:
            open_viewer(browser, site.url)
            keep(browser, "full")
            compare(browser, cameras, "its own", "full", LEAST_PSNR)
            check_path(browser, gsapp, folder)
            drop(browser, "dropped.ply", "model.ply")
            check(message(browser) == "", f"nothing is remarked on: {message(browser)}")
            compare(browser, cameras, "dropped.ply", "full", LEAST_PSNR)
            drop(browser, "dropped.spz", "model.spz")
            compare(browser, cameras, "dropped.spz", "full", LEAST_PSNR)
            drop(browser, "scene.ngsplat", "scene.ngsplat", title="glossy")
            keep(browser, "base")
            drop(browser, "dropped.splat", "model.splat")
            compare(browser, cameras, "dropped.splat", "base", LEAST_PSNR)
            check_remarks(browser, folder)
            check_refused(browser, folder)
            check_chosen(browser, folder)
            for suffix in ("ply", "splat", "spz"):
                check_address(browser, site.url, f"model.{suffix}")
            elsewhere = [r for r in browser.requests if not r.startswith((site.url, "blob:", "about:"))]
            check(elsewhere == [], f"the page asks only its own site: {elsewhere}")
            check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


sys.exit(main())
