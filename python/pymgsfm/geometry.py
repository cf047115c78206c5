# SPDX-License-Identifier: BSD-3-Clause
"""Rotations, rigid transforms and similarities, with pycolmap's names.

b_from_a maps coordinates in frame a to coordinates in frame b.
"""

from __future__ import annotations

from typing import NamedTuple, Union, overload

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def _as_floats(values: npt.ArrayLike, size: int, name: str) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (size,):
        raise ValueError(f"{name} must have the shape ({size},)")
    return array


class Rotation3d:
    """A rotation.

    Attributes:
      quat: (4,) unit quaternion x, y, z, w.
    """

    __slots__ = ("quat",)
    quat: FloatArray

    def __init__(self, quat: npt.ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """The rotation of a quaternion (4,), matrix (3, 3) or vector (3,).

        The vector has the direction of the axis and the length of the angle in
        radians. A quaternion that is an array of floats is kept as a view.
        """
        array = np.asarray(quat, dtype=np.float64)
        if array.shape == (3, 3):
            self.quat = Rotation3d.from_matrix(array).quat
        elif array.shape == (3,):
            half = 0.5 * float(np.linalg.norm(array))
            self.quat = np.append(0.5 * np.sinc(half / np.pi) * array,
                                  np.cos(half))
        else:
            self.quat = _as_floats(quat, 4, "quat")

    @staticmethod
    def from_matrix(matrix: npt.ArrayLike) -> "Rotation3d":
        """The rotation of a (3, 3) matrix."""
        R = np.asarray(matrix, dtype=np.float64)
        # The eigenvector of Bar-Itzhack's symmetric matrix, which is stable for
        # all angles.
        K = np.array([
            [R[0, 0] - R[1, 1] - R[2, 2], 0, 0, 0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0, 0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1],
             R[2, 2] - R[0, 0] - R[1, 1], 0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1],
             R[0, 0] + R[1, 1] + R[2, 2]]])
        quat = np.linalg.eigh(K, UPLO="L")[1][:, 3]
        return Rotation3d(quat if quat[3] >= 0 else -quat)

    def matrix(self) -> FloatArray:
        """(3, 3)"""
        x, y, z, w = self.quat
        return np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])

    def inverse(self) -> "Rotation3d":
        return Rotation3d(self.quat * (-1.0, -1.0, -1.0, 1.0))

    def angle(self) -> float:
        """The angle of the rotation in radians, between 0 and pi."""
        return float(2.0 * np.arctan2(np.linalg.norm(self.quat[:3]),
                                      abs(self.quat[3])))

    def angle_to(self, other: "Rotation3d") -> float:
        """The angle between two rotations in radians, between 0 and pi."""
        return (self.inverse() * other).angle()

    @overload
    def __mul__(self, other: "Rotation3d") -> "Rotation3d": ...
    @overload
    def __mul__(self, other: npt.ArrayLike) -> FloatArray: ...

    def __mul__(self, other: Union["Rotation3d", npt.ArrayLike]
                ) -> Union["Rotation3d", FloatArray]:
        """Composes rotations, or rotates points (3,) or (N, 3)."""
        if not isinstance(other, Rotation3d):
            points: FloatArray = np.asarray(other, dtype=np.float64)
            return points @ self.matrix().T
        a, b = self.quat, other.quat
        quat = np.append(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3]),
                         a[3] * b[3] - a[:3] @ b[:3])
        return Rotation3d(quat / np.linalg.norm(quat))

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, Rotation3d)
                and np.array_equal(self.quat, other.quat))

    def __repr__(self) -> str:
        return f"Rotation3d(quat_xyzw={self.quat.tolist()})"


class Rigid3d:
    """A rigid transform b_from_a: x_in_b = rotation * x_in_a + translation.

    Attributes:
      rotation: Rotation3d.
      translation: (3,) in the unit of the model.
    """

    __slots__ = ("rotation", "translation")
    rotation: Rotation3d
    translation: FloatArray

    def __init__(self,
                 rotation: Union[Rotation3d, npt.ArrayLike, None] = None,
                 translation: npt.ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """The identity without arguments.

        Args:
          rotation: A Rotation3d or what makes one; or the matrix (3, 4) or
            (4, 4) of the transform, without translation.
          translation: (3,)
        """
        if rotation is not None and not isinstance(rotation, Rotation3d):
            matrix = np.asarray(rotation, dtype=np.float64)
            if matrix.shape in ((3, 4), (4, 4)):
                rotation, translation = matrix[:3, :3], matrix[:3, 3].copy()
            rotation = Rotation3d(rotation)
        self.rotation = rotation or Rotation3d()
        self.translation = _as_floats(translation, 3, "translation")

    @staticmethod
    def from_row(row: FloatArray) -> "Rigid3d":
        """Views of an array (7,): quaternion x y z w, then translation."""
        return Rigid3d(Rotation3d(row[:4]), row[4:])

    def __call__(self) -> "Rigid3d":
        """Itself: image.cam_from_world is an attribute in pycolmap before 3.12
        and a method since."""
        return self

    def row(self) -> FloatArray:
        """(7,): quaternion x y z w, then translation."""
        return np.concatenate([self.rotation.quat, self.translation])

    def matrix(self) -> FloatArray:
        """(3, 4)"""
        return np.column_stack([self.rotation.matrix(), self.translation])

    def tgt_origin_in_src(self) -> FloatArray:
        """(3,), the origin of b in the frame a; the center of a camera."""
        return self.inverse().translation

    def inverse(self) -> "Rigid3d":
        inverse = self.rotation.inverse()
        return Rigid3d(inverse, -(inverse * self.translation))

    @overload
    def __mul__(self, other: "Rigid3d") -> "Rigid3d": ...
    @overload
    def __mul__(self, other: npt.ArrayLike) -> FloatArray: ...

    def __mul__(self, other: Union["Rigid3d", npt.ArrayLike]
                ) -> Union["Rigid3d", FloatArray]:
        """Composes transforms, or transforms points (3,) or (N, 3)."""
        if isinstance(other, Rigid3d):
            return Rigid3d(self.rotation * other.rotation,
                           self * other.translation)
        return self.rotation * other + self.translation

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, Rigid3d) and self.rotation == other.rotation
                and np.array_equal(self.translation, other.translation))

    def __repr__(self) -> str:
        return (f"Rigid3d(quat_xyzw={self.rotation.quat.tolist()}, "
                f"t={self.translation.tolist()})")


class Sim3d:
    """A similarity b_from_a: x_in_b = scale * rotation * x_in_a + translation.

    Attributes:
      scale: The length in b of a unit of length in a.
      rotation: Rotation3d.
      translation: (3,) in the unit of b.
    """

    __slots__ = ("scale", "rotation", "translation")
    scale: float
    rotation: Rotation3d
    translation: FloatArray

    def __init__(self, scale: Union[float, npt.ArrayLike] = 1.0,
                 rotation: Union[Rotation3d, npt.ArrayLike, None] = None,
                 translation: npt.ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """The identity without arguments.

        Args:
          scale: Or the matrix (3, 4) or (4, 4) of the similarity, alone.
          rotation: A Rotation3d or what makes one.
          translation: (3,)
        """
        given = np.asarray(scale, dtype=np.float64)
        if given.shape in ((3, 4), (4, 4)):
            length = float(np.cbrt(np.linalg.det(given[:3, :3])))
            rotation, translation = given[:3, :3] / length, given[:3, 3]
            given = np.asarray(length)
        self.scale = float(given)
        if not self.scale > 0.0:
            raise ValueError("the scale of a similarity must be positive")
        self.rotation = (rotation if isinstance(rotation, Rotation3d)
                         else Rotation3d() if rotation is None
                         else Rotation3d(rotation))
        self.translation = _as_floats(translation, 3, "translation").copy()

    def matrix(self) -> FloatArray:
        """(3, 4)"""
        return np.column_stack([self.scale * self.rotation.matrix(),
                                self.translation])

    def inverse(self) -> "Sim3d":
        rotation = self.rotation.inverse()
        return Sim3d(1.0 / self.scale, rotation,
                     -(rotation * self.translation) / self.scale)

    def transform_camera_world(self, cam_from_world: Rigid3d) -> Rigid3d:
        """The pose cam_from_new of a camera, for self = new_from_world.

        Lengths in the camera frame are scaled, too.
        """
        rotation = cam_from_world.rotation * self.rotation.inverse()
        center: FloatArray = self * cam_from_world.tgt_origin_in_src()
        return Rigid3d(rotation, -(rotation * center))

    @overload
    def __mul__(self, other: "Sim3d") -> "Sim3d": ...
    @overload
    def __mul__(self, other: npt.ArrayLike) -> FloatArray: ...

    def __mul__(self, other: Union["Sim3d", npt.ArrayLike]
                ) -> Union["Sim3d", FloatArray]:
        """Composes similarities, or transforms points (3,) or (N, 3)."""
        if isinstance(other, Sim3d):
            return Sim3d(self.scale * other.scale,
                         self.rotation * other.rotation,
                         self * other.translation)
        return self.scale * (self.rotation * other) + self.translation

    def __eq__(self, other: object) -> bool:
        return (isinstance(other, Sim3d) and self.scale == other.scale
                and self.rotation == other.rotation
                and np.array_equal(self.translation, other.translation))

    def __repr__(self) -> str:
        return (f"Sim3d(scale={self.scale}, "
                f"quat_xyzw={self.rotation.quat.tolist()}, "
                f"t={self.translation.tolist()})")


class AlignedBox3d(NamedTuple):
    """A box with sides along the axes.

    Attributes:
      min, max: (3,) opposite corners.
    """

    min: FloatArray
    max: FloatArray

    def contains_point(self, points: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether points (3,) or (N, 3) are in the box: () or (N,)."""
        xyz: FloatArray = np.asarray(points, dtype=np.float64)
        inside: npt.NDArray[np.bool_] = np.logical_and(
            xyz >= self.min, xyz <= self.max).all(axis=-1)
        return inside

    def diagonal(self) -> FloatArray:
        """(3,)"""
        difference: FloatArray = self.max - self.min
        return difference
