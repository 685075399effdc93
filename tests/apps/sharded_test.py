# SPDX-License-Identifier: Apache-2.0
"""bench, eval and render spread a model over several ranks on the CPU, and end with one message when one is lost.

Usage: sharded_test.py PROGRAM
"""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

SPLAT, SUMS = 48, 36  # bytes that cross the network for a splat, and back


def call(program, *arguments, **more):
    return subprocess.run(
        [program, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=120, **more
    )


def check(condition, *what):
    if not condition:
        print("FAILED:", *what)
        sys.exit(1)


def errors(text):
    return sum(line.startswith("error:") for line in text.splitlines())


def files_of(folder):
    """The files below a folder by name: their bytes, without times and dates."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            data = path.read_bytes()
            if path.suffix == ".exr":
                data = re.sub(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d", b"", data)  # when it was written
            if path.name == "results.json":
                data = re.sub(rb'"render_seconds": [-+.e\d]+', b"", data)
            found[str(path.relative_to(folder))] = data
    return found


def bench(program):
    """What crosses the network is 84 bytes a splat that another rank renders, and what there is without any."""
    for ranks in (1, 2, 3):
        done = call(
            program,
            "bench",
            "--generate",
            "0,2,300",
            "--ranks",
            ranks,
            "--device",
            "cpu",
            "--threads",
            1,
            "--repeat",
            2,
            "--appearance",
            "none",
            "--json",
            "--quiet",
        )
        check(done.returncode == 0 and done.stderr == "", ranks, done.stderr)
        results = json.loads(done.stdout)["results"]
        check([r["num_gaussians"] for r in results] == [0, 2, 300], results)
        total = []
        for r in results:
            check(len(r["ranks"]) == r["num_ranks"] == r["views_per_step"] == ranks, r)
            check(sum(rank["num_gaussians"] for rank in r["ranks"]) == r["num_gaussians"], r)
            check(
                all(
                    rank["resident_bytes"] > 1e6 and rank["exchange_seconds"] <= rank["seconds"] for rank in r["ranks"]
                ),
                r,
            )
            check(all(0 < rank["cpu_seconds"] < 2.5 * rank["seconds"] for rank in r["ranks"]), "one thread computes", r)
            check(r["views_per_second"] > 0 and (r["link"]["bytes_per_second"] > 0) == (ranks > 1), r)
            sent, received = (sum(rank[key] for rank in r["ranks"]) for key in ("bytes_sent", "bytes_received"))
            check(sent == received and (sent > 0) == (ranks > 1), r)
            total.append((sent, sum(rank["splats_sent"] for rank in r["ranks"])))
        check(total[0][1] == 0 and (total[2][1] > 0) == (ranks > 1), total)
        for sent, splats in total[1:]:
            check(sent - total[0][0] == (SPLAT + SUMS) * splats, ranks, total)
        check((results[2]["exchange_floor_seconds"] > 0) == (ranks > 1), results[2])
    table = call(
        program,
        "bench",
        "--generate",
        "50",
        "--ranks",
        2,
        "--device",
        "cpu",
        "--threads",
        1,
        "--repeat",
        1,
        "--batch",
        3,
    )
    check(
        table.returncode == 0 and "1 of 2 |" in table.stdout and "views/s" in table.stdout, table.stdout, table.stderr
    )


def wrong_use(program, root):
    for arguments in (
        ["bench", "--generate", "10", "--ranks", "0"],
        ["bench", "--generate", "10", "--ranks", "two"],
        ["bench", "--generate", "-1", "--ranks", "2"],
        ["bench", "--ranks", "2", "-s", "builtin:glossy"],
        ["bench", "--generate", "10", "--ranks", "2", "--compare-deterministic"],
        ["bench", "--generate", "10", "--ranks", "2", "--frame-repeat", "3"],
        ["eval", root / "run", "--ranks", "0"],
        ["eval", root / "run", "--ranks", "2", "--skip-render"],
        ["render", root / "run", "--ranks", "x"],
        ["render", root / "run", "--ranks", "2", "--views", "train", "--size", "0x0"],
    ):
        done = call(program, *arguments)
        check(done.returncode == 2 and done.stdout == "", arguments, done)


def no_gpu(program, root):
    """Where a GPU was asked for and none is seen, one message says so, also where ranks may share one."""
    for arguments in (
        ["bench", "--generate", "10"],
        ["eval", root / "run"],
        ["render", root / "run", "-o", root / "none"],
        ["train", "-s", "builtin:glossy", "-m", root / "none"],
    ):
        for share in ("", "1"):
            done = call(
                program,
                *arguments,
                "--ranks",
                "2",
                "--device",
                "cuda",
                env={**os.environ, "CUDA_VISIBLE_DEVICES": "", "GSAPP_SHARE_GPUS": share},
            )
            check(
                done.returncode == 4 and errors(done.stderr) == 1 and re.search("CUDA|option device", done.stderr),
                arguments,
                share,
                done,
            )
    check(not (root / "none").exists(), "nothing is left")


def same_as_one(program, root):
    """Tables, files and JSON do not tell how many ranks made them."""
    made = {}
    for ranks in (1, 2, 3):
        where = root / f"of-{ranks}"
        where.mkdir()
        shutil.copytree(root / "run", where / "run")
        score = call(
            program, "eval", "run", "--decompose", "--ranks", ranks, "--device", "cpu", "--json", "--quiet", cwd=where
        )
        check(score.returncode == 0 and score.stderr == "", ranks, score.stderr)
        render = call(
            program,
            "render",
            "run",
            "--decompose",
            "--alpha",
            "--depth",
            "--ranks",
            ranks,
            "--device",
            "cpu",
            "--json",
            "--quiet",
            cwd=where,
        )
        check(render.returncode == 0 and render.stderr == "", ranks, render.stderr)
        made[ranks] = score.stdout, render.stdout, files_of(where)
    score, render, files = made[1]
    check(sum(name.endswith(".png") for name in files) > 30 and json.loads(score) and json.loads(render), sorted(files))
    for ranks in (2, 3):
        check(made[ranks][0] == score, ranks, made[ranks][0], score)
        check(made[ranks][1] == render, ranks, made[ranks][1], render)
        check(sorted(made[ranks][2]) == sorted(files), ranks, sorted(made[ranks][2]))
        check(
            not [name for name in files if files[name] != made[ranks][2][name]],
            ranks,
            [name for name in files if files[name] != made[ranks][2][name]],
        )


def lost_rank(program, root):
    """A rank that dies ends all with one message, and nothing is left of what was begun."""
    before = files_of(root / "run")
    for arguments, where in (
        (["eval", "run", "--time-frames", "100000"], "test"),
        (["render", "run", "--orbit", "100000", "-o", "orbit"], "orbit"),
    ):
        process = subprocess.Popen(
            [program, *arguments, "--ranks", "3", "--device", "cpu"],
            cwd=root,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        deadline = time.monotonic() + 60
        pictures = []
        while len(pictures) < 3:
            check(time.monotonic() < deadline and process.poll() is None, arguments, "renders", process.poll())
            pictures = list(root.rglob(".*.tmp/**/*.png"))
            time.sleep(0.02)
        ranks = [
            int(pid) for pid in pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        ]
        check(len(ranks) == 2, ranks)
        os.kill(ranks[1], signal.SIGKILL)
        out, err = process.communicate(timeout=60)
        check(process.returncode == 4 and out == "", arguments, process.returncode, out, err)
        check(errors(err) == 1 and "rank 2 was ended by signal 9" in err, err)
        check(files_of(root / "run") == before and not (root / "orbit").exists(), arguments, sorted(root.rglob("*")))
        check(not list(root.rglob("*.tmp")), list(root.rglob("*.tmp")))


def missing_file(program, root):
    """An image that is gone when its view is scored ends all ranks with one message, and so does a missing run."""
    done = call(program, "eval", root / "nothing", "--ranks", 2, "--device", "cpu")
    check(done.returncode == 3 and errors(done.stderr) == 1 and "nothing" in done.stderr, done)
    done = call(program, "render", root / "nothing", "--ranks", 2, "--device", "cpu")
    check(done.returncode == 3 and errors(done.stderr) == 1 and "nothing" in done.stderr, done)
    data = pathlib.Path(os.environ.get("GSAPP_TEST_DATA", "")) / "tiny" / "lego"
    if not data.is_absolute() or not data.exists():
        print("SKIPPED: damaged images, which need GSAPP_TEST_DATA/tiny/lego")
        return
    scene = shutil.copytree(data, root / "scene")
    images = sorted((scene / "test").glob("*.png"))
    check(len(images) > 4, images)
    for image in images[3:]:  # the header stays, the pixels do not
        image.write_bytes(image.read_bytes()[:200])
    before = files_of(root / "run")
    done = call(program, "eval", root / "run", "-s", scene, "--ranks", 2, "--device", "cpu")
    check(done.returncode == 3 and done.stdout == "", done)
    check(errors(done.stderr) == 1 and ".png" in done.stderr, done.stderr)
    check(
        files_of(root / "run") == before and not (root / "run" / "on-scene").exists(), sorted((root / "run").rglob("*"))
    )


def main():
    program = os.path.abspath(sys.argv[1])
    with tempfile.TemporaryDirectory() as name:
        root = pathlib.Path(name)
        done = call(
            program,
            "train",
            "-s",
            "builtin:glossy",
            "-r",
            8,
            "--device",
            "cpu",
            "--iterations",
            40,
            "--cap-max",
            2000,
            "--eval",
            "-m",
            "run",
            cwd=root,
        )
        check(done.returncode == 0, done.stderr)
        bench(program)
        wrong_use(program, root)
        no_gpu(program, root)
        same_as_one(program, root)
        lost_rank(program, root)
        missing_file(program, root)
    print("passed")


if __name__ == "__main__":
    main()
