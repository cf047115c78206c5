// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "base/text_lines.h"
#include "matching/pair_selection.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// COLMAP's text files of image pairs and matches. Image names may contain
// blanks if the line splits into two known names in only one way. Empty lines
// between pairs and lines that start with '#' are skipped. All readers throw
// Error, naming the file and the line, for anything else.

// One line `name1 name2` per pair. Image indices are those of `image_names`.
ImagePairList ReadPairList(TextLines lines,
                           const std::vector<std::string>& image_names);

struct ListedMatches {
  ImageIdxPair images;
  std::vector<Match> matches;  // keypoint_idx1 is of image_idx1
};

// A pair is a line `name1 name2`, lines `keypoint_idx1 keypoint_idx2`
// (zero-based) and an empty line. The result is sorted by images; a duplicate
// pair is an Error.
std::vector<ListedMatches> ReadMatchList(
    TextLines lines, const std::vector<std::string>& image_names);

}  // namespace mgsfm
