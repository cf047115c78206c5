# SPDX-License-Identifier: BSD-3-Clause
"""Shows a model in Rerun: python3 view_in_rerun.py MODEL [IMAGES [FILE.rrd]]

Opens the viewer, or writes a recording. Needs rerun-sdk 0.23 or later.
"""
import sys
from pathlib import Path

import numpy as np
import pymgsfm
import rerun as rr


def log_pose(name, child_from_parent, **keywords):
    rr.log(name, rr.Transform3D(
        translation=np.array(child_from_parent.translation),
        rotation=rr.Quaternion(xyzw=child_from_parent.rotation.quat),
        relation=rr.TransformRelation.ChildFromParent), **keywords)


def is_nearly_pinhole(camera):
    """Whether two corners are less than 60 degrees off the optical axis."""
    rays = camera.cam_ray_from_img(
        [[0.5, 0.5], [camera.width - 0.5, camera.height - 0.5]])
    return bool((rays[:, 2] > 0.5).all())  # NaN: a corner has no ray


def show(model, image_path=None):
    """Cameras are children of the rig, which moves along a timeline."""
    frames = [model.frames[i] for i in sorted(model.frames)]
    path = [f.rig_from_world.inverse().translation for f in frames]
    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Y_DOWN, static=True)
    rr.log("world/path", rr.LineStrips3D([path]), static=True)
    rr.log("world/points", rr.Points3D(
        model.points3D.xyz, colors=model.points3D.color), static=True)
    for rig in model.rigs.values():
        for camera_id, sensor_from_rig in rig.sensors.items():
            if sensor_from_rig is None:
                continue
            name = f"world/rig_{rig.rig_id}/camera_{camera_id}"
            camera = model.cameras[camera_id]
            log_pose(name, sensor_from_rig, static=True)
            if is_nearly_pinhole(camera):
                rr.log(f"{name}/image", rr.Pinhole(
                    image_from_camera=camera.calibration_matrix(),
                    resolution=[camera.width, camera.height]), static=True)
    for number, frame in enumerate(frames):
        rr.set_time("frame", sequence=number)
        name = f"world/rig_{frame.rig_id}"
        log_pose(name, frame.rig_from_world)
        for image in (model.images[i] for i in frame.image_ids if image_path):
            rr.log(f"{name}/camera_{image.camera_id}/image",
                   rr.EncodedImage(path=Path(image_path, image.name)))


if __name__ == "__main__":
    rr.init("mgsfm", spawn=len(sys.argv) < 4)
    if len(sys.argv) > 3:
        rr.save(sys.argv[3])
    show(pymgsfm.Reconstruction(sys.argv[1]), *sys.argv[2:3])
