# SPDX-License-Identifier: BSD-3-Clause
"""The points of models in memory, with pycolmap's names."""

from __future__ import annotations

from typing import (Any, Dict, Iterable, Iterator, List, Mapping, NamedTuple,
                    Optional, Tuple)

import numpy as np
import numpy.typing as npt

from .cameras import INVALID_ID
from .errors import InputError
from .geometry import FloatArray

TrackArray = npt.NDArray[np.uint32]


class TrackElement(NamedTuple):
    """One observation of a point."""

    image_id: int = INVALID_ID
    point2D_idx: int = INVALID_ID


class Track:
    """The observations of a point.

    Attributes:
      array: (N, 2) image ids and indices of keypoints.
    """

    def __init__(self, elements: Iterable[Any] = (), *,
                 is_fixed: bool = False) -> None:
        """`elements` are TrackElement or an array (N, 2).

        The track of a point of a model is fixed: add and delete observations
        by the methods of Reconstruction.
        """
        if not isinstance(elements, np.ndarray):
            elements = np.array(list(elements), dtype=np.uint32).reshape(-1, 2)
        self.array: TrackArray = elements
        self._is_fixed = is_fixed

    @property
    def elements(self) -> List[TrackElement]:
        return [TrackElement(int(i), int(k)) for i, k in self.array]

    def length(self) -> int:
        return len(self.array)

    def add_element(self, image_id: int, point2D_idx: int) -> None:
        self._check_free()
        self.array = np.vstack([self.array, np.array(
            [[image_id, point2D_idx]], dtype=np.uint32)])

    def add_elements(self, elements: Iterable[TrackElement]) -> None:
        for element in elements:
            self.add_element(*element)

    def delete_element(self, image_id: int, point2D_idx: int) -> None:
        self._check_free()
        self.array = _without(self.array, image_id, point2D_idx)

    def _check_free(self) -> None:
        if self._is_fixed:
            raise InputError("the track belongs to a model: call its "
                             "add_observation and delete_observation")


def _without(track: TrackArray, image_id: int, point2D_idx: int) -> TrackArray:
    kept: TrackArray = track[(track != (image_id, point2D_idx)).any(axis=1)]
    return kept


class _Row:
    """A point that was added or has a new track."""

    def __init__(self, xyz: npt.ArrayLike, color: npt.ArrayLike, error: float,
                 track: TrackArray) -> None:
        self.xyz: FloatArray = np.array(xyz, dtype=np.float64).reshape(3)
        self.color: npt.NDArray[np.uint8] = np.array(
            color, dtype=np.uint8).reshape(3)
        self.error = np.array([error])
        self.track = track


class Point3D:
    """A point. One of a model reads and changes the arrays of the model.

    Attributes:
      xyz: (3,) in the world.
      color: (3,) red, green, blue, 0 to 255.
      error: Mean reprojection error in pixels; -1: unknown.
      track: Track, its observations.
    """

    def __init__(self, xyz: npt.ArrayLike = (0.0, 0.0, 0.0),
                 color: npt.ArrayLike = (0, 0, 0), error: float = -1.0,
                 track: Optional[Track] = None) -> None:
        row = _Row(xyz, color, error, Track().array)
        self._find: Any = lambda: row
        self._track = track or Track()  # None: that of the model

    @property
    def xyz(self) -> FloatArray:
        values: FloatArray = self._find().xyz
        return values

    @xyz.setter
    def xyz(self, xyz: npt.ArrayLike) -> None:
        self._find().xyz[:] = xyz

    @property
    def color(self) -> npt.NDArray[np.uint8]:
        values: npt.NDArray[np.uint8] = self._find().color
        return values

    @color.setter
    def color(self, color: npt.ArrayLike) -> None:
        self._find().color[:] = color

    @property
    def error(self) -> float:
        return float(self._find().error[0])

    @error.setter
    def error(self, error: float) -> None:
        self._find().error[0] = error

    @property
    def track(self) -> Track:
        return self._track or Track(self._find().track, is_fixed=True)

    @track.setter
    def track(self, track: Track) -> None:
        self.track._check_free()
        self._track = track

    def has_error(self) -> bool:
        return self.error >= 0.0

    def __reduce__(self) -> Tuple[Any, ...]:
        return (Point3D, (self.xyz.copy(), self.color.copy(), self.error,
                          Track(self.track.array.copy())))

    def __repr__(self) -> str:
        return f"Point3D(xyz={self.xyz.tolist()}, error={self.error:.3g})"


class Points3D(Mapping[int, Point3D]):
    """The points of a model by id, and as arrays.

    Attributes:
      ids: (N,) ascending.
      xyz: (N, 3) in the world.
      color: (N, 3) red, green, blue, 0 to 255.
      error: (N,) mean reprojection errors in pixels; -1: unknown.

    The arrays are those of the model until points or observations are added or
    deleted; then there are new ones, and those taken earlier are read-only.
    """

    def __init__(self, arrays: Dict[str, Any]) -> None:
        self._ids: npt.NDArray[np.uint64] = arrays["point_ids"]
        self._xyz: FloatArray = arrays["xyz"]
        self._color: npt.NDArray[np.uint8] = arrays["rgb"]
        self._error: FloatArray = arrays["errors_px"]
        self._track: TrackArray = arrays["track_elements"]
        self._offsets: npt.NDArray[np.int64] = arrays["track_offsets"]
        # Points that differ from the arrays; None: deleted.
        self._changed: Dict[int, Optional[_Row]] = {}
        self._num = len(self._ids)
        self._next_id = int(self._ids[-1]) + 1 if self._num else 1

    @property
    def ids(self) -> npt.NDArray[np.uint64]:
        self._merge()
        return self._ids

    @property
    def xyz(self) -> FloatArray:
        self._merge()
        return self._xyz

    @xyz.setter
    def xyz(self, xyz: npt.ArrayLike) -> None:
        self.xyz[:] = xyz

    @property
    def color(self) -> npt.NDArray[np.uint8]:
        self._merge()
        return self._color

    @property
    def error(self) -> FloatArray:
        self._merge()
        return self._error

    def arrays(self) -> Dict[str, Any]:
        """All arrays, as _core.write_model takes them."""
        self._merge()
        return {"point_ids": self._ids, "xyz": self._xyz, "rgb": self._color,
                "errors_px": self._error, "track_elements": self._track,
                "track_offsets": self._offsets}

    def __getitem__(self, point3D_id: int) -> Point3D:
        self._find(point3D_id)
        point = Point3D.__new__(Point3D)
        point._find = lambda: self._find(point3D_id)
        point._track = None  # type: ignore[assignment]
        return point

    def __contains__(self, point3D_id: object) -> bool:
        try:
            self._find(int(point3D_id))  # type: ignore[call-overload]
        except (KeyError, TypeError, ValueError, OverflowError):
            return False
        return True

    def __iter__(self) -> Iterator[int]:
        return map(int, self.ids)

    def __len__(self) -> int:
        return self._num

    def track_lengths(self) -> npt.NDArray[np.int64]:
        """(N,) numbers of observations"""
        self._merge()
        return np.diff(self._offsets)

    # ------------------------------------------- edits, for Reconstruction

    def _find(self, point3D_id: int) -> Any:
        """Its values as arrays that can be changed."""
        if point3D_id in self._changed:
            changed = self._changed[point3D_id]
            if changed is None:
                raise KeyError(point3D_id)
            return changed
        row = int(np.searchsorted(self._ids, np.uint64(point3D_id)))
        if row == len(self._ids) or int(self._ids[row]) != point3D_id:
            raise KeyError(point3D_id)
        return _View(self._xyz[row], self._color[row],
                     self._error[row:row + 1],
                     self._track[self._offsets[row]:self._offsets[row + 1]])

    def _add(self, row: _Row) -> int:
        point3D_id = self._next_id
        self._next_id += 1
        self._changed[point3D_id] = row
        self._num += 1
        return point3D_id

    def _delete(self, point3D_id: int) -> None:
        self._find(point3D_id)
        self._changed[point3D_id] = None
        self._num -= 1

    def _set_track(self, point3D_id: int, track: TrackArray) -> None:
        old = self._find(point3D_id)
        self._changed[point3D_id] = _Row(old.xyz, old.color,
                                         float(old.error[0]), track)

    def _merge(self) -> None:
        """Brings the arrays up to date."""
        if not self._changed:
            return
        changed_ids = np.array(sorted(self._changed), dtype=np.uint64)
        rows = [(i, row) for i, row in sorted(self._changed.items())
                if row is not None]
        stays = ~np.isin(self._ids, changed_ids)
        lengths = np.diff(self._offsets)
        new_lengths = np.concatenate([
            lengths[stays], [len(row.track) for _, row in rows]]).astype(int)
        ids = np.concatenate([self._ids[stays],
                              np.array([i for i, _ in rows], dtype=np.uint64)])
        track = np.concatenate([self._track[np.repeat(stays, lengths)],
                                *(row.track for _, row in rows)])
        order = np.argsort(ids, kind="stable")
        starts = np.cumsum(new_lengths) - new_lengths
        self._offsets = np.concatenate(
            [[0], np.cumsum(new_lengths[order])]).astype(np.int64)
        within = (np.arange(len(track))
                  - np.repeat(self._offsets[:-1], new_lengths[order]))
        self._track = track[np.repeat(starts[order], new_lengths[order])
                            + within]
        self._retire()
        self._xyz = self._joined(self._xyz[stays],
                                 [row.xyz for _, row in rows])[order]
        self._color = self._joined(self._color[stays],
                                   [row.color for _, row in rows])[order]
        self._error = np.concatenate(
            [self._error[stays], *(row.error for _, row in rows)])[order]
        self._ids = ids[order]
        self._changed = {}

    @staticmethod
    def _joined(old: Any, new: List[Any]) -> Any:
        return np.concatenate([old, np.array(new, dtype=old.dtype)
                               .reshape(-1, 3)])

    def _replace(self, keeps_point: npt.NDArray[np.bool_],
                 keeps_observation: npt.NDArray[np.bool_]) -> None:
        """Keeps points, and observations of them."""
        self._merge()
        rows = np.repeat(np.arange(len(self._ids)), np.diff(self._offsets))
        keeps_observation = keeps_observation & keeps_point[rows]
        lengths = np.bincount(rows[keeps_observation],
                              minlength=len(self._ids))[keeps_point]
        self._track = self._track[keeps_observation]
        self._offsets = np.concatenate([[0], np.cumsum(lengths)]
                                       ).astype(np.int64)
        self._retire()
        self._ids, self._xyz = self._ids[keeps_point], self._xyz[keeps_point]
        self._color = self._color[keeps_point]
        self._error = self._error[keeps_point]
        self._num = len(self._ids)


    def _take_over(self, other: "Points3D") -> None:
        """The points of another model: with the ids of these, if they have the
        same tracks."""
        self._merge()
        if (np.array_equal(self._offsets, other._offsets)
                and np.array_equal(self._track, other._track)):
            self._xyz[:], self._error[:] = other._xyz, other._error
            return
        self._retire()
        self._ids, self._xyz, self._color = other.ids, other._xyz, other._color
        self._error, self._num = other._error, len(other)
        self._track, self._offsets = other._track, other._offsets
        self._next_id = max(self._next_id, other._next_id)

    def _retire(self) -> None:
        """Changes of arrays that are about to be replaced would be lost."""
        arrays: List[Any] = [self._xyz, self._color, self._error]
        for array in arrays:
            array.flags.writeable = False


class _View(NamedTuple):
    xyz: FloatArray
    color: npt.NDArray[np.uint8]
    error: FloatArray
    track: TrackArray
