#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Formats the manual page with all of groff's warnings, and looks for every command that --help shows. Exit status 77:
no groff.

usage: manual_test.py GSAPP
"""
import re
import shutil
import subprocess
import sys


def output(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, **options)
    assert done.returncode == 0, f"{command}: exit code {done.returncode}\n{done.stderr}"
    return done


def main():
    if not shutil.which("groff"):
        print("skipped: no groff")
        return 77
    page = output(sys.argv[1], "manual").stdout
    shown = output("groff", "-ww", "-man", "-K", "utf8", "-T", "utf8", "-P", "-cbou", input=page)
    assert not shown.stderr, shown.stderr
    assert shown.stdout.startswith("GSAPP(1)"), shown.stdout[:100]
    listed = output(sys.argv[1], "--help").stdout.split("Subcommands:")[1]
    commands = re.findall(r"^  (\S+)", listed, re.MULTILINE)
    assert {"train", "eval", "doctor"} <= set(commands) and "manual" not in commands, commands
    for command in commands:
        assert re.search(rf"^   {command}$", shown.stdout, re.MULTILINE), f"no section about {command}"
    text = re.sub(r"\s+", " ", shown.stdout)
    for words in (
        "--iterations INTEGER",
        "length of the training (1..2147483647 iterations); default: 30000",
        "-m, -o, --output, --model",
        "3 input that is missing or damaged",
        "bench frames",
        "gsapp export [OPTIONS] runs ... -o DIR",
        "needs no scene (0..1000000000)",
    ):
        assert words in text, words
    assert text.count("length of the training") == 1, "options of a training stand once"
    print(f"{len(commands)} commands described: good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
