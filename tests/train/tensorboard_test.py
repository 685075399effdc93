#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads the event files of gsapp train --tensorboard back: with an own reader, and with TensorBoard's where it is
installed.

Usage: tensorboard_test.py GSAPP LIBRARY, the library of tests/faults/failing_writes.cpp."""

import errno
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile

GSAPP, LIBRARY = sys.argv[1:]
TRAIN = ["train", "-s", "builtin:glossy", "--eval", "-r", "8", "--device", "cpu", "--cap-max", "5000"]


def crc32c(data):
    """Bit by bit, unlike the program."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def masked(data):
    crc = crc32c(data)
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF


def records(path):
    data = path.read_bytes()
    while data:
        length, check = struct.unpack("<QI", data[:12])
        assert masked(data[:8]) == check, "checksum of a length"
        body, (check,) = data[12 : 12 + length], struct.unpack("<I", data[12 + length : 16 + length])
        assert len(body) == length and masked(body) == check, "checksum of a record"
        yield body
        data = data[16 + length :]


def varint(data, at):
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        shift, at = shift + 7, at + 1
        if data[at - 1] < 128:
            return value, at


def fields(data):
    """The fields of a protocol buffer as {number: [values]}."""
    out, at = {}, 0
    while at < len(data):
        key, at = varint(data, at)
        if key & 7 == 0:
            value, at = varint(data, at)
        elif key & 7 == 1:
            (value,), at = struct.unpack_from("<d", data, at), at + 8
        elif key & 7 == 5:
            (value,), at = struct.unpack_from("<f", data, at), at + 4
        else:
            assert key & 7 == 2, f"wire type {key & 7}"
            size, at = varint(data, at)
            value, at = data[at : at + size], at + size
            assert len(value) == size
        out.setdefault(key >> 3, []).append(value)
    return out


def read(path):
    """Returns the scalars {tag: {step: value}}, pictures {tag: {step: (width, height, bytes)}}, and steps of
    restarts."""
    scalars, pictures, restarts = {}, {}, []
    for index, record in enumerate(records(path)):
        event = fields(record)
        assert 1.6e9 < event[1][0] < 1e11, "wall time"
        if index == 0:
            assert event[3] == [b"brain.Event:2"], event
            continue
        step = event[2][0]
        if 7 in event:
            assert fields(event[7][0]) == {1: [1]}, event
            restarts.append(step)
        for value in fields(event[5][0])[1] if 5 in event else []:
            value = fields(value)
            tag = value[1][0].decode()
            if 2 in value:
                scalars.setdefault(tag, {})[step] = value[2][0]
            else:
                image = fields(value[4][0])
                assert image[3] == [3]
                pictures.setdefault(tag, {})[step] = (image[2][0], image[1][0], image[4][0])
    return scalars, pictures, restarts


def train(folder, *arguments, **environment):
    return subprocess.run(
        [GSAPP, *TRAIN, *arguments], cwd=folder, capture_output=True, text=True, env={**os.environ, **environment}
    )


def event_files(folder):
    return sorted(folder.glob("events.out.tfevents.*"))


def check_course(folder):
    """A run, and the part that follows a resume."""
    board = folder / "board"
    result = train(
        folder,
        "-m",
        "run",
        "--iterations",
        "250",
        "--test-iterations",
        "100",
        "--checkpoint-iterations",
        "200",
        "--tensorboard",
        "board",
        "--appearance",
        "sv",
    )
    assert result.returncode == 0, result.stderr
    model = (folder / "run/point_cloud/iteration_250/point_cloud.ply").read_bytes()
    (first,) = event_files(board)
    scalars, pictures, restarts = read(first)
    lines = [json.loads(line) for line in (folder / "run/stats/train.jsonl").read_text().splitlines()]
    for event, field, tag in [
        ("step", "loss", "train/loss"),
        ("step", "num_gaussians", "model/num_gaussians"),
        ("evaluation", "psnr", "test/psnr"),
        ("evaluation", "ssim", "test/ssim"),
    ]:
        expected = {line["iteration"]: line[field] for line in lines if line["event"] == event}
        assert expected.keys() == scalars[tag].keys() and len(expected) >= 2, (tag, scalars[tag], expected)
        for step, value in expected.items():
            assert abs(scalars[tag][step] - value) <= 1e-6 * abs(value), (tag, step)
    assert set(scalars["rates/means"]) == {100, 200, 250}
    assert scalars["rates/means"][250] < scalars["rates/means"][100], "the rate of the means falls"
    assert abs(scalars["rates/raw_scales"][100] - 0.005) < 1e-6
    assert 0 < scalars["rates/residuals"][250] < 1
    assert set(pictures["preview"]) == {100, 250} and not restarts
    width, height, jpeg = pictures["preview"][250]
    assert (width, height) == (20, 15) and jpeg[:3] == b"\xff\xd8\xff" and jpeg[-2:] == b"\xff\xd9"
    assert jpeg != pictures["preview"][100][2]

    # The folder is in config.yaml, so that a resumed run continues in it, and says what it does anew.
    result = train(
        folder,
        "-m",
        "run",
        "--resume",
        str(folder / "run/checkpoints/iteration_200.safetensors"),
        "--iterations",
        "300",
        "--overwrite",
    )
    assert result.returncode == 0, result.stderr
    again, second = event_files(board)
    assert again == first, "an earlier part sorts before"
    scalars, pictures, restarts = read(second)
    assert restarts == [201] and set(scalars["train/loss"]) == {300}, (restarts, scalars)
    assert set(pictures["preview"]) == {300}
    # It changes nothing of the model.
    result = train(folder, "-m", "plain", "--iterations", "250", "--appearance", "sv")
    assert result.returncode == 0, result.stderr
    plain = (folder / "plain/point_cloud/iteration_250/point_cloud.ply").read_bytes()
    assert plain == model, "the point clouds differ"
    return board


def check_refusals(folder):
    """What cannot be written is found before anything is trained, and leaves nothing."""
    (folder / "file").write_text("")
    result = train(folder, "-m", "none", "--iterations", "5", "--tensorboard", "file/board")
    assert result.returncode == 3 and "file/board" in result.stderr, result
    assert not (folder / "none").exists()
    # A run that does not begin leaves no event file either.
    (folder / "taken").mkdir()
    (folder / "taken/config.yaml").write_text("seed: 1\n")
    result = train(folder, "-m", "taken", "--iterations", "5", "--tensorboard", "unused")
    assert result.returncode == 2 and "--overwrite" in result.stderr, result
    assert not (folder / "unused").exists()


def check_full_disk(folder):
    """The disk of the event file is full after its second record: one warning, and the training goes on."""
    board = folder / "small"
    board.mkdir()
    failing = dict(
        LD_PRELOAD=LIBRARY,
        GSAPP_FAULT_ROOT=str(board),
        GSAPP_FAULT_KEEP="1",
        GSAPP_FAULT_ERROR=str(errno.ENOSPC),
        ASAN_OPTIONS="verify_asan_link_order=0:" + os.environ.get("ASAN_OPTIONS", ""),
    )
    arguments = ["-m", "small-run", "--iterations", "200", "--appearance", "none", "--tensorboard", str(board)]
    calls = folder / "calls"
    assert train(folder, *arguments, **failing, GSAPP_FAULT_AT="0", GSAPP_FAULT_REPORT=str(calls)).returncode == 0
    kinds = [line.split()[1] for line in calls.read_text().splitlines()]
    writes = [number for number, kind in enumerate(kinds, 1) if kind == "write"]
    assert len(writes) >= 5, kinds
    for path in event_files(board):
        path.unlink()
    result = train(folder, *arguments, "--overwrite", **failing, GSAPP_FAULT_AT=str(writes[2]))
    assert result.returncode == 0, result.stderr
    assert result.stderr.count("warning") == 1 and "No space left on device" in result.stderr, result.stderr
    (file,) = event_files(board)
    assert sum(1 for _ in records(file)) == 2
    # Where not even the first record can be written, nothing is trained.
    result = train(folder, *arguments, "--overwrite", **failing, GSAPP_FAULT_AT=str(writes[0]))
    assert result.returncode == 3 and "tfevents" in result.stderr, result
    assert len(event_files(board)) == 1 and (folder / "small-run/point_cloud/iteration_200").exists()


def check_runs(folder):
    """Each of several runs has a folder of its own, which TensorBoard shows as a run."""
    result = train(
        folder,
        "-m",
        "seeds/s",
        "--runs",
        "2",
        "--iterations",
        "5",
        "--quiet",
        "--appearance",
        "none",
        "--tensorboard",
        "several",
    )
    assert result.returncode == 0, result.stderr
    assert sorted(path.name for path in (folder / "several").iterdir()) == ["s-0", "s-1"]
    for path in (folder / "several").iterdir():
        assert 5 in read(event_files(path)[0])[0]["test/psnr"]


def check_with_tensorboard(board):
    try:
        from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    except ImportError:
        print("tensorboard is not installed: its own reader is left out")
        return
    accumulator = EventAccumulator(str(board)).Reload()
    assert [event.step for event in accumulator.Scalars("train/loss")] == [100, 200, 300], "what was done anew is gone"
    assert accumulator.Images("preview")[-1].width == 20


assert crc32c(b"123456789") == 0xE3069283
with tempfile.TemporaryDirectory(prefix="gsapp-test-") as name:
    check_with_tensorboard(check_course(pathlib.Path(name)))
    check_refusals(pathlib.Path(name))
    check_full_disk(pathlib.Path(name))
    check_runs(pathlib.Path(name))
print("ok")
