#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Starts the program on an emulated CPU that lacks what it was built for: it must say so, and not end by SIGILL. Exit
status 77: no emulator (Debian's qemu-user), or a program that any x86-64 runs.

usage: cpu_test.py GSAPP
"""
import json
import shutil
import subprocess
import sys


def main():
    features = json.loads(
        subprocess.run([sys.argv[1], "--version", "--json"], capture_output=True, check=True, timeout=60).stdout
    )["cpu_features"]
    if not shutil.which("qemu-x86_64") or not features:
        print("skipped: no qemu-x86_64" if features else "skipped: built for any x86-64")
        return 77
    done = subprocess.run(
        ["qemu-x86_64", "-cpu", "Nehalem", sys.argv[1], "options"], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 4, f"exit code {done.returncode}\n{done.stderr}"
    assert "this CPU lacks what this gsapp was built for: " + " ".join(features) in done.stderr, done.stderr
    assert not done.stdout
    print("good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
