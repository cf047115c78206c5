# SPDX-License-Identifier: BSD-3-Clause
"""Checks that shards of features and matches, whose processes are killed at
random and started again, merge to the database of a single process, row by row.

    python3 tests/workflow/shards.py MGSFM IMAGES [--counts 1,3,8] [--kills 3]
        [--extraction FLAGS] [--rigs FLAGS] [--matching FLAGS]
"""
import argparse
import pathlib
import random
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time

from compare import rows_of


class Runs:
    def __init__(self, mgsfm, max_kills, seed):
        self.mgsfm = mgsfm
        self.max_kills = max_kills
        self.random = random.Random(seed)
        self.num_kills = 0
        self.usual_s = {}  # per command, of a run that was not killed

    def run(self, command, *flags):
        """Runs to the end, and returns the processor time in seconds."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.monotonic()
        result = subprocess.run([self.mgsfm, command, *flags],
                                stderr=subprocess.PIPE, text=True)
        if result.returncode != 0:
            sys.exit(f"{command} {' '.join(flags)}: {result.stderr[-500:]}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.usual_s[command] = time.monotonic() - begin
        return (after.ru_utime - before.ru_utime +
                after.ru_stime - before.ru_stime)

    def run_with_kills(self, command, *flags, share):
        """Kills the process some times, within the time that it may take."""
        for _ in range(self.random.randint(0, self.max_kills)):
            process = subprocess.Popen([self.mgsfm, command, *flags],
                                       stderr=subprocess.DEVNULL)
            try:
                process.wait(self.random.random() *
                             self.usual_s[command] / share)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                self.num_kills += 1
        subprocess.run([self.mgsfm, command, *flags], check=True,
                       stderr=subprocess.DEVNULL)


def run_shares(runs, command, flags, path_flag, count, folder, merged, more):
    """All shares in a random order, merged in another one."""
    numbers = list(range(1, count + 1))
    runs.random.shuffle(numbers)
    paths = list(more)
    for number in numbers:
        path = str(folder / f"{command}_{number}_of_{count}.db")
        runs.run_with_kills(command, *flags, path_flag, path, "--shard",
                            f"{number}/{count}", share=count)
        paths.append(path)
    runs.random.shuffle(paths)
    runs.run("database_merger", "--database_path", ",".join(paths),
             "--merged_database_path", str(merged))


def check_equal(path, other):
    rows, others = rows_of(path), rows_of(other)
    for table in sorted(rows.keys() | others.keys()):
        if rows.get(table) != others.get(table):
            sys.exit(f"{path} and {other} differ in {table}")
    return sum(map(len, rows.values()))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("mgsfm")
    parser.add_argument("images")
    parser.add_argument("--counts", default="1,3,8")
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    for name in ("extraction", "rigs", "matching"):
        parser.add_argument("--" + name, default="", type=shlex.split)
    options = parser.parse_args()
    runs = Runs(options.mgsfm, options.kills, options.seed)
    folder = pathlib.Path(tempfile.mkdtemp())
    extraction = ["--image_path", options.images, *options.extraction]
    tree = ["--VocabTree.vocab_tree_path", str(folder / "tree.bin")]
    try:
        single = str(folder / "single.db")
        extraction_s = runs.run("feature_extractor", "--database_path", single,
                                *extraction)
        runs.run("rig_configurator", "--database_path", single, *options.rigs)
        runs.run("vocab_tree_builder", "--database_path", single,
                 "--vocab_tree_path", tree[1])
        matching_s = runs.run("sequential_matcher", "--database_path", single,
                              *tree, *options.matching)
        print(f"single process: extraction {extraction_s:.1f} s, matching "
              f"{matching_s:.1f} s of processor time", flush=True)
        for count in map(int, options.counts.split(",")):
            features = folder / f"features{count}.db"
            run_shares(runs, "feature_extractor", extraction,
                       "--database_path", count, folder, features, [])
            runs.run("rig_configurator", "--database_path", str(features),
                     *options.rigs)
            merged = folder / f"merged{count}.db"
            run_shares(runs, "sequential_matcher",
                       ["--database_path", str(features), *tree,
                        *options.matching],
                       "--shard_path", count, folder, merged, [str(features)])
            num_rows = check_equal(single, merged)
            print(f"{count} shards: {num_rows} equal rows, "
                  f"{runs.num_kills} processes killed so far", flush=True)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
