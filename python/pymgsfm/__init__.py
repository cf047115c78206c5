# SPDX-License-Identifier: BSD-3-Clause
"""Structure from motion for camera rigs: the commands of mgsfm as functions,
models in memory, and averaging of one's own relative poses.

    import pymgsfm
    models = pymgsfm.global_mapping("database.db", "images", "sparse")
    print(models[0].summary())

Threads may call any function at the same time; runs that write must have
outputs of their own. A process may fork as long as none of its threads runs a
function of pymgsfm, as the child has no other thread and keeps their locks.
"""

from ._core import commit as __commit__
from ._core import version as __version__
from .averaging import (ONE_CAMERA, Rotations, SensorState, Translations,
                        ViewGraph, average_rotations, average_translations)
from .commands import (automatic_reconstruction, build_vocab_tree,
                       bundle_adjustment, configure_rigs, evaluate, extend,
                       extract_features, global_mapping, import_features,
                       import_matches, import_recording, incremental_mapping,
                       match_exhaustive, match_sequential, match_spatial,
                       match_vocab_tree, partition, report, run, sample_videos,
                       simulate, split_images, triangulate_points,
                       verify_matches)
from .errors import InputError, InternalError, NotSolvableError
from .geometry import Rigid3d, Rotation3d
from .options import OptionGroup, OptionInfo, Options
from .reconstruction import (INVALID_POINT3D_ID, Camera, Frame, Image, Point2D,
                             Point3D, Points2D, Points3D, Reconstruction, Rig,
                             Track, TrackElement)
from .tools import (align_model, analyze_model, clean_database, convert_model,
                    crop_model, delete_images, join_models, merge_databases,
                    merge_models, split_model, undistort)

__all__ = [
    "__commit__", "__version__",
    "Camera", "Frame", "INVALID_POINT3D_ID", "Image", "InputError",
    "InternalError", "NotSolvableError", "ONE_CAMERA", "OptionGroup",
    "OptionInfo", "Options", "Point2D", "Point3D", "Points2D", "Points3D",
    "Reconstruction", "Rig", "Rigid3d", "Rotation3d", "Rotations",
    "SensorState", "Track", "TrackElement", "Translations", "ViewGraph",
    "align_model", "analyze_model", "automatic_reconstruction",
    "average_rotations", "average_translations", "build_vocab_tree",
    "bundle_adjustment", "clean_database", "configure_rigs", "convert_model",
    "crop_model", "delete_images", "evaluate", "extend", "extract_features",
    "global_mapping", "import_features", "import_matches",
    "import_recording", "incremental_mapping", "join_models",
    "match_exhaustive", "match_sequential", "match_spatial",
    "match_vocab_tree", "merge_databases", "merge_models", "partition",
    "report", "run", "sample_videos", "simulate", "split_images",
    "split_model", "triangulate_points", "undistort", "verify_matches",
]
