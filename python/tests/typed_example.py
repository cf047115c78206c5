# SPDX-License-Identifier: BSD-3-Clause
"""Uses all kinds of objects; test_types.py checks it with mypy --strict."""

from pathlib import Path
from typing import List, Tuple

import numpy as np
import pymgsfm


def centers_of(model: pymgsfm.Reconstruction) -> List[Tuple[str, float]]:
    return [(image.name, float(image.projection_center()[0]))
            for image in model.images.values()]


def map_and_adjust(database: Path, output: Path) -> float:
    options = pymgsfm.Options("mapper")
    options.Tracks.min_track_length = 2
    models = pymgsfm.global_mapping(
        database, None, output, options,
        progress=lambda stage, done, total: print(stage, done, total))
    model = pymgsfm.bundle_adjustment(
        models[0], {"BundleAdjustment": {"max_num_iterations": 5}})
    frame = next(iter(model.frames.values()))
    point: float = model.points3D[1].xyz[0]
    pose: pymgsfm.Rigid3d = frame.rig_from_world * pymgsfm.Rigid3d()
    rotated = pose.rotation * np.ones(3)
    return point + float(rotated.sum()) + len(centers_of(model))


def average(graph: pymgsfm.ViewGraph) -> List[bool]:
    rig = [pymgsfm.Rigid3d(), None]
    try:
        rotations = pymgsfm.average_rotations(graph, rig)
        positions = pymgsfm.average_translations(graph, rotations, rig)
    except pymgsfm.InputError as error:
        print(error)
        return []
    return [pose is not None for pose in positions.rig_from_world(rotations)]
