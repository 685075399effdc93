# SPDX-License-Identifier: Apache-2.0
"""Runs the commands that the pages for users show, shortened, and looks for the files that they promise.

A block of commands has the language `sh`. A comment in the line above it says how it is tested:

    <!-- test: with output/scene; makes site/index.html site/scene.ngsplat<=5000000 -->

  with PATH ...    what lies in the working folder before: finished runs (a .ply: the model of one; a .json: its cameras)
  needs NAME       a program, or a path of the sources; without it the block is skipped
  makes PATH ...   what has to be there afterwards and not empty; `<=BYTES`: and at most that large
  twice            the block runs a second time, as after an interruption
  NAME=VALUE       a variable of the environment

Each block runs by bash in a folder of its own and must end with exit code 0. `gsapp` is this script, which shortens the
command before it calls the program: a built-in scene instead of the reader's, its pictures at an eighth of their size,
few steps, the CPU. A block without the comment may only hold commands of NOT_RUN, each with the reason. Options that
the pages name anywhere must be known to some command.

Usage: guide_test.py SOURCE_FOLDER GSAPP, or --self-test. Exit code 1 and a line for each fault if there are any."""

import concurrent.futures
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request

PAGES = [f"docs/{name}.md" for name in ("install", "guide", "training", "troubleshooting", "faq", "ranks")]

# What no test of this page runs: the beginning of the command, and why.
NOT_RUN = {
    "gsapp prepare": "needs colmap, and minutes; tests/apps/prepare_test.cpp runs it with a stand-in",
    "gsapp train -s scene -m output/scene --eval --view": "serves its page until Ctrl-C; tests/apps/view_test.cpp and "
    "tests/eval/live run it",
    "scripts/setup": "installs packages; CI begins with it",
    "scripts/build-viewer": "needs npm; CI builds the viewer",
    "scripts/download": "fetches gigabytes; tests/scripts/download_test.py runs it on small archives",
    "export PATH": "is for the shell that follows",
    "cmake": "builds or installs the program; CI does, and tests/install looks at what is installed",
    "cpack": "packs what is built; scripts/check-package looks at the packages",
    "ssh": "needs a second machine",
    "srun gsapp train": "needs Slurm; tests/apps/ranks_test.py gives ranks their variables",
}
# Options in the pages that are those of other programs.
FOREIGN = {
    "--target",
    "--rm",
    "--gpus",
    "--build",
    "--preset",
    "--prefix",
    "--install",
    "--checksums",
    "--check",
    "--colmap",
    "--array",
    "--gres",
    "--cpus-per-task",
    "--mem",
    "--time",
    "--requeue",
    "--signal",
    "--job-name",
    "--nodes",
    "--ntasks-per-node",
    "--orientation-method",
    "--center-method",
    "--auto-scale-poses",
    "--logdir",
    "--spz-version",
}

FENCE = re.compile(r"^```(\w*)$")
MARK = re.compile(r"^<!-- test: ?(.*?) ?-->$")
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")


class Block:
    def __init__(self, page, line, text, mark):
        self.where, self.text = f"{page}:{line}", text
        self.marked = mark is not None
        self.given, self.needs, self.makes, self.environment, self.times = [], [], [], {}, 1
        for part in (mark or "").split(";"):
            words = part.split()
            if words[:1] == ["with"]:
                self.given += words[1:]
            elif words[:1] == ["needs"]:
                self.needs += words[1:]
            elif words[:1] == ["makes"]:
                self.makes += words[1:]
            elif words == ["twice"]:
                self.times = 2
            elif len(words) == 1 and "=" in words[0]:
                self.environment.update([words[0].split("=", 1)])
            elif words:
                raise ValueError(f"{self.where}: not understood: {part.strip()}")


def blocks_of(page, text):
    """The blocks of language sh of a page, and faults: commands in a block that is no such one."""
    blocks, faults, lines = [], [], text.splitlines()
    language, begin = None, 0
    for number, line in enumerate(lines, 1):
        fence = FENCE.match(line)
        if fence and language is None:
            language, begin = fence[1], number
        elif fence:
            inside = lines[begin : number - 1]
            if language == "sh":
                mark = MARK.match(lines[begin - 2]) if begin > 1 else None
                blocks.append(Block(page, begin, "\n".join(inside), mark[1] if mark else None))
            elif any(re.match(r"(gsapp|scripts/\S+) ", one) for one in inside):
                faults.append(f"{page}:{begin}: commands in a block that is not of language sh")
            language = None
    return blocks, faults


def unexplained(block):
    """Commands of a block without mark that NOT_RUN does not explain."""
    commands = [line.strip() for line in block.text.splitlines() if line.strip() and not line.startswith("#")]
    parts = [part.strip() for command in commands for part in command.split("&&")]
    return [part for part in parts if not any(part.startswith(name) for name in NOT_RUN)]


# --- the program as the blocks call it


def small(number):
    return str(max(2, int(number) // 1000)) if number.isdigit() and int(number) > 100 else number


def shortened(words):
    """The command with a small scene, small pictures, few steps and frames."""
    trains = words[:1] in (["train"], ["tradeoff"]) or words[:2] == ["bench", "suite"]
    out, name = [], ""
    for word in words:
        if word.startswith("-") and not word.lstrip("-").isdigit():
            name = word
        elif name in ("-s", "--source", "--data_dir", "--data") and not word.startswith("builtin:"):
            word = "builtin:diffuse" if "chair" in word else "builtin:glossy"
        elif name == "--time-limit":
            word = "20s" if words[0] == "tradeoff" else "1s"
        elif name == "--size-limit":
            word = {"5MB": "300KB"}[word]
        elif name in ("--iterations", "--max_steps", "--test_iterations", "--test-iterations", "--preview-every"):
            word = small(word)
        elif name == "--axes" and word.startswith("iterations="):
            word = "iterations=" + ",".join(small(n) for n in word.split("=")[1].split(","))
        elif name == "--orbit":
            word = "3"
        out.append(word)
    if trains and "--resume" not in words:
        out += ["--device", "cpu", "-r", "8", "--init-points", "500"]
        if not {"--time-limit", "--iterations", "--max_steps"} & set(words) or words[0] == "tradeoff":
            out += ["--iterations", "10"]
        if "--ppisp" in words:
            out += ["--controller-iterations", "5"]
    if words[:2] == ["bench", "suite"] and "--appearances" not in words:
        out += ["--appearances", "none"]
    if words[:1] == ["bench"] and words[1:2] not in (["suite"], ["stability"]):
        out += ["--device", "cpu"] + ([] if "--ranks" in words else ["--frame-repeat", "1"])
        out += [] if words[1:2] == ["frames"] else ["--repeat", "1"]
    return out


def serve(program, words):
    """Calls `gsapp view`, fetches the page that it prints, and stops it as Ctrl-C does."""
    server = subprocess.Popen([program, *words, "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        address = server.stdout.readline().strip()
        with urllib.request.urlopen(address, timeout=20) as answer:
            page = answer.read()
    finally:
        server.send_signal(signal.SIGINT)
    return server.wait(20) or (0 if b"<html" in page.lower() else 1)


def as_gsapp(program, words):
    if words[:1] == ["view"]:
        return serve(program, words)
    os.execv(program, [program, *shortened(words)])


# --- the blocks


class Runner:
    def __init__(self, root, program, folder):
        self.root, self.folder = pathlib.Path(root).resolve(), pathlib.Path(folder)
        self.program = pathlib.Path(program).resolve()
        (self.folder / "bin").mkdir()
        gsapp = self.folder / "bin/gsapp"
        gsapp.write_text(
            f"#!/bin/sh\nexec '{sys.executable}' '{pathlib.Path(__file__).resolve()}' --as-gsapp "
            f"'{self.program}' \"$@\"\n"
        )
        gsapp.chmod(0o755)
        self.runs = {}

    def shell(self, text, work, environment):
        path = f"{self.folder / 'bin'}:{os.environ['PATH']}"
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", text],
            cwd=work,
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PATH": path, **environment},
            capture_output=True,
            text=True,
            errors="replace",
            timeout=120,
        )
        return done.returncode, done.stdout + done.stderr

    def finished_run(self, name):
        """The folder of a finished run; one of each model that a name asks for, and with PPISP."""
        kind = name if name in ("none", "nasg", "neural", "sh", "ppisp") else "sh"
        if kind not in self.runs:
            folder = self.folder / "runs" / kind
            options = "--appearance sh --ppisp on" if kind == "ppisp" else f"--appearance {kind}"
            code, said = self.shell(f"gsapp train -s scene -m '{folder}' --eval {options}", self.folder, {})
            if code:
                raise RuntimeError(f"no run for the commands to work with: {said}")
            self.runs[kind] = folder
        return self.runs[kind]

    def lay_out(self, block, work):
        (work / "scenes").symlink_to(self.root / "scenes")
        for name in block.given:
            run, target = self.finished_run(pathlib.PurePath(name).stem), work / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if name.endswith(".ply"):
                shutil.copy(next(run.glob("point_cloud/*/point_cloud.ply")), target)
            elif name.endswith(".json"):
                shutil.copy(run / "cameras.json", target)
            else:
                shutil.copytree(run, target)

    def faults_of(self, block, work):
        work.mkdir()
        self.lay_out(block, work)
        for _ in range(block.times):
            code, said = self.shell(block.text, work, block.environment)
            if code:
                return [f"{block.where}: exit code {code}:\n{block.text}\n{said[-3000:]}"]
        faults = []
        for promise in block.makes:
            name, _, most = promise.partition("<=")
            path = work / name
            size = path.stat().st_size if path.is_file() else sum(1 for _ in path.iterdir()) if path.is_dir() else 0
            if size == 0:
                faults.append(f"{block.where}: {name} was not made")
            elif most and size > int(most):
                faults.append(f"{block.where}: {name} has {size} bytes, more than {most}")
        return faults

    def run(self, blocks):
        faults = []
        for block in blocks:
            if not block.marked:
                faults += [f"{block.where}: neither tested nor explained: {command}" for command in unexplained(block)]
        tested = []
        for block in blocks:
            missing = [need for need in block.needs if not shutil.which(need) and not (self.root / need).exists()]
            if missing:
                print(f"{block.where}: skipped: there is no {', '.join(missing)}")
            elif block.marked:
                tested.append(block)
        for name in {pathlib.PurePath(given).stem for block in tested for given in block.given}:
            self.finished_run(name)
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            works = [self.folder / f"block{number}" for number in range(len(tested))]
            for found in pool.map(self.faults_of, tested, works):
                faults += found
        return faults


def known_options(program):
    """Every option that the help of some command, or the list of all training options, names."""

    def said(*words):
        return subprocess.run([program, *words], capture_output=True, text=True, check=True).stdout

    text = said("--help") + said("options", "--coming-from") + said("options", "--markdown")
    commands = re.findall(r"^  ([a-z][a-z-]*)  ", text[text.index("Subcommands:") :], re.MULTILINE)
    for command in [[name] for name in commands] + [
        ["bench", n] for n in ("frames", "suite", "precision", "stability")
    ]:
        text += said(*command, "--help-all")
    return set(OPTION.findall(text))


def unknown_options(page, text, known):
    return [
        f"{page}:{number}: no command has the option {option}"
        for number, line in enumerate(text.splitlines(), 1)
        if not MARK.match(line)
        for option in OPTION.findall(line)
        if option not in known | FOREIGN
    ]


def check(root, program, pages):
    root, faults, blocks = pathlib.Path(root), [], []
    known = known_options(program)
    for page in pages:
        text = (root / page).read_text(encoding="utf-8")
        found, wrong = blocks_of(page, text)
        blocks, faults = blocks + found, faults + wrong + unknown_options(page, text, known)
    if not any(block.marked for block in blocks):
        faults.append("no block is tested")
    with tempfile.TemporaryDirectory() as folder:
        return faults + Runner(root, program, folder).run(blocks)


# A page as it should be, and what makes it wrong, with the fault that has to be found.
GOOD = (
    "# Page\nSee `--known`.\n<!-- test: with output/scene; makes copy -->\n```sh\ncp -r output/scene copy\n```\n"
    "```sh\ncmake --build .\n```\n```\ngsapp: a sample of output\n```\n"
)
BAD = [
    ("cp -r output/scene copy", "cp -r output/other copy", "exit code 1"),
    ("cp -r output/scene copy", "gsapp fails | cat", "exit code 7"),
    ("makes copy", "makes another", "another was not made"),
    ("cp -r output/scene copy", "printf 12345 > copy", None),
    ("makes copy -->\n```sh\ncp -r output/scene copy", "makes copy<=4 -->\n```sh\nprintf 12345 > copy", "5 bytes"),
    ("cmake --build .", "gsapp eval output/scene", "neither tested nor explained"),
    ("gsapp: a sample of output", "gsapp eval output/scene", "not of language sh"),
    ("with output/scene; makes copy", "needs no-such-program; makes another", None),
    ("`--known`", "`--unknown`", "no command has the option --unknown"),
]
STAND_IN = """#!/bin/sh
case "$*" in fails) exit 7 ;; *--help*|options*) printf 'Subcommands:\\n  train  does\\n --known\\n'; exit 0 ;; esac
while [ $# -gt 0 ]; do case $1 in -m) mkdir -p "$2"; echo x > "$2/results.json" ;; esac; shift; done
"""


def self_test():
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        program = root / "gsapp"
        program.write_text(STAND_IN)
        program.chmod(0o755)
        (root / "scenes").mkdir()
        wrong = []
        for before, after, expected in [("", "", None)] + BAD:
            (root / "page.md").write_text(GOOD.replace(before, after, 1) if before else GOOD)
            faults = check(root, program, ["page.md"])
            if (expected is None and faults) or (expected and (len(faults) != 1 or expected not in faults[0])):
                wrong.append(f"{after!r}: expected {expected}, found {faults}")
    return wrong


def main():
    if len(sys.argv) > 2 and sys.argv[1] == "--as-gsapp":
        return as_gsapp(sys.argv[2], sys.argv[3:])
    if sys.argv[1:] == ["--self-test"]:
        faults = self_test()
    elif len(sys.argv) == 3:
        if not shutil.which("bash"):
            print("skipped: no bash")
            return 77
        faults = check(sys.argv[1], sys.argv[2], PAGES)
    else:
        sys.exit(__doc__)
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
