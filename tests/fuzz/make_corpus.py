#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the binary seeds of the fuzz corpus; those of text are written by
hand."""
import pathlib
import struct
import sys

import numpy

CORPUS = pathlib.Path(__file__).parent / "corpus"
sys.path.append(str(CORPUS.parents[1] / "formats"))
import ros_files as ros  # noqa: E402 pylint: disable=wrong-import-position
POSES = [(1, 0, 0, 0, 0, 0, 0), (1, 0, 0, 0, -1, 0, 0)]
SECOND_FROM_FIRST = (1, 0, 0, 0, -0.5, 0, 0)


def write(target, name, data):
    (CORPUS / target / name).write_bytes(data)


def model(with_rigs):
    """Two frames of two cameras, and one point that all images see."""
    cameras = struct.pack("<Q", 2)
    for camera_id in (1, 2):
        cameras += struct.pack("<IiQQ3d", camera_id, 0, 640, 480, 500, 320, 240)
    images = struct.pack("<Q", 4)
    track = b""
    for frame, pose in enumerate(POSES):
        for camera in (0, 1):
            image_id = 2 * frame + camera + 1
            values = list(pose)
            values[4] += camera * SECOND_FROM_FIRST[4]
            images += struct.pack("<I7dI", image_id, *values, camera + 1)
            images += b"cam%d/%d.jpg\0" % (camera, frame)
            images += struct.pack("<Q2dq2dq", 2, 320 + 50 * values[4], 240, 1,
                                  10, 20, -1)
            track += struct.pack("<II", image_id, 0)
    points = struct.pack("<QQ3d3BdQ", 1, 1, 0, 0, 10, 255, 128, 0, 0.5, 4)
    files = [cameras, images, points + track]
    if with_rigs:
        rigs = struct.pack("<QIIiI", 1, 1, 2, 0, 1)
        rigs += struct.pack("<iIB7d", 0, 2, 1, *SECOND_FROM_FIRST)
        frames = struct.pack("<Q", 2)
        for frame, pose in enumerate(POSES):
            frames += struct.pack("<II7dI", frame + 1, 1, *pose, 2)
            for camera in (0, 1):
                frames += struct.pack("<iIQ", 0, camera + 1,
                                      2 * frame + camera + 1)
        files += [rigs, frames]
    return b"\n%%\n".join(files)


def value(v):
    """One value of a row, see BindValue in database.cc."""
    if v is None:
        return b"\0"
    if isinstance(v, tuple):  # pair id
        return bytes([4, *v])
    if isinstance(v, int) and -128 <= v < 128:
        return struct.pack("<Bb", 1, v)
    if isinstance(v, int):
        return struct.pack("<Bq", 2, v)
    if isinstance(v, float):
        return struct.pack("<Bd", 3, v)
    if isinstance(v, str):
        return bytes([5, len(v)]) + v.encode()
    return bytes([6, len(v)]) + v


TABLES = ["cameras", "images", "keypoints", "descriptors", "matches",
          "two_view_geometries", "pose_priors", "rigs", "rig_sensors",
          "frames", "frame_data"]


def rows():
    doubles = lambda *v: struct.pack("<%dd" % len(v), *v)
    result = []
    add = lambda table, *values: result.append(
        bytes([TABLES.index(table)]) + b"".join(map(value, values)))
    for camera in (1, 2):
        add("cameras", camera, 0, 640, 480, doubles(500, 320, 240), 1)
    for i in range(4):
        name = "cam%d/%d.jpg" % (i % 2, i // 2)
        add("images", i + 1, name, i % 2 + 1)
        add("keypoints", i + 1, 2, 2, struct.pack("<4f", 1, 2, 3, 4))
        add("descriptors", i + 1, 1, 128, bytes(128))
        add("pose_priors", i + 1, doubles(i, 0, 0), 1, None)
    matches = struct.pack("<4I", 0, 0, 1, 1)
    matrix = doubles(0, 0, 0, 0, 0, 1, 0, -1, 0)
    for pair in ((1, 2), (1, 3), (2, 4)):
        add("matches", pair, 2, 2, matches)
        add("two_view_geometries", pair, 2, 2, matches, 2, matrix, matrix,
            doubles(1, 0, 0, 0, 1, 0, 0, 0, 1), doubles(1, 0, 0, 0),
            doubles(1, 0, 0))
    add("rigs", 1, 1, 0)
    add("rig_sensors", 1, 2, 0, doubles(1, 0, 0, 0, -0.5, 0, 0))
    for frame in (1, 2):
        add("frames", frame, 1)
        for camera in (1, 2):
            add("frame_data", frame, 2 * frame + camera - 2, camera, 0)
    return result


def database(layout, sql="", patches=b""):
    all_rows = rows()
    return (bytes([layout, len(sql)]) + sql.encode() + bytes([len(all_rows)]) +
            b"".join(all_rows) + patches)


def exif_tiff():
    """Focal length and position, as in the file of a telephone."""
    def entry(tag, kind, count, data):
        return struct.pack("<HHI4s", tag, kind, count, data)
    exif_at, gps_at, data_at = 38, 38 + 2 + 3 * 12 + 4, 180
    tiff = b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", 2)
    tiff += entry(0x8769, 4, 1, struct.pack("<I", exif_at))
    tiff += entry(0x8825, 4, 1, struct.pack("<I", gps_at)) + bytes(4)
    tiff = tiff.ljust(exif_at, b"\0") + struct.pack("<H", 3)
    tiff += entry(0xa405, 3, 1, struct.pack("<HH", 28, 0))
    tiff += entry(0x920a, 5, 1, struct.pack("<I", data_at))
    tiff += entry(0xa210, 3, 1, struct.pack("<HH", 3, 0)) + bytes(4)
    tiff = tiff.ljust(gps_at, b"\0") + struct.pack("<H", 5)
    tiff += entry(1, 2, 2, b"N\0\0\0")
    tiff += entry(2, 5, 3, struct.pack("<I", data_at + 8))
    tiff += entry(3, 2, 2, b"E\0\0\0")
    tiff += entry(4, 5, 3, struct.pack("<I", data_at + 32))
    tiff += entry(6, 5, 1, struct.pack("<I", data_at + 56)) + bytes(4)
    tiff = tiff.ljust(data_at, b"\0") + struct.pack("<II", 48, 10)
    tiff += struct.pack("<6I", 49, 1, 0, 1, 30, 1)
    tiff += struct.pack("<6I", 8, 1, 24, 1, 0, 1) + struct.pack("<II", 115, 1)
    return tiff


def exif_jpeg():
    segment = b"Exif\0\0" + exif_tiff()
    return (b"\xff\xd8\xff\xe1" + struct.pack(">H", len(segment) + 2) +
            segment + b"\xff\xd9")


def vocabulary():
    """A root with two words."""
    nodes = [(1, 2, 0, 50), (0, 0, 0, 10), (0, 0, 1, 90)]
    return b"mgsfm vocabulary tree 1\n" + struct.pack("<i", len(nodes)) + b"".join(
        struct.pack("<3i128h", first, children, word, *[value] * 128)
        for first, children, word, value in nodes)


def messages(encoding):
    """One of each type that is read."""
    add = lambda topic, kind, data: ros.Message(topic, kind, 10**9, data)
    lens = ros.camera_info(encoding, "cam", (4, 2), "plumb_bob", [0.1] * 5,
                           [3.0, 0, 2, 0, 3, 1, 0, 0, 1])
    return [
        add("/tf_static", "tf2_msgs/TFMessage", ros.transforms(
            encoding, [("base", "cam", (1, 2, 3), (0, 0, 0, 1))])),
        add("/camera_info", "sensor_msgs/CameraInfo", lens),
        add("/image", "sensor_msgs/Image", ros.image(
            encoding, 10**9, "cam", "bayer_rggb8",
            numpy.arange(8, dtype=numpy.uint8).reshape(2, 4))),
        add("/c", "sensor_msgs/CompressedImage", ros.compressed_image(
            encoding, 10**9, "cam", "jpeg", b"\xff\xd8\xff\xd9")),
        add("/fix", "sensor_msgs/NavSatFix", ros.nav_sat_fix(
            encoding, 10**9, (49, 8, 100))),
    ]


def recordings():
    folder = CORPUS / "recording"
    for codec in ("none", "bz2", "lz4"):
        ros.write_ros1_bag(folder / f"bag_{codec}", messages("ros1"), codec,
                           header_size=128)
    whole = (folder / "bag_none").read_bytes()
    write("recording", "bag_cut", whole[:len(whole) // 2])
    for codec in ("", "lz4", "zstd"):
        ros.write_mcap(folder / f"mcap_{codec or 'none'}", messages("cdr"),
                       compression=codec)
    ros.write_mcap(folder / "mcap_without_chunks", messages("ros1"), "ros1",
                   chunk_size=0)
    database = folder / "db3"
    database.unlink(missing_ok=True)
    ros.write_db3(database, messages("cdr"), "zstd", page_size=512)


def main():
    write("binary_model", "with_rigs", model(True))
    write("binary_model", "without_rigs", model(False))
    for layout in range(3):
        write("database", "layout_%d" % layout, database(layout))
        write("database", "layout_%d_features" % layout,
              database(layout + 129 - 129 % 3))
    write("database", "view",
          database(1, "DROP TABLE images; CREATE VIEW images AS WITH RECURSIVE "
                      "c(x) AS (SELECT 1 UNION ALL SELECT x+1 FROM c) SELECT "
                      "x image_id, x||'' name, 1 camera_id FROM c"))
    write("database", "overwritten",
          database(1, patches=struct.pack("<HBHBHB", 600, 7, 1100, 255, 40, 1)))
    recordings()
    write("exif", "tiff", exif_tiff())
    write("exif", "jpeg", exif_jpeg())
    write("vocabulary", "two_words", vocabulary())
    write("vocabulary", "truncated", vocabulary()[:-1])


if __name__ == "__main__":
    main()
