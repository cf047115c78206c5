# SPDX-License-Identifier: BSD-3-Clause
"""Files, axes and colors of all figures."""
import math

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

# The same results give the same files.
plt.rcParams["svg.hashsalt"] = "mgsfm"
COLORS = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#8c564b", "#e377c2",
          "#bcbd22", "#17becf"]
GRID = "#e6e6e6"


def save(figure, path):
    """Writes an .svg or .png file, and closes the figure."""
    figure.savefig(path, dpi=110, metadata={"Date": None}
                   if path.suffix == ".svg" else None)
    plt.close(figure)


def save_both(figure, path):
    """Writes PATH.svg and PATH.png."""
    for suffix in (".svg", ".png"):
        figure.savefig(path.with_name(path.name + suffix), dpi=110,
                       metadata={"Date": None} if suffix == ".svg" else None)
    plt.close(figure)
    print(f"wrote {path}.svg and .png")


def set_log_scale(axes):
    """A logarithmic y axis from one power of ten to another."""
    axes.set_yscale("log")
    low, high = axes.dataLim.intervaly
    low = axes.dataLim.minposy if low <= 0.0 else low
    lowest = math.floor(math.log10(low))
    highest = max(math.ceil(math.log10(high)), lowest + 1)
    axes.set_ylim(10.0 ** lowest, 10.0 ** highest)
    axes.yaxis.set_major_formatter("{x:g}")


def legend_outside(axes):
    """A legend to the right of the axes."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
