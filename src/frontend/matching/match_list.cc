// SPDX-License-Identifier: BSD-3-Clause
#include "matching/match_list.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>

#include "base/ranges.h"
#include "matching/pair_selection.h"

namespace mgsfm {
namespace {

constexpr const char* kBlanks = " \t";

class ImageNames {
 public:
  explicit ImageNames(const std::vector<std::string>& names) {
    for (size_t i = 0; i < names.size(); ++i) {
      positions_.emplace(names[i], static_cast<int>(i));
    }
  }

  // The image indices in the order of the line.
  std::pair<int, int> Split(const TextLines& lines) const {
    const std::string line(lines.line());
    std::optional<std::pair<int, int>> found;
    for (size_t blank = line.find_first_of(kBlanks); blank != std::string::npos;
         blank = line.find_first_of(kBlanks, blank + 1)) {
      const auto first = Find(line.substr(0, blank));
      const auto second = Find(line.substr(blank));
      if (!first || !second || found == std::make_pair(*first, *second)) {
        continue;
      }
      if (found) {
        lines.Throw("'" + line +
                    "' is ambiguous: it names two different pairs");
      }
      found = {*first, *second};
    }
    if (!found) {
      lines.Throw("'" + line +
                  "' does not name two images of the database; names are "
                  "relative to the image folder");
    }
    if (found->first == found->second) {
      lines.Throw("'" + line + "' pairs an image with itself");
    }
    return *found;
  }

 private:
  std::optional<int> Find(const std::string& name) const {
    const auto found = positions_.find(std::string(TrimBlanks(name)));
    if (found == positions_.end()) return std::nullopt;
    return found->second;
  }

  std::map<std::string, int> positions_;
};

Match ParseMatch(const TextLines& lines) {
  const std::string line(lines.line());
  const size_t blank = std::min(line.find_first_of(kBlanks), line.size());
  const size_t second =
      std::min(line.find_first_not_of(kBlanks, blank), line.size());
  Match match{};
  const char* end = line.data() + line.size();
  const auto first_result =
      std::from_chars(line.data(), line.data() + blank, match.keypoint_idx1);
  const auto second_result =
      std::from_chars(line.data() + second, end, match.keypoint_idx2);
  if (first_result.ec != std::errc() ||
      first_result.ptr != line.data() + blank ||
      second_result.ec != std::errc() || second_result.ptr != end) {
    lines.Throw("'" + line + "' is not a match, that is, two keypoint indices");
  }
  return match;
}

}  // namespace

ImagePairList ReadPairList(TextLines lines,
                           const std::vector<std::string>& image_names) {
  const ImageNames names(image_names);
  ImagePairList pairs;
  while (lines.NextContent()) {
    const auto [image1, image2] = names.Split(lines);
    pairs.push_back(MakePair(image1, image2));
  }
  SortUnique(&pairs);
  return pairs;
}

std::vector<ListedMatches> ReadMatchList(
    TextLines lines, const std::vector<std::string>& image_names) {
  const ImageNames names(image_names);
  std::map<ImageIdxPair, std::vector<Match>> matches_of_pair;
  while (lines.NextContent()) {
    const auto [image1, image2] = names.Split(lines);
    const auto [entry, is_new] =
        matches_of_pair.try_emplace(MakePair(image1, image2));
    if (!is_new) {
      lines.Throw("duplicate pair '" + std::string(lines.line()) + "'");
    }
    while (lines.Next() && !lines.line().empty()) {
      if (lines.line().front() == '#') continue;
      Match match = ParseMatch(lines);
      if (image1 > image2) std::swap(match.keypoint_idx1, match.keypoint_idx2);
      entry->second.push_back(match);
    }
  }
  std::vector<ListedMatches> lists;
  for (auto& [images, matches] : matches_of_pair) {
    lists.push_back({images, std::move(matches)});
  }
  return lists;
}

}  // namespace mgsfm
