# SPDX-License-Identifier: BSD-3-Clause
"""Reads and changes databases in COLMAP's format."""
import contextlib
import re
import shutil
import sqlite3
import struct

MAX_NUM_IMAGES = 2147483647  # COLMAP's base of pair ids
# Positions of the focal lengths among the parameters, by camera model id.
FOCAL_LENGTHS = {0: [0], 1: [0, 1], 2: [0], 3: [0], 4: [0, 1], 5: [0, 1],
                 8: [0]}


def image_ids_of_pair(pair_id):
    """The ids of the two images of a pair."""
    return divmod(pair_id, MAX_NUM_IMAGES)


def frame_number(name):
    """7 of cam0/000007.png."""
    return int(re.search(r"(\d+)\.\w+$", name).group(1))


def image_names(database, belongs):
    """The sorted names of the images for which belongs(name) is true."""
    uri = f"file:{database}?mode=ro"
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as connection:
        return [name for (name,) in connection.execute(
            "SELECT name FROM images ORDER BY name") if belongs(name)]


@contextlib.contextmanager
def changed_copy(source, target):
    """A connection to a copy. The copy gets its name only when it is complete,
    so that an interrupted change is repeated."""
    part = target.with_name(target.name + ".part")
    shutil.copy(source, part)
    with contextlib.closing(sqlite3.connect(part)) as connection:
        yield connection
        connection.commit()
    part.replace(target)


def scale_focal_lengths(source, target, factor, is_prior):
    """Copies a database with all focal lengths times a factor.

    is_prior: whether the result claims to know its focal lengths. Nothing is
    done if the target exists.
    """
    if target.exists():
        return
    with changed_copy(source, target) as connection:
        rows = connection.execute(
            "SELECT camera_id, model, params FROM cameras").fetchall()
        for camera_id, model, blob in rows:
            layout = f"<{len(blob) // 8}d"
            params = list(struct.unpack(layout, blob))
            for i in FOCAL_LENGTHS[model]:
                params[i] *= factor
            connection.execute(
                "UPDATE cameras SET params = ?, prior_focal_length = ? WHERE "
                "camera_id = ?",
                (struct.pack(layout, *params), int(is_prior), camera_id))


def remove_frames(source, target, first, last):
    """Copies a database without the pairs of frames `first` to `last`, and
    without the pairs across them. Nothing is done if the target exists."""
    if target.exists():
        return
    with changed_copy(source, target) as connection:
        frame = {i: frame_number(name) for i, name in connection.execute(
            "SELECT image_id, name FROM images")}
        for (pair,) in connection.execute(
                "SELECT pair_id FROM two_view_geometries").fetchall():
            a, b = sorted(frame[i] for i in image_ids_of_pair(pair))
            if b >= first and a <= last:
                connection.execute(
                    "DELETE FROM two_view_geometries WHERE pair_id = ?",
                    (pair,))
