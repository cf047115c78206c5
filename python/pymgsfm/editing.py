# SPDX-License-Identifier: BSD-3-Clause
"""Building and editing of models in memory, with pycolmap's names.

Edits are written by Reconstruction.write, which raises InputError if they
contradict each other.
"""

from __future__ import annotations

from typing import (Any, Dict, Iterable, Iterator, List, Optional, Tuple,
                    Union)

import numpy as np
import numpy.typing as npt

from . import _core
from .cameras import INVALID_ID, Camera
from .errors import InputError
from .geometry import FloatArray, Rigid3d
from .points import Points3D, Track, TrackElement, _Row, _without
from .scene import INVALID_POINT3D_ID, Frame, Image, Rig

_NO_POINT = np.uint64(INVALID_POINT3D_ID)
_Mask = npt.NDArray[np.bool_]


class Editing:
    """The methods of Reconstruction that change it."""

    cameras: Dict[int, Camera]
    rigs: Dict[int, Rig]
    frames: Dict[int, Frame]
    images: Dict[int, Image]
    points3D: Points3D

    # -------------------------------------------------------------- building

    def add_camera(self, camera: Camera) -> None:
        """Adds a camera with an id of its own."""
        if not camera.verify_params():
            raise InputError(f"camera {camera.camera_id} has wrong parameters "
                             f"for the model {camera.model_name}")
        _add(self.cameras, camera.camera_id, camera, "camera")

    def add_camera_with_trivial_rig(self, camera: Camera) -> None:
        """Adds a camera, and a rig of the same id with this camera only."""
        self.add_camera(camera)
        rig = Rig(camera.camera_id)
        rig.add_ref_sensor(camera.sensor_id)
        self.add_rig(rig)

    def add_rig(self, rig: Rig) -> None:
        """Adds a rig, after its cameras."""
        if rig.ref_camera_id not in rig.sensors:
            raise InputError(f"rig {rig.rig_id} has no reference sensor; call "
                             "add_ref_sensor")
        for camera_id in rig.sensors:
            _get(self.cameras, camera_id, "camera")
        _add(self.rigs, rig.rig_id, rig, "rig")

    def add_frame(self, frame: Frame) -> None:
        """Adds a frame, after its rig and before its images."""
        rig = _get(self.rigs, frame.rig_id, "rig")
        for data_id in frame.data_ids:
            if not rig.has_sensor(data_id.sensor_id):
                raise InputError(f"rig {rig.rig_id} of frame {frame.frame_id} "
                                 f"has no camera {data_id.sensor_id.id}")
        _add(self.frames, frame.frame_id, frame, "frame")
        frame.rig = rig

    def add_image(self, image: Image) -> None:
        """Adds an image, after its camera and frame.

        The frame is that which has the data_id of the image, or that of the
        frame_id of the image.
        """
        camera = _get(self.cameras, image.camera_id, "camera")
        if (image.points2D.point3D_ids != _NO_POINT).any():
            raise InputError(f"image '{image.name}' has keypoints that observe "
                             "points; add it without, then add the points")
        if image.frame_id == INVALID_ID:
            frames = [f for f in self.frames.values()
                      if image.image_id in f.image_ids]
            if not frames:
                raise InputError(f"no frame has the image {image.image_id}; "
                                 "add one, or set image.frame_id")
            frame = frames[0]
        else:
            frame = _get(self.frames, image.frame_id, "frame")
        if not frame.rig.has_sensor(camera.camera_id):
            raise InputError(f"the rig of frame {frame.frame_id} has no camera "
                             f"{camera.camera_id}")
        _check_new(self.images, image.image_id, "image")
        if image.image_id not in frame.image_ids:
            frame.add_data_id(image.data_id)
        self.images[image.image_id] = image
        image.camera, image.frame = camera, frame

    def add_image_with_trivial_frame(
            self, image: Image,
            cam_from_world: Optional[Rigid3d] = None) -> None:
        """Adds an image, and a frame of the same id with this image only.

        The camera must be the reference of the rig of the same id, as
        add_camera_with_trivial_rig makes it.
        """
        rig = _get(self.rigs, image.camera_id, "rig")
        if not rig.is_ref_sensor(image.camera_id):
            raise InputError(f"camera {image.camera_id} is not the reference "
                             f"of rig {rig.rig_id}")
        if image.image_id in self.images:
            raise InputError(f"the model has an image {image.image_id}")
        frame = Frame(image.image_id, rig_id=rig.rig_id,
                      rig_from_world=cam_from_world)
        frame.add_data_id(image.data_id)
        self.add_frame(frame)
        self.add_image(image)

    def add_point3D(self, xyz: npt.ArrayLike,
                    track: Union[Track, Iterable[TrackElement]] = (),
                    color: npt.ArrayLike = (0, 0, 0)) -> int:
        """Adds a point with its observations. Returns its id."""
        array = (track if isinstance(track, Track) else Track(track)).array
        keypoints = [self._free_keypoint(*element) for element in array.tolist()]
        if len({tuple(row) for row in array.tolist()}) < len(array):
            raise InputError("the track has an observation twice")
        point3D_id = self.points3D._add(_Row(xyz, color, -1.0, array))
        for image, point2D_idx in keypoints:
            image.points2D.point3D_ids[point2D_idx] = point3D_id
        return point3D_id

    def add_observation(self, point3D_id: int,
                        track_element: TrackElement) -> None:
        """Adds an observation to a point."""
        track = self.points3D[point3D_id].track.array
        image, point2D_idx = self._free_keypoint(*track_element)
        self.points3D._set_track(point3D_id, np.vstack([track, np.array(
            [track_element], dtype=np.uint32)]))
        image.points2D.point3D_ids[point2D_idx] = point3D_id

    def _free_keypoint(self, image_id: int, point2D_idx: int
                       ) -> Tuple[Image, int]:
        image = _get(self.images, image_id, "image")
        if not 0 <= point2D_idx < len(image.points2D):
            raise InputError(f"image '{image.name}' has no keypoint "
                             f"{point2D_idx}")
        if image.points2D.point3D_ids[point2D_idx] != _NO_POINT:
            raise InputError(f"keypoint {point2D_idx} of image '{image.name}' "
                             "observes a point")
        return image, point2D_idx

    # -------------------------------------------------------------- deleting

    def delete_point3D(self, point3D_id: int) -> None:
        for image_id, point2D_idx in self.points3D[point3D_id].track.elements:
            self._reset_keypoint(image_id, point2D_idx)
        self.points3D._delete(point3D_id)

    def delete_observation(self, image_id: int, point2D_idx: int) -> None:
        """Deletes an observation, and its point if it has only one other."""
        image = _get(self.images, image_id, "image")
        point3D_id = int(image.points2D.point3D_ids[point2D_idx])
        track = self.points3D[point3D_id].track.array
        if len(track) <= 2:
            return self.delete_point3D(point3D_id)
        self.points3D._set_track(point3D_id,
                                 _without(track, image_id, point2D_idx))
        self._reset_keypoint(image_id, point2D_idx)

    def merge_points3D(self, point3D_id1: int, point3D_id2: int) -> int:
        """Replaces two points by their mean, weighted by the lengths of their
        tracks. Returns its id."""
        points = [self.points3D[i] for i in (point3D_id1, point3D_id2)]
        tracks = [point.track.array for point in points]
        weights = [len(track) for track in tracks]
        xyz, color = (np.average([getattr(point, name) for point in points],
                                 axis=0, weights=weights)
                      for name in ("xyz", "color"))
        self.delete_point3D(point3D_id1)
        self.delete_point3D(point3D_id2)
        return self.add_point3D(xyz, Track(np.vstack(tracks)), color.round())

    def register_frame(self, frame_id: int) -> None:
        """Checks that a frame has a pose; frames with one are registered."""
        if not _get(self.frames, frame_id, "frame").has_pose():
            raise InputError(f"frame {frame_id} has no pose; set its "
                             "rig_from_world")

    def deregister_frame(self, frame_id: int) -> None:
        """Deletes the pose of a frame, and the observations in its images."""
        frame = _get(self.frames, frame_id, "frame")
        for image_id in frame.image_ids:
            points2D = self.images[image_id].points2D
            for point2D_idx in points2D.observed().tolist():
                if points2D.point3D_ids[point2D_idx] != _NO_POINT:
                    self.delete_observation(image_id, point2D_idx)
        frame.reset_pose()

    def tear_down(self) -> None:
        """Deletes frames and images that are not registered, and rigs and
        cameras without any."""
        self.images = {i: image for i, image in self.images.items()
                       if image.has_pose}
        self.frames = {i: f for i, f in self.frames.items() if f.has_pose()}
        rig_ids = {frame.rig_id for frame in self.frames.values()}
        self.rigs = {i: r for i, r in self.rigs.items() if i in rig_ids}
        camera_ids = {i for rig in self.rigs.values() for i in rig.sensors}
        self.cameras = {i: c for i, c in self.cameras.items()
                        if i in camera_ids}

    def _reset_keypoint(self, image_id: int, point2D_idx: int) -> None:
        self.images[image_id].points2D.point3D_ids[point2D_idx] = _NO_POINT

    def _keep_points(self, keeps: _Mask) -> None:
        self._keep_observations(
            np.repeat(keeps, self.points3D.track_lengths()))

    def _keep_observations(self, keeps: _Mask) -> int:
        """Deletes observations, and points with fewer than two.

        Args:
          keeps: (N,), in the order of points3D.

        Returns the number of deleted observations.
        """
        lengths = self.points3D.track_lengths()
        rows = np.repeat(np.arange(len(lengths)), lengths)
        keeps_point = np.bincount(rows[keeps], minlength=len(lengths)) >= 2
        keeps = keeps & keeps_point[rows]
        deleted = self.points3D._track[~keeps]
        for image_id, rows in _by_image(deleted):
            self.images[image_id].points2D.point3D_ids[
                deleted[rows, 1]] = _NO_POINT
        self.points3D._replace(keeps_point, keeps)
        return len(deleted)

    # --------------------------------------------------------------- filters

    def observation_errors(self) -> FloatArray:
        """(M,), the reprojection errors in pixels of the observations of all
        points, in the order of points3D; infinite if a point does not project
        into its image."""
        points = self.points3D.arrays()
        track = points["track_elements"]
        xyz = np.repeat(points["xyz"], np.diff(points["track_offsets"]), axis=0)
        errors: FloatArray = np.full(len(track), np.inf)
        for image_id, rows in _by_image(track):
            image = _get(self.images, image_id, "image")
            if image.has_pose:
                pixels = image.project_point(xyz[rows])
                error = np.linalg.norm(
                    pixels - image.points2D.xy[track[rows, 1]], axis=1)
                errors[rows] = np.where(np.isfinite(error), error, np.inf)
        return errors

    def update_point_3d_errors(self) -> None:
        """Sets point.error of all points to their mean reprojection error."""
        self._set_errors(self.observation_errors())

    def _set_errors(self, errors: FloatArray) -> None:
        lengths = self.points3D.track_lengths()
        rows = np.repeat(np.arange(len(lengths)), lengths)
        sums = np.bincount(rows, weights=errors, minlength=len(lengths))
        mean = sums / np.maximum(lengths, 1)
        self.points3D.error[:] = np.where(np.isfinite(mean) & (lengths > 0),
                                          mean, -1.0)

    def filter_all_points3D(self, max_reproj_error: float,
                            min_tri_angle: float) -> int:
        """Deletes observations with larger errors, and points with fewer than
        two observations or a smaller triangulation angle.

        Args:
          max_reproj_error: In pixels.
          min_tri_angle: In degrees, of the two rays that are farthest apart.

        Sets point.error of the others. Returns the number of deleted
        observations.
        """
        return self._filter(max_reproj_error, min_tri_angle,
                            np.ones(len(self.points3D), dtype=bool))

    def filter_points3D(self, max_reproj_error: float, min_tri_angle: float,
                        point3D_ids: Iterable[int]) -> int:
        """filter_all_points3D for some points."""
        wanted = np.isin(self.points3D.ids,
                         np.array(list(point3D_ids), dtype=np.uint64))
        return self._filter(max_reproj_error, min_tri_angle, wanted)

    def filter_points3D_in_images(self, max_reproj_error: float,
                                  min_tri_angle: float,
                                  image_ids: Iterable[int]) -> int:
        """filter_all_points3D for the points that these images observe."""
        ids = [self.images[i].points2D.point3D_ids for i in image_ids]
        wanted = np.isin(self.points3D.ids,
                         np.concatenate([np.empty(0, np.uint64), *ids]))
        return self._filter(max_reproj_error, min_tri_angle, wanted)

    def _filter(self, max_reproj_error: float, min_tri_angle: float,
                wanted: _Mask) -> int:
        errors = self.observation_errors()
        wanted_observations = np.repeat(wanted, self.points3D.track_lengths())
        keeps = ~wanted_observations | (errors <= max_reproj_error)
        lengths = self.points3D.track_lengths()
        rows = np.repeat(np.arange(len(lengths)), lengths)
        stays = np.bincount(rows[keeps], minlength=len(lengths)) >= 2
        keeps &= stays[rows]
        num_deleted = self._keep_observations(keeps)
        errors, wanted = errors[keeps], wanted[stays]
        is_wide = ~wanted | (self._angles_deg() >= min_tri_angle)
        kept = np.repeat(is_wide, self.points3D.track_lengths())
        num_deleted += self._keep_observations(kept)
        self._set_errors(errors[kept])
        return num_deleted

    def _angles_deg(self) -> FloatArray:
        points = self.points3D.arrays()
        center_of = {i: image.projection_center()
                     for i, image in self.images.items() if image.has_pose}
        centers = np.array([center_of[i] for i in
                            points["track_elements"][:, 0].tolist()])
        return np.rad2deg(_core.triangulation_angles(
            points["xyz"], centers.reshape(-1, 3), points["track_offsets"]))

    def filter_observations_with_negative_depth(self) -> int:
        """Deletes observations of points that do not project into the image.

        Returns the number of deleted observations.
        """
        return self._keep_observations(np.isfinite(self.observation_errors()))

    def filter_frames(self, min_focal_length_ratio: float,
                      max_focal_length_ratio: float,
                      max_extra_param: float) -> List[int]:
        """Deregisters frames whose images observe no point or of which a
        camera has bogus parameters. Returns their ids."""
        bad = []
        for frame in self.frames.values():
            images = [self.images[i] for i in frame.image_ids]
            if frame.has_pose() and (
                    not any(image.num_points3D for image in images)
                    or any(image.camera and image.camera.has_bogus_params(
                        min_focal_length_ratio, max_focal_length_ratio,
                        max_extra_param) for image in images)):
                bad.append(frame.frame_id)
        for frame_id in bad:
            self.deregister_frame(frame_id)
        return bad

    # ----------------------------------------------------------- consistency

    def check(self) -> None:
        """Raises InputError unless tracks and keypoints refer to each other,
        and frames, images, rigs and cameras exist where others name them."""
        points = self.points3D.arrays()
        track = points["track_elements"]
        expected = {i: np.full(len(image.points2D), _NO_POINT)
                    for i, image in self.images.items()}
        ids = np.repeat(points["point_ids"], np.diff(points["track_offsets"]))
        for image_id, rows in _by_image(track):
            image = _get(self.images, image_id, "image")
            if (track[rows, 1] >= len(image.points2D)).any():
                raise InputError(f"image '{image.name}' lacks a keypoint of a "
                                 "track")
            expected[image_id][track[rows, 1]] = ids[rows]
        for image_id, image in self.images.items():
            differ = np.flatnonzero(expected[image_id]
                                    != image.points2D.point3D_ids)
            if len(differ):
                raise InputError(
                    f"keypoint {differ[0]} of image '{image.name}' and the "
                    "tracks disagree on its point; use add_observation and "
                    "delete_observation")
        for rig in self.rigs.values():
            if rig.sensors.get(rig.ref_camera_id) != Rigid3d():
                raise InputError(f"rig {rig.rig_id}: the pose of the reference "
                                 "sensor must be the identity")
        for frame in self.frames.values():
            for image_id in frame.image_ids:
                _get(self.images, image_id, f"frame {frame.frame_id}: image")


def _by_image(track: npt.NDArray[np.uint32]
              ) -> Iterator[Tuple[int, npt.NDArray[np.int64]]]:
    """The image ids in a track, each with its rows."""
    order = np.argsort(track[:, 0], kind="stable")
    image_ids, starts = np.unique(track[order, 0], return_index=True)
    yield from zip(image_ids.tolist(), np.split(order, starts[1:]))


def _get(items: Dict[int, Any], item_id: int, kind: str) -> Any:
    if item_id not in items:
        raise InputError(f"the model has no {kind} {item_id}"
                         if ":" not in kind else f"{kind} {item_id} is missing")
    return items[item_id]


def _add(items: Dict[int, Any], item_id: int, item: Any, kind: str) -> None:
    _check_new(items, item_id, kind)
    items[item_id] = item


def _check_new(items: Dict[int, Any], item_id: int, kind: str) -> None:
    if item_id in items:
        raise InputError(f"the model has a {kind} {item_id} already")
    if not 0 <= item_id < INVALID_ID:
        raise InputError(f"set {kind}_id before adding a {kind}")


class ObservationManager:
    """pycolmap's access to the filters of a model."""

    def __init__(self, reconstruction: Editing) -> None:
        self.filter_all_points3D = reconstruction.filter_all_points3D
        self.filter_points3D = reconstruction.filter_points3D
        self.filter_points3D_in_images = (
            reconstruction.filter_points3D_in_images)
        self.filter_observations_with_negative_depth = (
            reconstruction.filter_observations_with_negative_depth)
        self.filter_frames = reconstruction.filter_frames
        self.add_observation = reconstruction.add_observation
        self.add_point3D = reconstruction.add_point3D
        self.delete_observation = reconstruction.delete_observation
        self.delete_point3D = reconstruction.delete_point3D
        self.merge_points3D = reconstruction.merge_points3D
        self.deregister_frame = reconstruction.deregister_frame
