# SPDX-License-Identifier: BSD-3-Clause
"""The lenses and the figures of the study of unknown lenses."""
import math

import pytest

from experiments.studies import lenses


@pytest.mark.parametrize("lens", lenses.LENSES)
def test_the_field_of_view_spans_the_width(lens):
    _, params = lens.model_and_params()
    angle = math.radians(lens.fov_deg / 2)
    x = angle if lens.is_fisheye else math.tan(angle)
    k1, k2 = lens.radial
    assert params[0] * (x + k1 * x ** 3 + k2 * x ** 5) == pytest.approx(
        lenses.WIDTH / 2)


@pytest.mark.parametrize("lens", lenses.LENSES)
def test_radii_grow_up_to_the_edge(lens):
    half = math.radians(lens.fov_deg / 2)
    largest = half if lens.is_fisheye else math.tan(half)
    k1, k2 = lens.radial
    radii = [x + k1 * x ** 3 + k2 * x ** 5
             for x in (largest * i / 50 for i in range(51))]
    assert radii == sorted(radii)


def test_a_rig_has_different_lenses_and_always_the_same():
    first = lenses.lenses_of("drone", "around", "1")
    assert len(set(first)) == 3
    assert first == lenses.lenses_of("drone", "around", "1")


def test_false_claims_are_counted():
    rows = [{"error": 0.1, "sigma": 0.2, "source": "pairs"},
            {"error": -0.1, "sigma": 0.01, "source": "adjustment"},
            {"error": 0.001, "sigma": None, "source": "given"},
            {"error": None, "sigma": None, "source": "no model"}]
    text = lenses.summary_of(rows)
    assert "3 of 4 cameras" in text
    assert "median error 10.00 %" in text
    assert "; 1 within two" in text
    assert "; 1 wrong by over 5 %" in text
