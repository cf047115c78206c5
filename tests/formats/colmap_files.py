# SPDX-License-Identifier: BSD-3-Clause
"""COLMAP's files, read and written from the definition of their formats."""
import struct
from dataclasses import dataclass, field

import numpy

NUM_PARAMS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8}
NO_POINT = 2**64 - 1


def rotation_of(w, x, y, z):
    return numpy.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def matrix_of(values):
    """The 4 x 4 matrix of qw qx qy qz tx ty tz."""
    matrix = numpy.eye(4)
    matrix[:3, :3] = rotation_of(*values[:4])
    matrix[:3, 3] = values[4:]
    return matrix


class Bytes:
    def __init__(self, path):
        self.data, self.position = path.read_bytes(), 0

    def take(self, layout):
        values = struct.unpack_from("<" + layout, self.data, self.position)
        self.position += struct.calcsize("<" + layout)
        return values if len(values) > 1 else values[0]

    def name(self):
        end = self.data.index(b"\0", self.position)
        name = self.data[self.position:end].decode()
        self.position = end + 1
        return name

    def records(self):
        for _ in range(self.take("Q")):
            yield self
        assert self.position == len(self.data)


@dataclass
class Image:
    cam_from_world: numpy.ndarray
    camera: int
    name: str
    keypoints: list = field(default_factory=list)  # x, y, id of the point


@dataclass
class Model:
    cameras: dict = field(default_factory=dict)  # model, width, height, params
    images: dict = field(default_factory=dict)
    points: dict = field(default_factory=dict)  # xyz, rgb, error, track
    rigs: dict = field(default_factory=dict)  # sensor: sensor_from_rig
    frames: dict = field(default_factory=dict)  # rig, pose, images


def read_binary(folder):
    model = Model()
    for f in Bytes(folder / "cameras.bin").records():
        number, kind, width, height = f.take("IiQQ")
        model.cameras[number] = (kind, width, height,
                                 f.take(f"{NUM_PARAMS[kind]}d"))
    for f in Bytes(folder / "images.bin").records():
        number = f.take("I")
        image = Image(matrix_of(f.take("7d")), f.take("I"), f.name())
        image.keypoints = [f.take("ddQ") for _ in range(f.take("Q"))]
        model.images[number] = image
    for f in Bytes(folder / "points3D.bin").records():
        number = f.take("Q")
        xyz, rgb, error = f.take("3d"), f.take("3B"), f.take("d")
        model.points[number] = (xyz, rgb, error,
                                [f.take("II") for _ in range(f.take("Q"))])
    for f in Bytes(folder / "rigs.bin").records():
        number, num_sensors = f.take("II")
        kind, reference = f.take("iI")
        sensors = {reference: numpy.eye(4)}
        for _ in range(num_sensors - 1):
            kind, sensor, has_pose = f.take("iIB")
            assert kind == 0
            sensors[sensor] = matrix_of(f.take("7d")) if has_pose else None
        model.rigs[number] = sensors
    for f in Bytes(folder / "frames.bin").records():
        number, rig = f.take("II")
        pose = matrix_of(f.take("7d"))
        data = [f.take("iIQ") for _ in range(f.take("I"))]
        model.frames[number] = (rig, pose, [image for _, _, image in data])
    return model


def lines_of(path):
    return [line for line in path.read_text().split("\n")
            if not line.startswith("#")]


def read_text(folder):
    """The cameras, images and points of a model in text."""
    kinds = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2,
             "RADIAL": 3, "OPENCV": 4, "OPENCV_FISHEYE": 5}
    model = Model()
    for line in filter(None, lines_of(folder / "cameras.txt")):
        number, kind, width, height, *params = line.split()
        model.cameras[int(number)] = (kinds[kind], int(width), int(height),
                                      tuple(map(float, params)))
    lines = lines_of(folder / "images.txt")
    for line, keypoints in zip(lines[0::2], lines[1::2]):
        words = line.split()
        values = iter(keypoints.split())
        model.images[int(words[0])] = Image(
            matrix_of(list(map(float, words[1:8]))), int(words[8]), words[9],
            [(float(x), float(y), NO_POINT if p == "-1" else int(p))
             for x, y, p in zip(values, values, values)])
    for line in filter(None, lines_of(folder / "points3D.txt")):
        words = line.split()
        track = list(map(int, words[8:]))
        model.points[int(words[0])] = (
            tuple(map(float, words[1:4])), tuple(map(int, words[4:7])),
            float(words[7]), list(zip(track[0::2], track[1::2])))
    return model


def project(camera, point_in_cam):
    """Pixels of pinhole cameras without distortion."""
    kind, _, _, params = camera
    fx, fy, cx, cy = params if kind == 1 else (params[0], *params[:3])
    x, y, z = point_in_cam[:3]
    return numpy.array([fx * x / z + cx, fy * y / z + cy])
