# SPDX-License-Identifier: BSD-3-Clause
"""Prints what the jobs of a workflow needed, per rule, and what a number of
such images would need.

    python3 workflow/cost.py WORK [--images 1000000] [--core_hour_price 0.04]

Processor time and storage are scaled by the number of images, which holds for
all rules but select_pairs with retrieval and join (docs/guides/fleets.md).
"""
import argparse
import csv
import pathlib
import sqlite3


def read_benchmarks(folder):
    """Per rule: number of jobs, sum of processor seconds, peak memory in MB."""
    rules = {}
    for path in sorted(folder.rglob("*.tsv")):
        rule = path.relative_to(folder).parts[0].replace(".tsv", "")
        with open(path, newline="") as file:
            for row in csv.DictReader(file, delimiter="\t"):
                entry = rules.setdefault(rule, [0, 0.0, 0.0])
                entry[0] += 1
                entry[1] += number(row["cpu_time"])
                entry[2] = max(entry[2], number(row["max_rss"]))
    return rules


def number(text):
    """Snakemake writes NA or - for jobs that ended before it looked."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def count(database, table):
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        return connection.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--images", type=int, default=1_000_000)
    parser.add_argument("--core_hour_price", type=float, default=0.04)
    options = parser.parse_args()
    database = options.work / "database.db"
    num_images = count(database, "images")
    scale = options.images / num_images
    rules = read_benchmarks(options.work / "benchmarks")
    print(f"{num_images} images, {count(database, 'matches')} pairs")
    print(f"| rule | jobs | s per image | MB | core hours of "
          f"{options.images} images |\n|---|---|---|---|---|")
    total = 0.0
    for rule, (jobs, seconds, megabytes) in rules.items():
        hours = seconds * scale / 3600
        total += hours
        print(f"| {rule} | {jobs} | {seconds / num_images:.4f} | "
              f"{megabytes:.0f} | {hours:.0f} |")
    gigabytes = database.stat().st_size * scale / 1e9
    print(f"\n{total:.0f} core hours, {total * options.core_hour_price:.0f} at "
          f"{options.core_hour_price} per core hour; database.db of "
          f"{gigabytes:.0f} GB")


if __name__ == "__main__":
    main()
