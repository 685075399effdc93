# SPDX-License-Identifier: Apache-2.0
"""scripts/download against a server on this machine: archives with the right names and counts of files, but tiny ones.
Usage: download_test.py SOURCE_FOLDER [test...]"""

import hashlib
import http.server
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import unittest
import zipfile

SOURCE = pathlib.Path(sys.argv.pop(1)) if len(sys.argv) > 1 else pathlib.Path(__file__).parents[2]
ROWS = [line.split() for line in (SOURCE / "scripts/datasets.txt").read_text().splitlines()]
SCENES = [row[1:] for row in ROWS if row[:1] == ["scene"]]
ARCHIVES = [row[1] for row in ROWS if row[:1] == ["archive"]]
TANDT = "tandt_db.zip"
# Thousands of tiny files: in memory where that is possible.
ROOM = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def write_archive(path, scenes, leave_out=()):
    """The scenes' files, of a few bytes each, and files that archives hold besides; without those in `leave_out`."""
    with zipfile.ZipFile(path, "w") as archive:

        def add(name, text):
            if name not in leave_out and not any(name.startswith(folder + "/") for folder in leave_out):
                archive.writestr(name, text)

        add("__MACOSX/._README.txt", "not of interest")
        for target, _, inside, *contents in scenes:
            for entry in contents:
                folder, count = entry.split("=")
                for i in range(int(count)):
                    add(f"{inside}/{folder}/r_{i}.png", f"{target} {i}")
                if folder == "test":
                    add(f"{inside}/test/r_0_depth_0001.png", "no view")
                if not folder.startswith("images"):
                    add(f"{inside}/transforms_{folder}.json", "{}")
            if contents[0].startswith("images"):
                for name in ("cameras", "images", "points3D"):
                    add(f"{inside}/sparse/0/{name}.bin", "model")


class Handler(http.server.BaseHTTPRequestHandler):
    """Files of `root`, with byte ranges. `break_after`: the next answer ends after so many bytes."""

    root, ranges, break_after, requests = None, True, None, []

    def do_GET(self):
        file = pathlib.Path(self.root, self.path.lstrip("/"))
        if not file.is_file():
            self.send_error(404)
            return
        data = file.read_bytes()
        cls, asked = type(self), re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", ""))
        begin = int(asked[1]) if asked and cls.ranges else 0
        cls.requests.append((self.path, begin))
        if begin and begin >= len(data):
            self.send_response(416)
            self.send_header("Content-Range", f"bytes */{len(data)}")
            self.end_headers()
            return
        self.send_response(206 if begin else 200)
        self.send_header("Content-Length", str(len(data) - begin))
        if begin:
            self.send_header("Content-Range", f"bytes {begin}-{len(data) - 1}/{len(data)}")
        self.end_headers()
        end, cls.break_after = (len(data) if cls.break_after is None else cls.break_after), None
        self.wfile.write(data[begin:end])

    def log_message(self, *_):
        pass


class Download(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.fixture = tempfile.TemporaryDirectory(prefix="gsapp-test-", dir=ROOM)
        for name in ARCHIVES:
            write_archive(pathlib.Path(cls.fixture.name, name), [s for s in SCENES if s[1] == name])
        cls.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=cls.server.serve_forever, daemon=True).start()

    @classmethod
    def tearDownClass(cls):
        cls.server.shutdown()
        cls.server.server_close()
        cls.fixture.cleanup()

    def setUp(self):
        work = tempfile.TemporaryDirectory(prefix="gsapp-test-", dir=ROOM)
        self.addCleanup(work.cleanup)
        # A blank in the path: quoting is easily forgotten.
        self.data = pathlib.Path(work.name, "my data")
        self.served = pathlib.Path(work.name, "served")
        self.served.mkdir()
        for name in ARCHIVES:
            shutil.copy(pathlib.Path(self.fixture.name, name), self.served)
        Handler.root, Handler.ranges, Handler.break_after, Handler.requests = self.served, True, None, []
        self.write_sums()

    def write_sums(self):
        lines = [f"{hashlib.sha256((self.served / n).read_bytes()).hexdigest()}  {n}\n" for n in ARCHIVES]
        self.sums = self.served / "sums"
        self.sums.write_text("".join(lines))

    def run_script(self, *arguments, sums=True):
        command = [SOURCE / "scripts/download", *arguments, self.data]
        if sums:
            command[1:1] = ["--checksums", self.sums]
        url = f"http://127.0.0.1:{self.server.server_port}"
        done = subprocess.run(
            command,
            env={**os.environ, "GSAPP_DATA_URL": url, "no_proxy": "*"},
            capture_output=True,
            text=True,
            timeout=60,
        )
        self.output = done.stdout + done.stderr
        return done.returncode

    def images(self, scene, folder="images"):
        return len(list((self.data / scene / folder).glob("r_*.png")))

    def assert_only_left(self, *names):
        """What lies in the data folder; an archive or a temporary folder there would be a leftover."""
        self.assertEqual(sorted(p.name for p in self.data.iterdir()), sorted(names), self.output)

    def test_brings_all_scenes_and_does_nothing_the_second_time(self):
        self.assertEqual(self.run_script("all"), 0, self.output)
        self.assertEqual(sorted(path for path, _ in Handler.requests), sorted("/" + name for name in ARCHIVES))
        self.assert_only_left("mipnerf360", "tanksandtemples", "deepblending", "nerf-synthetic", "SHA256SUMS")
        found = {str(p.relative_to(self.data)) for p in self.data.glob("*/*")}
        self.assertEqual(found, {scene[0] for scene in SCENES})
        self.assertEqual(len(found), 21)
        self.assertEqual(self.images("mipnerf360/bonsai", "images_2"), 292)
        self.assertEqual(self.images("deepblending/playroom"), 225)
        self.assertTrue((self.data / "nerf-synthetic/lego/transforms_test.json").is_file())
        self.assertEqual(sorted((self.data / "SHA256SUMS").read_text().split()), sorted(self.sums.read_text().split()))

        Handler.requests.clear()
        self.assertEqual(self.run_script("all"), 0, self.output)
        self.assertEqual(Handler.requests, [])
        self.assertEqual(self.run_script("--check", "all"), 0, self.output)

    def test_names_the_same_scenes_as_the_option_files(self):
        files = {str(p.relative_to(SOURCE / "scenes").with_suffix("")) for p in (SOURCE / "scenes").glob("*/*.yaml")}
        files = {name for name in files if not name.startswith("procedural/") and not name.endswith("/base")}
        self.assertEqual({scene[0] for scene in SCENES}, files)

    def test_a_broken_connection_is_continued(self):
        Handler.break_after = 50000
        self.assertEqual(self.run_script("tanksandtemples"), 0, self.output)
        self.assertEqual(Handler.requests, [("/" + TANDT, 0), ("/" + TANDT, 50000)])

    def test_an_interrupted_download_is_continued(self):
        self.data.mkdir()
        whole = (self.served / TANDT).read_bytes()
        for part, begin in ((whole[:30000], 30000), (whole, len(whole))):
            Handler.requests.clear()
            (self.data / (TANDT + ".part")).write_bytes(part)
            self.assertEqual(self.run_script("deepblending"), 0, self.output)
            self.assertEqual(Handler.requests, [("/" + TANDT, begin)])
            self.assertEqual(self.images("deepblending/drjohnson"), 263)
            shutil.rmtree(self.data / "deepblending")

    def test_without_ranges_it_starts_again(self):
        Handler.ranges = False
        self.data.mkdir()
        (self.data / (TANDT + ".part")).write_bytes(b"old")
        self.assertEqual(self.run_script("tanksandtemples"), 0, self.output)
        self.assertEqual(self.images("tanksandtemples/train"), 301)

    def test_an_archive_put_into_the_folder_is_taken(self):
        self.data.mkdir()
        shutil.copy(self.served / TANDT, self.data)
        self.assertEqual(self.run_script("tanksandtemples"), 0, self.output)
        self.assertEqual(Handler.requests, [])

    def test_a_wrong_checksum_is_refused(self):
        self.sums.write_text(f"{'0' * 64}  {TANDT}\n")
        self.assertEqual(self.run_script("tanksandtemples"), 1)
        self.assertIn("sha256 sum is", self.output)
        self.assertIn("0" * 64, self.output)
        self.assert_only_left(TANDT + ".bad")

    def test_a_truncated_archive_is_refused_by_its_size(self):
        self.assertEqual(self.run_script("tanksandtemples", sums=False), 1)
        self.assertRegex(self.output, r"tandt_db\.zip has \d+ bytes, not 682628995")
        self.assert_only_left(TANDT + ".bad")

    def test_a_file_of_the_table_without_a_sum_is_tested_as_an_archive(self):
        # The table knows the size of this one, so that a sparse file of that size comes as far as the archive's own
        # sums.
        self.data.mkdir()
        archive = self.data / "360_extra_scenes.zip"
        archive.touch()
        os.truncate(archive, 4488140217)
        (self.served / archive.name).unlink()
        (self.served / archive.name).write_bytes(b"<html>quota exceeded</html>")
        self.sums.write_text("")
        self.assertEqual(self.run_script("mipnerf360"), 1)
        self.assertIn("360_extra_scenes.zip is not an intact zip archive", self.output)

    def test_a_corrupted_archive_is_refused(self):
        data = bytearray((self.served / TANDT).read_bytes())
        at = data.index(b"tanksandtemples/train 7")
        data[at] ^= 1
        (self.served / TANDT).write_bytes(data)
        self.write_sums()
        self.assertEqual(self.run_script("tanksandtemples"), 1)
        self.assertIn("unzip", self.output)
        self.assertFalse((self.data / "tanksandtemples/train").exists(), "half a scene")

    def test_missing_scenes_and_images_are_refused(self):
        scenes = [s for s in SCENES if s[1] == TANDT]
        for gone, message in (
            ("db/playroom", "has no folder db/playroom"),
            ("db/playroom/images/r_3.png", "db/playroom/images holds 224 images, not 225"),
            ("db/playroom/sparse/0/points3D.bin", "db/playroom/sparse/0/points3D.bin is missing or empty"),
        ):
            with self.subTest(gone):
                write_archive(self.served / TANDT, scenes, leave_out=(gone,))
                self.write_sums()
                self.assertEqual(self.run_script("deepblending"), 1)
                self.assertIn(message, self.output)
                self.assertFalse((self.data / "deepblending/playroom").exists())
                self.assert_only_left("deepblending", "tanksandtemples", "SHA256SUMS", TANDT + ".bad")

    def test_an_incomplete_scene_of_the_user_is_left_alone(self):
        own = self.data / "tanksandtemples/truck/images/mine.png"
        own.parent.mkdir(parents=True)
        own.write_text("mine")
        self.assertEqual(self.run_script("tanksandtemples"), 1)
        self.assertIn("exists but is not complete", self.output)
        self.assertEqual(Handler.requests, [])
        self.assertTrue(own.exists())
        self.assertEqual(self.run_script("--check", "tanksandtemples"), 1)
        self.assertIn("truck/images holds 1 images, not 251", self.output)

    def test_an_unknown_file_says_where_it_was_looked_for(self):
        (self.served / TANDT).rename(self.served / "other.zip")
        self.assertEqual(self.run_script("tanksandtemples"), 1)
        self.assertIn(f"/{TANDT}: curl failed with status", self.output)
        self.assertIn(f"put it into {self.data}", self.output)

    def test_usage(self):
        self.assertEqual(self.run_script("mipnerf"), 2)
        self.assertIn("mipnerf360 tanksandtemples deepblending nerf-synthetic", self.output)
        self.assertEqual(self.run_script("--fast", "all"), 2)


if __name__ == "__main__":
    for program in ("bash", "curl", "unzip"):
        if not shutil.which(program):
            print(f"skipped: {program} is not installed")
            sys.exit(77)
    unittest.main()
