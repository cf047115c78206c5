# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories from above, and position errors along them."""
import math

import matplotlib.pyplot as plt
import numpy as np

from experiments import poses
from experiments.figures import style

TRUE_COLOR = "#d1495b"
COLUMNS = 3
MIN_ERROR_M = 1e-4  # smaller errors are drawn here, on a logarithmic axis


class Trajectory:
    """The aligned path of the reference camera, in the order of the drive.

    true_m, estimate_m: n x 3 positions; driven_m: n distances from the start;
    errors_m: n position errors.
    """

    def __init__(self, truth, model, errors):
        """truth, model: {image name: position}. errors: of the model, as
        model_evaluator reports them, with the alignment."""
        prefix = reference_prefix(truth)
        names = [n for n in sorted(truth)
                 if n in model and n.startswith(prefix)]
        self.true_m = np.array([truth[n] for n in names]).reshape(-1, 3)
        aligned = errors["world_from_model"]
        rotation = np.array(
            poses.rotation_from_quaternion(*aligned["rotation_wxyz"]))
        estimate = np.array([model[n] for n in names]).reshape(-1, 3)
        self.estimate_m = (aligned["scale"] * estimate @ rotation.T
                           + aligned["translation_m"])
        self.mean_error_m = errors["position_m"]["mean"]
        steps = np.linalg.norm(np.diff(self.true_m, axis=0), axis=1)
        self.driven_m = np.concatenate([[0.0], np.cumsum(steps)])
        self.errors_m = np.linalg.norm(self.estimate_m - self.true_m, axis=1)


def reference_prefix(names):
    """The folder of the first image, with a slash; "" without folders."""
    first = sorted(names)[0]
    return first.rpartition("/")[0] + "/" if "/" in first else ""


def main_plane(points):
    """2 x 3: the axes of the plane that n x 3 points are closest to."""
    centered = points - points.mean(0)
    _, _, vt = np.linalg.svd(centered, full_matrices=False)
    return vt[:2]


def limits_around(points):
    """The lower and upper corner of the drawn area around n x 2 true points;
    a straight drive gets some width, too."""
    low, high = points.min(0), points.max(0)
    middle = 0.5 * (low + high)
    half = 0.6 * np.maximum(high - low, 0.4 * (high - low).max())
    return middle - half, middle + half


def draw_paths(trajectories, truth, path, title):
    """A map for each method, the estimate over the truth.

    trajectories: {method: Trajectory}. path: of the files, without suffix.
    """
    prefix = reference_prefix(truth)
    true = np.array([truth[n] for n in sorted(truth) if n.startswith(prefix)])
    plane = main_plane(true)
    true = true @ plane.T
    low, high = limits_around(true)
    height = 3.6 * (high[1] - low[1]) / (high[0] - low[0]) + 0.8
    rows = math.ceil(len(trajectories) / COLUMNS)
    columns = min(COLUMNS, len(trajectories))
    figure, grid = plt.subplots(rows, columns, squeeze=False,
                                figsize=(4.2 * columns, height * rows + 0.4),
                                sharex=True, sharey=True,
                                constrained_layout=True)
    figure.suptitle(title)
    for axes in grid.flat[len(trajectories):]:
        axes.set_visible(False)
    for k, (method, one) in enumerate(trajectories.items()):
        draw_map(grid.flat[k], true, one.estimate_m @ plane.T)
        grid.flat[k].set_title(f"{method}: mean {one.mean_error_m:.3g} m")
        # Only where no other map is below.
        grid.flat[k].tick_params(labelbottom=k + columns >= len(trajectories))
    grid.flat[0].set_xlim(low[0], high[0])
    grid.flat[0].set_ylim(low[1], high[1])
    grid.flat[0].legend(loc="best", fontsize="small")
    style.save_both(figure, path)


def draw_map(axes, true, estimate):
    """n x 2 true and m x 2 estimated positions, in meters."""
    axes.plot(*true.T, color=TRUE_COLOR, linewidth=2.5, label="truth")
    axes.plot(*estimate.T, color="black", linewidth=1.0, label="estimate")
    axes.set_aspect("equal")
    axes.set_xlabel("m")
    axes.set_ylabel("m")
    axes.grid(color=style.GRID)


def draw_errors(trajectories, path, title):
    """Position errors over the distance driven, one curve for each method."""
    figure, axes = plt.subplots(figsize=(9.0, 4.0), constrained_layout=True)
    # Thinner and thinner, so that no curve hides another.
    for k, (method, one) in enumerate(trajectories.items()):
        axes.plot(one.driven_m, np.maximum(one.errors_m, MIN_ERROR_M),
                  label=method, linewidth=max(1.0, 3.4 - 0.8 * k))
    style.set_log_scale(axes)
    axes.set_xlabel("distance driven (m)")
    axes.set_ylabel("position error (m)")
    axes.set_title(title)
    axes.grid(color=style.GRID, which="both")
    style.legend_outside(axes)
    style.save_both(figure, path)
