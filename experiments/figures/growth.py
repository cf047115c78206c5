# SPDX-License-Identifier: BSD-3-Clause
"""Time and memory over the number of observations."""
import matplotlib.pyplot as plt
import matplotlib.ticker

from experiments.figures import style

FIRST_COLOR = "#222"


def draw(seconds_curves, memory_curves, path):
    """Processor seconds of the mapper (above) and its peak memory in MiB
    (below), on logarithmic axes.

    A curve is (label, [(observations, value), ...]); the first is the total.
    """
    figure, (seconds, memory) = plt.subplots(
        2, 1, sharex=True, figsize=(8.0, 6.0), constrained_layout=True,
        gridspec_kw={"height_ratios": [2, 1]})
    plot(seconds, seconds_curves)
    plot(memory, memory_curves)
    seconds.set_ylabel("processor time of the mapper (s)")
    memory.set_ylabel("peak memory (MiB)")
    memory.set_xlabel("observations")
    set_number_labels(memory.xaxis)
    set_number_labels(memory.yaxis)
    seconds.yaxis.set_major_formatter("{x:g}")
    style.save(figure, path)


def plot(axes, curves):
    """Curves with points, and a legend with their exponents."""
    colors = [FIRST_COLOR, *style.COLORS]
    for k, (label, points) in enumerate(curves):
        if points:
            axes.loglog(*zip(*points), "o-", color=colors[k % len(colors)],
                        markersize=4, label=label)
    axes.grid(color=style.GRID, which="both")
    axes.set_axisbelow(True)
    if axes.lines:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5),
                    fontsize="small", title="exponent", title_fontsize="small")


def set_number_labels(axis):
    """Labels at 1, 2 and 5 times powers of ten, as plain numbers."""
    axis.set_major_locator(matplotlib.ticker.LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(matplotlib.ticker.StrMethodFormatter("{x:,.0f}"))
    axis.set_minor_locator(matplotlib.ticker.NullLocator())
