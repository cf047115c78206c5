# SPDX-License-Identifier: BSD-3-Clause
"""Simulated models in COLMAP's binary format, written without mgsfm."""

import dataclasses
import pathlib
import struct

import numpy as np

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 640, 480, 400.0
STEP = 1.0
# cam_from_rig of the sensors: to the front, front, left and right.
SENSORS = [(0.0, [0.0, 0.0, 0.0]), (0.0, [-0.5, 0.0, 0.0]),
           (1.2, [0.3, 0.0, 0.2]), (-1.2, [-0.3, 0.0, 0.2])]


@dataclasses.dataclass
class Model:
    names: list  # of images
    rotations: np.ndarray  # cam_from_world
    translations: np.ndarray
    points: np.ndarray
    colors: np.ndarray
    tracks: list  # per point, [(image, keypoint)]
    keypoints: list  # per image, [(x, y, point)]
    camera_of_image: list

    def centers(self):
        return -np.einsum("nji,nj->ni", self.rotations, self.translations)


def about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def make_drive(num_frames=20, num_sensors=2, points_per_frame=12, reach=6,
               name="cam{sensor}/{frame:06}.png", offset=(0.0, 0.0, 0.0),
               noise_px=0.3):
    """A rig drives along a curve with y down; points lie around it."""
    random = np.random.default_rng(0)
    angles = np.cumsum(0.02 * np.sin(np.arange(num_frames) / 40.0))
    directions = np.stack([np.sin(angles), np.zeros(num_frames),
                           np.cos(angles)], axis=1)
    places = np.cumsum(STEP * directions, axis=0) + np.array(offset)
    points = np.repeat(places, points_per_frame, axis=0)
    points = points + random.uniform([-12, -4, -2], [12, 1, 14], points.shape)
    model = Model([], [], [], points,
                  random.integers(40, 255, points.shape).astype(np.uint8),
                  [[] for _ in points], [], [])
    for sensor in range(num_sensors):
        angle, translation = SENSORS[sensor]
        for frame in range(num_frames):
            rotation = about_y(angle) @ about_y(angles[frame]).T
            translation_in_world = (np.array(translation)
                                    - rotation @ places[frame])
            add_image(model, sensor, name.format(sensor=sensor, frame=frame),
                      rotation, translation_in_world, frame, points_per_frame,
                      reach, noise_px, random)
    model.rotations = np.array(model.rotations)
    model.translations = np.array(model.translations)
    return model


def add_image(model, sensor, name, rotation, translation, frame,
              points_per_frame, reach, noise_px, random):
    first = max(0, frame - 1) * points_per_frame
    last = min(len(model.points), (frame + reach) * points_per_frame)
    in_cam = model.points[first:last] @ rotation.T + translation
    depth = np.maximum(in_cam[:, 2:], 1e-9)
    pixels = (FOCAL_PX * in_cam[:, :2] / depth
              + np.array([WIDTH_PX / 2, HEIGHT_PX / 2]))
    seen = ((in_cam[:, 2] > 0.5) & (pixels > 0).all(axis=1)
            & (pixels < [WIDTH_PX, HEIGHT_PX]).all(axis=1))
    keypoints = []
    for k in np.flatnonzero(seen):
        x, y = pixels[k] + random.normal(0.0, noise_px, 2)
        model.tracks[first + k].append((len(model.names), len(keypoints)))
        keypoints.append((x, y, first + k))
    model.names.append(name)
    model.rotations.append(rotation)
    model.translations.append(translation)
    model.keypoints.append(keypoints)
    model.camera_of_image.append(sensor + 1)


def quaternion(rotation):
    """[w, x, y, z] of a rotation by less than 180 degrees."""
    w = 0.5 * np.sqrt(max(0.0, 1.0 + np.trace(rotation)))
    skew = rotation - rotation.T
    return np.array([w, skew[2, 1] / (4 * w), skew[0, 2] / (4 * w),
                     skew[1, 0] / (4 * w)])


def write_model(model, folder):
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True)
    cameras = sorted(set(model.camera_of_image))
    pinhole = 1
    with open(folder / "cameras.bin", "wb") as file:
        file.write(struct.pack("<Q", len(cameras)))
        for camera in cameras:
            file.write(struct.pack("<IiQQ4d", camera, pinhole, WIDTH_PX,
                                   HEIGHT_PX, FOCAL_PX, FOCAL_PX, WIDTH_PX / 2,
                                   HEIGHT_PX / 2))
    ids = [point + 1 if len(track) >= 2 else 2**64 - 1
           for point, track in enumerate(model.tracks)]
    with open(folder / "images.bin", "wb") as file:
        file.write(struct.pack("<Q", len(model.names)))
        for i, name in enumerate(model.names):
            file.write(struct.pack("<I7dI", i + 1,
                                   *quaternion(model.rotations[i]),
                                   *model.translations[i],
                                   model.camera_of_image[i]))
            file.write(name.encode() + b"\0")
            file.write(struct.pack("<Q", len(model.keypoints[i])))
            for x, y, point in model.keypoints[i]:
                file.write(struct.pack("<ddQ", x, y, ids[point]))
    kept = [point for point, track in enumerate(model.tracks)
            if len(track) >= 2]
    with open(folder / "points3D.bin", "wb") as file:
        file.write(struct.pack("<Q", len(kept)))
        for point in kept:
            track = model.tracks[point]
            file.write(struct.pack("<Q3d3BdQ", ids[point],
                                   *model.points[point], *model.colors[point],
                                   0.3, len(track)))
            for image, keypoint in track:
                file.write(struct.pack("<II", image + 1, keypoint))
    return folder


POINT_OF_TWO_IMAGES = np.dtype([
    ("id", "<u8"), ("xyz", "<3f8"), ("rgb", "3u1"), ("error", "<f8"),
    ("length", "<u8"), ("track", "<4u4")])


def write_dense_model(folder, num_points, num_frames=50):
    """A straight drive of one camera along z. Each point is seen in two
    consecutive frames. Written as arrays, for millions of points."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True)
    random = np.random.default_rng(0)
    frame = np.sort(random.integers(0, num_frames - 1, num_points))
    pixels = random.uniform(0, [WIDTH_PX, HEIGHT_PX], (num_points, 2))
    depth = random.uniform(4, 30, num_points)
    middle = np.array([WIDTH_PX / 2, HEIGHT_PX / 2])
    points = np.c_[(pixels - middle) * depth[:, None] / FOCAL_PX,
                   depth + STEP * frame]
    later = points[:, :2] * FOCAL_PX / (depth - STEP)[:, None] + middle
    starts = np.searchsorted(frame, np.arange(num_frames + 1))
    with open(folder / "cameras.bin", "wb") as file:
        file.write(struct.pack("<QIiQQ4d", 1, 1, 1, WIDTH_PX, HEIGHT_PX,
                               FOCAL_PX, FOCAL_PX, *middle))
    keypoint = np.dtype([("xy", "<2f8"), ("point", "<u8")])
    with open(folder / "images.bin", "wb") as file:
        file.write(struct.pack("<Q", num_frames))
        for i in range(num_frames):
            own = slice(starts[i], starts[i + 1])
            old = slice(starts[max(i - 1, 0)] if i > 0 else 0,
                        starts[i] if i > 0 else 0)
            file.write(struct.pack("<I7dI", i + 1, 1, 0, 0, 0, 0, 0, -STEP * i,
                                   1))
            file.write(f"{i:06}.png".encode() + b"\0")
            keypoints = np.empty(own.stop - own.start + old.stop - old.start,
                                 keypoint)
            keypoints["xy"] = np.r_[later[old], pixels[own]]
            keypoints["point"] = 1 + np.r_[np.arange(old.start, old.stop),
                                           np.arange(own.start, own.stop)]
            file.write(struct.pack("<Q", len(keypoints)))
            file.write(keypoints.tobytes())
    rows = np.zeros(num_points, POINT_OF_TWO_IMAGES)
    rows["id"] = 1 + np.arange(num_points)
    rows["xyz"] = points
    rows["rgb"] = random.integers(40, 255, (num_points, 3))
    rows["length"] = 2
    first = np.arange(num_points) - starts[frame]
    num_old = np.where(frame > 0, starts[frame] - starts[frame - 1], 0)
    rows["track"] = np.c_[frame + 1, first + num_old, frame + 2, first]
    with open(folder / "points3D.bin", "wb") as file:
        file.write(struct.pack("<Q", num_points))
        file.write(rows.tobytes())
    return folder


def read_points(folder):
    """The positions of a model that write_dense_model() wrote."""
    data = (pathlib.Path(folder) / "points3D.bin").read_bytes()
    return np.frombuffer(data, POINT_OF_TWO_IMAGES, offset=8)["xyz"]
