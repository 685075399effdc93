# SPDX-License-Identifier: Apache-2.0
"""Lets writes fail, one after another, in every subcommand that writes: open, write, fsync, close, rename and mkdir
(failing_writes.cpp). Each time the program has to end with exit code 3, name the file, leave no temporary file, and
leave every file as it was before or as it would have become. Then stdout on a full device, and closed.

Usage: write_test.py GSAPP LIBRARY [--all] [--only CASE]. A spread of the calls fails, about 4 a subcommand; with --all
each of them.
"""

import argparse
import concurrent.futures
import errno
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

TRAIN = [
    "-s",
    "builtin:diffuse",
    "--device",
    "cpu",
    "-r",
    "48",
    "--iterations",
    "4",
    "--init-points",
    "300",
    "--cap-max",
    "300",
    "--threads",
    "1",
]
SAVE = ["--eval", "--preview-every", "2", "--checkpoint-iterations", "2", "--save-iterations", "2", "4", "--quiet"]
# Messages and the owner of a lock are no results: a write to these may fail without ending the program.
NO_RESULTS = {"gsapp.log", ".gsapp.lock"}
BINARY = {".png", ".ply", ".ngsplat", ".splat"}
COLMAP = """#!/bin/sh
command=$1
while [ $# -gt 0 ]; do
  case $1 in --output_path) output=$2;; esac
  shift
done
case $command in
  mapper) mkdir -p "$output/0"; printf '\\002\\000\\000\\000\\000\\000\\000\\000' > "$output/0/images.bin";;
  image_undistorter)
    mkdir -p "$output/images" "$output/sparse"
    cp "$PHOTOGRAPH" "$output/images"
    echo "1 PINHOLE 48 48 50 50 24 24" > "$output/sparse/cameras.txt"
    printf '1 1 0 0 0 0 0 0 1 %s\\n\\n' "$(basename "$PHOTOGRAPH")" > "$output/sparse/images.txt"
    echo "1 0 0 5 9 9 9 0.5" > "$output/sparse/points3D.txt";;
esac
"""


class Case:
    """A subcommand: its words, with {} for the folder it works in; `replaces`: that an earlier file may be gone while
    the command fails; `heavy`: only with --all, and every training is a process that counts its own calls."""

    def __init__(self, name, words, replaces=False, heavy=False):
        self.name, self.words, self.replaces, self.heavy = name, words, replaces, heavy


CASES = [
    Case("train", ["train", *TRAIN, *SAVE, "-m", "{}/new"]),
    Case("train again", ["train", *TRAIN, *SAVE, "-m", "{}/run", "--overwrite", "--strategy", "adc"], replaces=True),
    Case("resume", ["train", *TRAIN, *SAVE, "-m", "{}/run", "--resume", "latest", "--iterations", "6"]),
    Case("eval", ["eval", "{}/run", "--decompose", "--html", "{}/page.html"]),
    Case("render", ["render", "{}/run", "-o", "{}/pictures"]),
    Case("export web", ["export", "{}/run", "-o", "{}/site", "--overwrite"]),
    Case("export ply", ["export", "{}/run", "-o", "{}/files", "--format", "ply", "--overwrite"]),
    Case("export splat", ["export", "{}/run", "-o", "{}/files", "--format", "splat", "--overwrite"]),
    Case("prepare", ["prepare", "{}/run/test/ours_4/gt", "-o", "{}/scene", "--overwrite"]),
    Case("bench frames", ["bench", "frames", "{}/run", "--frame-repeat", "1"]),
    Case(
        "bench suite",
        ["bench", "suite", "densification", *TRAIN, "--appearances", "none", "-m", "{}/suite"],
        heavy=True,
    ),
    Case("tradeoff", ["tradeoff", *TRAIN, "--axes", "iterations=2,3", "-m", "{}/tradeoff"], heavy=True),
]


def check(condition, message):
    if not condition:
        raise SystemExit(f"FAILED: {message}")


def contents(folder):
    """Every file by its path. Numbers in them are blurred, since some are times, and so is the folder."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink() or not path.is_file() or path.name in NO_RESULTS:
            continue
        data, tail = path.read_bytes(), b""
        if path.suffix == ".safetensors":  # length of the header, header with blanks at its end, tensors
            end = 8 + int.from_bytes(data[:8], "little")
            data, tail = data[8:end].rstrip(), data[end:]
        if path.suffix not in BINARY:
            data = re.sub(rb"[0-9.]+(e[-+]?[0-9]+)?", b"#", data.replace(str(folder).encode(), b"FOLDER"))
        found[path.relative_to(folder).as_posix()] = data + tail
    return found


class Suite:
    def __init__(self, arguments, folder):
        self.gsapp, self.library = (str(pathlib.Path(file).resolve()) for file in (arguments.gsapp, arguments.library))
        self.all, self.folder = arguments.all, folder
        self.template = folder / "template"
        colmap = folder / "bin" / "colmap"
        colmap.parent.mkdir()
        colmap.write_text(COLMAP)
        colmap.chmod(0o755)
        self.environment = dict(
            os.environ,
            PATH=f"{colmap.parent}:{os.environ['PATH']}",
            GSAPP_FAULT_ROOT="",
            PHOTOGRAPH=str(self.template / "run/test/ours_4/gt/00000.png"),
            ASAN_OPTIONS="verify_asan_link_order=0:" + os.environ.get("ASAN_OPTIONS", ""),
        )

    def run(self, words, folder, faults=None):
        environment = dict(self.environment)
        if faults is not None:
            environment.update(LD_PRELOAD=self.library, GSAPP_FAULT_ROOT=str(folder), **faults)
        return subprocess.run(
            [self.gsapp] + [word.replace("{}", str(folder)) for word in words],
            env=environment,
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=120,
        )

    def prepare(self):
        """What was there before: a run, and what the subcommands make of it."""
        self.template.mkdir()
        made = self.run(["train", *TRAIN, *SAVE, "-m", "{}/run"], self.template)
        check(made.returncode == 0, f"train: {made.stderr}")
        for case in CASES[3:9]:
            made = self.run(case.words, self.template)
            check(made.returncode == 0, f"{case.name}: {made.stderr}")
        (self.template / "page.html").write_text("an earlier page\n")

    def copy(self, name):
        folder = self.folder / name
        shutil.copytree(self.template, folder)
        return folder

    def calls(self, case):
        """Returns what the subcommand calls, in order, as (kind, path), and the files it leaves. Of several processes
        the calls of the longest."""
        folder, report = self.copy("count"), self.folder / "report"
        done = self.run(case.words, folder, {"GSAPP_FAULT_AT": "0", "GSAPP_FAULT_REPORT": str(report)})
        check(done.returncode == 0, f"{case.name}: {done.stderr}")
        processes = {}
        for line in report.read_text().splitlines():
            process, kind, path = line.split(" ", 2)
            processes.setdefault(process, []).append((kind, path))
        calls = max(processes.values(), key=len)
        check(len(calls) > 2, f"{case.name}: only {calls} was seen: is the library loaded?")
        after = contents(folder)
        shutil.rmtree(folder)
        report.unlink()
        return calls, after

    def fail(self, case, number, full, call, after):
        kind, path = call
        name = pathlib.Path(path).name
        leftover = re.fullmatch(r"\.(.+)\.\d+-\d+\.tmp", name)
        target = leftover.group(1) if leftover else re.sub(r"\.replaced-\d+$", "", name)
        what = f"{case.name}, call {number} ({kind} {path}{', as on a full disk' if full else ''})"
        folder = self.copy(f"fail-{case.name.replace(' ', '-')}-{number}-{int(full)}")
        before = contents(folder)
        done = self.run(
            case.words,
            folder,
            {
                "GSAPP_FAULT_AT": str(number),
                "GSAPP_FAULT_KEEP": str(int(full)),
                "GSAPP_FAULT_ERROR": str(errno.ENOSPC if full else errno.EIO),
            },
        )
        found = contents(folder)
        told = f"{what}: exit code {done.returncode}\n{done.stderr}"
        excused = target in NO_RESULTS or (
            target == "train.jsonl" and kind == "write" and not full
        )  # written at the second try
        check(done.returncode == 3 or (excused and done.returncode == 0), told)
        # A full disk is met by another file than the first where that one is excused.
        unsaid = target == ".gsapp.lock" or (target == "gsapp.log" and (full or kind == "open"))  # which is tried again
        check(target in done.stderr or unsaid or case.heavy, f"{target} is not named: {told}")
        reason = os.strerror(errno.ENOSPC if full else errno.EIO)
        check(reason in done.stderr or done.returncode == 0, f"no reason is given: {told}")
        temporary = [str(p) for p in folder.rglob(".*.tmp")]
        check(not temporary, f"{what}: {temporary} were left")
        if case.replaces and found["run/config.yaml"] == before["run/config.yaml"]:
            check(found == before, f"{what}: the earlier run is not whole")
        for file in sorted(set(before) | set(found)):
            if case.heavy:
                check(
                    not file.endswith(".json") or json.loads((folder / file).read_text()), f"{what}: {file} is damaged"
                )
            elif file not in found:
                check(case.replaces, f"{what}: {file} is gone")
            elif file.endswith(".html"):  # holds times in units that depend on them
                check(
                    found[file] == before.get(file) or found[file].endswith(b"</html>\n"), f"{what}: {file} is damaged"
                )
            elif file.endswith("results.json"):  # written several times
                check(
                    found[file].endswith(b"}\n") and json.loads((folder / file).read_text()),
                    f"{what}: {file} is damaged",
                )
            elif file.endswith("train.jsonl"):  # grows line by line
                kept = max(found[file].rfind(b"\n") + 1, 0)
                check(
                    any(other.get(file, b"").startswith(found[file][:kept]) for other in (before, after)),
                    f"{what}: {file} is damaged",
                )
            else:
                check(
                    found[file] in (before.get(file), after.get(file)),
                    f"{what}: {file} is neither the old file nor the new one",
                )
        shutil.rmtree(folder)

    def chosen(self, calls):
        """The faults to try: (number, as on a full disk). Without --all about four, of different kinds where
        there are."""
        # That a file which is thrown away, or is already in its place, cannot be closed is no loss.
        numbers = [
            number
            for number, (kind, path) in enumerate(calls, 1)
            if kind != "close" or ("fsync", path) in calls[: number - 1]
        ]
        if self.all:
            return [(number, full) for number in numbers for full in (False, True)]
        picked = {(1, True), (numbers[len(numbers) // 2], True)}
        kinds = {}
        for number in numbers:
            kind, path = calls[number - 1]
            kinds.setdefault(kind + (" folder" if kind == "fsync" and not path.endswith(".tmp") else ""), []).append(
                number
            )
        self.turn = getattr(self, "turn", 0)
        for _ in range(2):  # each subcommand takes the next two kinds
            of_kind = kinds[sorted(kinds)[self.turn % len(kinds)]]
            picked.add((of_kind[self.turn * 7 % len(of_kind)], False))
            self.turn += 1
        return sorted(picked)

    def check_case(self, case, pool):
        calls, after = self.calls(case)
        faults = self.chosen(calls)
        tries = [pool.submit(self.fail, case, *fault, calls[fault[0] - 1], after) for fault in faults]
        try:
            for one in concurrent.futures.as_completed(tries):
                one.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)  # the first failure is enough
            raise
        print(f"{case.name}: {len(calls)} calls, {len(faults)} failures: as they should be", flush=True)

    def check_stdout(self):
        picture = str(self.template / "run/test/ours_4/gt/00000.png")
        run = str(self.template / "run")
        commands = [
            ["options"],
            ["--version"],
            ["--help"],
            ["train", "--help"],
            ["eval", "--skip-render", run],
            ["metrics", picture, picture, "--metrics", "psnr"],
            ["bench", "frames", run, "--frame-repeat", "1"],
            ["train", *TRAIN, "--json", "-m", str(self.folder / "printed")],
        ]
        for words in commands:
            for to in (">/dev/full", ">&-"):
                shutil.rmtree(self.folder / "printed", ignore_errors=True)
                done = subprocess.run(
                    ["sh", "-c", f'"$0" "$@" {to}', self.gsapp, *words],
                    env=self.environment,
                    cwd=self.folder,
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    text=True,
                )
                check(
                    done.returncode == 3 and "stdout" in done.stderr,
                    f"{words} {to}: exit code {done.returncode}\n{done.stderr}",
                )
        check(
            (self.folder / "printed/point_cloud/iteration_4/point_cloud.ply").exists(),
            "what is not printed is written nevertheless",
        )
        # What prints nothing needs no stdout, and no file of it gets what belongs to stdout or stderr.
        words = ["export", run, "-o", str(self.folder / "closed"), "--format", "ply"]
        done = subprocess.run(
            ["sh", "-c", '"$0" "$@" >&- 2>&- <&-', self.gsapp, *words], env=self.environment, cwd=self.folder
        )
        check(done.returncode == 0, f"{words} with closed stdin, stdout and stderr: exit code {done.returncode}")
        check(
            (self.folder / "closed/point_cloud.ply").read_bytes()
            == (self.template / "files/point_cloud.ply").read_bytes(),
            "something was printed into a file",
        )
        print("stdout on a full device, and closed: as it should be")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("gsapp")
    parser.add_argument("library")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--only")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gsapp-faults-") as name, concurrent.futures.ThreadPoolExecutor(
        os.cpu_count()
    ) as pool:
        suite = Suite(arguments, pathlib.Path(name).resolve())
        suite.prepare()
        for case in CASES:
            if arguments.only in (None, case.name) and (arguments.all or not case.heavy or arguments.only):
                suite.check_case(case, pool)
        if arguments.only in (None, "stdout"):
            suite.check_stdout()


if __name__ == "__main__":
    sys.exit(main())
