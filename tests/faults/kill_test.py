# SPDX-License-Identifier: Apache-2.0
"""Kills trainings at random moments (SIGKILL) and resumes them until they finish. What they leave behind has to equal,
bit for bit, what a training leaves that nobody stopped: point clouds, checkpoints but for the time in them, scores,
pictures, and the log but for its times.

Usage: kill_test.py GSAPP [--kills N] [--seed S] [--device cpu|cuda] [--iterations N]. Prints what it did. On a GPU
trainings run with --deterministic.
"""

import argparse
import collections
import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

TIMES = ("milliseconds", "data_wait_milliseconds", "train_seconds", "data_wait_seconds")
COMMON = [
    "-r",
    "48",
    "--eval",
    "--quiet",
    "--init-points",
    "1000",
    "--cap-max",
    "1500",
    "--densify-from-iter",
    "40",
    "--densification-interval",
    "40",
    "--densify-grad-threshold",
    "1e-5",
    "--opacity-reset-interval",
    "150",
    "--preview-every",
    "150",
    "--checkpoint-minutes",
    "0.001",
]  # at every multiple of 100 iterations
CASES = {
    "mcmc": ["-s", "builtin:diffuse", "--strategy", "mcmc"],
    "adc": ["-s", "builtin:diffuse", "--strategy", "adc", "--appearance", "neural"],
    "ppisp": ["-s", "builtin:exposure", "--ppisp", "on", "--controller-iterations", "20"],
}


def check(condition, message):
    if not condition:
        raise SystemExit(f"FAILED: {message}")


def without(values, keys):
    return {key: value for key, value in values.items() if key not in keys}


def checkpoint(data):
    """The header without times and folder, and the tensors as bytes."""
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    metadata = header.pop("__metadata__")
    metadata["options"] = configuration(metadata["options"])
    return header, without(metadata, TIMES), data[8 + length :]


def configuration(text):
    """config.yaml without what a resumed run says otherwise."""
    return [line for line in text.splitlines() if not line.startswith(("model:", "resume:", "overwrite:"))]


def results(text):
    """Scores and facts without times, and without the memory of a GPU, of which a resumed part may need less."""
    return without(json.loads(text), ("timing", "memory"))


READERS = {
    "config.yaml": configuration,
    "cfg_args": lambda text: text.split("model_path=")[0] + text.split("', resolution=")[1],
    "train.jsonl": lambda text: [without(json.loads(line), TIMES) for line in text.splitlines()],
    "results.json": results,
}


def content(path):
    if path.suffix == ".safetensors":
        return checkpoint(path.read_bytes())
    return READERS[path.name](path.read_text()) if path.name in READERS else path.read_bytes()


def files(folder):
    found = {str(p.relative_to(folder)): p for p in sorted(folder.rglob("*")) if p.is_file()}
    return {name: p for name, p in found.items() if name != "gsapp.log" and ".tmp" not in p.name}


def compare(whole, killed, name):
    first, second = files(whole), files(killed)
    check(first.keys() == second.keys(), f"{name}: files differ: {sorted(first.keys() ^ second.keys())}")
    for file in first:
        check(content(first[file]) == content(second[file]), f"{name}: {file} differs")
    return len(first)


class Trainings:
    def __init__(self, arguments, folder):
        self.gsapp, self.folder = str(pathlib.Path(arguments.gsapp).resolve()), folder
        end = arguments.iterations
        self.options = [
            *COMMON,
            "--iterations",
            str(end),
            "--device",
            arguments.device,
            "--checkpoint-iterations",
            *(str(n) for n in range(30, end, 30)),
            "--save-iterations",
            *(str(n) for n in range(50, end, 50)),
        ]
        if arguments.device == "cuda":
            self.options.append("--deterministic")
        self.moments = collections.Counter()

    def start(self, options):
        return subprocess.Popen(
            [self.gsapp, "train", *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )

    def uninterrupted(self, case):
        run = self.folder / f"{case}-whole"
        began = time.monotonic()
        process = self.start([*CASES[case], *self.options, "-m", str(run)])
        message = process.communicate()[1]
        check(process.returncode == 0, f"{case}: {message}")
        return run, time.monotonic() - began

    def killed(self, case, seconds, most_kills, generator):
        """Trains with kills until it finishes. Returns the folder and the number of kills."""
        run, kills = self.folder / f"{case}-killed", 0
        shutil.rmtree(run, ignore_errors=True)
        while True:
            begun, saved = (run / "config.yaml").exists(), any((run / "checkpoints").glob("iteration_*.safetensors"))
            anew = [*CASES[case], *self.options, "-m", str(run)]
            if begun and not saved:
                refused = subprocess.run(
                    [self.gsapp, "train", "-m", str(run), "--resume", "latest"], capture_output=True, text=True
                )
                check(
                    refused.returncode == 3 and "--overwrite in place of --resume" in refused.stderr,
                    f"{case}: {refused.stderr}",
                )
                anew.append("--overwrite")
            process = self.start(["-m", str(run), "--resume", "latest"] if saved else anew)
            try:
                message = process.communicate(
                    timeout=generator.uniform(0, 1.1 * seconds) if kills < most_kills else None
                )[1]
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
                kills += 1
                self.moments[self.moment(run)] += 1
                continue
            check(process.returncode == 0, f"{case} after {kills} kills: exit {process.returncode}: {message}")
            return run, kills

    def resumed_at_its_end(self, case, whole):
        """Resumes a copy of a training as if it had been killed before its last file was written. Returns its
        folder."""
        run = self.folder / f"{case}-ended"
        shutil.copytree(whole, run)
        (run / "results.json").unlink()
        process = self.start(["-m", str(run), "--resume", "latest"])
        message = process.communicate()[1]
        check(process.returncode == 0, f"{case} after its end: exit {process.returncode}: {message}")
        return run

    @staticmethod
    def moment(run):
        """What a run that was killed had done."""
        if not (run / "config.yaml").exists():
            return "before its first file"
        if not any((run / "checkpoints").glob("iteration_*.safetensors")):
            return "before its first checkpoint"
        return "in its evaluation or later" if (run / "results.json").exists() else "between checkpoints"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("gsapp")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu", choices=["cpu", "cuda"])
    parser.add_argument("--iterations", type=int, default=240)
    arguments = parser.parse_args()
    generator = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory(prefix="gsapp-test-") as name:
        trainings = Trainings(arguments, pathlib.Path(name))
        whole = {case: trainings.uninterrupted(case) for case in CASES}
        kills = runs = compared = 0
        for case, (run, _) in whole.items():
            compared += compare(run, trainings.resumed_at_its_end(case, run), case)
        while kills < arguments.kills:
            for case, (run, seconds) in whole.items():
                most = min(-(-arguments.kills // len(CASES)), arguments.kills - kills)
                if most <= 0:
                    break
                other, added = trainings.killed(case, seconds, most, generator)
                kills, runs = kills + added, runs + 1
                compared += compare(run, other, case)
        print(
            f"{kills} kills in {runs} trainings of {arguments.iterations} iterations ("
            + ", ".join(f"{n} {moment}" for moment, n in sorted(trainings.moments.items()))
            + f"): {compared} files, all equal to those of {len(whole)} uninterrupted trainings"
        )


if __name__ == "__main__":
    sys.exit(main())
