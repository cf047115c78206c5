// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/database/database.h"
#include "mgsfm/scene/pair_matches.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Sources of rigs and frames; the first one that is given is used:
//
// 1. `rig_config_path`: COLMAP's rig_config.json (see rig_config.h), or a
//    folder with this file or with a sparse model, whose calibration is used.
//    Images without a matching prefix are single: each camera is a rig, each
//    image a frame. Or `calibration_path`: a calibration in another format
//    (src/io/calibration/calibration_rigs.h), likewise. With a list of images,
//    2 to 4 apply to those without a matching prefix: the calibration of one
//    part of a database may lack the rigs of another.
// 2. `rig_name_rule` other than "auto".
//    "none": all images are single.
//    A regular expression of RE2, i.e. without back-references and look-around,
//    that matches all image names. The group (?<camera>...) identifies the
//    camera of the rig, e.g.
//      [^/]+/(?<camera>[^/]+)/.*       seqA/cam0/0001.jpg
//      (?<camera>left|right)_.*        left_0001.jpg
//    Images belong to one frame if their names agree without the camera group
//    or, if there are groups (?<frame>...), if these agree. Images with
//    different (?<rig>...) belong to different rigs.
// 3. The tables rigs and frames of the database, if any rig there has several
//    cameras or any frame several images (COLMAP's extractor writes one rig per
//    camera and one frame per image, which carries no information).
// 4. The folders in the image names. One level of folders identifies the
//    camera: images belong to one frame if their names agree without that
//    folder and the extension: cam0/seq/0001.jpg and cam1/seq/0001.jpg do,
//    cam0/seqA/0001.jpg and cam0/seqB/0001.jpg do not. The level is the one
//    whose folders are mostly named like cameras (cam, image, left, right,
//    front, ...), else the one by which the most images share frames (10 % more
//    than by any other), else the only one whose folders each have one set of
//    intrinsics; if several levels remain, an Error asks for a rule.
//    Names of different depth are independent. Folders that share a frame,
//    directly or through others, make a rig; the images of all other folders
//    are single.
//
// If cameras of the same name have different intrinsics in different outer
// folders (rig1/cam0, rig2/cam0), each outer folder is a separate rig. The
// images of a camera folder must have one camera, or equal ones, which are
// merged; otherwise, LoadScene throws Error.
//
// With `frame_max_time_difference_s`, names define the cameras only (1, 2 and
// 4; 3 is skipped), and images of different cameras of a rig belong to one
// frame by their times (src/io/rigs/frames_by_time.h). In 4, any level of
// folders may then identify the camera.
//
// The reference sensor is given by 1 or 3; otherwise it is the one with the
// most images, ties by name. If it has no image, another sensor replaces it.
struct SceneLoadingOptions {
  Option<std::string> rig_config_path{
      "rig_config_path", "",
      "Read the rigs from COLMAP's rig_config.json, or from the folder of an "
      "earlier model with the calibration. They override the rigs of the "
      "database."};
  Option<std::string> calibration_path{
      "calibration_path", "",
      "Read intrinsics and poses in the rig from a calibration by Kalibr, "
      "EuRoC (sensor.yaml), OpenCV, ROS, KITTI, KITTI-360, nuScenes, Argoverse "
      "1, OpenSfM (rig_cameras.json), kapture (sensors.txt) or COLMAP "
      "(rig_config.json): a file, several separated by commas, or a folder."};
  Option<std::string> rig_name_rule{
      "rig_name_rule", "auto",
      "Choose how image names identify cameras and frames: auto (by folder, or "
      "by the part of names in one folder that is called like cameras, unless "
      "the database has rigs), none (single images), or a regular "
      "expression with a group (?<camera>...) and optional groups "
      "(?<frame>...) and (?<rig>...)."};

  Option<double> frame_max_time_difference_s{
      "frame_max_time_difference_s", 0.0, Between(0.0, 1e6), "s",
      "Pair images of different cameras into frames by their times, one to "
      "one, if they are at most this far apart. 0 pairs by name. Set it if "
      "names are times that differ from camera to camera."};
  Option<std::string> image_timestamps_path{
      "image_timestamps_path", "",
      "Read the exposure times of images from this file with one line "
      "`image_name SECONDS` per image. Without it, frame_max_time_difference_s "
      "and the methods of SoftRig.method that estimate times use those in "
      "image "
      "names."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(rig_config_path, calibration_path, rig_name_rule,
          frame_max_time_difference_s, image_timestamps_path);
  }

  bool HasKnownRig() const {
    return !rig_config_path->empty() || !calibration_path->empty();
  }
  bool PairsFramesByTime() const { return frame_max_time_difference_s > 0.0; }
};

// Changes of a loaded scene at the user's request.
struct RigSplitOptions {
  Option<std::string> split_rig_at{
      "split_rig_at", "",
      "Calibrate the rig separately from the frame of this name on. Set it if "
      "a camera was moved during the recording."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(split_rig_at);
  }
};

struct LoadedScene {
  Scene scene;
  ViewGraph view_graph;
  std::string rig_source;  // for messages and the report
};

// Reads a database (ReadDatabase) into the canonical order of Scene and
// ViewGraph. Pairs without matches are dropped. Renumbering the database
// changes only the ids in the result. Throws Error for bad input.
[[nodiscard]] LoadedScene LoadScene(const std::string& database_path,
                                    const SceneLoadingOptions& options,
                                    const Context& context);

// The same for rows in memory.
[[nodiscard]] LoadedScene LoadScene(DatabaseContents contents,
                                    const SceneLoadingOptions& options,
                                    const Context& context);

struct LoadedMatches {
  Scene scene;
  std::vector<PairMatches> pairs;  // sorted as in a ViewGraph
};

// The same for rows that were selected without geometries.
[[nodiscard]] LoadedMatches LoadMatches(DatabaseContents contents,
                                        const SceneLoadingOptions& options,
                                        const Context& context);

}  // namespace mgsfm
