# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of the experiments, as SVG and PNG, by matplotlib."""
import math

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

import experiments  # noqa: E402

# The same files for the same results.
plt.rcParams["svg.hashsalt"] = "mgsfm"
TRUE_COLOR = "#d1495b"
COLUMNS = 3


class Path:
    """An aligned path of the reference camera, in the order of the drive."""

    def __init__(self, truth, model, errors):
        """errors: of the model, as model_evaluator has them."""
        prefix = reference_prefix(truth)
        names = [n for n in sorted(truth)
                 if n in model and n.startswith(prefix)]
        self.true = np.array([truth[n] for n in names]).reshape(-1, 3)
        aligned = errors["world_from_model"]
        rotation = np.array(
            experiments.rotation_rows(*aligned["rotation_wxyz"]))
        estimate = np.array([model[n] for n in names]).reshape(-1, 3)
        self.estimate = (aligned["scale"] * estimate @ rotation.T
                         + aligned["translation_m"])
        self.mean_error = errors["position_m"]["mean"]
        steps = np.linalg.norm(np.diff(self.true, axis=0), axis=1)
        self.driven = np.concatenate([[0.0], np.cumsum(steps)])
        self.errors = np.linalg.norm(self.estimate - self.true, axis=1)


def reference_prefix(names):
    first = sorted(names)[0]
    return first.rpartition("/")[0] + "/" if "/" in first else ""


def plane_from_above(points):
    """Two axes of the plane in which a path mostly lies."""
    centered = points - points.mean(0)
    _, _, vt = np.linalg.svd(centered, full_matrices=False)
    return vt[:2]


def save(figure, path):
    for suffix in (".svg", ".png"):
        figure.savefig(path.with_name(path.name + suffix), dpi=110,
                       metadata={"Date": None} if suffix == ".svg" else None)
    plt.close(figure)
    print(f"wrote {path}.svg and .png")


def limits_around(points):
    """Of the truth, whatever the estimates are, and not too narrow."""
    low, high = points.min(0), points.max(0)
    middle = 0.5 * (low + high)
    half = 0.6 * np.maximum(high - low, 0.4 * (high - low).max())
    return middle - half, middle + half


def set_log_scale(axes):
    """From one power of ten to another."""
    axes.set_yscale("log")
    low, high = axes.dataLim.intervaly
    low = axes.dataLim.minposy if low <= 0.0 else low
    lowest = math.floor(math.log10(low))
    highest = max(math.ceil(math.log10(high)), lowest + 1)
    axes.set_ylim(10.0 ** lowest, 10.0 ** highest)
    axes.yaxis.set_major_formatter("{x:g}")


def draw_paths(paths, truth, path, title):
    """A map for each method, the estimate over the truth."""
    prefix = reference_prefix(truth)
    true = np.array([truth[n] for n in sorted(truth) if n.startswith(prefix)])
    axes_2d = plane_from_above(true)
    true = true @ axes_2d.T
    low, high = limits_around(true)
    height = 3.6 * (high[1] - low[1]) / (high[0] - low[0]) + 0.8
    rows = math.ceil(len(paths) / COLUMNS)
    columns = min(COLUMNS, len(paths))
    figure, grid = plt.subplots(rows, columns, squeeze=False,
                                figsize=(4.2 * columns, height * rows + 0.4),
                                sharex=True, sharey=True,
                                constrained_layout=True)
    figure.suptitle(title)
    for axes in grid.flat[len(paths):]:
        axes.set_visible(False)
    for k, (method, one) in enumerate(paths.items()):
        axes = grid.flat[k]
        estimate = one.estimate @ axes_2d.T
        axes.plot(*true.T, color=TRUE_COLOR, linewidth=2.5, label="truth")
        axes.plot(*estimate.T, color="black", linewidth=1.0, label="estimate")
        axes.set_aspect("equal")
        axes.set_title(f"{method}: mean {one.mean_error:.3g} m")
        axes.set_xlabel("m")
        axes.set_ylabel("m")
        axes.grid(color="#e6e6e6")
        # Where nothing is below.
        axes.tick_params(labelbottom=k + columns >= len(paths))
    grid.flat[0].set_xlim(low[0], high[0])
    grid.flat[0].set_ylim(low[1], high[1])
    grid.flat[0].legend(loc="best", fontsize="small")
    save(figure, path)


def draw_errors(paths, path, title):
    figure, axes = plt.subplots(figsize=(9.0, 4.0), constrained_layout=True)
    # Thinner and thinner, so that none hides another.
    for k, (method, one) in enumerate(paths.items()):
        axes.plot(one.driven, np.maximum(one.errors, 1e-4), label=method,
                  linewidth=max(1.0, 3.4 - 0.8 * k))
    set_log_scale(axes)
    axes.set_xlabel("distance driven (m)")
    axes.set_ylabel("position error (m)")
    axes.set_title(title)
    axes.grid(color="#e6e6e6", which="both")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    save(figure, path)


def draw_runtime(records, path):
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
    set_log_scale(axes)
    axes.set_xticks(range(len(sequences)))
    axes.set_xticklabels(sequences)
    axes.set_xlabel("sequence")
    axes.set_ylabel("seconds without\nview-graph construction")
    axes.grid(color="#e6e6e6", axis="y", which="both")
    axes.set_axisbelow(True)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    save(figure, path)


def path_of(truth, model, errors):
    """None if the model was removed, or shows the reference camera nowhere."""
    if not truth or not model.exists():
        return None
    path = Path(truth, experiments.read_positions(model), errors)
    return path if len(path.errors) > 1 else None


def draw(work, sequences, records):
    folder = work / "pictures"
    folder.mkdir(exist_ok=True)
    for sequence in sequences:
        truth = sequence.truth_positions()
        paths = {}
        for record in records:
            errors = record.get("errors") or {}
            if (record["sequence"] == sequence.name
                    and "world_from_model" in errors):
                path = path_of(truth, work / record["model"], errors)
                if path:
                    paths[record["method"]] = path
        if not paths:
            continue
        draw_paths(paths, truth, folder / f"{sequence.name}_paths",
                   f"{sequence.name}, from above")
        draw_errors(paths, folder / f"{sequence.name}_errors",
                    f"{sequence.name}, along the path")
    draw_runtime(records, folder / "runtime")
