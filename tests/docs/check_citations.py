# SPDX-License-Identifier: Apache-2.0
"""Finds citations of documents and links between them that lead nowhere.

  - a source file or page that cites a specification outside of the repository
  - `docs/<page>.md`, or `docs/<page>.md#<anchor>`, without such a page or anchor
  - a relative link of a page without such a file or anchor
  - a C++ or CUDA file that a page or a comment names and that is not there; notes of experiments may name what is gone

Anchors are those of headings, as GitHub makes them, and of `<a id="...">`.
Usage: check_citations.py SOURCE_FOLDER, or --self-test. Exit code 1 and a line for each fault if there are any."""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import urllib.parse

SOURCES = {".h", ".cuh", ".cpp", ".cu", ".glsl", ".ts", ".md"}
NOT_OURS = {"build", "node_modules", "dist"}  # only where git does not say what is

OUTSIDE = re.compile(
    r"\bspec(?:ification)?s?\s+(?:section|§|\d)|\bspec/"
    r"|\b(?:appearance|rasterizer|optimization|densification|ppisp|viewer|data[- ]formats) spec(?:ification)?\b"
    r"|\bof the spec(?:ification)?\b",
    re.IGNORECASE,
)
# One anchor or several: docs/page.md#one, #two.
CITATION = re.compile(r"(?<![\w/.-])(docs/[\w./-]+\.md)((?:#[\w-]+(?:, #[\w-]+)*)?)")
# A C++ or CUDA file of the project: its path, or the end of it. Names that begin with _ are endings.
NAMED_SOURCE = re.compile(r"(?<![\w/.<>*-])((?:[\w-]+/)*[A-Za-z][\w-]*\.(?:cuh|cpp|cu|h))\b")
COMMENT = re.compile(r"//.*")
OF_OTHERS = {"nccl.h"}
HISTORY = ("docs/lab/", "CHANGELOG.md")
FENCE = re.compile(r"^\s*(```|~~~)")
HEADING = re.compile(r"^#{1,6}\s+(.*?)\s*#*\s*$")
NAMED = re.compile(r"<a\s+(?:id|name)=[\"']([^\"']+)[\"']")
LINK = re.compile(
    r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(\s*<?([^)\s>]+)>?(?:\s+[\"'][^)]*)?\)|^\s*\[[^\]]+\]:\s+(\S+)"
    r"|(?:src|href)=[\"']([^\"']+)[\"']",
    re.MULTILINE,
)


def files_of(root):
    """Paths, relative to `root`, of what belongs to the project: what git knows or would take up."""
    listed = subprocess.run(["git", "-C", root, "ls-files", "-coz", "--exclude-standard"], capture_output=True)
    if listed.returncode == 0 and listed.stdout:
        return sorted({name for name in os.fsdecode(listed.stdout).split("\0") if name and (root / name).is_file()})
    found = []
    for folder, folders, names in os.walk(root):
        folders[:] = [f for f in folders if f not in NOT_OURS and not f.startswith(".")]
        found += [os.path.relpath(os.path.join(folder, name), root) for name in names]
    return sorted(found)


def without_code_blocks(text):
    """A page's lines, those of code blocks empty."""
    inside = False
    for line in text.splitlines():
        fence = FENCE.match(line)
        inside = inside != bool(fence)
        yield "" if fence or inside else line


def prose_of(text):
    """A page without code, line for line."""
    return re.sub(r"`[^`]*`", lambda code: "\n" * code[0].count("\n"), "\n".join(without_code_blocks(text)))


def slug(heading):
    """Anchor that GitHub gives a heading."""
    shown = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    return re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")


def anchors_of(text):
    anchors, seen = set(), {}
    for line in without_code_blocks(text):
        anchors.update(NAMED.findall(line))
        heading = HEADING.match(line)
        if heading:
            name = slug(heading[1])
            count = seen[name] = seen.get(name, -1) + 1
            anchors.add(f"{name}-{count}" if count else name)
    return anchors


class Checker:
    def __init__(self, root):
        self.root = pathlib.Path(root).resolve()
        self.anchors = {}
        self.faults = []

    def has_anchor(self, page, anchor):
        if page not in self.anchors:
            self.anchors[page] = anchors_of(page.read_text(encoding="utf-8"))
        return anchor in self.anchors[page]

    def check_target(self, where, page, anchor, cited):
        if not page.exists():
            self.faults.append(f"{where}: {cited}: no such file")
        elif anchor and page.suffix == ".md" and not self.has_anchor(page, anchor):
            self.faults.append(f"{where}: {cited}: no such anchor")

    def check_sources_named(self, name, lines):
        if name.startswith(HISTORY) or pathlib.PurePath(name).suffix in {".ts", ".glsl"}:
            return
        for number, line in enumerate(lines, 1):
            comment = COMMENT.search(line)
            text = line if name.endswith(".md") else comment[0] if comment else ""
            for match in NAMED_SOURCE.finditer(text):
                if match[1] not in self.endings | OF_OTHERS:
                    self.faults.append(f"{name}:{number}: {match[1]}: no such file")

    def check_file(self, name):
        path = self.root / name
        text = path.read_text(encoding="utf-8", errors="replace")
        lines = text.splitlines()
        for match in OUTSIDE.finditer(text):
            number = text.count("\n", 0, match.start()) + 1
            self.faults.append(f"{name}:{number}: cites a specification that is not here: {lines[number - 1].strip()}")
        for number, line in enumerate(lines, 1):
            for match in CITATION.finditer(line):
                for anchor in match[2].split(", "):
                    self.check_target(f"{name}:{number}", self.root / match[1], anchor[1:], match[1] + anchor)
        self.check_sources_named(name, lines)
        if path.suffix == ".md":
            prose = prose_of(text)
            for match in LINK.finditer(prose):  # may go over a line's end
                number = prose.count("\n", 0, match.start()) + 1
                self.check_link(f"{name}:{number}", path, match[1] or match[2] or match[3])

    def check_link(self, where, page, link):
        if re.match(r"[a-z][a-z0-9+.-]*:|//", link, re.IGNORECASE):  # another site
            return
        target, _, anchor = urllib.parse.unquote(link).partition("#")
        if target.startswith("/"):
            self.faults.append(f"{where}: {link}: not relative")
        else:
            self.check_target(where, page.parent / target if target else page, anchor, link)

    def run(self):
        known = files_of(self.root)
        self.endings = {name[at:] for name in known for at in [0] + [m.end() for m in re.finditer("/", name)]}
        names = [name for name in known if pathlib.PurePath(name).suffix in SOURCES]
        for name in names:
            self.check_file(name)
        return self.faults if names else [f"{self.root}: no sources and no pages"]


PAGE = """# The page
See [below](#two-words), [again](#two-words-1), [the other](other.md), [site](https://example.org/#x), `[not](a link)`.
## Two words
```
# no heading
[no link](nowhere.md)
```
## Two words
"""
GOOD = {
    "docs/page.md": PAGE,
    "docs/other.md": '<a id="mark"></a>\n[up](page.md#the-page) and [marked](#mark)\n',
    "kernels/a.h": "// Blending (docs/page.md#two-words). AppearanceSpec spec; docs/other.md\n",
}
# What is written over GOOD, and the only fault that is to be found then.
BAD = [
    ("kernels/a.h", "// One fragment (rasterizer spec sections 7 and 8).\n", "cites a specification"),
    ("kernels/a.h", "// SSIM (optimization spec\n// section 2).\n", "cites a specification"),
    ("kernels/a.cu", "// rates (spec 5)\n", "cites a specification"),
    ("tests/a.cpp", "/// Section 4 of the spec, word by word.\n", "cites a specification"),
    ("lib/a.cpp", "// ../shared/spec/appearance.md\n", "cites a specification"),
    ("apps/a.ts", "// docs/page.md#no-heading\n", "no such anchor"),
    ("apps/a.ts", "// docs/page.md#two-words, #three-words\n", "no such anchor"),
    ("appearance/a.glsl", "// docs/gone.md\n", "no such file"),
    ("docs/other.md", '<a id="mark"></a>\n[page](page.md#two-words-2)\n', "no such anchor"),
    ("docs/other.md", '<a id="mark"></a>\n[a\npage](page.md#page)\n', "no such anchor"),
    ("docs/other.md", '<a id="mark"></a>\n![picture](images/gone.png)\n', "no such file"),
    ("README.md", "[docs](/docs/page.md)\n", "not relative"),
    ("README.md", "`kernels/a.h` and `b.h`, `_cuda.cuh`\n", "b.h: no such file"),
    ("lib/a.cpp", "// kernels/a.h, lib/a.h\nint x;  // nccl.h\n", "lib/a.h: no such file"),
]


def faults_of(files):
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            path = pathlib.Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return Checker(folder).run()


def self_test():
    """Faults of this script itself, as run() lists those of documents."""
    wrong = [f"found where there is none: {fault}" for fault in faults_of(GOOD)]
    for name, text, expected in BAD:
        faults = faults_of({**GOOD, name: text})
        if len(faults) != 1 or expected not in faults[0] or not faults[0].startswith(name + ":"):
            wrong.append(f"{name} with {text!r}: expected '{expected}', found {faults}")
    return wrong


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    faults = self_test() if sys.argv[1] == "--self-test" else Checker(sys.argv[1]).run()
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
