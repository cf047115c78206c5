# SPDX-License-Identifier: BSD-3-Clause
"""The tables of the paper.

`records` is {(sequence, method): record}; a record without errors or costs
leaves its cells empty. Errors are those of model_evaluator after alignment.
"""
import math

from experiments.tables import MISSING, Cell, Table, mean_row


def make_tables(records, groups):
    """All tables. groups: methods to compare, members of the ablation, and
    the same before bundle adjustment; a group may be empty."""
    sequences = list(dict.fromkeys(sequence for sequence, _ in records))
    main, ablation, averaged = groups
    tables = []
    if main:
        tables += [
            accuracy(records, sequences, main, "rotation_deg", "deg"),
            accuracy(records, sequences, main, "position_m", "m"),
            areas(records, sequences, main),
            registered(records, sequences, main),
            rig_extrinsics(records, sequences, main, averaged),
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


def statistic(record, kind, name):
    """A statistic, such as the mean of position_m, or None without errors."""
    values = ((record or {}).get("errors") or {}).get(kind)
    return values[name] if values else None


def has_failed(record):
    """True if a run ended without a model."""
    return record is not None and "model" not in record and not record.get(
        "errors")


def accuracy(records, sequences, methods, kind, unit, name=None, what=None):
    """Median and mean error of images; `kind` is position_m or rotation_deg.

    The last row has the means over the sequences that all methods mapped."""
    quantity = kind.split("_")[0]
    what = what or f"{quantity.capitalize()} error of images"
    table = Table(name or f"{quantity}_error",
                  f"{what}, median / mean ({unit})", ["sequence", *methods], 3,
                  min)
    values = [[statistic(records.get((sequence, method)), kind, n)
               for method in methods for n in ("median", "mean")]
              for sequence in sequences]
    labels = [*sequences]
    mean = mean_row(values)
    if mean:
        labels.append(f"mean of {mean[0]}")
        values.append(mean[1])
    for label, row in zip(labels, values):
        pairs = zip(row[::2], row[1::2])
        table.rows.append([label, *[
            MISSING if None in pair else
            Cell(f"{pair[0]:.3f} / {pair[1]:.3f}", pair[1])
            for pair in pairs]])
    return table


def num_images_of(records, sequence):
    """The number of images with a true pose, from any evaluated run."""
    numbers = [record["errors"]["num_images"]
               for (name, _), record in records.items()
               if name == sequence and record.get("errors")]
    return max(numbers, default=None)


def registered(records, sequences, methods):
    """Registered images, of all images with a true pose."""
    table = Table("registered", "Registered images", ["sequence", *methods], 0,
                  max)
    for sequence in sequences:
        num_images = num_images_of(records, sequence)
        row = [sequence]
        for method in methods:
            record = records.get((sequence, method))
            errors = (record or {}).get("errors")
            if errors:
                row.append(Cell(f"{errors['num_registered']} / "
                                f"{errors['num_images']}",
                                errors["num_registered"]))
            elif has_failed(record) and num_images is not None:
                row.append(Cell(f"0 / {num_images}", 0))
            else:
                row.append(MISSING)
        table.rows.append(row)
    table.add_mean()
    return table


def areas(records, sequences, methods):
    """Areas under the curve of position errors, for each threshold (m). A run
    without a model has none."""
    table = Table("position_auc",
                  "Area under the curve of position errors (%)", [], 1, max)
    thresholds = []
    for record in records.values():
        for area in (record.get("errors") or {}).get("position_auc", []):
            if area["threshold"] not in thresholds:
                thresholds.append(area["threshold"])
    table.header = ["sequence", *[f"{m} @ {t:g} m" for m in methods
                                  for t in thresholds]]
    table.period = max(1, len(thresholds))
    for sequence in sequences:
        row = []
        for method in methods:
            record = records.get((sequence, method))
            errors = (record or {}).get("errors") or {}
            found = {a["threshold"]: 100.0 * a["area"]
                     for a in errors.get("position_auc", [])}
            nothing = 0.0 if has_failed(record) else None
            row += [found.get(t, nothing) for t in thresholds]
        table.rows.append([sequence, *row])
    if thresholds:
        table.add_mean()
    return table


def rig_extrinsics(records, sequences, methods, averaged):
    """Errors of sensor_from_rig. The last column is its rotation before bundle
    adjustment, which all `averaged` methods share."""
    first = averaged[:1]
    table = Table("rig_extrinsics",
                  "Errors of rig extrinsics: rotation, direction of "
                  "translation (deg), length (%)",
                  ["sequence, camera", *methods,
                   *["rotation before bundle adjustment" for _ in first]], 3,
                  min)
    for sequence in sequences:
        by_camera = {}
        for method in [*methods, *first]:
            errors = records.get((sequence, method), {}).get("errors") or {}
            for sensor in errors.get("sensors", []):
                by_camera.setdefault(sensor["name"], {})[method] = sensor
        for camera, found in by_camera.items():
            row = [f"{sequence}, {camera}"]
            row += [extrinsics_cell(found.get(method)) for method in methods]
            row += [f"{found[m]['rotation_deg']:.3f}" if m in found else None
                    for m in first]
            table.rows.append(row)
    return table


def extrinsics_cell(sensor):
    """Rotation and direction in degrees, and the relative length in %; the
    rotation is compared."""
    if not sensor or sensor["direction_deg"] is None:
        return MISSING
    length = 100.0 * (sensor["length_m"] / sensor["true_length_m"] - 1.0)
    return Cell(f"{sensor['rotation_deg']:.3f}, "
                f"{sensor['direction_deg']:.3f}, {length:+.2f}",
                sensor["rotation_deg"])


def runtime(records, sequences, methods, kind):
    """Run time; `kind` is seconds or processor_seconds."""
    what = "Processor seconds" if kind == "processor_seconds" else "Seconds"
    table = Table(f"runtime_{kind}",
                  f"{what} without reading, view-graph construction and "
                  "writing", ["sequence", *methods], 2, min)
    for sequence in sequences:
        table.rows.append([sequence, *[
            records.get((sequence, m), {}).get(f"{kind}_counted")
            for m in methods]])
    table.add_mean()
    return table


def translation_seconds(records, sequences, methods):
    """Processor seconds of the stage alone."""
    table = Table("translation_averaging",
                  "Processor seconds of translation averaging",
                  ["sequence", *methods], 2, min)
    for sequence in sequences:
        row = [sequence]
        for method in methods:
            stages = records.get((sequence, method), {}).get("stages", {})
            stage = stages.get("translation averaging")
            row.append(stage["processor_seconds"] if stage else None)
        table.rows.append(row)
    table.add_mean()
    return table


def memory(records, sequences, methods):
    """Peak memory of the whole process, of runs that made a model."""
    table = Table("peak_memory", "Peak memory (MiB)", ["sequence", *methods], 0,
                  min)
    for sequence in sequences:
        found = [records.get((sequence, m), {}) for m in methods]
        table.rows.append([sequence, *[
            r["peak_memory_mib"] if r.get("exit_code") == 0 else None
            for r in found]])
    table.add_mean()
    return table


def geometric_mean(values):
    """(mean, relative standard error); no error, None, of one value."""
    logs = [math.log(v) for v in values]
    mean = sum(logs) / len(logs)
    if len(logs) < 2:
        return math.exp(mean), None
    variance = sum((v - mean) ** 2 for v in logs) / (len(logs) - 1)
    return math.exp(mean), math.sqrt(variance / len(logs))


def over_seeds(records, runs, methods):
    """Two tables: mean position errors over seeds, and ratios to the first
    method.

    runs: {setting: names of its sequences}. A sequence counts if all methods
    have a model of it; a ratio is that of two runs on the same input.
    """
    errors = Table("errors_over_seeds",
                   "Mean position error (m), geometric mean over the seeds",
                   ["setting", "seeds", *methods], 4)
    ratios = Table("ratios_over_seeds",
                   f"Ratio to {methods[0]}: geometric mean and standard "
                   f"error; number of runs where {methods[0]} is lowest",
                   ["setting", "seeds", *methods], 3)
    for setting, names in runs.items():
        found = [[statistic(records.get((name, method)), "position_m", "mean")
                  for method in methods] for name in names]
        found = [row for row in found if None not in row]
        start = [setting, str(len(found))]
        if not found:
            for table in (errors, ratios):
                table.rows.append([*start, *[None for _ in methods]])
            continue
        columns = list(zip(*found))
        errors.rows.append([*start, *[geometric_mean(c)[0] for c in columns]])
        lowest = sum(r[0] <= min(r) for r in found)
        ratios.rows.append([*start, f"lowest {lowest} times",
                            *[ratio_cell(c, columns[0]) for c in columns[1:]]])
    return [errors, ratios]


def ratio_cell(values, first):
    """Geometric mean of values / first, and its standard error."""
    mean, error = geometric_mean([v / f for v, f in zip(values, first)])
    return (f"{mean:.3f}" if error is None
            else f"{mean:.3f} +- {mean * error:.3f}")
