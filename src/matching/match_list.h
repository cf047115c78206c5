// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <istream>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/matching/pair_selection.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// COLMAP's text files of pairs. Images are told by their names, which may have
// blanks as long as a line can be split into two known names in one way only.
// Empty lines (between pairs) and lines that begin with '#' are skipped. All
// readers throw Error, naming `source` and the line, for anything else.

// A line `name1 name2` for each pair. Images are positions in `image_names`.
ImagePairList ReadPairList(std::istream& text, const std::string& source,
                           const std::vector<std::string>& image_names);

struct ListedMatches {
  ImageIdxPair images;
  std::vector<Match> matches;  // 1 is the smaller position
};

// For each pair a line `name1 name2`, lines `keypoint1 keypoint2` (counted from
// 0), and an empty line. Sorted by images; a pair that comes twice is an Error.
std::vector<ListedMatches> ReadMatchList(
    std::istream& text, const std::string& source,
    const std::vector<std::string>& image_names);

}  // namespace mgsfm
