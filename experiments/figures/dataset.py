# SPDX-License-Identifier: BSD-3-Clause
"""All figures of the runs on a data set."""
import matplotlib.pyplot as plt
import numpy as np

from experiments import colmap_model
from experiments.figures import style, trajectories


def draw(work, sequences, records):
    """WORK/pictures: paths, errors along them, and run times."""
    folder = work / "pictures"
    folder.mkdir(exist_ok=True)
    for sequence in sequences:
        truth = sequence.truth_positions()
        found = trajectories_of(work, sequence.name, truth, records)
        if not found:
            continue
        trajectories.draw_paths(found, truth,
                                folder / f"{sequence.name}_paths",
                                f"{sequence.name}, from above")
        trajectories.draw_errors(found, folder / f"{sequence.name}_errors",
                                 f"{sequence.name}, along the path")
    draw_runtime(records, folder / "runtime")


def trajectories_of(work, name, truth, records):
    """{method: Trajectory} of the runs on a sequence."""
    found = {}
    for record in records:
        errors = record.get("errors") or {}
        if record["sequence"] == name and "world_from_model" in errors:
            one = trajectory_of(truth, work / record["model"], errors)
            if one:
                found[record["method"]] = one
    return found


def trajectory_of(truth, model, errors):
    """None if the model was removed or lacks the reference camera."""
    if not truth or not model.exists():
        return None
    one = trajectories.Trajectory(truth, colmap_model.read_positions(model),
                                  errors)
    return one if len(one.errors_m) > 1 else None


def draw_runtime(records, path):
    """Seconds of each method, grouped by sequence; no figure without any."""
    sequences = list(dict.fromkeys(r["sequence"] for r in records))
    methods = list(dict.fromkeys(r["method"] for r in records))
    seconds = {(r["sequence"], r["method"]): r.get("seconds_counted")
               for r in records}
    if not any(seconds.values()):
        return
    figure, axes = plt.subplots(
        figsize=(max(7.0, 1.6 + 0.16 * len(sequences) * len(methods)), 4.2),
        constrained_layout=True)
    width = 0.8 / len(methods)
    for k, method in enumerate(methods):
        at = [i + (k + 0.5) * width - 0.4 for i in range(len(sequences))]
        axes.bar(at, [seconds.get((s, method)) or np.nan for s in sequences],
                 width, label=method)
    style.set_log_scale(axes)
    axes.set_xticks(range(len(sequences)))
    axes.set_xticklabels(sequences)
    axes.set_xlabel("sequence")
    axes.set_ylabel("seconds without\nview-graph construction")
    axes.grid(color=style.GRID, axis="y", which="both")
    axes.set_axisbelow(True)
    style.legend_outside(axes)
    style.save_both(figure, path)
