#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Completes command lines in bash, and in zsh and fish where they are installed. Exit status 77: no bash.

usage: completions_test.py GSAPP
"""
import pathlib
import shutil
import subprocess
import sys
import tempfile

# (words typed, words that must be offered, words that must not)
CASES = [
    (["tr"], {"train", "tradeoff"}, {"eval"}),
    (["--ver"], {"--version"}, {"--iterations"}),
    (["train", "--it"], {"--iterations"}, {"--iteration", "--version"}),
    (["train", "--strategy", ""], {"mcmc", "adc", "none"}, {"a scene"}),
    (["export", "--format", "p"], {"ply"}, {"web", "splat"}),
    (["bench", "fr"], {"frames"}, {"precision"}),
    (["bench", "frames", "--appearan"], {"--appearances"}, {"--views"}),
    (["train", "-s", "a"], {"a scene"}, {"train"}),
    (["view", "a"], {"a scene"}, {"eval"}),
    (["train", "--iterations", ""], set(), {"a scene", "train"}),
]


def output(*command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=60, **options)
    assert (
        done.returncode == 0 and not done.stderr
    ), f"{command[0]}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout


def check(shell, words, offered, wanted, unwanted):
    assert wanted <= offered, f"{shell}: {words} offers {sorted(offered)}, without {sorted(wanted - offered)}"
    assert not unwanted & offered, f"{shell}: {words} also offers {sorted(unwanted & offered)}"


def test_bash(file, folder):
    output("bash", "-n", file)
    # The last case is as readline gives it: --format=w is three words.
    for words, wanted, unwanted in CASES + [
        (["export", "--format", "=", "w"], {"web"}, {"ply"}),
        (["export", "--format", "="], {"web", "ply"}, {"="}),
    ]:
        script = 'source "$1"; shift; COMP_WORDS=(gsapp "$@"); COMP_CWORD=$#; _gsapp; printf "%s\\n" "${COMPREPLY[@]}"'
        offered = set(output("bash", "--norc", "-c", script, "bash", file, *words, cwd=folder).splitlines())
        check("bash", words, offered, wanted, unwanted)


def test_fish(file, folder):
    output("fish", "--no-execute", file)
    for words, wanted, unwanted in CASES:
        line = " ".join(["gsapp", *words])
        lines = output(
            "fish", "--no-config", "-c", "source $argv[1]; complete -C $argv[2]", file, line, cwd=folder
        ).splitlines()
        offered = {one.split("\t")[0].rstrip("/").replace("\\ ", " ") for one in lines}
        check("fish", words, offered, wanted, unwanted)


def test_zsh(file, folder):
    """zsh completes only in its editor, so a second zsh on a pseudo-terminal is typed into. There gsapp prints its
    words."""
    output("zsh", "-n", file)
    script = """
zmodload zsh/zpty
zpty shell zsh -f
zpty -w shell "cd ${(q)2}; fpath=(${(q)1:h} \\$fpath); autoload -U compinit; compinit -u -d ${(q)2}/../dump; gsapp() print -r -- got \\$* end; print RE''ADY"
while zpty -r shell line; do [[ $line == *READY* ]] && break; done
zpty -n -w shell "gsapp $3"$'\\t\\n'
while zpty -r shell line; do [[ $line == *got*end* ]] && break; done
print -r -- $line
"""
    for words, wanted in (
        ("export --format pl", "export --format ply"),
        ("bench frames --appearan", "bench frames --appearance"),
        ("prep", "prepare"),
        ("train --strategy mc", "train --strategy mcmc"),
        ("view a", "view a scene"),
    ):
        shown = output("zsh", "-f", "-c", script, "zsh", file, folder, words)
        assert f"got {wanted} end" in shown, f"zsh: 'gsapp {words}' becomes {shown!r}"


def main():
    gsapp = pathlib.Path(sys.argv[1]).resolve()
    if not shutil.which("bash"):
        print("skipped: no bash")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "work/a scene").mkdir(parents=True)
        for shell, file_name, test in (
            ("bash", "gsapp", test_bash),
            ("zsh", "_gsapp", test_zsh),
            ("fish", "gsapp.fish", test_fish),
        ):
            if not shutil.which(shell):
                print(f"no {shell}: its completion is not tested")
                continue
            file = folder / shell / file_name
            file.parent.mkdir()
            file.write_text(output(gsapp, "completions", shell))
            test(file, folder / "work")
            print(f"{shell}: good")
    return 0


if __name__ == "__main__":
    sys.exit(main())
