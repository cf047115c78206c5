# SPDX-License-Identifier: BSD-3-Clause
"""The calibration and the poses of KITTI-360, in COLMAP's conventions."""
import numpy as np

from experiments.datasets import mei_camera
from experiments.text_files import names_its_file


@names_its_file
def read_matrices(path, num_rows, columns_of=()):
    """{first word without colon: matrix with `num_rows` rows}; 3 x 4 matrices
    become 4 x 4. Lines of other sizes are skipped.

    columns_of: {name: number of columns} of matrices that must be there. All
    of them but projections, P_..., start with a rotation.
    """
    matrices = {}
    for line in path.read_text().splitlines():
        words = line.split()
        try:
            values = list(map(float, words[1:]))
        except ValueError:
            continue
        if len(values) % num_rows or len(values) < num_rows * 3:
            continue
        matrix = np.array(values).reshape(num_rows, -1)
        matrices[words[0].rstrip(":")] = matrix
    for name, num_columns in dict(columns_of).items():
        matrix = matrices[name]
        if matrix.shape != (num_rows, num_columns):
            raise ValueError(f"{name} has {matrix.size} numbers, not "
                             f"{num_rows * num_columns}")
        if not np.isfinite(matrix).all():
            raise ValueError(f"{name} has a number that is not finite")
        if not name.startswith("P_") and not is_rotation(matrix[:3, :3]):
            raise ValueError(f"{name} is no rotation matrix")
    return {name: np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
            if matrix.shape == (3, 4) else matrix
            for name, matrix in matrices.items()}


def is_rotation(matrix):
    """True for an orthonormal right-handed matrix, up to three digits."""
    return (np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-2
            and np.linalg.det(matrix) > 0.0)


def read_world_from_cam0(path):
    """{frame number as text: 4 x 4 matrix, meters}."""
    return read_matrices(path, 4)


class Calibration:
    """Camera parameters, and cam0_from[camera]: the pose (4 x 4, meters) of
    each camera, rectified if it is perspective, in the first perspective one.
    """

    def __init__(self, folder, perspective_cameras, fisheye_cameras):
        pose_from_cam = read_matrices(
            folder / "calib_cam_to_pose.txt", 3,
            dict.fromkeys([*perspective_cameras, *fisheye_cameras], 4))
        perspective = read_matrices(
            folder / "perspective.txt", 3,
            {f"{kind}_rect_{k:02}": num_columns
             for k in range(len(perspective_cameras))
             for kind, num_columns in (("R", 3), ("P", 4))})
        pose_from, self.params = {}, {}
        for k, camera in enumerate(perspective_cameras):
            rectified = np.eye(4)
            rectified[:3, :3] = perspective[f"R_rect_{k:02}"]
            pose_from[camera] = pose_from_cam[camera] @ rectified.T
            p = perspective[f"P_rect_{k:02}"]
            self.params[camera] = ("PINHOLE",
                                   [p[0, 0], p[1, 1], p[0, 2], p[1, 2]])
        for camera in fisheye_cameras:
            pose_from[camera] = pose_from_cam[camera]
            self.params[camera] = ("OPENCV_FISHEYE", fit_fisheye(
                camera, folder / f"{camera}.yaml"))
        cam0_from_pose = np.linalg.inv(pose_from[perspective_cameras[0]])
        self.cam0_from = {camera: cam0_from_pose @ pose
                          for camera, pose in pose_from.items()}

    def camera_text(self, camera, size):
        """"MODEL WIDTH HEIGHT PARAMS..." of a camera; size in pixels."""
        model, params = self.params[camera]
        return (f"{model} {size[0]} {size[1]} "
                + " ".join(repr(float(p)) for p in params))

    def cam_from_cam(self, to_camera, from_camera):
        """The pose (4 x 4, meters) of one camera in another."""
        return (np.linalg.inv(self.cam0_from[to_camera])
                @ self.cam0_from[from_camera])


def fit_fisheye(camera, path):
    """Parameters of OPENCV_FISHEYE; prints how well they fit."""
    fitted, rms, largest = mei_camera.fit_fisheye(mei_camera.read_mei(path))
    print(f"{camera}: OPENCV_FISHEYE differs from the calibration by "
          f"{rms:.3f} px (root mean square), {largest:.3f} px at most, "
          "up to 95 deg from the axis")
    return list(fitted)
