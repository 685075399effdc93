#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks every #include against the table of rooms in docs/architecture.md.

A room is a folder, or a single header of kernels/. A file may include its own room, the rooms in its row of the table,
and whatever those may include. Usage: check_rooms.py ROOT
"""
import re
import sys
from pathlib import Path

TABLE = "docs/architecture.md"
FOLDERS = ("appearance", "kernels", "lib", "eval", "apps")
SUFFIXES = (".h", ".cuh", ".cpp", ".cu")
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)
# | `room` | what it holds | `included room`, `included room` |
ROW = re.compile(r"^\|\s*`([^`]+)`\s*\|[^|]*\|([^|]*)\|\s*$", re.MULTILINE)


def read_rooms(root):
    """Maps each room to the set of rooms it may include, itself among them."""
    text = (root / TABLE).read_text(encoding="utf-8").split("<!-- rooms -->")[1].split("<!-- end of rooms -->")[0]
    direct = {name: re.findall(r"`([^`]+)`", includes) for name, includes in ROW.findall(text)}
    rooms = {}
    for name, includes in direct.items():
        unknown = [other for other in includes if other not in rooms]
        if unknown:
            raise SystemExit(f"{TABLE}: `{name}` includes {', '.join(unknown)}, which no row above it names")
        rooms[name] = {name}.union(*(rooms[other] for other in includes))
    return rooms


def room_of(path, rooms):
    """The room of a path relative to the root: the longest entry of the table that holds it, or None."""
    parts = path.split("/")
    for k in range(len(parts), 0, -1):
        if "/".join(parts[:k]) in rooms:
            return "/".join(parts[:k])
    return None


def find_faults(root):
    """Returns one line for every include against the direction, and for every file or room without a row."""
    rooms = read_rooms(root)
    faults, used = [], set()
    for file in sorted(p for folder in FOLDERS for p in (root / folder).rglob("*") if p.suffix in SUFFIXES):
        name = file.relative_to(root).as_posix()
        if "/node_modules/" in name:
            continue
        room = room_of(name, rooms)
        if room is None:
            faults.append(f"{name}: its folder has no row in {TABLE}")
            continue
        used.add(room)
        if name.endswith("_test.cpp"):
            continue  # a model's own test stays in its folder and includes what tests include
        for included in INCLUDE.findall(file.read_text(encoding="utf-8")):
            if not (root / included).exists():
                continue  # generated
            target = room_of(included, rooms)
            if target is None:
                faults.append(f"{name}: includes {included}, whose folder has no row in {TABLE}")
            elif target not in rooms[room]:
                faults.append(f"{name}: includes {included}; {room} may not include {target}")
    faults += [f"{TABLE}: room `{room}` holds no source file" for room in sorted(set(rooms) - used)]
    return faults


if __name__ == "__main__":
    found = find_faults(Path(sys.argv[1]))
    print("\n".join(found) if found else "every include follows the table of rooms")
    sys.exit(1 if found else 0)
