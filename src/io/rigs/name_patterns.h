// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// The names of the images of each camera, by its number. The functions return
// the results of the cameras in this order.
using NameGroups = std::map<int, std::vector<std::string>>;

// The parts of a name that match the stars of a pattern, joined by '_'; nullopt
// if the name does not fit. "IMG_0001_cam1.jpg" fits "IMG_*_cam1.jpg" with
// "0001".
std::optional<std::string> MatchNamePattern(const std::string& name,
                                            const std::string& pattern);

// Ways to describe the names of each camera by a pattern, the most legible
// first. Common parts of the names of a camera are text, other parts are stars.
std::vector<std::vector<std::string>> FindNamePatterns(
    const NameGroups& groups);

// The part of the names that distinguishes each camera, "cam1" of
// "IMG_0001_cam1.jpg"; nullopt if there is none.
std::optional<std::vector<std::string>> FindTellingParts(
    const NameGroups& groups);

// The words, numbers and separators of a name: "IMG", "_", "0001", ".", "jpg".
// `splits_words` also splits "cam1" into "cam" and "1".
std::vector<std::string> SplitNameParts(const std::string& name,
                                        bool splits_words);

}  // namespace mgsfm
