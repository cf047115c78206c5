// SPDX-License-Identifier: BSD-3-Clause
#include "matching/match_list.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>

#include "matching/pair_lists.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr const char* kBlanks = " \t\r";

std::string Trim(const std::string& line) {
  const size_t begin = line.find_first_not_of(kBlanks);
  if (begin == std::string::npos) return "";
  return line.substr(begin, line.find_last_not_of(kBlanks) - begin + 1);
}

// Reads trimmed lines and skips comments.
class LineReader {
 public:
  LineReader(std::istream& text, const std::string& source)
      : text_(text), source_(source) {}

  bool Next(std::string* line) {
    while (std::getline(text_, *line)) {
      ++number_;
      *line = Trim(*line);
      if (line->empty() || line->front() != '#') return true;
    }
    if (text_.bad()) throw Error(source_ + ": read error");
    return false;
  }

  [[noreturn]] void Fail(const std::string& problem) const {
    throw Error(source_ + ", line " + std::to_string(number_) + ": " + problem);
  }

 private:
  std::istream& text_;
  const std::string& source_;
  int number_ = 0;
};

class ImageNames {
 public:
  explicit ImageNames(const std::vector<std::string>& names) {
    for (size_t i = 0; i < names.size(); ++i) {
      positions_.emplace(names[i], static_cast<int>(i));
    }
  }

  // The image indices in the order of the line.
  std::pair<int, int> Split(const std::string& line,
                            const LineReader& reader) const {
    std::optional<std::pair<int, int>> found;
    for (size_t blank = line.find_first_of(kBlanks); blank != std::string::npos;
         blank = line.find_first_of(kBlanks, blank + 1)) {
      const auto first = Find(line.substr(0, blank));
      const auto second = Find(line.substr(blank));
      if (!first || !second || found == std::make_pair(*first, *second)) {
        continue;
      }
      if (found) {
        reader.Fail("'" + line +
                    "' is ambiguous: it names two different pairs");
      }
      found = {*first, *second};
    }
    if (!found) {
      reader.Fail("'" + line +
                  "' does not name two images of the database; names are "
                  "relative to the image folder");
    }
    if (found->first == found->second) {
      reader.Fail("'" + line + "' pairs an image with itself");
    }
    return *found;
  }

 private:
  std::optional<int> Find(const std::string& name) const {
    const auto found = positions_.find(Trim(name));
    if (found == positions_.end()) return std::nullopt;
    return found->second;
  }

  std::map<std::string, int> positions_;
};

Match ParseMatch(const std::string& line, const LineReader& reader) {
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
    reader.Fail("'" + line + "' is not a match, that is, two keypoint indices");
  }
  return match;
}

}  // namespace

ImagePairList ReadPairList(std::istream& text, const std::string& source,
                           const std::vector<std::string>& image_names) {
  LineReader reader(text, source);
  const ImageNames names(image_names);
  ImagePairList pairs;
  std::string line;
  while (reader.Next(&line)) {
    if (line.empty()) continue;
    const auto [image1, image2] = names.Split(line, reader);
    pairs.push_back(internal::MakePair(image1, image2));
  }
  internal::SortUnique(&pairs);
  return pairs;
}

std::vector<ListedMatches> ReadMatchList(
    std::istream& text, const std::string& source,
    const std::vector<std::string>& image_names) {
  LineReader reader(text, source);
  const ImageNames names(image_names);
  std::map<ImageIdxPair, std::vector<Match>> matches_of_pair;
  std::string line;
  while (reader.Next(&line)) {
    if (line.empty()) continue;
    const auto [image1, image2] = names.Split(line, reader);
    const auto [entry, is_new] =
        matches_of_pair.try_emplace(internal::MakePair(image1, image2));
    if (!is_new) reader.Fail("duplicate pair '" + line + "'");
    while (reader.Next(&line) && !line.empty()) {
      Match match = ParseMatch(line, reader);
      if (image1 > image2) std::swap(match.keypoint_idx1, match.keypoint_idx2);
      entry->second.push_back(match);
    }
  }
  std::vector<ListedMatches> lists;
  lists.reserve(matches_of_pair.size());
  for (auto& [images, matches] : matches_of_pair) {
    lists.push_back({images, std::move(matches)});
  }
  return lists;
}

}  // namespace mgsfm
