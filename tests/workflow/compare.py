# SPDX-License-Identifier: BSD-3-Clause
"""Compares the results of two runs of the workflow: rows of the databases and
bytes of the models. Exits with 1 if they differ."""
import pathlib
import sqlite3
import sys


def rows_of(path):
    """Empty without a database, if the workflow started with one."""
    if not path.exists():
        return {}
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as database:
        tables = [name for name, in database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY 1")]
        return {table: database.execute(
            f"SELECT * FROM {table} ORDER BY rowid").fetchall()
            for table in tables}


def models_of(folder):
    return {str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*.bin"))}


def main():
    first, second = (pathlib.Path(argument) for argument in sys.argv[1:])
    rows, other_rows = (rows_of(path / "database.db")
                        for path in (first, second))
    for table in sorted(rows.keys() | other_rows.keys()):
        if rows.get(table) != other_rows.get(table):
            sys.exit(f"the rows of {table} differ")
    models, other_models = (models_of(path / "model")
                            for path in (first, second))
    if not models or models.keys() != other_models.keys():
        sys.exit(f"models: {sorted(models)} and {sorted(other_models)}")
    for name, content in models.items():
        if content != other_models[name]:
            sys.exit(f"{name} differs")
    print(f"equal: {sum(map(len, rows.values()))} rows, "
          f"{len(models)} files of models")


if __name__ == "__main__":
    main()
