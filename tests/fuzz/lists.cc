// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "database/database_reader.h"
#include "fuzz/fuzz_target.h"
#include "matching/match_list.h"

namespace mgsfm {
namespace {

const std::vector<std::string> kNames = {"a", "b.jpg", "a b.jpg", "c d",
                                         "cam0/1.jpg"};

void FuzzImageList(const std::string& text) {
  const std::string path = (FuzzFolder() / "images.txt").string();
  WriteTextFile(path, text);
  std::vector<std::string> names;
  if (!Accepts([&] { names = ReadImageList(path); })) return;
  std::string list;
  for (const std::string& name : names) list += name + "\n";
  WriteTextFile(path, list);
  FUZZ_CHECK(ReadImageList(path) == names);
}

void FuzzPairList(const std::string& text) {
  ImagePairList pairs;
  if (!Accepts(
          [&] { pairs = ReadPairList(TextLines::Of(text, "list"), kNames); }))
    return;
  std::string list;
  for (const auto& [image1, image2] : pairs) {
    FUZZ_CHECK(0 <= image1 && image1 < image2);
    list += kNames.at(image1) + " " + kNames.at(image2) + "\n";
  }
  // A list of ours may be ambiguous: "a b.jpg" "c d" and "a" "b.jpg c d".
  Accepts([&] {
    FUZZ_CHECK(ReadPairList(TextLines::Of(list, "list"), kNames) == pairs);
  });
}

void FuzzMatchList(const std::string& text) {
  std::vector<ListedMatches> lists;
  if (!Accepts(
          [&] { lists = ReadMatchList(TextLines::Of(text, "list"), kNames); }))
    return;
  std::string list;
  for (const ListedMatches& matches : lists) {
    list += kNames.at(matches.images.image_idx1) + " " +
            kNames.at(matches.images.image_idx2) + "\n";
    for (const Match& match : matches.matches) {
      list += std::to_string(match.keypoint_idx1) + " " +
              std::to_string(match.keypoint_idx2) + "\n";
    }
    list += "\n";
  }
  Accepts([&] {
    const std::vector<ListedMatches> copy =
        ReadMatchList(TextLines::Of(list, "list"), kNames);
    FUZZ_CHECK(std::equal(
        lists.begin(), lists.end(), copy.begin(), copy.end(),
        [](const ListedMatches& a, const ListedMatches& b) {
          return a.images == b.images &&
                 std::equal(a.matches.begin(), a.matches.end(),
                            b.matches.begin(), b.matches.end(),
                            [](const Match& x, const Match& y) {
                              return x.keypoint_idx1 == y.keypoint_idx1 &&
                                     x.keypoint_idx2 == y.keypoint_idx2;
                            });
        }));
  });
}

}  // namespace

// The first byte selects the kind of list.
void FuzzLists(const std::string& input) {
  if (input.empty()) return;
  const std::string text = input.substr(1);
  switch (input[0] % 3) {
    case 0:
      return FuzzImageList(text);
    case 1:
      return FuzzPairList(text);
    default:
      return FuzzMatchList(text);
  }
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(lists, mgsfm::FuzzLists)
