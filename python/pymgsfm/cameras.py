# SPDX-License-Identifier: BSD-3-Clause
"""Cameras that project, with pycolmap's names.

Pixels: (0, 0) is the upper left corner of the image, and (0.5, 0.5) the center
of the first pixel. Camera frame: x right, y down, z forward.
"""

from __future__ import annotations

import enum
from typing import (Any, Dict, List, Mapping, NamedTuple, Optional, Tuple,
                    Union)

import numpy as np
import numpy.typing as npt

from . import _core
from .errors import InputError
from .geometry import FloatArray

INVALID_ID = 2**32 - 1

_PARAM_NAMES = {
    "SIMPLE_PINHOLE": "f, cx, cy",
    "PINHOLE": "fx, fy, cx, cy",
    "SIMPLE_RADIAL": "f, cx, cy, k",
    "RADIAL": "f, cx, cy, k1, k2",
    "OPENCV": "fx, fy, cx, cy, k1, k2, p1, p2",
    "OPENCV_FISHEYE": "fx, fy, cx, cy, k1, k2, k3, k4",
    "FULL_OPENCV": "fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6",
    "FOV": "fx, fy, cx, cy, omega",
    "SIMPLE_RADIAL_FISHEYE": "f, cx, cy, k",
    "RADIAL_FISHEYE": "f, cx, cy, k1, k2",
    "THIN_PRISM_FISHEYE": ("fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": ("fx, fy, cx, cy, k0, k1, k2, k3, k4, k5, "
                                   "p0, p1, s0, s1, s2, s3"),
    "SIMPLE_DIVISION": "f, cx, cy, k",
    "DIVISION": "fx, fy, cx, cy, k",
    "SIMPLE_FISHEYE": "f, cx, cy",
    "FISHEYE": "fx, fy, cx, cy",
    "EUCM": "fx, fy, cx, cy, alpha, beta",
    "EQUIRECTANGULAR": "w, h",
}


class CameraModelId(enum.IntEnum):
    """COLMAP's camera models, with its numbers."""

    INVALID = -1
    SIMPLE_PINHOLE = 0
    PINHOLE = 1
    SIMPLE_RADIAL = 2
    RADIAL = 3
    OPENCV = 4
    OPENCV_FISHEYE = 5
    FULL_OPENCV = 6
    FOV = 7
    SIMPLE_RADIAL_FISHEYE = 8
    RADIAL_FISHEYE = 9
    THIN_PRISM_FISHEYE = 10
    RAD_TAN_THIN_PRISM_FISHEYE = 11
    SIMPLE_DIVISION = 12
    DIVISION = 13
    SIMPLE_FISHEYE = 14
    FISHEYE = 15
    EUCM = 16
    EQUIRECTANGULAR = 17

    @classmethod
    def of(cls, model: Union["CameraModelId", str, int]) -> "CameraModelId":
        """By number or name."""
        if isinstance(model, str) and model in cls.__members__:
            return cls[model]
        try:
            return cls(int(model))
        except ValueError:
            raise InputError(f"unknown camera model '{model}'") from None

    @classmethod
    def _missing_(cls, value: object) -> Any:
        return cls.__members__.get(str(value))


class SensorType(enum.IntEnum):
    """The type of a sensor; mgsfm uses cameras only."""

    INVALID = -1
    CAMERA = 0
    IMU = 1


class sensor_t(NamedTuple):  # noqa: N801: pycolmap's name
    """A sensor of a rig; the id of a camera is its camera id."""

    type: SensorType
    id: int


class data_t(NamedTuple):  # noqa: N801: pycolmap's name
    """A measurement of a sensor; the id of an image is its image id."""

    sensor_id: sensor_t
    id: int


class _Model(NamedTuple):
    num_params: int
    focal: List[int]
    center: List[int]
    extra: List[int]


_MODELS: Dict[str, _Model] = {
    row[1]: _Model(*row[2:]) for row in _core.list_camera_models()}


class Camera:
    """Intrinsics.

    Attributes:
      camera_id
      model_name: Of COLMAP, such as "PINHOLE".
      width, height: In pixels.
      params: (K,) in COLMAP's order; lengths in pixels.
      has_prior_focal_length: Whether the focal length is known; models do not
        store it, databases do.
    """

    camera_id: int
    model_name: str
    width: int
    height: int
    has_prior_focal_length: bool

    def __init__(self, camera_id: Union[int, Mapping[str, Any]] = INVALID_ID,
                 model_name: Optional[str] = None, width: int = 0,
                 height: int = 0, params: npt.ArrayLike = (), *,
                 model: Union[CameraModelId, str, int, None] = None,
                 has_prior_focal_length: bool = False) -> None:
        """Takes pycolmap's keywords or a dict of them, too."""
        if isinstance(camera_id, Mapping):
            self.__init__(**camera_id)  # type: ignore[misc]
            return
        self.camera_id = camera_id
        self.model_name = model_name or "INVALID"
        if model is not None:
            self.model = model  # type: ignore[assignment]
        self.width, self.height = width, height
        self.params = params  # type: ignore[assignment]
        self.has_prior_focal_length = has_prior_focal_length

    @staticmethod
    def create(camera_id: int, model: Union[CameraModelId, str, int],
               focal_length: float, width: int, height: int) -> "Camera":
        """A camera with centered principal point and no distortion."""
        camera = Camera(camera_id, width=width, height=height, model=model)
        kind = camera._kind()
        params = np.zeros(kind.num_params)
        params[kind.focal] = focal_length
        if kind.center:
            params[kind.center] = 0.5 * width, 0.5 * height
        if camera.model_name == "FOV":
            params[-1] = 1e-2
        if camera.model_name == "EUCM":
            params[-1] = 1.0
        if camera.model_name == "EQUIRECTANGULAR":
            params[:] = width, height
        camera.params = params
        return camera

    create_from_model_id = create
    create_from_model_name = create

    @property
    def params(self) -> FloatArray:
        return self._params

    @params.setter
    def params(self, params: npt.ArrayLike) -> None:
        self._params: FloatArray = np.asarray(params, dtype=np.float64)

    @property
    def model(self) -> CameraModelId:
        return CameraModelId.of(self.model_name)

    @model.setter
    def model(self, model: Union[CameraModelId, str, int]) -> None:
        self.model_name = CameraModelId.of(model).name

    @property
    def sensor_id(self) -> sensor_t:
        return sensor_t(SensorType.CAMERA, self.camera_id)

    @property
    def params_info(self) -> str:
        """The names of the parameters, such as "fx, fy, cx, cy"."""
        self._kind()
        return _PARAM_NAMES[self.model_name]

    def params_to_string(self) -> str:
        return ", ".join(map(repr, self.params.tolist()))

    def set_params_from_string(self, params: str) -> bool:
        """Returns whether the number of values fits the model."""
        values = np.array([float(text) for text in params.split(",")])
        if len(values) != self._kind().num_params:
            return False
        self.params = values
        return True

    def focal_length_idxs(self) -> List[int]:
        return self._kind().focal

    def principal_point_idxs(self) -> List[int]:
        return self._kind().center

    def extra_params_idxs(self) -> List[int]:
        """The positions of the distortion parameters in `params`."""
        return self._kind().extra

    @property
    def focal_length(self) -> float:
        """In pixels; raises for models with two focal lengths."""
        return self._only(self._kind().focal, 1, "focal_length")

    @focal_length.setter
    def focal_length(self, value: float) -> None:
        self._only(self._kind().focal, 1, "focal_length")
        self.params[self._kind().focal] = value

    @property
    def focal_length_x(self) -> float:
        return self._param(self._kind().focal, 0, "focal_length_x")

    @focal_length_x.setter
    def focal_length_x(self, value: float) -> None:
        self.params[self._kind().focal[0]] = value

    @property
    def focal_length_y(self) -> float:
        return self._param(self._kind().focal, -1, "focal_length_y")

    @focal_length_y.setter
    def focal_length_y(self, value: float) -> None:
        self.params[self._kind().focal[-1]] = value

    @property
    def principal_point_x(self) -> float:
        return self._param(self._kind().center, 0, "principal_point_x")

    @principal_point_x.setter
    def principal_point_x(self, value: float) -> None:
        self.params[self._kind().center[0]] = value

    @property
    def principal_point_y(self) -> float:
        return self._param(self._kind().center, 1, "principal_point_y")

    @principal_point_y.setter
    def principal_point_y(self, value: float) -> None:
        self.params[self._kind().center[1]] = value

    def mean_focal_length(self) -> float:
        """Pixels per radian in the center of the image."""
        return float(_core.pixels_per_radian(self.model_name, self.params))

    def calibration_matrix(self) -> FloatArray:
        """(3, 3), without distortion"""
        return np.array([
            [self.focal_length_x, 0.0, self.principal_point_x],
            [0.0, self.focal_length_y, self.principal_point_y],
            [0.0, 0.0, 1.0]])

    def verify_params(self) -> bool:
        """Whether the number of parameters fits the model."""
        return (self.model_name in _MODELS
                and self.params.shape == (self._kind().num_params,))

    def has_bogus_params(self, min_focal_length_ratio: float,
                         max_focal_length_ratio: float,
                         max_extra_param: float) -> bool:
        """Whether a focal length in units of the larger image side, the
        principal point or a distortion parameter is out of bounds."""
        kind = self._kind()
        ratio = self.params[kind.focal] / max(self.width, self.height, 1)
        center = self.params[kind.center]
        return bool((ratio < min_focal_length_ratio).any()
                    or (ratio > max_focal_length_ratio).any()
                    or (np.abs(self.params[kind.extra])
                        > max_extra_param).any()
                    or (center < 0.0).any()
                    or (center > (self.width, self.height)[:len(center)]).any())

    def rescale(self, width: Union[int, float],
                height: Optional[int] = None) -> None:
        """Resizes images by a factor, or to a width and height in pixels."""
        if height is None:
            factor = float(width)
            width, height = (round(factor * side)
                             for side in (self.width, self.height))
        scale = np.array([width / self.width, height / self.height])
        kind = self._kind()
        params = self.params.copy()
        params[kind.center] *= scale[:len(kind.center)]
        params[kind.focal] *= scale if len(kind.focal) == 2 else scale.mean()
        if self.model_name == "EQUIRECTANGULAR":
            params *= scale
        self.params = params
        self.width, self.height = int(width), height

    def img_from_cam(self, points: npt.ArrayLike) -> Any:
        """Projects points in the camera frame to pixels.

        Args:
          points: (3,) or (N, 3); or (2,) or (N, 2) with z = 1.

        Returns (2,), or None if the camera cannot see the point; for several
        points (N, 2), NaN where it cannot.
        """
        given: FloatArray = np.asarray(points, dtype=np.float64)
        xyz = np.atleast_2d(given)
        if xyz.shape[-1] == 2:
            xyz = np.column_stack([xyz, np.ones(len(xyz))])
        pixels = _core.project(self.model_name, self.params, xyz, False)[0]
        return pixels if given.ndim == 2 else _or_none(pixels[0])

    def img_from_cam_jacobians(
            self, points: npt.ArrayLike
            ) -> Tuple[FloatArray, FloatArray, FloatArray]:
        """Projects points (N, 3) in the camera frame, with derivatives.

        Returns pixels (N, 2), their derivatives by the point (N, 2, 3) and by
        params (N, 2, K); NaN where the camera cannot see the point.
        """
        pixels, by_point, by_params = _core.project(
            self.model_name, self.params, points, True)
        assert by_point is not None and by_params is not None
        return pixels, by_point, by_params

    def cam_ray_from_img(self, pixels: Any) -> Any:
        """Unit rays in the camera frame of pixels.

        Args:
          pixels: (2,) or (N, 2), or Points2D.

        Returns (3,), or None if the pixel has no ray; for several pixels
        (N, 3), NaN where one has none.
        """
        given: FloatArray = np.asarray(getattr(pixels, "xy", pixels),
                                       dtype=np.float64)
        rays = _core.unproject(self.model_name, self.params,
                               np.atleast_2d(given))
        return rays if given.ndim == 2 else _or_none(rays[0])

    def cam_from_img(self, pixels: Any) -> Any:
        """The points of pixels in the plane z = 1 of the camera frame.

        Args:
          pixels: (2,) or (N, 2), or Points2D.

        Returns (2,), or None if the ray of the pixel does not meet the plane;
        for several pixels (N, 2), NaN where one does not. cam_ray_from_img has
        no such pixels.
        """
        rays = self.cam_ray_from_img(pixels)
        if rays is None:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            points = np.where(rays[..., 2:] > 0.0,
                              rays[..., :2] / rays[..., 2:], np.nan)
        return points if rays.ndim == 2 else _or_none(points)

    def cam_from_img_threshold(self, threshold: float) -> float:
        """An error in pixels as an angle in radians."""
        return threshold / self.mean_focal_length()

    def _kind(self) -> _Model:
        if self.model_name not in _MODELS:
            raise InputError(f"unknown camera model '{self.model_name}'")
        return _MODELS[self.model_name]

    def _param(self, idxs: List[int], which: int, name: str) -> float:
        if not idxs:
            raise InputError(f"a camera of the model {self.model_name} has no "
                             f"{name}")
        return float(self.params[idxs[which]])

    def _only(self, idxs: List[int], number: int, name: str) -> float:
        if len(idxs) != number:
            raise InputError(
                f"a camera of the model {self.model_name} has {len(idxs)} focal "
                f"lengths; use {name}_x and {name}_y, or mean_focal_length")
        return float(self.params[idxs[0]])

    def _row(self) -> Tuple[int, str, int, int, FloatArray, bool]:
        return (self.camera_id, self.model_name, self.width, self.height,
                self.params, self.has_prior_focal_length)

    def __repr__(self) -> str:
        return (f"Camera(camera_id={self.camera_id}, model={self.model_name}, "
                f"width={self.width}, height={self.height}, "
                f"params={self.params.tolist()})")


def _or_none(row: FloatArray) -> Optional[FloatArray]:
    return row if np.isfinite(row).all() else None


def camera_id_of(sensor: Union[int, sensor_t]) -> int:
    """The camera id of a sensor, or of itself."""
    if not isinstance(sensor, tuple):
        return int(sensor)
    if sensor.type != SensorType.CAMERA:
        raise InputError(f"{sensor} is no camera; mgsfm uses cameras only")
    return sensor.id
