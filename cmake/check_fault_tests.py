#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that every test a table names exists: `Suite.Name`, or `Name` alone of the suite named last; `*` and `...`
stand for the rest of a name. Prints the names that do not exist and ends with 1 if there is any.

usage: check_fault_tests.py ROOT [PAGE]
"""

import pathlib
import re
import sys

TEST = re.compile(r"^(?:TEST|TEST_F|TEST_P)\((\w+),\s+(\w+)\)", re.MULTILINE)


def main():
    root = pathlib.Path(sys.argv[1])
    page = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else root / "docs/faults.md"
    sources = (root / "tests").rglob("*.cpp")
    tests = {match for source in sources for match in TEST.findall(source.read_text(encoding="utf-8"))}
    tests |= {("FuzzSeeds", folder.name) for folder in (root / "tests/fuzz/seeds").iterdir()}
    missing, suite = [], None
    for token in re.findall(r"`([^`]+)`", page.read_text(encoding="utf-8")):
        match = re.fullmatch(r"([A-Z]\w*)?(?:\.|^)(\w*)(\*|\.\.\.)?", token)
        if not match or not (match[1] or token[0] == "." or re.fullmatch(r"[A-Z]\w*[a-z]\w*", token)):
            continue  # A key, a file, a piece of code.
        suite, name, rest = match[1] or suite, match[2], match[3]
        if not any(s == suite and (n.startswith(name) if rest else n == name) for s, n in tests):
            missing.append(f"{suite}.{name}{rest or ''}")
    print("\n".join(missing) or f"{page.name}: every test named there exists")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
