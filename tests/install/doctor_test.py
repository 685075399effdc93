#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Asks gsapp doctor on machines that have nothing, and everything, of what it looks for on PATH.

usage: doctor_test.py GSAPP
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

PROGRAMS = {"colmap": "colmap", "ffmpeg": "ffmpeg", "Chromium": "chromium-browser", "node": "node"}


def doctor(gsapp, *arguments, **variables):
    environment = {key: value for key, value in os.environ.items() if key not in ("PATH", "GSAPP_METRIC_WEIGHTS")}
    done = subprocess.run(
        [gsapp, *arguments], env={**environment, **variables}, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def findings(text):
    return {one["name"]: one for one in json.loads(text)["findings"]}


def main():
    gsapp = str(pathlib.Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for file in PROGRAMS.values():
            (folder / file).write_text("#!/bin/sh\n")
            (folder / file).chmod(0o755)
        (folder / "weights").mkdir()
        (folder / "weights/vgg16.safetensors").write_text("")
        (folder / "empty").mkdir()

        nothing = doctor(
            gsapp, "doctor", "--json", PATH=str(folder / "empty"), GSAPP_METRIC_WEIGHTS=str(folder / "nowhere")
        )
        for missing in [*PROGRAMS, "metric weights"]:
            one = findings(nothing)[missing]
            assert one["is_there"] is False and one["needed_for"] and one["get"] and "found" not in one, one
        text = doctor(gsapp, "doctor", PATH="")
        assert "apt-get install colmap" in text and "gsapp itself works" in text, text

        everything = doctor(
            gsapp, "doctor", "--json", PATH=f"{folder / 'empty'}:{folder}", GSAPP_METRIC_WEIGHTS=str(folder / "weights")
        )
        for there, file in PROGRAMS.items():
            one = findings(everything)[there]
            assert one == {"name": there, "is_there": True, "found": str(folder / file)}, one
        assert findings(everything)["metric weights"]["found"].startswith("1 files"), everything
        no_nccl = findings(doctor(gsapp, "doctor", "--json", GSAPP_NCCL="off"))["NCCL"]
        assert no_nccl["is_there"] is False and no_nccl["needed_for"] and "libnccl" in no_nccl["get"], no_nccl
        assert "- colmap" not in doctor(gsapp, "doctor", PATH=str(folder))
        (folder / "colmap").chmod(0o644)
        assert (
            findings(doctor(gsapp, "doctor", "--json", PATH=str(folder)))["colmap"]["is_there"] is False
        ), "not executable"

        version = json.loads(doctor(gsapp, "--version", "--json"))
        assert json.loads(everything)["gsapp"] == version
        words = doctor(gsapp, "--version").split()
        assert words[:2] == ["gsapp", version["version"]], words
        assert version["backends"][0] == "cpu" and ("device" in version) != ("no_cuda" in version), version
        assert doctor(gsapp, "--json", "--version") == doctor(gsapp, "--version", "--json")
        alone = subprocess.run([gsapp, "--json"], capture_output=True, text=True, timeout=60)
        assert alone.returncode == 2 and "--version" in alone.stderr, alone
    print("good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
