#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints which share of the lines of each module tests have run, and of each
file with --files. Reads what a build with --coverage has left (gcov).

  scripts/coverage.py BUILD_FOLDER [--files MODULE] [--missed FILE]
"""
import argparse
import collections
import gzip
import json
import pathlib
import subprocess
import sys
import tempfile

SOURCES = pathlib.Path(__file__).resolve().parent.parent
ROOTS = ("src", "apps", "include")


def count_lines(build):
    """File, relative to the sources -> line -> how often it has run."""
    counts = collections.defaultdict(lambda: collections.defaultdict(int))
    # Tests are instrumented, too, but are no part of what they cover.
    notes = [path for path in sorted(build.rglob("*.gcno"))
             if "tests" not in path.relative_to(build).parts]
    with tempfile.TemporaryDirectory() as folder:
        for path in notes:
            subprocess.run(["gcov", "--json-format", str(path)], cwd=folder,
                           check=True, stdout=subprocess.DEVNULL,
                           stderr=subprocess.DEVNULL)
            for report in pathlib.Path(folder).glob("*.gcov.json.gz"):
                add_report(json.loads(gzip.decompress(report.read_bytes())),
                           counts)
                report.unlink()
    return counts


def add_report(report, counts):
    for file in report["files"]:
        path = pathlib.Path(report["current_working_directory"], file["file"])
        try:
            name = path.resolve().relative_to(SOURCES)
        except ValueError:
            continue  # of a library
        if name.parts[0] not in ROOTS:
            continue
        for line in file["lines"]:
            counts[str(name)][line["line_number"]] += line["count"]


def module_of(name):
    """GROUP/MODULE; a public header belongs to the module of its folder."""
    parts = pathlib.PurePath(name).parts
    if parts[0] == "include":
        folder, = (SOURCES / "src").glob(f"*/{parts[2]}")
        return f"{folder.parent.name}/{parts[2]}"
    return "/".join(parts[1:3] if parts[0] == "src" else parts[:2])


def print_shares(shares):
    for name, (num_run, num_lines) in sorted(shares.items()):
        print(f"{name:45} {num_run:6} of {num_lines:6} lines "
              f"{100.0 * num_run / max(num_lines, 1):6.1f} %")


def shares_by(counts, key):
    shares = collections.defaultdict(lambda: [0, 0])
    for name, lines in counts.items():
        share = shares[key(name)]
        share[0] += sum(count > 0 for count in lines.values())
        share[1] += len(lines)
    return shares


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--files", help="part of the name of a module")
    parser.add_argument("--missed", help="part of the name of a file")
    options = parser.parse_args()
    counts = count_lines(options.build.resolve())
    if not counts:
        sys.exit(f"{options.build} has no counts; run the tests first")
    if options.missed:
        for name in sorted(n for n in counts if options.missed in n):
            missed = sorted(i for i, c in counts[name].items() if c == 0)
            print(name + ":", *missed)
        return
    if options.files:
        counts = {n: c for n, c in counts.items()
                  if options.files in module_of(n)}
        print_shares(shares_by(counts, lambda name: name))
        return
    print_shares(shares_by(counts, module_of))


if __name__ == "__main__":
    main()
