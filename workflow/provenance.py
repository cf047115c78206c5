# SPDX-License-Identifier: BSD-3-Clause
"""Writes where an output of the workflow comes from, as JSON: the program with
its commit, the options, and the SHA-256 of the output and of all inputs.

    OPTIONS="--threads 2" provenance.py RECORD MGSFM OUTPUT INPUT ...

The digest of a folder is that of the sorted names and digests of its files. A
file is read again only if its size or time has changed: digests are kept in the
folder `digests` beside the record.
"""
import datetime
import hashlib
import json
import os
import pathlib
import subprocess
import sys


def write(path, text):
    """Jobs that write the same file leave one of their texts."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    part.write_text(text)
    part.replace(path)


def digest_of_file(path):
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def digest_of(path, folder):
    path = pathlib.Path(path)
    if path.is_dir():
        lines = [f"{file.relative_to(path)} {digest_of(file, folder)}\n"
                 for file in sorted(path.rglob("*")) if file.is_file()]
        return hashlib.sha256("".join(lines).encode()).hexdigest()
    status = path.stat()
    state = f"{status.st_size} {status.st_mtime_ns}"
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()
    known = folder / name
    if known.exists():
        known_state, _, digest = known.read_text().rpartition(" ")
        if known_state == state:
            return digest
    digest = digest_of_file(path)
    write(known, f"{state} {digest}")
    return digest


def main():
    record, mgsfm, output, *inputs = sys.argv[1:]
    record = pathlib.Path(record)
    folder = record.parent / "digests"
    version = subprocess.run([mgsfm, "--version"], capture_output=True,
                             text=True, check=False).stdout.splitlines()
    write(record, json.dumps({
        "output": output,
        "sha256": digest_of(output, folder),
        "program": version[0] if version else "",
        "options": os.environ.get("OPTIONS", "").strip(),
        "inputs": {path: digest_of(path, folder) for path in inputs},
        "date": datetime.datetime.now(datetime.timezone.utc).strftime(
            "%Y-%m-%d %H:%M UTC"),
    }, indent=2) + "\n")


if __name__ == "__main__":
    main()
