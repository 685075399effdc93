#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Installs a build into a fresh folder, moves it, and trains, exports and views from there. Then the program alone,
without its folder share, must say that it has no viewer: so no path of the build machine is in it. Exit status 77: the
viewer is not built.

usage: moved_test.py BUILD
"""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request

EXPECTED = (
    "bin/gsapp",
    "lib/gsapp/libgsapp_images.so",
    "share/man/man1/gsapp.1",
    "share/bash-completion/completions/gsapp",
    "share/zsh/site-functions/_gsapp",
    "share/fish/vendor_completions.d/gsapp.fish",
    "share/doc/gsapp/LICENSE",
    "share/doc/gsapp/README.md",
    "share/doc/gsapp/docs/guide.md",
    "share/gsapp/scenes/mipnerf360/bonsai.yaml",
    "share/gsapp/scripts/download",
)


def run(*command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=100, **options)
    assert done.returncode == 0, f"{command}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done


def answer(gsapp, folder, path=""):
    """Serves a folder with the program, and returns what its address answers."""
    server = subprocess.Popen(
        [str(gsapp), "view", str(folder), "--port", "0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    try:
        address = server.stdout.readline().strip()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\S*", address), f"gsapp view printed '{address}'"
        with urllib.request.build_opener(urllib.request.ProxyHandler({})).open(address + path, timeout=30) as response:
            return response.read()
    finally:
        server.send_signal(signal.SIGINT)
        assert server.wait(timeout=30) == 0


def main():
    build = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run("cmake", "--install", build, "--prefix", folder / "first")
        prefix = folder / "moved to here"
        (folder / "first").rename(prefix)
        for file in EXPECTED:
            assert (prefix / file).stat().st_size > 0, file
        gsapp = prefix / "bin/gsapp"
        small = ["--iterations", "2", "-r", "8", "--device", "cpu"]
        run(gsapp, "train", "-s", "builtin:diffuse", "-m", "run", *small, cwd=folder)
        run(
            gsapp,
            "train",
            "-c",
            prefix / "share/gsapp/scenes/base.yaml",
            "-s",
            "builtin:diffuse",
            "-m",
            "with file",
            *small,
            cwd=folder,
        )
        assert "usage" in run(prefix / "share/gsapp/scripts/download", "--help").stdout

        alone = folder / "alone/bin/gsapp"
        alone.parent.mkdir(parents=True)
        shutil.copy2(gsapp, alone)
        done = run(alone, "export", "run", "-o", "scene", cwd=folder)
        assert "viewer is not built" in done.stderr, done.stderr
        assert not (folder / "scene/index.html").exists()
        print("a program without share has no viewer: good")

        viewer = prefix / "share/gsapp/viewer"
        if not (viewer / "index.html").exists():
            print("skipped: the viewer is not built (scripts/build-viewer)")
            return 77
        run(gsapp, "export", "run", "-o", "site", cwd=folder)
        page = (viewer / "index.html").read_bytes()
        # An exported page has a title and descriptions of its own.
        parts = re.findall(rb'"(\S*assets/\S+)"', page)
        exported = (folder / "site/index.html").read_bytes()
        assert parts and all(part in exported for part in parts), exported
        assert answer(gsapp, folder / "site") == exported
        assert answer(gsapp, folder / "run") == page, "a run is shown by the viewer of the installation"
        link = folder / "link"
        link.symlink_to(gsapp)
        run(link, "export", "run", "-o", "site of a link", cwd=folder)
        assert (folder / "site of a link/index.html").read_bytes() == exported
        print("a moved installation exports and serves its viewer: good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
