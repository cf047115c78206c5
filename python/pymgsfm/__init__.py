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
from .alignment import (ImageAlignmentError, align_reconstruction_to_locations,
                        align_reconstructions_via_proj_centers,
                        align_reconstructions_via_reprojections,
                        compare_reconstructions, estimate_rigid3d,
                        estimate_sim3d)
from .averaging import (ONE_CAMERA, Rotations, SensorState, Translations,
                        ViewGraph, average_rotations, average_translations)
from .cameras import Camera, CameraModelId, SensorType, data_t, sensor_t
from .commands import (automatic_reconstruction, build_vocab_tree,
                       bundle_adjustment, configure_rigs, evaluate, extend,
                       extract_features, global_mapping, import_features,
                       import_matches, import_recording, incremental_mapping,
                       match_exhaustive, match_sequential, match_spatial,
                       match_vocab_tree, partition, report, run, sample_videos,
                       simulate, split_images, triangulate_points,
                       verify_matches)
from .database import (Database, DatabaseTransaction, PosePrior,
                       PosePriorCoordinateSystem, image_pair_to_pair_id,
                       pair_id_to_image_pair)
from .dialect import (BundleAdjustmentOptions, GlobalPipelineOptions,
                      ImageReaderOptions, IncrementalPipelineOptions,
                      SiftExtractionOptions, SiftMatchingOptions,
                      TwoViewGeometryOptions, match_vocabtree,
                      undistort_images)
from .editing import ObservationManager
from .errors import InputError, InternalError, NotSolvableError
from .estimators import (AbsolutePoseEstimationOptions,
                         AbsolutePoseRefinementOptions,
                         EstimateTriangulationOptions, RANSACOptions,
                         TriangulationResidualType, TwoViewGeometry,
                         TwoViewGeometryConfiguration,
                         absolute_pose_estimation,
                         calculate_triangulation_angle,
                         essential_matrix_estimation,
                         essential_matrix_from_pose, estimate_absolute_pose,
                         estimate_and_refine_absolute_pose,
                         estimate_and_refine_generalized_absolute_pose,
                         estimate_calibrated_two_view_geometry,
                         estimate_essential_matrix,
                         estimate_fundamental_matrix,
                         estimate_generalized_absolute_pose,
                         estimate_generalized_relative_pose,
                         estimate_homography_matrix, estimate_relative_pose,
                         estimate_triangulation, estimate_two_view_geometry,
                         fundamental_matrix_estimation,
                         homography_matrix_estimation,
                         pose_from_essential_matrix, pose_refinement,
                         refine_absolute_pose,
                         refine_generalized_absolute_pose,
                         rig_absolute_pose_estimation, squared_sampson_error)
from .geometry import AlignedBox3d, Rigid3d, Rotation3d, Sim3d
from .options import OptionGroup, OptionInfo, Options
from .points import Point3D, Points3D, Track, TrackElement
from .reconstruction import Reconstruction
from .scene import (INVALID_POINT3D_ID, Frame, Image, ListPoint2D, Point2D,
                    Point2DList, Points2D, Rig)
from .tools import (align_model, analyze_model, clean_database, convert_model,
                    crop_model, delete_images, join_models, merge_databases,
                    merge_models, split_model, undistort)

__all__ = [
    "__commit__", "__version__",
    "AbsolutePoseEstimationOptions", "AbsolutePoseRefinementOptions",
    "AlignedBox3d", "BundleAdjustmentOptions", "Camera", "CameraModelId",
    "Database", "DatabaseTransaction", "EstimateTriangulationOptions", "Frame",
    "GlobalPipelineOptions", "INVALID_POINT3D_ID", "Image",
    "ImageAlignmentError", "ImageReaderOptions", "IncrementalPipelineOptions",
    "InputError", "InternalError", "ListPoint2D", "NotSolvableError",
    "ONE_CAMERA", "ObservationManager", "OptionGroup", "OptionInfo", "Options",
    "Point2D", "Point2DList", "Point3D", "Points2D", "Points3D", "PosePrior",
    "PosePriorCoordinateSystem", "RANSACOptions", "Reconstruction", "Rig",
    "Rigid3d", "Rotation3d", "Rotations", "SensorState", "SensorType",
    "SiftExtractionOptions", "SiftMatchingOptions", "Sim3d", "Track",
    "TrackElement", "Translations", "TriangulationResidualType",
    "TwoViewGeometry", "TwoViewGeometryConfiguration",
    "TwoViewGeometryOptions", "ViewGraph", "absolute_pose_estimation",
    "align_model", "align_reconstruction_to_locations",
    "align_reconstructions_via_proj_centers",
    "align_reconstructions_via_reprojections", "analyze_model",
    "automatic_reconstruction", "average_rotations", "average_translations",
    "build_vocab_tree", "bundle_adjustment", "calculate_triangulation_angle",
    "clean_database", "compare_reconstructions", "configure_rigs",
    "convert_model", "crop_model", "data_t", "delete_images",
    "essential_matrix_estimation", "essential_matrix_from_pose",
    "estimate_absolute_pose", "estimate_and_refine_absolute_pose",
    "estimate_and_refine_generalized_absolute_pose",
    "estimate_calibrated_two_view_geometry", "estimate_essential_matrix",
    "estimate_fundamental_matrix", "estimate_generalized_absolute_pose",
    "estimate_generalized_relative_pose", "estimate_homography_matrix",
    "estimate_relative_pose", "estimate_rigid3d", "estimate_sim3d",
    "estimate_triangulation", "estimate_two_view_geometry", "evaluate",
    "extend", "extract_features", "fundamental_matrix_estimation",
    "global_mapping", "homography_matrix_estimation", "image_pair_to_pair_id",
    "import_features", "import_matches", "import_recording",
    "incremental_mapping", "join_models",
    "match_exhaustive", "match_sequential", "match_spatial",
    "match_vocab_tree", "match_vocabtree", "merge_databases", "merge_models",
    "pair_id_to_image_pair", "partition", "pose_from_essential_matrix",
    "pose_refinement", "refine_absolute_pose",
    "refine_generalized_absolute_pose", "report",
    "rig_absolute_pose_estimation", "run", "sample_videos", "sensor_t",
    "simulate", "split_images", "split_model", "squared_sampson_error",
    "triangulate_points", "undistort", "undistort_images", "verify_matches",
]
