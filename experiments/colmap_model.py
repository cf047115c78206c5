# SPDX-License-Identifier: BSD-3-Clause
"""Reads and writes models in COLMAP's formats, without points."""
import contextlib
import pathlib
import struct

from experiments import poses
from experiments.text_files import MALFORMED, names_its_file


def pose_text(pose):
    """Quaternion and translation of the inverse of a rigid 4 x 4 matrix."""
    r, t = poses.inverse(pose)
    return " ".join(repr(float(n))
                    for n in [*poses.quaternion_from_rotation(r), *t])


def write_truth(folder, camera_lines, rig_from_cam, frames):
    """Writes the ground truth of a drive as a text model with one rig.

    camera_lines: "FOLDER MODEL WIDTH HEIGHT PARAMS..." of each camera.
    rig_from_cam: {FOLDER: 4 x 4 matrix}; that of the first camera is the
    identity. frames: {name: world_from_rig as 4 x 4 matrix, meters}; images are
    called FOLDER/name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = [line.split(maxsplit=1)[0] for line in camera_lines]
    with open(folder / "cameras.txt", "w", encoding="utf-8") as file:
        for k, line in enumerate(camera_lines, 1):
            file.write(f"{k} {line.split(maxsplit=1)[1]}\n")
    with open(folder / "rigs.txt", "w", encoding="utf-8") as file:
        others = "".join(f" CAMERA {k} 1 {pose_text(rig_from_cam[camera])}"
                         for k, camera in enumerate(cameras[1:], 2))
        file.write(f"1 {len(cameras)} CAMERA 1{others}\n")
    write_frames(folder, cameras, rig_from_cam, frames)
    (folder / "points3D.txt").write_text("")


def write_frames(folder, cameras, rig_from_cam, frames):
    """images.txt and frames.txt of write_truth()."""
    with contextlib.ExitStack() as stack:
        images, rows = (stack.enter_context(
            open(folder / name, "w", encoding="utf-8"))
            for name in ("images.txt", "frames.txt"))
        image_id = 0
        for frame_id, (name, pose) in enumerate(frames.items(), 1):
            data = ""
            for k, camera in enumerate(cameras, 1):
                image_id += 1
                data += f" CAMERA {k} {image_id}"
                world_from_cam = poses.product(pose, rig_from_cam[camera])
                images.write(f"{image_id} {pose_text(world_from_cam)} {k} "
                             f"{camera}/{name}\n\n")
            rows.write(f"{frame_id} 1 {pose_text(pose)} {len(cameras)}{data}\n")


def read_positions(model):
    """{image name: camera center, world units} of a binary or text model."""
    return {name: poses.camera_center(quaternion, translation)
            for name, (quaternion, translation) in read_poses(model).items()}


def read_poses(model):
    """{image name: (quaternion, translation) of cam_from_world}, of a binary or
    text model."""
    model = pathlib.Path(model)
    if (model / "images.bin").exists():
        return read_binary_poses(model / "images.bin")
    return read_text_poses(model / "images.txt")


@names_its_file
def read_text_poses(path):
    """The text case of read_poses()."""
    result = {}
    for line in text_image_lines(path):
        words = line.split(maxsplit=9)
        numbers = tuple(map(float, words[1:8]))
        result[words[9].rstrip()] = (numbers[:4], numbers[4:])
    return result


def text_image_lines(path):
    """The first line of each image; the second lists its keypoints. Some
    programs omit it if it is empty."""
    lines, is_first = [], True
    for line in path.read_text(encoding="utf-8-sig").splitlines():
        if line.startswith("#"):
            continue
        # Keypoints have three numbers each; an image has at least ten words.
        if is_first or is_image_line(line):
            if line.strip():
                lines.append(line)
                is_first = False
        else:
            is_first = True
    return lines


def is_image_line(line):
    """False for a line of keypoints, that is, of triples of numbers."""
    words = line.split()
    try:
        numbers = list(map(float, words))
    except ValueError:
        return True
    return len(numbers) % 3 != 0


@names_its_file
def read_binary_poses(path):
    """The binary case of read_poses()."""
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    result, at = {}, 8
    for _ in range(count):
        numbers = struct.unpack_from("<7d", data, at + 4)
        at += 4 + 56 + 4
        end = data.index(b"\0", at)
        result[data[at:end].decode()] = (numbers[:4], numbers[4:])
        (num_points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * num_points
    return result


def num_images(model):
    """The number of images of a model; 0 if the folder holds none that can be
    read, as a program that is stopped leaves it."""
    try:
        if (model / "images.bin").exists():
            with open(model / "images.bin", "rb") as file:
                (count,) = struct.unpack("<Q", file.read(8))
            return count
        if (model / "images.txt").exists():
            return len(text_image_lines(model / "images.txt"))
    except MALFORMED:
        pass
    return 0


def largest_model(folder):
    """The model with most images in a folder or its sub-folders, or None."""
    candidates = [folder, *sorted(p for p in folder.glob("*") if p.is_dir())]
    best = max(candidates, key=num_images)
    return best if num_images(best) > 0 else None
