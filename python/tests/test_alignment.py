# SPDX-License-Identifier: BSD-3-Clause
"""Models that were moved are moved back."""

import numpy as np
import pymgsfm
import pytest

TRUE = pymgsfm.Sim3d(3.0, [0.2, -0.1, 0.4], [5.0, -2.0, 1.0])


@pytest.fixture
def moved(model):
    other = pymgsfm.Reconstruction(model)
    other.transform(TRUE)
    return other


def assert_true(transform):
    np.testing.assert_allclose(transform.matrix(), TRUE.matrix(), rtol=1e-6,
                               atol=1e-5)


def test_alignment_by_images(model, moved):
    assert_true(pymgsfm.align_reconstructions_via_proj_centers(
        model, moved, 0.1))
    assert_true(pymgsfm.align_reconstructions_via_reprojections(model, moved))


def test_alignment_to_locations(model, moved):
    images = list(moved.images.values())
    names = [image.name for image in images]
    locations = np.array([image.projection_center() for image in images])
    locations[0] += 100.0  # an outlier
    assert_true(pymgsfm.align_reconstruction_to_locations(
        model, names, locations, 3, pymgsfm.RANSACOptions(max_error=0.5)))
    assert pymgsfm.align_reconstruction_to_locations(
        model, names[:2], locations[:2], 3) is None
    with pytest.raises(pymgsfm.InputError, match="row per name"):
        pymgsfm.align_reconstruction_to_locations(model, names, locations[:2])


def test_comparison(model, moved, drive):
    same = pymgsfm.compare_reconstructions(model, moved)
    assert_true(same["rec2_from_rec1"])
    assert len(same["errors"]) == model.num_reg_images()
    assert max(error.proj_center_error for error in same["errors"]) < 1e-4
    image = next(iter(moved.images.values()))
    frame = moved.frames[image.frame_id]
    frame.rig_from_world = pymgsfm.Rigid3d(
        pymgsfm.Rotation3d([0.0, np.deg2rad(2.0), 0.0])
        * frame.rig_from_world.rotation, frame.rig_from_world.translation)
    turned = {error.image_name: error for error in
              pymgsfm.compare_reconstructions(
                  model, moved, "proj_center",
                  max_proj_center_error=0.1)["errors"]}
    assert turned[image.name].rotation_error_deg == pytest.approx(2.0, abs=0.05)
    truth = pymgsfm.Reconstruction(drive / "truth")
    against = pymgsfm.compare_reconstructions(model, truth, "proj_center",
                                              max_proj_center_error=0.5)
    assert np.median([e.proj_center_error for e in against["errors"]]) < 0.1


def test_models_that_differ(model, moved):
    random = np.random.default_rng(7)
    for frame in moved.frames.values():
        frame.rig_from_world = pymgsfm.Rigid3d(
            random.normal(size=3), 10.0 * random.normal(size=3))
    assert pymgsfm.compare_reconstructions(model, moved) is None
    for image in moved.images.values():
        image.name = "other/" + image.name
    assert pymgsfm.align_reconstructions_via_proj_centers(
        model, moved, 0.1) is None
