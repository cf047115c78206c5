// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

#include "database/database_merging.h"
#include "mgsfm/database/database.h"

namespace mgsfm {

// The cameras, images, rigs and frames of one of the databases to merge.
struct StructureInput : MergeInput {
  DatabaseContents contents;
  std::map<CameraId, std::string> shard_cameras;  // see database_shard.h
};

struct MergedStructure {
  std::vector<Camera> cameras;
  std::vector<ImageRow> images;
  std::vector<RigRow> rigs;
  std::vector<FrameRow> frames;
  // Per input: maps an id of the input to a position in `images`.
  std::vector<std::unordered_map<int64_t, size_t>> image_positions;
  bool has_common_images = false;
};

// Whether two lists have the same values of `key`.
template <class T, class Key>
bool AreEqualBy(const std::vector<T>& a, const std::vector<T>& b,
                const Key& key) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [&](const T& x, const T& y) { return key(x) == key(y); });
}

// The union, in canonical order and with the ids 1, 2, ...: images by name,
// everything else by its first image. The result depends neither on the order
// of the inputs nor on their ids. These are equal:
// - images of the same name, with prefix;
// - cameras of equal images, or whose images are in the same folder of two
//   inputs of one vehicle;
// - rigs with the same reference camera;
// - frames with a common image.
// Throws Error, naming the image, if two equal things differ.
MergedStructure MergeStructures(const std::vector<StructureInput>& inputs);

}  // namespace mgsfm
