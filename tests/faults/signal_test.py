# SPDX-License-Identifier: Apache-2.0
"""Signals, two runs in one folder, and files and folders that vanish under a training.

Usage: signal_test.py GSAPP [test...]"""

import json
import os
import pathlib
import resource
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

GSAPP = str(pathlib.Path(sys.argv.pop(1)).resolve()) if len(sys.argv) > 1 else "gsapp"
SIZE = 32


def write_png(path, shade):
    rows = b"".join(
        b"\0" + bytes((7 * x + shade) % 256 if c else (5 * y + shade) % 256 for x in range(SIZE) for c in range(3))
        for y in range(SIZE)
    )

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", SIZE, SIZE, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def write_scene(folder):
    """Eight training and two test images of cameras in a row."""
    for split, count in (("train", 8), ("test", 2)):
        (folder / split).mkdir(parents=True)
        frames = []
        for i in range(count):
            write_png(folder / split / f"r_{i}.png", 20 * i)
            frames.append(
                {
                    "file_path": f"./{split}/r_{i}",
                    "transform_matrix": [[1, 0, 0, 0.1 * i], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]],
                }
            )
        (folder / f"transforms_{split}.json").write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))


class Signals(unittest.TestCase):
    expected = None

    def setUp(self):
        work = tempfile.TemporaryDirectory(prefix="gsapp-test-")
        self.addCleanup(work.cleanup)
        self.folder = pathlib.Path(work.name)
        self.scene, self.run_folder = self.folder / "scene", self.folder / "run"
        write_scene(self.scene)

    def arguments(self, *more, run=None, iterations=100):
        return [
            GSAPP,
            "train",
            "-s",
            str(self.scene),
            "-m",
            str(run or self.run_folder),
            "--device",
            "cpu",
            "--eval",
            "--init-points",
            "300",
            "--cap-max",
            "300",
            "--checkpoint-iterations",
            "20",
            "--iterations",
            str(iterations),
            *more,
        ]

    def start(self, arguments, **options):
        process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)
        self.addCleanup(lambda: (process.kill(), process.communicate()))
        return process

    def finish(self, process):
        self.output, self.messages = process.communicate(timeout=60)
        return process.returncode

    def run_to_end(self, arguments):
        return self.finish(self.start(arguments))

    def stop_after_first_checkpoint(self, arguments, **options):
        """Starts a training and halts the process while it trains."""
        process = self.start(arguments, **options)
        saved = self.run_folder / "checkpoints/iteration_20.safetensors"
        for _ in range(3000):
            if saved.exists() or process.poll() is not None:
                break
            time.sleep(0.01)
        process.send_signal(signal.SIGSTOP)
        self.assertTrue(saved.exists(), "the training has not begun")
        return process

    def point_cloud(self, run=None, iterations=100):
        return ((run or self.run_folder) / f"point_cloud/iteration_{iterations}/point_cloud.ply").read_bytes()

    def uninterrupted(self):
        """The point cloud of a training that nothing happened to."""
        if Signals.expected is None:
            run = self.folder / "whole"
            self.assertEqual(self.run_to_end(self.arguments(run=run)), 0, self.messages)
            Signals.expected = self.point_cloud(run)
        return Signals.expected

    def resume(self, *more):
        self.assertEqual(
            self.run_to_end([GSAPP, "train", "-m", str(self.run_folder), "--resume", "latest", *more]), 0, self.messages
        )

    def test_signals_that_ask_to_end_leave_a_checkpoint(self):
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            with self.subTest(number):
                shutil.rmtree(self.run_folder, ignore_errors=True)
                default = lambda: signal.signal(number, signal.SIG_DFL)  # whatever this test was started with
                process = self.stop_after_first_checkpoint(self.arguments(iterations=1000000), preexec_fn=default)
                process.send_signal(number)
                process.send_signal(signal.SIGCONT)
                self.assertEqual(self.finish(process), 130, self.messages)
                self.assertIn("continue with --resume latest", self.messages)
                last = max(int(p.stem.split("_")[1]) for p in (self.run_folder / "checkpoints").iterdir())
                self.assertGreater(last, 20)
                self.resume("--iterations", str(last + 1))

    def test_under_nohup_a_closed_terminal_ends_nothing(self):
        process = self.stop_after_first_checkpoint(
            self.arguments(), preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)
        )
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGCONT)
        self.assertEqual(self.finish(process), 0, self.messages)

    def test_a_closed_pipe_does_not_end_it_without_a_word(self):
        process = self.stop_after_first_checkpoint(self.arguments(), restore_signals=True)
        process.stdout.close()
        process.send_signal(signal.SIGCONT)
        messages = process.stderr.read()
        # The error of stdout itself is another test's.
        self.assertIn(process.wait(60), (0, 3), messages)

    def test_the_limit_of_file_sizes_is_an_error_with_its_reason(self):
        limit = 100000
        process = self.start(
            self.arguments(), preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
        )
        self.assertEqual(self.finish(process), 3, self.messages)
        self.assertIn("iteration_20.safetensors", self.messages)
        self.assertIn("File too large", self.messages)
        self.assertFalse(any((self.run_folder / "checkpoints").iterdir()))

    def test_a_second_run_in_the_folder_is_refused(self):
        expected = self.uninterrupted()
        first = self.stop_after_first_checkpoint(self.arguments())
        for more in ((), ("--overwrite",), ("--resume", "latest")):
            self.assertEqual(self.run_to_end(self.arguments(*more)), 2, self.messages)
            self.assertIn(str(self.run_folder), self.messages)
            self.assertIn(f"process {first.pid}", self.messages)
        first.send_signal(signal.SIGCONT)
        self.assertEqual(self.finish(first), 0, self.messages)
        self.assertEqual(self.point_cloud(), expected)
        self.assertEqual([p.name for p in self.run_folder.iterdir() if "lock" in p.name], [])

    def test_a_killed_run_leaves_no_lock_behind(self):
        expected = self.uninterrupted()
        process = self.stop_after_first_checkpoint(self.arguments())
        process.kill()
        self.finish(process)
        self.resume()
        self.assertEqual(self.point_cloud(), expected)

    def test_images_that_are_in_memory_may_vanish(self):
        expected = self.uninterrupted()
        process = self.stop_after_first_checkpoint(self.arguments())
        shutil.rmtree(self.scene)
        process.send_signal(signal.SIGCONT)
        self.assertEqual(self.finish(process), 0, self.messages)
        self.assertEqual(self.point_cloud(), expected)
        self.assertIn(
            "ours_100", json.loads((self.run_folder / "results.json").read_text()), "test images were decoded, too"
        )

    def test_images_that_vanish_leave_a_checkpoint_that_resumes(self):
        expected = self.uninterrupted()
        for fault in ("removed", "damaged", "of another size"):
            with self.subTest(fault):
                shutil.rmtree(self.run_folder, ignore_errors=True)
                process = self.stop_after_first_checkpoint(self.arguments("--image-cache", "0"))
                aside = self.folder / "aside"
                (self.scene / "train").rename(aside)
                if fault != "removed":
                    shutil.copytree(aside, self.scene / "train")
                    for image in (self.scene / "train").iterdir():
                        data = image.read_bytes()
                        image.write_bytes(
                            data[: len(data) // 2]
                            if fault == "damaged"
                            else data[:16] + struct.pack(">II", 16, 16) + data[24:]
                        )
                process.send_signal(signal.SIGCONT)
                self.assertEqual(self.finish(process), 3, self.messages)
                self.assertIn("scene/train/r_", self.messages)
                self.assertIn("checkpoint written to", self.messages)
                shutil.rmtree(self.scene / "train", ignore_errors=True)
                aside.rename(self.scene / "train")
                self.resume()
                self.assertEqual(self.point_cloud(), expected)

    def test_a_truncated_test_image_is_found_before_the_training(self):
        image = self.scene / "test/r_1.png"
        os.truncate(image, image.stat().st_size // 2)
        self.assertEqual(self.run_to_end(self.arguments()), 3)
        self.assertIn(str(image), self.messages)
        self.assertFalse(self.run_folder.exists())
        self.assertEqual(self.run_to_end(self.arguments("--verify-images", "off")), 3)
        self.assertIn("the training itself is saved", self.messages)
        self.assertIn(str(image), self.messages)

    def test_a_folder_that_is_removed_ends_the_run(self):
        process = self.stop_after_first_checkpoint(self.arguments(iterations=1000000))
        shutil.rmtree(self.run_folder)
        process.send_signal(signal.SIGCONT)
        self.assertEqual(self.finish(process), 3, self.messages)
        self.assertIn(f"'{self.run_folder}' was removed or replaced", self.messages)
        self.assertFalse(self.run_folder.exists())


if __name__ == "__main__":
    unittest.main()
