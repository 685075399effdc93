# SPDX-License-Identifier: Apache-2.0
"""Four `gsapp tradeoff` processes train one set of configurations; one of them is killed. Three more share one that
fails.

Usage: cooperation_test.py PROGRAM
"""
import os
import signal
import subprocess
import sys
import tempfile
import time

CELLS = 6


def start(program, folder, *axes):
    command = [
        program,
        "tradeoff",
        "-s",
        "builtin:diffuse",
        "-r",
        "8",
        "--init-points",
        "500",
        "--iterations",
        "300",
        "--device",
        "cpu",
        "--threads",
        "1",
        "--axes",
        *axes,
        "-m",
        folder,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def claims(folder):
    found = {}
    for name in os.listdir(folder) if os.path.isdir(folder) else []:
        if name.endswith(".claim"):
            try:
                with open(os.path.join(folder, name)) as file:
                    words = file.read().split()
            except FileNotFoundError:
                continue
            if len(words) == 3:
                found[int(words[1])] = name
    return found


def share_a_failure(program, root):
    """The second configuration keeps all of them at work while they learn of the first, which fails at once."""
    folder = os.path.join(root, "failing")
    os.mkdir(folder)
    with open(os.path.join(folder, "iterations-2"), "w") as file:
        file.write("a file where the run's folder should be")
    processes = [start(program, folder, "iterations=2,500") for _ in range(3)]
    messages = []
    for process in processes:
        out, err = process.communicate(timeout=120)
        assert process.returncode == 3, (process.returncode, err)
        assert "- iterations 2: failed: " in out, out
        messages.append(err)
    told = sum("iterations 2: failed in another process: " in err for err in messages)
    assert told == 2, (told, *messages)


def main():
    program = os.path.abspath(sys.argv[1])
    with tempfile.TemporaryDirectory() as root:
        folder = os.path.join(root, "cells")
        processes = [start(program, folder, "appearance=none,sh,nasg", "iterations=200,300") for _ in range(4)]
        victim = None
        deadline = time.monotonic() + 60
        while victim is None:
            assert time.monotonic() < deadline, "no process claimed a configuration"
            held = claims(folder)
            victim = next((p for p in processes if p.pid in held), None)
            time.sleep(0.01)
        victim.send_signal(signal.SIGKILL)
        victim.wait()  # until then its number is that of a process
        tables = []
        for process in processes:
            out, err = process.communicate(timeout=120)
            if process is victim:
                assert process.returncode == -signal.SIGKILL, process.returncode
                continue
            assert process.returncode == 0, err
            tables.append(out)
        assert tables[0] == tables[1] == tables[2], "\n".join(tables)
        assert tables[0].count("| none") + tables[0].count("| sh") + tables[0].count("| nasg") >= CELLS, tables[0]
        left = [name for name in os.listdir(folder) if name.endswith(".claim")]
        assert not left, left
        folders = [name for name in os.listdir(folder) if os.path.isdir(os.path.join(folder, name))]
        assert len(folders) == CELLS, folders
        for name in folders:
            assert os.path.exists(os.path.join(folder, name, "results.json")), name
        share_a_failure(program, root)
    print(
        f"{CELLS} configurations trained by four processes, of which one was killed; three equal tables; "
        "a failure was tried once by three"
    )


if __name__ == "__main__":
    main()
