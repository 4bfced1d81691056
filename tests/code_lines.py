#!/usr/bin/env python3
"""Counts the lines of Rust code by crate: without blank lines, comments and tests.

    tests/code_lines.py [COMMIT ...]

Prints a column for each commit and one for the present files. Code of tests is what compiles only with `test` or with the
feature `testing`: items with such a `cfg`, and the files of modules that are declared so. Commits from before the crates had
one folder for each module; each module counts for the crate that contains it today.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = "panelprep"

# One token: a comment, a literal, or a name with `#` before raw names. What lies between tokens is punctuation.
TOKEN = re.compile(
    r'//[^\n]*'
    r'|(?P<block>/\*)'
    r'|[bc]?r(?P<hashes>#*)"(?:.|\n)*?"(?P=hashes)'
    r'|[bc]?"(?:\\(?:.|\n)|[^"\\])*"'
    r"|b?'(?:\\(?:u\{[^}]*\}|x..|.)|[^'\\\n])'"
    r"|(?:r\#)?\w+"
)
TEST_CFG = re.compile(r'#\[cfg\((?!not\b)[^\]]*\b(?:test\b|feature = "testing")[^\]]*\)\]')
MODULE = re.compile(r'\s*(?:#\[[^\]]*\]\s*)*(?:pub(?:\([^)]*\))?\s+)?mod\s+(\w+)\s*;')


def git(*arguments):
    return subprocess.run(["git", "-C", ROOT, *arguments], check=True, capture_output=True).stdout


def files_of(commit):
    """Returns the text of each Rust file below `src/`, by its path there; of the present files if `commit` is `None`."""
    if commit is None:
        names = git("ls-files", "--cached", "--others", "--exclude-standard", "src").decode().split("\n")
        found = [(name, ROOT / name) for name in names if name.endswith(".rs")]
        return {name.removeprefix("src/"): path.read_text() for name, path in found if path.exists()}
    rows = [row.split(None, 3) for row in git("ls-tree", "-r", commit, "src").decode().splitlines()]
    rows = [(blob, name.removeprefix("src/")) for _, _, blob, name in rows if name.endswith(".rs")]
    asked = "".join(f"{blob}\n" for blob, _ in rows)
    out = subprocess.run(["git", "-C", ROOT, "cat-file", "--batch"], input=asked.encode(), check=True, capture_output=True).stdout
    texts, at = {}, 0
    for _, name in rows:
        head = out.index(b"\n", at)
        size = int(out[at:head].split()[2])
        texts[name] = out[head + 1 : head + 1 + size].decode()
        at = head + 2 + size
    return texts


def blank(text):
    """Returns the text without comments, and a copy in which literals are also empty, so that brackets in it nest. Both have
    the same lengths and lines as the text."""
    def spaces(span):
        return re.sub(r"[^\n]", " ", span)

    code, bare, at = [], [], 0
    while found := TOKEN.search(text, at):
        between, token, end = text[at : found.start()], found.group(), found.end()
        if found.group("block"):
            # Block comments nest.
            depth = 1
            while depth:
                mark = re.compile(r"/\*|\*/").search(text, end)
                depth, end = depth + (1 if mark.group() == "/*" else -1), mark.end()
            token = text[found.start() : end]
        is_comment = token.startswith(("//", "/*"))
        is_literal = token[-1] in "\"'#"
        code += [between, spaces(token) if is_comment else token]
        bare += [between, spaces(token) if is_comment or is_literal else token]
        at = end
    return "".join(code + [text[at:]]), "".join(bare + [text[at:]])


def item_end(bare, at):
    """Returns the end of the item, field or statement that begins here: its semicolon, comma or last bracket."""
    depth = 0
    for place in range(at, len(bare)):
        letter = bare[place]
        if letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth -= 1
            if depth < 0:
                return place
            if depth == 0 and letter == "}":
                return place + 1
        elif letter in ";," and depth == 0:
            return place + 1
    return len(bare)


def measure(name, text):
    """Returns the number of code lines of a file, and the files or folders of its modules for tests, without ending."""
    code, bare = blank(text)
    if re.search(r'#!\[cfg\((?!not\b)[^\]]*\b(?:test\b|feature = "testing")', code):
        return 0, set()
    tests, at, rest = set(), 0, []
    path = Path(name)
    folder = path.parent if path.name in ("mod.rs", "lib.rs", "main.rs") else path.with_suffix("")
    while found := TEST_CFG.search(code, at):
        rest.append(code[at : found.start()])
        module = MODULE.match(code, found.end())
        if module:
            tests.add(str(folder / module.group(1)))
            at = module.end()
            continue
        at = found.end()
        # Further attributes belong to the same item.
        while attribute := re.compile(r"\s*#\[").match(bare, at):
            at = bare.index("]", attribute.end()) + 1
        at = item_end(bare, at)
    rest.append(code[at:])
    return sum(1 for line in "".join(rest).split("\n") if line.strip()), tests


def count(texts, crates):
    """Returns the code lines by crate."""
    measured = {name: measure(name, text) for name, text in texts.items()}
    tests = {module for _, modules in measured.values() for module in modules}

    def is_test(name):
        parents = [str(parent) for parent in Path(name).parents]
        return name.removesuffix(".rs") in tests or any(parent in tests for parent in parents)

    lines = {}
    for name, (number, _) in measured.items():
        if not is_test(name):
            first = Path(name).parts[0].removesuffix(".rs")
            crate = first if first in crates and f"{first}/lib.rs" in texts else crates.get(first, PROGRAM)
            lines[crate] = lines.get(crate, 0) + number
    return lines


def crates_of(texts):
    """Returns the crate of each module, and of each crate itself."""
    crates = {}
    names = {Path(name).parts[0] for name in texts if name.endswith("/lib.rs")}
    for name in texts:
        parts = Path(name).parts
        if parts[0] in names and len(parts) > 1:
            crates[parts[1].removesuffix(".rs")] = parts[0]
    crates.pop("lib", None)
    crates.pop("mod", None)
    return crates | {crate: crate for crate in names}


def main(commits):
    present = files_of(None)
    crates = crates_of(present)
    columns = [(commit[:8], count(files_of(commit), crates)) for commit in commits]
    columns.append(("present", count(present, crates)))
    rows = sorted({crate for _, lines in columns for crate in lines} - {PROGRAM}) + [PROGRAM]
    print(f"{'code lines':12}" + "".join(f"{name:>10}" for name, _ in columns))
    for crate in rows:
        print(f"{crate:12}" + "".join(f"{lines.get(crate, 0):10}" for _, lines in columns))
    print(f"{'all':12}" + "".join(f"{sum(lines.values()):10}" for _, lines in columns))


if __name__ == "__main__":
    main(sys.argv[1:])
