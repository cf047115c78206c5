# SPDX-License-Identifier: BSD-3-Clause
"""Values and axes of figures; pixels are not compared."""
import sys

import pytest

pytest.importorskip("matplotlib")
import numpy as np  # noqa: E402

from experiments.figures import (growth, robustness, style,  # noqa: E402
                                 trajectories)
from experiments.studies import growth_numbers  # noqa: E402
from experiments.studies.robustness import SWEEPS  # noqa: E402
from studies_test import growth_runs  # noqa: E402

ERRORS = {"position_m": {"mean": 0.5},
          "world_from_model": {"scale": 2.0, "translation_m": [1, 0, 0],
                               "rotation_wxyz": [0.5 ** 0.5, 0, 0, 0.5 ** 0.5]}}


@pytest.fixture
def kept(monkeypatch):
    """Figures are kept, not written, and given here."""
    figures = []
    for name in ("save", "save_both"):
        monkeypatch.setattr(style, name,
                            lambda figure, path: figures.append(figure))
    yield figures
    for figure in figures:
        style.plt.close(figure)


def test_trajectories_are_aligned():
    # A turn by 90 deg about z: x becomes y.
    truth = {f"cam0/{i}.png": (1.0, 2.0 * i, 0.0) for i in range(3)}
    truth["cam1/0.png"] = (9.0, 9.0, 9.0)
    model = {name: (0.5 * (y + 0.2), 0.0, 0.0)
             for name, (_, y, _) in truth.items()}
    one = trajectories.Trajectory(truth, model, ERRORS)
    assert one.true_m.shape == (3, 3)
    assert one.driven_m == pytest.approx([0.0, 2.0, 4.0])
    assert one.errors_m == pytest.approx([0.2, 0.2, 0.2])


def test_images_that_are_not_registered_are_not_drawn():
    truth = {f"cam0/{i}.png": (1.0, 2.0 * i, 0.0) for i in range(3)}
    one = trajectories.Trajectory(truth, {"cam0/1.png": (0, 0, 0)}, ERRORS)
    assert one.estimate_m == pytest.approx(np.array([[1.0, 0.0, 0.0]]))


def test_the_plane_of_a_flat_path():
    points = np.array([[0, 0, 0], [4, 0, 0], [4, 0, 3], [0, 0, 3.0]])
    plane = trajectories.main_plane(points)
    assert np.abs(plane[:, 1]) == pytest.approx([0, 0], abs=1e-12)
    assert plane @ plane.T == pytest.approx(np.eye(2), abs=1e-12)


def test_a_straight_path_gets_some_width():
    low, high = trajectories.limits_around(np.array([[0.0, 0.0], [10.0, 0.0]]))
    assert low == pytest.approx([-1.0, -2.4])
    assert high == pytest.approx([11.0, 2.4])


def test_logarithmic_axes_end_at_powers_of_ten():
    figure, axes = style.plt.subplots()
    axes.plot([0, 1], [0.02, 3.0])
    style.set_log_scale(axes)
    assert axes.get_ylim() == pytest.approx((0.01, 10.0))
    style.plt.close(figure)


def curves():
    return growth_numbers.figure_curves(growth_runs())


def test_growth_shows_stages_with_exponents(kept, tmp_path):
    growth.draw(*curves(), tmp_path / "growth.svg")
    seconds, memory = kept[0].axes
    labels = [line.get_label() for line in seconds.lines]
    total = np.polyfit(np.log([1000, 4000, 9000]), np.log([4, 18, 56]), 1)[0]
    assert labels == [f"total, {total:.2f}", "reading, 0.00", "tracks, 1.50"]
    assert [line.get_label() for line in memory.lines] == ["total, 0.50"]
    tracks = seconds.lines[2]
    assert tracks.get_xdata() == pytest.approx([1000, 4000, 9000])
    assert tracks.get_ydata() == pytest.approx([2.0, 16.0, 54.0])
    assert seconds.get_xscale() == seconds.get_yscale() == "log"


def test_growth_omits_short_stages(kept, tmp_path):
    runs = growth_runs()
    for run in runs:
        run.costs["reading"]["processor_seconds"] = 0.001
    growth.draw(*growth_numbers.figure_curves(runs), tmp_path / "growth.svg")
    labels = [line.get_label() for line in kept[0].axes[0].lines]
    assert [label.split(",")[0] for label in labels] == ["total", "tracks"]


def test_robustness_shows_mapper_and_oracle(kept, tmp_path):
    curves = {"stereo": {"mapper_m": {0.0: 0.02, 10.0: 0.05},
                         "full_oracle_m": {0.0: 0.01, 10.0: 0.02},
                         "registered_percent": {0.0: 100.0, 10.0: 90.0}}}
    robustness.draw(curves, SWEEPS["mismatch_ratio"], tmp_path / "a.svg")
    errors, shares = kept[0].axes
    dashed, solid = errors.lines
    assert (dashed.get_linestyle(), solid.get_linestyle()) == ("--", "-")
    assert dashed.get_color() == solid.get_color()
    assert list(solid.get_ydata()) == [0.02, 0.05]
    assert list(shares.lines[0].get_ydata()) == [100.0, 90.0]
    assert errors.get_title() == "Mismatches"
    assert shares.get_xlabel() == "mismatches before verification, %"


def test_robustness_without_any_model(tmp_path):
    curves = {"stereo": {"mapper_m": {}, "full_oracle_m": {},
                         "registered_percent": {0.0: 0.0}}}
    robustness.draw(curves, SWEEPS["mismatch_ratio"], tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_files_do_not_depend_on_the_clock(tmp_path):
    for name in ("a.svg", "b.svg"):
        growth.draw(*curves(), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (
        tmp_path / "b.svg").read_bytes()


def test_nothing_is_shown_on_a_display():
    assert style.matplotlib.get_backend().lower() == "agg"
    assert "tkinter" not in sys.modules
