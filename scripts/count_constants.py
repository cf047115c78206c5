#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints how many named numbers each module of the core has.

Counted are constants kName at namespace or function scope whose initializer
has a number. Members of classes (sizes), texts, tables of names, sentinels and
expressions of other constants are not. With an argument, lists them.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GROUPS = [ROOT / "src" / name for name in ("foundation", "estimation", "mapper")]
DECLARATION = re.compile(
    r"^[ \t]*(?:inline\s+)?(?:constexpr|const)\s+([\w:<>,\s*&]*?)\b(k[A-Z]\w*)"
    r"\s*(?:\[[^\]]*\])*\s*[={(]([^;]*);", re.MULTILINE)


def constants_in(path):
    text = re.sub(r"//[^\n]*", "", path.read_text(encoding="utf-8"))
    for kind, name, value in DECLARATION.findall(text):
        value = re.sub(r'"[^"]*"', "", value)
        is_text = "char" in kind or "string" in kind
        is_sentinel = re.fullmatch(r"\s*(std::numeric_limits.*|-1)\s*", value)
        if not is_text and not is_sentinel and re.search(r"(?<!\w)\d", value):
            yield f"{name} = {' '.join(value.split())}"


def main():
    total = 0
    for module in sorted(m for group in GROUPS for m in group.iterdir()):
        folders = [module, ROOT / "include" / "mgsfm" / module.name]
        found = [(path.relative_to(ROOT), line) for folder in folders
                 for path in sorted(folder.rglob("*.[ch]*"))
                 if path.suffix in (".h", ".cc") for line in constants_in(path)]
        total += len(found)
        if not module.is_dir():
            continue
        print(f"{len(found):4} {module.name}")
        if len(sys.argv) > 1:
            for path, line in found:
                print(f"     {path}: {line}")
    print(f"{total:4} in all")


if __name__ == "__main__":
    main()
