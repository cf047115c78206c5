// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/rig_rule_suggestion.h"

#include <re2/re2.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "rigs/frames_by_time.h"
#include "rigs/name_patterns.h"

namespace mgsfm {
namespace {

// Rigs have fewer cameras; more texts are those of frames.
constexpr size_t kMaxNumCameras = 24;

using Parts = std::vector<std::string>;

// A place in the names whose texts may be cameras.
struct Place {
  size_t position = 0;
  std::set<std::string> cameras;
  size_t num_shared = 0;  // images whose frame has another image
  size_t num_frames = 0;
  bool is_called_like_cameras = false;

  bool operator<(const Place& other) const {
    return std::make_tuple(is_called_like_cameras, num_shared, num_frames) <
           std::make_tuple(other.is_called_like_cameras, other.num_shared,
                           other.num_frames);
  }
};

bool IsWord(const std::string& part) {
  return std::isalnum(static_cast<unsigned char>(part.front())) != 0;
}

bool IsSide(const std::string& part) {
  return part.size() == 1 && std::string("lrLR").find(part) < 4;
}

std::string JoinWithout(const Parts& parts, size_t position) {
  std::string joined;
  for (size_t i = 0; i < parts.size(); ++i) {
    // A star keeps the place apart from the neighbors.
    joined += i == position ? "*" : parts[i];
  }
  return joined;
}

std::optional<Place> RatePlace(const std::vector<Parts>& names,
                               size_t position) {
  Place place;
  place.position = position;
  std::map<std::string, size_t> frame_sizes;
  for (const Parts& parts : names) {
    if (!IsWord(parts[position])) return std::nullopt;
    place.cameras.insert(parts[position]);
    ++frame_sizes[JoinWithout(parts, position)];
  }
  if (place.cameras.size() < 2 || place.cameras.size() > kMaxNumCameras) {
    return std::nullopt;
  }
  for (const auto& [frame, size] : frame_sizes) {
    if (size > 1) place.num_shared += size;
  }
  place.num_frames = frame_sizes.size();
  const auto num_called = std::count_if(
      place.cameras.begin(), place.cameras.end(), [](const std::string& name) {
        return IsCalledLikeCamera(name) || IsSide(name);
      });
  place.is_called_like_cameras =
      2 * static_cast<size_t>(num_called) > place.cameras.size();
  return place;
}

std::string RuleOf(const Parts& example, const Place& place) {
  const size_t p = place.position;
  std::string rule;
  if (p > 0) rule += ".*";
  if (p > 0 && !IsWord(example[p - 1])) rule += RE2::QuoteMeta(example[p - 1]);
  rule += "(?<camera>";
  for (const std::string& camera : place.cameras) {
    rule += (camera == *place.cameras.begin() ? "" : "|") + camera;
  }
  rule += ")";
  if (p + 1 == example.size()) return rule;
  if (!IsWord(example[p + 1])) rule += RE2::QuoteMeta(example[p + 1]);
  return rule + ".*";
}

// Whether the rule finds the cameras of all names.
bool Fits(const std::string& rule, const std::vector<Parts>& names,
          const RigInput& input, size_t position) {
  RE2::Options quiet;
  quiet.set_log_errors(false);
  std::string with_names = rule;
  with_names.replace(rule.find("(?<"), 3, "(?P<");
  const RE2 regex(with_names, quiet);
  for (size_t i = 0; i < names.size(); ++i) {
    std::string camera;
    if (!RE2::FullMatch(input.contents.images[i].name, regex, &camera) ||
        camera != names[i][position]) {
      return false;
    }
  }
  return true;
}

std::vector<ImageKeys> KeysByCamera(const std::vector<Parts>& names,
                                    size_t position) {
  std::vector<ImageKeys> keys;
  for (const Parts& parts : names) {
    keys.push_back({"", parts[position], "", parts[position], ""});
  }
  return keys;
}

// "'left', 'right'".
std::string ListCameras(const Place& place) {
  std::string list;
  for (const std::string& camera : place.cameras) {
    list += (list.empty() ? "'" : ", '") + camera + "'";
  }
  return list;
}

std::optional<RigRuleSuggestion> Suggest(const RigInput& input,
                                         const std::vector<Parts>& names) {
  std::vector<Place> places;
  for (size_t p = 0; p < names.front().size(); ++p) {
    if (const auto place = RatePlace(names, p)) places.push_back(*place);
  }
  if (places.empty()) return std::nullopt;
  const Place& best = *std::max_element(places.begin(), places.end());
  const std::string rule = RuleOf(names.front(), best);
  if (!Fits(rule, names, input, best.position)) return std::nullopt;
  const std::string text = "the names of images tell the cameras " +
                           ListCameras(best) +
                           " apart; if these are mounted on one rig, set "
                           "rig_name_rule '" +
                           rule + "'";
  // Texts without a meaning are cameras only if nearly all frames are complete.
  constexpr double kMinShared = 0.5, kMinSharedOfUnknown = 0.9;
  const double shared =
      static_cast<double>(best.num_shared) / static_cast<double>(names.size());
  if (best.is_called_like_cameras && shared >= kMinShared)
    return {{text, true}};
  if (best.is_called_like_cameras) {
    const auto by_time =
        SuggestFramesByTime(input, KeysByCamera(names, best.position));
    if (by_time) return {{text + "; " + *by_time, true}};
  }
  if (shared >= kMinSharedOfUnknown && best.num_frames > best.cameras.size()) {
    return {{text, false}};
  }
  return std::nullopt;
}

}  // namespace

std::optional<RigRuleSuggestion> SuggestRigRule(const RigInput& input) {
  for (const bool splits_words : {false, true}) {
    std::vector<Parts> names;
    for (const ImageRow& image : input.contents.images) {
      names.push_back(SplitNameParts(image.name, splits_words));
      if (names.back().size() != names.front().size()) break;
    }
    if (names.empty() || names.size() != input.contents.images.size() ||
        names.back().size() != names.front().size()) {
      continue;
    }
    if (auto suggestion = Suggest(input, names)) return suggestion;
  }
  return std::nullopt;
}

}  // namespace mgsfm
