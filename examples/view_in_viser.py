# SPDX-License-Identifier: BSD-3-Clause
"""Shows a model in a browser: python3 view_in_viser.py MODEL [IMAGES]

Needs viser 1.0 or later, and Pillow.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pymgsfm
import viser
from PIL import Image


def placed(parent_from_child):
    x, y, z, w = parent_from_child.rotation.quat
    return {"wxyz": np.array([w, x, y, z]),
            "position": np.array(parent_from_child.translation)}


def vertical_fov_rad(camera):
    """At most 2, because no frustum shows the whole view of a fisheye."""
    x, y = 0.5 * camera.width, camera.height - 0.5
    top, bottom = camera.cam_ray_from_img([[x, 0.5], [x, y]])[:, 2]
    return float(np.nanmin([np.arccos(top) + np.arccos(bottom), 2.0]))


def show(scene, model, image_path=None):
    """Cameras are children of the frames of the rig."""
    frames = [model.frames[i] for i in sorted(model.frames)]
    path = np.array([f.rig_from_world.inverse().translation for f in frames])
    size = 0.02 * np.linalg.norm(np.ptp(path, axis=0)) or 1.0
    downs = [f.rig_from_world.rotation.matrix()[1] for f in frames]
    scene.set_up_direction(tuple(-np.mean(downs, axis=0)))
    scene.add_point_cloud("/points", model.points3D.xyz, model.points3D.color,
                          point_size=0.1 * size, precision="float32")
    scene.add_line_segments("/path", np.stack([path[:-1], path[1:]], axis=1),
                            colors=(230, 60, 20))
    for frame in frames:
        name = f"/frames/{frame.frame_id}"
        scene.add_frame(name, axes_length=size, axes_radius=0.03 * size,
                        **placed(frame.rig_from_world.inverse()))
        for image in (model.images[i] for i in frame.image_ids):
            camera = image.camera
            pose = frame.rig.sensor_from_rig(camera.camera_id).inverse()
            file = image_path and Path(image_path, image.name)
            scene.add_camera_frustum(
                f"{name}/{camera.camera_id}", vertical_fov_rad(camera),
                camera.width / camera.height, scale=size, **placed(pose),
                image=file and np.array(
                    Image.open(file).convert("RGB").reduce(4)))


if __name__ == "__main__":
    server = viser.ViserServer()
    show(server.scene, pymgsfm.Reconstruction(sys.argv[1]), *sys.argv[2:3])
    while True:
        time.sleep(1.0)
