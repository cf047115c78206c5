# SPDX-License-Identifier: BSD-3-Clause
"""Averaging of the caller's own relative poses, with the rig as input."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence

import numpy as np
import numpy.typing as npt

from . import _core
from .commands import Log, Progress, log_to_logging
from .geometry import FloatArray, Rigid3d, Rotation3d
from .options import OptionsLike, to_texts

IntArray = npt.NDArray[np.int32]


def _integers(values: npt.ArrayLike, name: str) -> IntArray:
    given = np.asarray(values)
    with np.errstate(invalid="ignore"):
        converted: IntArray = given.astype(np.int32)
    different = np.argwhere(converted != given)
    if len(different):
        at = tuple(int(i) for i in different[0])
        raise _core.InputError(
            f"{name}{list(at)} is {given[at]}; must be an integer of 32 bits")
    return converted


class ViewGraph:
    """Relative poses of pairs of images.

    Args:
      frame_idxs: (I,) the frame of each image, from 0.
      sensor_idxs: (I,) the sensor of each image in the rig, from 0; None: all
        images are of sensor 0. Images of a frame have different sensors.
      pairs: (P, 2) indices of two images; each pair at most once.
      rotations: (P, 4) quaternions x y z w of cam2_from_cam1, where camera 1 is
        that of the first image: x_in_cam2 = R x_in_cam1 + t.
      translations: (P, 3) t up to its length, in camera 2. Rows that are zero
        or NaN mean that the pair has no parallax. None: rotations only.
      num_matches: (P,) the support of each pair; its weight grows with it up to
        200 matches. None: equal weights.
    """

    def __init__(self, frame_idxs: npt.ArrayLike,
                 sensor_idxs: Optional[npt.ArrayLike], pairs: npt.ArrayLike,
                 rotations: npt.ArrayLike,
                 translations: Optional[npt.ArrayLike] = None,
                 num_matches: Optional[npt.ArrayLike] = None) -> None:
        self.frame_idxs: IntArray = _integers(frame_idxs, "frame_idxs")
        self.pairs: IntArray = _integers(pairs, "pairs")
        self.rotations: FloatArray = np.asarray(rotations, np.float64)
        self.sensor_idxs: IntArray = (
            np.zeros_like(self.frame_idxs) if sensor_idxs is None
            else _integers(sensor_idxs, "sensor_idxs"))
        self.translations: FloatArray = (
            np.full((len(self.pairs), 3), np.nan) if translations is None
            else np.asarray(translations, np.float64))
        self.num_matches: IntArray = (
            np.ones(len(self.pairs), np.int32) if num_matches is None
            else _integers(num_matches, "num_matches"))

    def _arrays(self) -> Dict[str, Any]:
        return dict(vars(self))


SensorPoses = Sequence[Optional[Rigid3d]]
ONE_CAMERA: SensorPoses = (Rigid3d(),)


@dataclass
class SensorState:
    """Whether the data determine a sensor, and how or why not.

    Attributes:
      num_samples, median_deviation_deg: Frames that contributed to a rotation,
        and their median deviation; None: not of this sensor.
    """

    is_observable: bool
    message: str
    num_samples: Optional[int] = None
    median_deviation_deg: Optional[float] = None


@dataclass
class Rotations:
    """The result of average_rotations. Rows of NaN: not estimated.

    Attributes:
      rig_from_world: (F, 4) quaternions x, y, z, w of the frames.
      sensor_from_rig: (S, 4) quaternions x, y, z, w of the sensors.
      pair_is_inlier: (P,) 1 if the pair agrees with the estimate.
      components: (F,) connected component of each frame, the largest is 0; -1:
        none. Each component has a world of its own.
      sensors: A SensorState for each sensor.
      summary: The keys of rotation_averaging in report.json
        (docs/reference/report.md).
    """

    rig_from_world: FloatArray
    sensor_from_rig: FloatArray
    pair_is_inlier: npt.NDArray[np.uint8]
    components: IntArray
    sensors: List[SensorState]
    summary: Dict[str, Any] = field(default_factory=dict)


@dataclass
class Translations:
    """The result of average_translations. Rows of NaN: not estimated.

    Attributes:
      centers: (F, 3) origins of the rig in the world.
      sensor_from_rig: (S, 3) translations of the sensors.
      is_metric: The known poses of sensors determine the unit of length; else
        the median baseline is about 1.
      sensors: A SensorState for each sensor.
      summary: The keys of translation_averaging in report.json.
    """

    centers: FloatArray
    sensor_from_rig: FloatArray
    is_metric: bool
    sensors: List[SensorState]
    summary: Dict[str, Any] = field(default_factory=dict)

    def rig_from_world(self, rotations: Rotations) -> List[Optional[Rigid3d]]:
        """The poses of the frames; None: not estimated."""
        return _join(rotations.rig_from_world, self.centers, is_center=True)

    def sensor_from_rig_poses(self, rotations: Rotations
                              ) -> List[Optional[Rigid3d]]:
        """The poses of the sensors; None: not estimated."""
        return _join(rotations.sensor_from_rig, self.sensor_from_rig,
                     is_center=False)


def average_rotations(graph: ViewGraph, sensor_from_rig: SensorPoses = ONE_CAMERA,
                      options: OptionsLike = None, *,
                      log: Optional[Log] = None,
                      progress: Optional[Progress] = None) -> Rotations:
    """Estimates the rotations of frames and of unknown sensors.

    Args:
      sensor_from_rig: Poses of the sensors in the rig; None: estimated. The
        first sensor is the reference and must be the identity.
      options: Of the group RotationAveraging of the command mapper, without
        its name (docs/maths/rotation_averaging.md).

    Raises InputError if the graph has no pair.
    """
    result = _core.average_rotations(
        graph._arrays(), _rows(sensor_from_rig), to_texts(options),
        log or log_to_logging, progress)
    return Rotations(**_with_states(result))


def average_translations(graph: ViewGraph, rotations: Rotations,
                         sensor_from_rig: SensorPoses = ONE_CAMERA,
                         options: OptionsLike = None, component: int = 0, *,
                         log: Optional[Log] = None,
                         progress: Optional[Progress] = None) -> Translations:
    """Estimates the positions of the frames of one component, and those of
    unknown sensors, from the directions of the inlier pairs.

    Args:
      rotations: Of average_rotations.
      sensor_from_rig: That of average_rotations.
      options: Of the group TranslationAveraging of the command mapper, without
        its name.
      component: Number of the component in rotations.components.

    Directions alone do not determine the distances along a straight path
    (docs/maths/translation_averaging.md).
    """
    result = _core.average_translations(
        graph._arrays(), _rows(sensor_from_rig),
        dict(vars(rotations), component=component), to_texts(options),
        log or log_to_logging, progress)
    return Translations(**_with_states(result))


def _rows(poses: SensorPoses) -> List[Optional[FloatArray]]:
    return [None if pose is None else pose.row() for pose in poses]


def _with_states(result: Dict[str, Any]) -> Dict[str, Any]:
    result["sensors"] = [SensorState(**row) for row in result["sensors"]]
    return result


def _join(quats: FloatArray, vectors: FloatArray,
          is_center: bool) -> List[Optional[Rigid3d]]:
    poses: List[Optional[Rigid3d]] = []
    for quat, vector in zip(quats, vectors):
        if not (np.isfinite(quat).all() and np.isfinite(vector).all()):
            poses.append(None)
            continue
        rotation = Rotation3d(quat)
        poses.append(Rigid3d(rotation, -(rotation * vector) if is_center
                             else vector))
    return poses
