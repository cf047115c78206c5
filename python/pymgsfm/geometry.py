# SPDX-License-Identifier: BSD-3-Clause
"""Rotations and rigid transforms, with pycolmap's names.

b_from_a maps coordinates in frame a to coordinates in frame b.
"""

from __future__ import annotations

from typing import Optional, Union, overload

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
        """Keeps a view of an array of floats, or copies other sequences."""
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

    def __init__(self, rotation: Optional[Rotation3d] = None,
                 translation: npt.ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """The identity without arguments."""
        self.rotation = Rotation3d() if rotation is None else rotation
        self.translation = _as_floats(translation, 3, "translation")

    @staticmethod
    def from_row(row: FloatArray) -> "Rigid3d":
        """Views of an array (7,): quaternion x y z w, then translation."""
        return Rigid3d(Rotation3d(row[:4]), row[4:])

    def row(self) -> FloatArray:
        """(7,): quaternion x y z w, then translation."""
        return np.concatenate([self.rotation.quat, self.translation])

    def matrix(self) -> FloatArray:
        """(3, 4)"""
        return np.column_stack([self.rotation.matrix(), self.translation])

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
