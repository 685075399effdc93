#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Shows that check_rooms.py finds what it is for, on small trees of its own."""
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from check_rooms import find_faults  # noqa: E402

TABLE = """<!-- rooms -->
| room | holds | includes |
|---|---|---|
| `kernels/base` | scalars | |
| `kernels/sort` | a stage | `kernels/base` |
| `kernels/blend` | a stage | `kernels/base` |
| `kernels/backend.h` | the interface | `kernels/base` |
| `lib/train` | the loop | `kernels/backend.h` |
<!-- end of rooms -->
"""


class CheckRooms(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = Path(self.folder.name)
        self.write("docs/architecture.md", TABLE)
        self.write("kernels/base/vec.h", "")
        self.write("kernels/sort/sort.h", '#include "kernels/base/vec.h"\n')
        self.write("kernels/blend/blend.h", '#include "kernels/base/vec.h"\n')
        self.write("kernels/backend.h", "")
        self.write("lib/train/trainer.h", '#include "kernels/backend.h"\n#include "kernels/base/vec.h"\n')

    def tearDown(self):
        self.folder.cleanup()

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def test_accepts_the_direction(self):
        self.assertEqual(find_faults(self.root), [])

    def test_finds_a_stage_that_includes_another(self):
        self.write("kernels/blend/blend.h", '#include "kernels/sort/sort.h"\n')
        self.assertIn("kernels/blend may not include kernels/sort", "".join(find_faults(self.root)))

    def test_finds_an_include_upwards(self):
        self.write("kernels/base/vec.h", '#include "lib/train/trainer.h"\n')
        self.assertIn("kernels/base may not include lib/train", "".join(find_faults(self.root)))

    def test_finds_a_folder_without_a_row(self):
        self.write("lib/new/thing.h", "")
        self.assertIn("lib/new/thing.h: its folder has no row", "".join(find_faults(self.root)))

    def test_finds_a_row_without_files(self):
        (self.root / "kernels/sort/sort.h").unlink()
        self.assertIn("`kernels/sort` holds no source file", "".join(find_faults(self.root)))


if __name__ == "__main__":
    unittest.main()
