// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/database/database.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Where rigs and frames come from; the first that is given decides:
//
// 1. `rig_config_path`: COLMAP's rig_config.json, see rig_config.h, or a folder
//    with one or with a sparse model, whose calibration is taken. Images that
//    no prefix covers are single: each camera a rig of its own, each image a
//    frame.
// 2. `rig_name_rule` other than "auto".
//    "none": all images are single.
//    A regular expression (ECMAScript) that matches all image names. The group
//    (?<camera>...) is what tells the cameras of a rig apart, e.g.
//      [^/]+/(?<camera>[^/]+)/.*       seqA/cam0/0001.jpg
//      (?<camera>left|right)_.*        left_0001.jpg
//    Images are of one frame if their names agree when the camera group is
//    taken out, or, if groups (?<frame>...) are given, when these agree. Images
//    with different (?<rig>...) are of different rigs.
// 3. The tables rigs and frames of the database, if any rig there has several
//    cameras or any frame several images (COLMAP's extractor makes one of each
//    per camera and image, which says nothing).
// 4. The folders in the image names. One level of folders tells the cameras
//    apart: images are of one frame if their names agree when that folder is
//    taken out, up to the extension: cam0/seq/0001.jpg and cam1/seq/0001.jpg
//    are, cam0/seqA/0001.jpg and cam0/seqB/0001.jpg are not. The level is the
//    one whose folders are mostly called like cameras (cam, image, left,
//    right, front, ...), else by which clearly the most images share frames
//    (10 % more than by any other), else the only one whose folders each have
//    one set of intrinsics; if that leaves several, an Error asks for a rule.
//    Names of different depth are independent. Folders that share a frame,
//    directly or through others, make a rig; the images of all other folders
//    are single.
//
// Where cameras of the same name have different intrinsics in different outer
// folders (rig1/cam0, rig2/cam0), each outer folder is a rig of its own. Within
// a folder of a rig, the images must have one camera, or equal ones, which are
// then joined to one; else an Error says so.
//
// The reference sensor is that of 1 or 3, and else the one with most images,
// ties by name. If it has no image, another takes its place.
struct SceneLoadingOptions {
  std::string rig_config_path;
  std::string rig_name_rule = "auto";

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("rig_config_path", self.rig_config_path, AnyValue(), "",
          "COLMAP's rig_config.json, or the folder of an earlier model, whose "
          "calibration is taken. Goes before rigs in the database.");
    visit("rig_name_rule", self.rig_name_rule, AnyValue(), "",
          "How image names tell cameras and frames: auto (by folder, unless "
          "the database has rigs), none (single images), or a regular "
          "expression with a group (?<camera>...) and optional groups "
          "(?<frame>...) and (?<rig>...).");
  }
};

struct LoadedScene {
  Scene scene;
  ViewGraph view_graph;
  std::string rig_source;  // in words, for the report
};

// Reads a database, see ReadDatabase, and puts it in the canonical order of
// Scene and ViewGraph. Pairs without matches are left out. The result depends
// on ids in nothing but the ids it holds. Throws Error for bad input.
[[nodiscard]] LoadedScene LoadScene(const std::string& database_path,
                                    const SceneLoadingOptions& options,
                                    const Context& context);

// The same from rows that are in memory already.
[[nodiscard]] LoadedScene LoadScene(DatabaseContents contents,
                                    const SceneLoadingOptions& options,
                                    const Context& context);

}  // namespace mgsfm
