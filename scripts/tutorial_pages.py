#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs the code of a documentation page, or turns the page into a notebook.

    scripts/tutorial_pages.py run PAGE --program MGSFM [--python_path FOLDER]
    scripts/tutorial_pages.py notebook [--if_python] PAGE NOTEBOOK

`run` executes all blocks of a page in order, in a temporary folder with a small
copy of data/. It fails with the number of the line of the block that fails.

  ```python              runs; all blocks of a page share their variables
  ```bash                runs
  ```                    runs if it begins with one of COMMANDS; else it is text
  ```json, ```yaml, ...  is text, or a file; see below

Text that follows commands without a word in between is their output: each of
its lines must occur there, whatever its numbers are; "..." stands for anything.

Comments in the line before a block, which readers do not see, say more:

  <!-- not run: REASON -->    the block is not run, for this reason
  <!-- output: REASON -->     the text is the output of commands farther above
  <!-- file: PATH -->         the block is the content of this file
  <!-- before: COMMANDS -->   are run before the block; they make the input that
                              readers have and the test does not

Anywhere in a page, commands test what the text says; `refused` is a command that
must fail, with one line that matches a pattern:

  <!-- check: COMMANDS -->    for example: refused 'line 3' mgsfm ...

Pages that consist of Python code are executed as notebooks if nbclient and
ipykernel are installed.
"""

import argparse
import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import traceback
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

COMMANDS = {"apt-get", "bash", "cat", "cd", "cmake", "colmap", "cp", "docker",
            "echo", "export", "ffmpeg", "for", "git", "mgsfm", "mkdir",
            "ns-train", "pip", "python3", "ros2", "sbatch", "snakemake",
            "sudo"}

# Folders of the repository that commands of a page name.
FOLDERS = ("examples", "experiments", "scripts", "workflow")

# The frames of data/rendered_rig that tests use, to save time.
NUM_FRAMES = 8

BLOCK = re.compile(r"((?:^<!--(?:(?!-->).)*-->\n+)*)^```(\w*)\n(.*?)^```$",
                   re.M | re.S)
MARK = re.compile(r"<!--\s*([a-z ]+):\s*(.*?)\s*-->", re.S)


CHECK = re.compile(r"^<!--\s*check:\s*(.*?)\s*-->", re.M | re.S)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")

# For checks: the command fails, and its last line matches the pattern.
REFUSED = """refused() {
  local pattern=$1 text; shift
  if text=$("$@" 2>&1); then echo "not refused: $*"; return 1; fi
  grep -qE -- "$pattern" <<<"${text##*$'\\n'}" || { echo "$text"; return 1; }
}
"""


class Check:
    """A hidden test of what the page says."""

    def __init__(self, match):
        self.code = REFUSED + match[1]
        self.start, self.end = match.span()
        self.line = match.string.count("\n", 0, self.start) + 1
        self.marks, self.reason, self.kind = {}, None, "check"


class Block:
    """A fenced block: its kind is python, bash, file or text."""

    def __init__(self, match):
        self.code = match[3]
        self.start, self.end = match.span()
        self.line = match.string.count("\n", 0, match.start(2)) + 1
        self.marks = dict(MARK.findall(match[1]))
        unknown = set(self.marks) - {"not run", "file", "before", "check",
                                     "output"}
        if unknown:
            raise SystemExit(f"line {self.line}: unknown mark {unknown}")
        self.reason = self.marks.get("not run")
        self.kind = self._kind(match[2])

    def _kind(self, language):
        if "file" in self.marks:
            return "file"
        words = self.code.split(maxsplit=1)
        is_command = bool(words) and (words[0] in COMMANDS
                                      or words[0].startswith("scripts/"))
        if language in ("bash", "sh") or (not language and is_command):
            return "bash"
        return "python" if language == "python" else "text"


def blocks_of(text):
    return [Block(match) for match in BLOCK.finditer(text)]


def checks_of(text):
    return [Check(match) for match in CHECK.finditer(text)]


def normalized(text):
    return " ".join(NUMBER.sub("#", text).split())


def missing_lines(expected, output):
    """The expected lines that the output lacks."""
    lines = [normalized(line) for line in output.splitlines()]
    return [line for line in expected.splitlines()
            if not any(all(part in got for part in
                           normalized(line).split("..."))
                       for got in lines + [""])]


def make_data(folder):
    """The repository as commands see it, with fewer frames of the images."""
    for name in FOLDERS:
        if (ROOT / name).exists():
            (folder / name).symlink_to(ROOT / name)
    source = ROOT / "data"
    (folder / "data" / "rendered_rig").mkdir(parents=True)
    for path in source.iterdir():
        if path.name != "rendered_rig":
            (folder / "data" / path.name).symlink_to(path)
    for path in (source / "rendered_rig").iterdir():
        if path.name != "images":
            (folder / "data" / "rendered_rig" / path.name).symlink_to(path)
    for path in sorted((source / "rendered_rig" / "images").glob("*/*.jpg")):
        if int(path.stem) < NUM_FRAMES:
            copy = folder / path.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(path)


def run_commands(commands):
    """Returns what they print."""
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", commands],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, check=False)
    print(done.stdout, end="", flush=True)
    done.check_returncode()
    return done.stdout


def run_block(block, variables, page):
    if "before" in block.marks:
        run_commands(block.marks["before"])
    if block.kind == "file":
        path = Path(block.marks["file"])
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.code, encoding="utf-8")
    elif block.kind in ("bash", "check"):
        return run_commands(block.code)
    elif block.kind == "python":
        # Lines of messages are those of the page.
        code = "\n" * block.line + block.code
        exec(compile(code, str(page), "exec"), variables)
    return None


def run_as_script(page, page_text, blocks):
    variables = {"__name__": "__main__"}
    output, end = None, 0
    for block in blocks:
        is_adjacent = not page_text[end:block.start].strip()
        if block.kind == "text" and output is not None and not block.reason:
            if is_adjacent or "output" in block.marks:
                missing = missing_lines(block.code, output)
                if missing:
                    raise SystemExit(f"{page}:{block.line}: not printed: "
                                     f"{missing[0]}")
        if block.reason or block.kind == "text":
            continue
        start = time.monotonic()
        print(f"-- line {block.line} ({block.kind})", flush=True)
        try:
            output, end = run_block(block, variables, page), block.end
        except subprocess.CalledProcessError as error:
            raise SystemExit(f"{page}:{block.line}: exit code "
                             f"{error.returncode}") from None
        except Exception:
            traceback.print_exc()
            raise SystemExit(f"{page}:{block.line}: failed") from None
        print(f"   {time.monotonic() - start:.1f} s", flush=True)


def run_as_notebook(page):
    import nbclient
    import nbformat
    os.environ["PYDEVD_DISABLE_FILE_VALIDATION"] = "1"  # of the kernel
    book = nbformat.reads(json.dumps(notebook_of(page)), as_version=4)
    try:
        nbclient.NotebookClient(book, timeout=300,
                                kernel_name="python3").execute()
    except nbclient.exceptions.CellExecutionError as error:
        raise SystemExit(f"{page}: {error}") from None
    for cell in book.cells:
        for output in cell.get("outputs", []):
            print(output.get("text", ""), end="")
    print(f"-- {len(book.cells)} cells of the notebook ran")


def has_notebook_tools():
    with contextlib.suppress(ImportError):
        import ipykernel  # noqa: F401
        import nbclient  # noqa: F401
        return True
    return False


def run_page(arguments):
    page = arguments.page.resolve()
    text = page.read_text(encoding="utf-8")
    blocks = sorted(blocks_of(text) + checks_of(text),
                    key=lambda block: block.start)
    for block in blocks:
        if block.reason:
            print(f"-- line {block.line} not run: {block.reason}")
    kinds = {block.kind for block in blocks if not block.reason} - {"text"}
    if arguments.python_path:
        os.environ["PYTHONPATH"] = str(arguments.python_path.resolve())
        sys.path.insert(0, os.environ["PYTHONPATH"])
    elif "python" in kinds:
        print("skipped: the Python package is not built")
        return 77
    os.environ["PATH"] = (f"{arguments.program.resolve().parent}{os.pathsep}"
                          f"{os.environ['PATH']}")
    with tempfile.TemporaryDirectory(prefix="mgsfm_page_") as folder:
        make_data(Path(folder))
        os.chdir(folder)
        if kinds == {"python"} and has_notebook_tools():
            run_as_notebook(page)
        else:
            run_as_script(page, text, blocks)
        os.chdir(ROOT)
    return 0


def markdown_cell(text):
    """A cell of text; links lead nowhere from a notebook and become text."""
    text = re.sub(r"!?\[([^\]]+)\]\((?!\w+://|#)[^)]*\)", r"\1",
                  MARK.sub("", text)).strip()
    if not text:
        return []
    return [{"cell_type": "markdown", "metadata": {},
             "source": text.splitlines(keepends=True)}]


def notebook_of(page):
    """The page as a notebook: blocks that run are cells, all else is text."""
    text = page.read_text(encoding="utf-8")
    cells, position = [], 0
    for block in blocks_of(text):
        if block.reason or block.kind not in ("python", "bash"):
            continue
        cells += markdown_cell(text[position:block.start])
        position = block.end
        magic = "%%bash\n" if block.kind == "bash" else ""
        cells.append({"cell_type": "code", "execution_count": None,
                      "metadata": {}, "outputs": [],
                      "source": (magic + block.code.rstrip()).splitlines(
                          keepends=True)})
    cells += markdown_cell(text[position:])
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python",
              "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel},
            "nbformat": 4, "nbformat_minor": 5}


def write_notebook(arguments):
    blocks = blocks_of(arguments.page.read_text(encoding="utf-8"))
    if arguments.if_python and not any(block.kind == "python"
                                       for block in blocks):
        return 0
    arguments.notebook.parent.mkdir(parents=True, exist_ok=True)
    arguments.notebook.write_text(
        json.dumps(notebook_of(arguments.page), indent=1) + "\n",
        encoding="utf-8")
    return 0


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    commands = parser.add_subparsers(required=True)
    run = commands.add_parser("run")
    run.add_argument("page", type=Path)
    run.add_argument("--program", type=Path, required=True)
    run.add_argument("--python_path", type=Path)
    run.set_defaults(call=run_page)
    notebook = commands.add_parser("notebook")
    notebook.add_argument("page", type=Path)
    notebook.add_argument("notebook", type=Path)
    notebook.add_argument("--if_python", action="store_true")
    notebook.set_defaults(call=write_notebook)
    arguments = parser.parse_args()
    sys.exit(arguments.call(arguments))


if __name__ == "__main__":
    main()
