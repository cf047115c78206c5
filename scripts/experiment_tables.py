# SPDX-License-Identifier: BSD-3-Clause
"""The tables of the paper from the records of runs, in several formats."""
import csv
import io
import json
import math

MISSING = "-"


class Table:
    """Rows of cells that are text or numbers; `digits` of numbers."""

    def __init__(self, name, title, header, digits):
        self.name, self.title, self.header = name, title, header
        self.digits = digits
        self.rows = []

    def cell(self, value):
        if value is None:
            return MISSING
        if isinstance(value, str):
            return value
        return f"{value:.{self.digits}f}"

    def cells(self):
        return [[self.cell(v) for v in row] for row in self.rows]

    def text(self):
        rows = [self.header, *self.cells()]
        widths = [max(map(len, column)) for column in zip(*rows)]
        lines = ["  ".join(c.ljust(w) if i == 0 else c.rjust(w)
                           for i, (c, w) in enumerate(zip(row, widths)))
                 for row in rows]
        return "\n".join([self.title, *lines]) + "\n"

    def markdown(self):
        lines = ["| " + " | ".join(row) + " |"
                 for row in [self.header, *self.cells()]]
        lines.insert(1, "|---" + "|---:" * (len(self.header) - 1) + "|")
        return "\n".join([f"**{self.title}**", "", *lines]) + "\n"

    def csv(self):
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows(
            [["table", *self.header],
             *[[self.name, *row] for row in self.cells()]])
        return out.getvalue()

    def latex(self):
        def escape(text):
            return text.replace("_", r"\_").replace("%", r"\%")
        lines = [" & ".join(map(escape, row)) + r" \\"
                 for row in [self.header, *self.cells()]]
        lines.insert(1, r"\hline")
        return "\n".join([
            r"\begin{table}", r"\centering",
            r"\begin{tabular}{l" + "r" * (len(self.header) - 1) + "}",
            *lines, r"\end{tabular}", rf"\caption{{{escape(self.title)}}}",
            r"\end{table}"]) + "\n"

    def json(self):
        return {"name": self.name, "title": self.title,
                "header": self.header, "rows": self.rows}


def statistic(record, kind, name):
    values = ((record or {}).get("errors") or {}).get(kind)
    return values[name] if values else None


def accuracy(records, sequences, methods, kind, unit, name=None, what=None):
    quantity = kind.split("_")[0]
    what = what or f"{quantity.capitalize()} error of images"
    table = Table(name or f"{quantity}_error",
                  f"{what}, median / mean ({unit})", ["sequence", *methods], 3)
    for sequence in sequences:
        row = [sequence]
        for method in methods:
            record = records.get((sequence, method))
            values = [statistic(record, kind, n) for n in ("median", "mean")]
            row.append(MISSING if None in values else
                       f"{values[0]:.3f} / {values[1]:.3f}")
        table.rows.append(row)
    return table


def registered(records, sequences, methods):
    table = Table("registered", "Registered images", ["sequence", *methods], 0)
    for sequence in sequences:
        row = [sequence]
        for method in methods:
            errors = records.get((sequence, method), {}).get("errors")
            row.append(f"{errors['num_registered']} / {errors['num_images']}"
                       if errors else MISSING)
        table.rows.append(row)
    return table


def areas(records, sequences, methods):
    table = Table("position_auc",
                  "Area under the curve of position errors (%)", [], 1)
    thresholds = []
    for record in records.values():
        for area in (record.get("errors") or {}).get("position_auc", []):
            if area["threshold"] not in thresholds:
                thresholds.append(area["threshold"])
    table.header = ["sequence", *[f"{m} @ {t:g} m" for m in methods
                                  for t in thresholds]]
    for sequence in sequences:
        row = [sequence]
        for method in methods:
            errors = records.get((sequence, method), {}).get("errors") or {}
            found = {a["threshold"]: 100.0 * a["area"]
                     for a in errors.get("position_auc", [])}
            row += [found.get(t) for t in thresholds]
        table.rows.append(row)
    return table


def internal_poses(records, sequences, methods, averaged):
    """Of the `averaged`, which share their rotations, one shows those."""
    first = averaged[:1]
    table = Table("internal_poses",
                  "Errors of cameras in the rig: rotation, direction of "
                  "translation (deg), length (%)",
                  ["sequence, camera", *methods,
                   *["rotation before bundle adjustment" for _ in first]], 3)
    for sequence in sequences:
        by_camera = {}
        for method in [*methods, *first]:
            errors = records.get((sequence, method), {}).get("errors") or {}
            for sensor in errors.get("sensors", []):
                by_camera.setdefault(sensor["name"], {})[method] = sensor
        for camera, found in by_camera.items():
            row = [f"{sequence}, {camera}"]
            row += [internal_cell(found.get(method)) for method in methods]
            row += [found[m]["rotation_deg"] if m in found else None
                    for m in first]
            table.rows.append(row)
    return table


def internal_cell(sensor):
    if not sensor or sensor["direction_deg"] is None:
        return MISSING
    length = 100.0 * (sensor["length_m"] / sensor["true_length_m"] - 1.0)
    return (f"{sensor['rotation_deg']:.3f}, {sensor['direction_deg']:.3f}, "
            f"{length:+.2f}")


def runtime(records, sequences, methods, kind):
    what = "Processor seconds" if kind == "processor_seconds" else "Seconds"
    table = Table(f"runtime_{kind}",
                  f"{what} without view-graph construction (reading, relative "
                  "poses and writing left out)", ["sequence", *methods], 2)
    for sequence in sequences:
        table.rows.append([sequence, *[
            records.get((sequence, m), {}).get(f"{kind}_counted")
            for m in methods]])
    return table


def translation_seconds(records, sequences, methods):
    table = Table("translation_averaging",
                  "Processor seconds of translation averaging",
                  ["sequence", *methods], 2)
    for sequence in sequences:
        row = [sequence]
        for method in methods:
            stages = records.get((sequence, method), {}).get("stages", {})
            stage = stages.get("translation averaging")
            row.append(stage["processor_seconds"] if stage else None)
        table.rows.append(row)
    return table


def memory(records, sequences, methods):
    table = Table("peak_memory", "Peak memory (MiB)", ["sequence", *methods], 0)
    for sequence in sequences:
        found = [records.get((sequence, m), {}) for m in methods]
        table.rows.append([sequence, *[
            r["peak_memory_mib"] if r.get("exit_code") == 0 else None
            for r in found]])
    return table


def geometric_mean(values):
    """And its relative standard error, None of one value."""
    logs = [math.log(v) for v in values]
    mean = sum(logs) / len(logs)
    if len(logs) < 2:
        return math.exp(mean), None
    variance = sum((v - mean) ** 2 for v in logs) / (len(logs) - 1)
    return math.exp(mean), math.sqrt(variance / len(logs))


def over_seeds(records, runs, methods):
    """Mean position errors of methods, over the runs of each setting that all
    methods have a model of; ratios are those of one run with another of the
    same input."""
    errors = Table("errors_over_seeds",
                   "Mean position error (m), geometric mean over the seeds",
                   ["setting", "seeds", *methods], 4)
    ratios = Table("ratios_over_seeds",
                   f"Ratio to {methods[0]}, geometric mean and its standard "
                   "error; runs that it has the lowest error of",
                   ["setting", "seeds", *methods], 3)
    for setting, names in runs.items():
        found = [[statistic(records.get((name, method)), "position_m", "mean")
                  for method in methods] for name in names]
        found = [row for row in found if None not in row]
        if not found:
            for table in (errors, ratios):
                table.rows.append([setting, "0", *[None for _ in methods]])
            continue
        columns = list(zip(*found))
        errors.rows.append([setting, str(len(found)),
                            *[geometric_mean(c)[0] for c in columns]])
        row = [setting, str(len(found))]
        lowest = sum(r[0] <= min(r) for r in found)
        row.append(f"lowest {lowest} times")
        for column in columns[1:]:
            mean, error = geometric_mean(
                [value / first for value, first in zip(column, columns[0])])
            row.append(f"{mean:.3f}" if error is None
                       else f"{mean:.3f} +- {mean * error:.3f}")
        ratios.rows.append(row)
    return [errors, ratios]


def make_tables(records, groups):
    """records by sequence and method; groups: methods to compare, those of the
    ablation, and the same before bundle adjustment."""
    sequences = list(dict.fromkeys(sequence for sequence, _ in records))
    main, ablation, averaged = groups
    tables = []
    if main:
        tables += [
            accuracy(records, sequences, main, "rotation_deg", "deg"),
            accuracy(records, sequences, main, "position_m", "m"),
            areas(records, sequences, main),
            registered(records, sequences, main),
            internal_poses(records, sequences, main, averaged),
            runtime(records, sequences, main, "seconds"),
            runtime(records, sequences, main, "processor_seconds"),
            memory(records, sequences, main)]
    title = "Inputs and objectives of translation averaging: position error"
    if ablation:
        tables.append(accuracy(records, sequences, ablation, "position_m", "m",
                               "ablation", title))
    if averaged:
        tables += [
            accuracy(records, sequences, averaged, "position_m", "m",
                     "ablation_averaged",
                     title + ", before bundle adjustment"),
            translation_seconds(records, sequences, averaged)]
    return tables


def write_tables(tables, path, description):
    """PATH.txt, .md, .csv, .tex and .json; the text also to the screen."""
    text = "\n".join(t.text() for t in tables)
    print("\n" + text, end="")
    path.with_suffix(".txt").write_text(text)
    path.with_suffix(".md").write_text(
        "\n".join(t.markdown() for t in tables))
    path.with_suffix(".csv").write_text("\n".join(t.csv() for t in tables))
    path.with_suffix(".tex").write_text("\n".join(t.latex() for t in tables))
    path.with_suffix(".json").write_text(json.dumps(
        {**description, "tables": [t.json() for t in tables]}, indent=2)
        + "\n")
    print(f"\nwrote {path}.txt, .md, .csv, .tex and .json")
