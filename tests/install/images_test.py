#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The module for images: commands that open no image load neither it nor OpenImageIO, and a program that cannot load it
says which file it lacks.

usage: images_test.py GSAPP MODULE FAILING_LIBRARY
"""
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib


def png(pixels_kept=1.0):
    """A grey image of 64x64 pixels, of whose compressed pixels only the first part is kept."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    pixels = zlib.compress(b"".join(b"\0" + os.urandom(64) for _ in range(64)))
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", 64, 64, 8, 0, 0, 0, 0))
        + chunk(b"IDAT", pixels[: int(len(pixels) * pixels_kept)])
        + chunk(b"IEND", b"")
    )


def run(*command, code=0, **variables):
    environment = {
        **os.environ,
        "ASAN_OPTIONS": "detect_leaks=0",
        **variables,
    }  # OpenImageIO loses the text of each decoding error
    done = subprocess.run([str(word) for word in command], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == code, f"{command}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stderr


def main():
    gsapp, module, failing = (pathlib.Path(word).resolve() for word in sys.argv[1:])
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name).resolve()
        image, damaged = folder / "image.png", folder / "damaged.png"
        image.write_bytes(png())
        damaged.write_bytes(png(0.5))
        compare = ["metrics", image, image, "--metrics", "psnr"]

        for command in (["--version"], ["train", "--help"], ["doctor"], ["metrics", folder / "none.png", image]):
            loaded = run(gsapp, *command, code=3 if "metrics" in command else 0, LD_DEBUG="files")
            assert "libspdlog" in loaded, "the dynamic linker tells nothing of what it loads"
            assert "OpenImageIO" not in loaded and module.name not in loaded, f"{command} loads libraries for images"
        loaded = run(gsapp, *compare, LD_DEBUG="files")
        assert "OpenImageIO" in loaded and module.name in loaded
        print("libraries for images are loaded for an image: good")

        assert "cannot be decoded" in run(gsapp, "metrics", damaged, image, code=3)
        print("errors of the module are the program's: good")

        alone = folder / "bin/gsapp"
        installed, beside = folder / "lib/gsapp" / module.name, folder / "bin" / module.name
        for file in (alone, installed):
            file.parent.mkdir(parents=True)
        shutil.copy2(gsapp, alone)
        said = run(alone, *compare, code=4)
        assert said.count("error: ") == 1 and str(installed) in said and "No such file" in said, said
        beside.write_text("no library")
        said = run(alone, *compare, code=4)
        assert said.count("error: ") == 1 and str(beside) in said, said
        beside.unlink()
        shutil.copy2(failing, beside)
        said = run(alone, *compare, code=4)
        assert said.count("error: ") == 1 and "out of memory" in said, said
        beside.unlink()
        for file in (beside, installed):
            shutil.copy2(module, file)
            run(alone, *compare)
            file.unlink()
        print("a missing module is named, and found in both places: good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
