# SPDX-License-Identifier: Apache-2.0
"""Short trainings of scenes in other units and places: scripts/lab/scale_table.py with what a test has time for."""
import os
import pathlib
import subprocess
import sys
import tempfile

source, program = pathlib.Path(sys.argv[1]), sys.argv[2]
data = pathlib.Path(os.environ.get("GSAPP_TEST_DATA", "")) / "tiny"
if not os.environ.get("GSAPP_TEST_DATA") or not data.is_dir():
    print("GSAPP_TEST_DATA names no folder with the scene 'tiny': skipped")
    sys.exit(77)
failed = 0
with tempfile.TemporaryDirectory() as folder:
    for scene, strategy in (("lego", "mcmc"), ("bonsai", "adc")):
        failed |= subprocess.run(
            [
                sys.executable,
                source / "scripts" / "lab" / "scale_table.py",
                program,
                data / scene,
                "-o",
                folder,
                "--strategies",
                strategy,
                "--scales",
                "1e-6",
                "1e3",
                "--iterations",
                "60",
                "--",
                "--device",
                "cpu",
                "--init-points",
                "500",
                "--cap-max",
                "1000",
            ]
        ).returncode
sys.exit(failed)
