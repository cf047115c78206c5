# SPDX-License-Identifier: BSD-3-Clause
"""One drive of a data set, as its driver hands it to the methods."""
import collections.abc
import dataclasses
import pathlib
import struct

# Calibrated cameras keep the intrinsics of the data set.
FIXED_INTRINSICS = ("--BundleAdjustment.refine_focal_length", "no",
                    "--BundleAdjustment.refine_extra_params", "no")


@dataclasses.dataclass
class Sequence:
    """Images or a database, and the ground truth if there is one."""

    name: str
    # An existing database; without it, features are extracted and matched.
    database: pathlib.Path | None = None
    image_path: pathlib.Path | None = None
    image_list: list = dataclasses.field(default_factory=list)
    # Lines of the file for --ImageReader.camera_params_path.
    camera_lines: list = dataclasses.field(default_factory=list)
    mask_path: pathlib.Path | None = None
    mapper_options: list = dataclasses.field(default_factory=list)
    # Image prefixes of the cameras, the reference camera first, if the folders
    # of the images do not define the rig.
    rig_prefixes: list = dataclasses.field(default_factory=list)
    # Options of `mgsfm model_evaluator`; empty without ground truth.
    truth: list = dataclasses.field(default_factory=list)
    # Returns {image name: true position, meters} for figures.
    truth_positions: collections.abc.Callable[[], dict] = dict


def png_size(path):
    """(width, height) of a PNG in pixels."""
    with open(path, "rb") as file:
        header = file.read(24)
    if header[:8] != b"\x89PNG\r\n\x1a\n" or len(header) < 24:
        raise SystemExit(f"{path} is not a PNG file")
    return struct.unpack(">II", header[16:24])
