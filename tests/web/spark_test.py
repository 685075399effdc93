# SPDX-License-Identifier: Apache-2.0
"""Has Spark, a renderer by others, read and draw the PLY file of a run.

Usage: spark_test.py GSAPP READERS. READERS is tests/web/readers after npm ci. Exit status 77: no Chromium, or no Spark there.
"""

import json
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile

from browser import Browser, find_chromium, check
from site_server import PSNR, SOFTWARE_WEBGL, Site, wait_for

# Spark was seen to agree to 46 dB. Another convention anywhere, such as a mirrored axis or another basis, leaves less than 20.
LEAST_PSNR = 35
# Centres are half-precision numbers there.
HALF_EPSILON = 2 ** -11


def centres(ply):
    """Count and bounds as the file's bytes have them."""
    data = ply.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    lines = data[:end].decode().splitlines()
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[2])
    names = [line.split()[2] for line in lines if line.startswith("property float")]
    check(names[:3] == ["x", "y", "z"], "the PLY begins with x y z")
    rows = [struct.unpack_from("<3f", data, end + 4 * len(names) * i) for i in range(count)]
    return count, [min(axis) for axis in zip(*rows)], [max(axis) for axis in zip(*rows)]


def main():
    program = find_chromium()
    gsapp, readers = sys.argv[1], pathlib.Path(sys.argv[2])
    if program is None or not (readers / "node_modules/@sparkjsdev/spark").exists():
        print("skipped: no chromium on PATH, or Spark is not installed (npm ci --ignore-scripts --prefix tests/web/readers)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run = folder / "run"
        subprocess.run([gsapp, "train", "-s", "builtin:glossy", "--eval", "-r", "4", "--device", "cpu", "--quiet", "--appearance", "sh", "--iterations", "1200",
                        "--init-points", "2000", "--cap-max", "2000", "-m", run], check=True, capture_output=True)
        subprocess.run([gsapp, "render", run, "-o", folder / "reference"], check=True, capture_output=True)
        shutil.copy(run / "point_cloud/iteration_1200/point_cloud.ply", folder / "model.ply")
        shutil.copy(readers / "spark.html", folder)
        (folder / "node_modules").symlink_to(readers.resolve() / "node_modules")
        with Browser(program, flags=SOFTWARE_WEBGL) as browser:
            browser.open(Site(folder).url + "spark.html")
            wait_for(browser, "window.draw", "Spark is loaded")
            count, low, high = centres(folder / "model.ply")
            read = browser.evaluate("read('model.ply')")
            check(read["count"] == count, f"it reads {count} Gaussians, not {read['count']}")
            for wanted, seen in zip(low + high, read["low"] + read["high"]):
                check(abs(wanted - seen) <= HALF_EPSILON * abs(wanted), f"and their bounds: {wanted}, not {seen}")
            camera = json.dumps(json.loads((run / "cameras.json").read_text())[0])
            psnr = browser.evaluate(PSNR % (f"await draw('model.ply', {camera})", "reference/00000.png"))
            print(f"{count} Gaussians, PSNR {psnr:.2f} dB against gsapp's own picture")
            check(psnr >= LEAST_PSNR, f"PSNR of at least {LEAST_PSNR} dB")
            check(browser.errors == [], f"the console is silent: {browser.errors}")
    print("passed")
    return 0


sys.exit(main())
