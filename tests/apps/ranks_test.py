# SPDX-License-Identifier: Apache-2.0
"""Several ranks train one model on the CPU, resume in other numbers, and end together when one is lost.

Usage: ranks_test.py PROGRAM
"""
import concurrent.futures
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time

SCENE = [
    "-s",
    "builtin:diffuse",
    "-r",
    "8",
    "--device",
    "cpu",
    "--threads",
    "1",
    "--init-points",
    "800",
    "--cap-max",
    "1500",
    "--seed",
    "3",
]
ENDLESS = ["--iterations", "1000000", "--checkpoint-iterations", "100"]


def train(program, *arguments, **more):
    command = [program, "train", *SCENE, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


def finish(process, seconds=120):
    out, err = process.communicate(timeout=seconds)
    return process.returncode, out, err


def check(condition, *what):
    if not condition:
        print("FAILED:", *what)
        sys.exit(1)


def psnr(folder, iterations):
    return json.loads((folder / "results.json").read_text())[f"ours_{iterations}"]["PSNR"]


def children(pid):
    return [int(c) for c in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def wait_for(what, condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        check(time.monotonic() < deadline, "within", seconds, "s:", what)
        time.sleep(0.05)


def ended(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def equal_quality(program, root):
    """One to four ranks reach the same quality, and resume what others began."""
    length = 1000
    found = {}
    for ranks in (1, 2, 3, 4):
        run = root / f"of-{ranks}"
        code, _, err = finish(
            train(
                program,
                "-m",
                run,
                "--eval",
                "--ranks",
                ranks,
                "--iterations",
                length,
                "--checkpoint-iterations",
                length // 2,
            )
        )
        check(code == 0, ranks, "ranks:", err)
        found[ranks] = psnr(run, length)
    print("PSNR by ranks:", found)
    for ranks in (2, 3, 4):
        check(abs(found[ranks] - found[1]) < 0.15, "PSNR by number of ranks:", found)
    for begun, ranks in ((2, 3), (3, 1)):
        run = root / f"of-{begun}-then-{ranks}"
        subprocess.run(["cp", "-r", root / f"of-{begun}", run], check=True)
        checkpoint = run / "checkpoints" / f"iteration_{length // 2}.safetensors"
        check(checkpoint.exists(), sorted((run / "checkpoints").iterdir()))
        code, _, err = finish(
            train(
                program,
                "-m",
                run,
                "--eval",
                "--ranks",
                ranks,
                "--iterations",
                length,
                "--resume",
                checkpoint,
                "--overwrite",
            )
        )
        check(code == 0, f"{begun} then {ranks} ranks:", err)
        check(abs(psnr(run, length) - found[1]) < 0.15, f"{begun} then {ranks} ranks:", psnr(run, length), found)


def steps_on_several_views(program, root):
    """Steps end where something is due, whatever the number of their views."""
    run = root / "batch"
    code, _, err = finish(
        train(
            program,
            "-m",
            run,
            "--batch",
            3,
            "--iterations",
            130,
            "--save-iterations",
            50,
            "--checkpoint-iterations",
            64,
        )
    )
    check(code == 0, err)
    for iteration in (50, 130):
        check(
            (run / "point_cloud" / f"iteration_{iteration}" / "point_cloud.ply").exists(),
            iteration,
            list(run.glob("*/*")),
        )
    for iteration in (64, 130):
        check((run / "checkpoints" / f"iteration_{iteration}.safetensors").exists(), iteration, list(run.glob("*/*")))
    lines = [json.loads(line) for line in (run / "stats" / "train.jsonl").read_text().splitlines()]
    check([line["iteration"] for line in lines if line["event"] == "step"] == [100, 130], lines)


def lost_rank(program, root, sent, expected):
    """A rank that dies or hangs ends the others, and the last checkpoint is whole."""
    run = root / f"lost-{sent}"
    process = train(program, "-m", run, "--ranks", 3, *ENDLESS)
    wait_for("a checkpoint", lambda: list(run.glob("checkpoints/*.safetensors")) or process.poll() is not None)
    check(process.poll() is None, "it trains:", process.poll() is not None and finish(process))
    ranks = children(process.pid)
    check(len(ranks) == 2, ranks)
    os.kill(ranks[1], sent)
    start = time.monotonic()
    code, _, err = finish(process, 60)
    seconds = time.monotonic() - start
    print(f"signal {sent}: ended after {seconds:.1f} s: {err.strip().splitlines()[-1]}")
    check(code == 4, code, err)
    check(seconds < 30, "it took", seconds, "s")
    check(expected in err and err.count("error:") == 1, err)
    wait_for("the others end", lambda: all(ended(pid) for pid in ranks), 15)
    latest = max(int(path.stem.split("_")[-1]) for path in run.glob("checkpoints/*.safetensors"))
    check(f"iteration_{latest}" in err and "--resume latest" in err, "it says how to go on:", err)
    to = latest + 50
    code, _, err = finish(train(program, "-m", run, "--ranks", 2, "--iterations", to, "--resume", "latest"))
    check(code == 0, "it resumes:", err)


def stopped_together(program, root):
    """Ranks that were stopped together, as Ctrl-Z does, go on together."""
    process = train(
        program,
        "-m",
        root / "stopped",
        "--ranks",
        2,
        "--iterations",
        400,
        "--appearance",
        "neural",
        "--ppisp",
        "on",
        start_new_session=True,
    )
    time.sleep(1)
    os.killpg(process.pid, signal.SIGSTOP)
    time.sleep(17)
    os.killpg(process.pid, signal.SIGCONT)
    code, _, err = finish(process, 60)
    check(code == 0, code, err)


def interrupted(program, root):
    """Ctrl-C, which all processes of a terminal get, is for rank 0."""
    run = root / "interrupted"
    process = train(program, "-m", run, "--ranks", 2, *ENDLESS, start_new_session=True)
    wait_for("a checkpoint", lambda: list(run.glob("checkpoints/*.safetensors")) or process.poll() is not None)
    ranks = children(process.pid)
    os.killpg(process.pid, signal.SIGINT)
    code, _, err = finish(process, 60)
    check(code == 130, code, err)
    check("interrupted after" in err, err)
    wait_for("the other ends", lambda: all(ended(pid) for pid in ranks), 15)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def two_jobs_at_one_port(program, root):
    """A rank of another job that was given the same port goes by itself, and leaves the first job alone."""
    port = str(free_port())

    def start(rank, run):
        environment = {
            **os.environ,
            "RANK": str(rank),
            "WORLD_SIZE": "2",
            "MASTER_ADDR": "127.0.0.1",
            "MASTER_PORT": port,
        }
        return train(program, "-m", root / run, "--iterations", 20, env=environment)

    first = start(0, "job-one")
    code, _, err = finish(start(1, "job-two"))
    check(code == 4 and "found another job" in err and err.count("error:") == 1, code, err)
    check(first.poll() is None, "the first job still waits")
    results = [finish(p) for p in (start(1, "job-one"), first)]
    check([code for code, _, _ in results] == [0, 0], results)
    check(not (root / "job-two").exists(), "nothing is written")


class Strangers:
    """Connections to a port from somebody who does not know the job's secret: idle ones, and such that say
    something."""

    WORDS = [
        b"x",
        b"\0",
        bytes(range(256)) * 100,
        b"GET / HTTP/1.1\r\n\r\n",
        b"POST /failed HTTP/1.1\r\nGsapp-Job: 0\r\nContent-Length: 1\r\n\r\nx",
        (16).to_bytes(4, "little") + b"half of a request",
    ]

    def __init__(self, port, idle=40):
        self.connections = [socket.create_connection(("127.0.0.1", port)) for _ in range(idle)]
        for words in self.WORDS:
            for stays in (False, True):
                connection = socket.create_connection(("127.0.0.1", port))
                connection.sendall(words)
                self.connections.append(connection) if stays else connection.close()


def listening_ports(pid):
    """The ports at which a process listens."""
    sockets = set()
    for link in pathlib.Path(f"/proc/{pid}/fd").iterdir():
        try:
            sockets.add(os.readlink(link))
        except FileNotFoundError:
            pass
    lines = [line.split() for line in pathlib.Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]]
    return {int(line[1].split(":")[1], 16) for line in lines if line[3] == "0A" and f"socket:[{line[9]}]" in sockets}


def strangers(program, root):
    """What strangers send to the ports of the ranks changes nothing, and a rank without the secret is refused."""
    port = free_port()

    def start(rank, secret="the secret of this job"):
        environment = {
            **os.environ,
            "RANK": str(rank),
            "WORLD_SIZE": "3",
            "MASTER_ADDR": "127.0.0.1",
            "MASTER_PORT": str(port),
            "GSAPP_RANK_SECRET": secret,
        }
        return train(program, "-m", root / "strangers", "--iterations", 20, env=environment)

    first = start(0)
    wait_for("rank 0 listens", lambda: port in listening_ports(first.pid))
    kept = [Strangers(port)]
    code, _, err = finish(start(1, "the secret of another"))
    check(code == 4 and "rank 1 found ranks with another secret" in err and err.count("error:") == 1, code, err)
    code, _, err = finish(start(1, "guess me"))
    check(code == 2 and "GSAPP_RANK_SECRET: a secret of 8 characters can be guessed" in err, code, err)
    second = start(1)
    wait_for("rank 1 listens", lambda: second.poll() is not None or listening_ports(second.pid))
    kept += [Strangers(at) for at in [port, *listening_ports(second.pid)]]
    results = [finish(p) for p in (start(2), second, first)]
    check([code for code, _, _ in results] == [0, 0, 0], results)


def started_by_others(program, root):
    """The variables of torchrun; ranks that differ are found before the training."""

    def world(size, *different, local_size=None):
        port = str(free_port())
        processes = []
        for rank in range(size):
            environment = {
                **os.environ,
                "RANK": str(rank),
                "WORLD_SIZE": str(size),
                "MASTER_ADDR": "127.0.0.1",
                "MASTER_PORT": port,
                "LOCAL_RANK": str(rank % (local_size or size)),
                "LOCAL_WORLD_SIZE": str(local_size or size),
            }
            processes.append(
                train(
                    program,
                    "-m",
                    root / "world",
                    "--overwrite",
                    *(different if rank == 1 else ()),
                    "--iterations",
                    60,
                    env=environment,
                )
            )
        return [finish(p) for p in processes]

    results = world(2)
    check([code for code, _, _ in results] == [0, 0], results)
    check((root / "config" / "gsapp" / "rank_secret").stat().st_mode & 0o777 == 0o600, "only its user reads the secret")
    check(results[1][1] == "" and results[1][2] == "", "only rank 0 speaks:", results[1])
    two_jobs_at_one_port(program, root)
    results = world(3, local_size=1)
    check([code for code, _, _ in results] == [0, 0, 0], "ranks that take each other for other machines:", results)
    results = world(2, "--lambda-dssim", "0.3")
    check(results[0][0] == 4 and "--lambda-dssim 0.3" in results[0][2] and "rank 1" in results[0][2], results)
    check(results[1][0] == 4 and results[1][2] == "", "rank 0 says it:", results[1])
    code, _, err = finish(train(program, "-s", root / "nothing", "-m", root / "x", "--ranks", 2))
    check(code in (3, 4) and err.count("error:") == 1 and "nothing" in err, code, err)
    code, _, err = finish(
        train(
            program,
            "-m",
            root / "x",
            "--ranks",
            2,
            env={**os.environ, "RANK": "0", "WORLD_SIZE": "3", "MASTER_ADDR": "x", "MASTER_PORT": "1"},
        )
    )
    check(code == 2 and "option ranks: 2 is not the number of processes" in err, code, err)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, _, err = finish(
            train(
                program,
                "-m",
                root / "x",
                env={
                    **os.environ,
                    "RANK": "0",
                    "WORLD_SIZE": "2",
                    "MASTER_ADDR": "127.0.0.1",
                    "MASTER_PORT": str(taken.getsockname()[1]),
                },
            )
        )
    check(code == 4 and "it is taken" in err, code, err)
    for value in ("0", "two", "-1", "all"):
        code, _, err = finish(train(program, "-m", root / "x", "--ranks", value))
        check(code == 2 and "ranks" in err, value, code, err)
    code, _, err = finish(
        train(
            program,
            "-m",
            root / "x",
            "--device",
            "cuda",
            "--gpus",
            "all",
            env={**os.environ, "CUDA_VISIBLE_DEVICES": ""},
        )
    )
    check(code == 4 and "option ranks: all" in err and "there is none" in err, code, err)
    check(not (root / "x").exists(), "nothing is written")


def main():
    program = os.path.abspath(sys.argv[1])
    with tempfile.TemporaryDirectory() as name:
        root = pathlib.Path(name)
        os.environ["XDG_CONFIG_HOME"] = str(root / "config")  # for the secret of ranks that were not given one
        steps_on_several_views(program, root)
        started_by_others(program, root)
        lost_rank(program, root, signal.SIGKILL, "rank 2 was ended by signal 9")
        with concurrent.futures.ThreadPoolExecutor() as pool:  # these mostly wait
            waits = [
                pool.submit(strangers, program, root),
                pool.submit(lost_rank, program, root, signal.SIGSTOP, "has not been heard of"),
                pool.submit(stopped_together, program, root),
                pool.submit(interrupted, program, root),
            ]
            for wait in waits:
                wait.result()
        equal_quality(program, root)
    print("passed")


if __name__ == "__main__":
    main()
