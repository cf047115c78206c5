# SPDX-License-Identifier: BSD-3-Clause
"""Error and registered share over a setting of the simulation."""
import matplotlib.lines
import matplotlib.pyplot as plt

from experiments.figures import style


def draw(curves, sweep, path):
    """Above, on a logarithmic axis, the mean position error of the mapper, and
    dashed that of the full oracle; below, the share of registered images.

    curves: of studies.robustness.make_curves(); one color for each rig.
    """
    figure, (errors, shares) = plt.subplots(
        2, 1, sharex=True, figsize=(6.8, 5.4), constrained_layout=True,
        gridspec_kw={"height_ratios": [2, 1]})
    for k, (rig, one) in enumerate(curves.items()):
        # Thinner and thinner, so that no curve hides another.
        look = {"color": style.COLORS[k % len(style.COLORS)],
                "linewidth": max(1.0, 3.0 - 1.5 * k),
                "markersize": max(3.0, 6.0 - 2.0 * k)}
        plot(errors, one["full_oracle_m"], "--", look)
        plot(errors, one["mapper_m"], "o-", look)
        plot(shares, one["registered_percent"], "o-", {**look, "label": rig})
    errors.set_title(sweep.title)
    if any(one["mapper_m"] for one in curves.values()):
        style.set_log_scale(errors)
    errors.set_ylabel("position error, mean (m)")
    shares.set_ylabel("registered (%)")
    shares.set_ylim(0.0, 105.0)
    shares.set_yticks([0, 25, 50, 75, 100])
    shares.set_xlabel(sweep.x_label)
    for axes in (errors, shares):
        axes.grid(color=style.GRID, which="both")
    errors.legend(handles=[
        matplotlib.lines.Line2D([], [], color="#444", marker="o",
                                label="mapper"),
        matplotlib.lines.Line2D([], [], color="#444", linestyle="--",
                                label="full oracle")],
        loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    style.legend_outside(shares)
    style.save(figure, path)


def plot(axes, curve, line, look):
    """One curve {x: y}."""
    axes.plot(list(curve), list(curve.values()), line, **look)
