// SPDX-License-Identifier: BSD-3-Clause
#include <re2/re2.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "rigs/name_patterns.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

// Rigs have fewer cameras; more distinct texts belong to frames.
constexpr size_t kMaxNumCameras = 24;

using NameParts = std::vector<std::string>;

// A position in the names whose texts may be cameras.
struct Place {
  size_t position = 0;
  // The common word before the texts, "cam" of "0001cam2.jpg"; may be empty.
  std::string word;
  std::set<std::string> cameras;  // with the word
  size_t num_shared = 0;          // images whose frame has another image
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

std::string JoinWithout(const NameParts& parts, size_t position) {
  std::string joined;
  for (size_t i = 0; i < parts.size(); ++i) {
    // A star separates the position from its neighbors.
    joined += i == position ? "*" : parts[i];
  }
  return joined;
}

std::string CommonWordBefore(const std::vector<NameParts>& names,
                             size_t position) {
  if (position == 0) return "";
  const std::string& word = names.front()[position - 1];
  const bool is_word =
      std::isalpha(static_cast<unsigned char>(word.front())) != 0 &&
      AllOf(names, [&](const NameParts& parts) {
        return parts[position - 1] == word;
      });
  return is_word ? word : "";
}

std::optional<Place> RatePlace(const std::vector<NameParts>& names,
                               size_t position) {
  Place place;
  place.position = position;
  std::map<std::string, size_t> frame_sizes;
  place.word = CommonWordBefore(names, position);
  for (const NameParts& parts : names) {
    if (!IsWord(parts[position])) return std::nullopt;
    place.cameras.insert(place.word + parts[position]);
    ++frame_sizes[JoinWithout(parts, position)];
  }
  if (place.cameras.size() < 2 || place.cameras.size() > kMaxNumCameras) {
    return std::nullopt;
  }
  for (const auto& [frame, size] : frame_sizes) {
    if (size > 1) place.num_shared += size;
  }
  place.num_frames = frame_sizes.size();
  const auto num_called = CountIf(place.cameras, [](const std::string& name) {
    return IsCalledLikeCamera(name) || IsSide(name);
  });
  place.is_called_like_cameras =
      2 * static_cast<size_t>(num_called) > place.cameras.size();
  return place;
}

std::string QuoteSeparator(const std::string& part) {
  return IsWord(part) ? "" : RE2::QuoteMeta(part);
}

// The rule for cameras that are told apart at these places, in order.
std::string RuleOf(const NameParts& example, const std::vector<Place>& places) {
  std::string rule;
  size_t begin = 0;  // of the parts that the rule does not yet match
  for (const Place& place : places) {
    const size_t p = place.position - (place.word.empty() ? 0 : 1);
    if (begin > 0) rule += QuoteSeparator(example[begin]);
    if (p > begin + (begin > 0 ? 1 : 0)) {
      rule += ".*" + QuoteSeparator(example[p - 1]);
    }
    rule += "(?<camera>" + Joined(place.cameras, "|") + ")";
    begin = place.position + 1;
  }
  if (begin == example.size()) return rule;
  return rule + QuoteSeparator(example[begin]) + ".*";
}

// Whether the rule finds the cameras of all names.
bool Fits(const std::string& rule, const std::vector<NameParts>& names,
          const RigInput& input, const std::vector<Place>& places) {
  std::string unnamed = rule;
  RE2::GlobalReplace(&unnamed, RE2("\\(\\?<camera>"), "(");
  const RE2 regex(unnamed, RE2::Quiet);
  std::vector<std::string> found(places.size());
  std::vector<RE2::Arg> arguments(found.size());
  std::vector<const RE2::Arg*> pointers;
  for (size_t i = 0; i < found.size(); ++i) {
    arguments[i] = &found[i];
    pointers.push_back(&arguments[i]);
  }
  for (size_t i = 0; i < names.size(); ++i) {
    if (!RE2::FullMatchN(input.contents.images[i].name, regex, pointers.data(),
                         static_cast<int>(pointers.size()))) {
      return false;
    }
    for (size_t k = 0; k < found.size(); ++k) {
      if (found[k] != places[k].word + names[i][places[k].position]) {
        return false;
      }
    }
  }
  return true;
}

// The share of images in frames with others. Texts without a meaning are
// cameras only if nearly all frames are complete, and so are cameras that no
// option confirms.
constexpr double kMinShared = 0.5, kMinComplete = 0.9;

double ShareOf(const Place& place, const std::vector<NameParts>& names) {
  return static_cast<double>(place.num_shared) /
         static_cast<double>(names.size());
}

// Whether the texts are called like cameras, whose images pair one to one and
// have one size per camera. "image1" may be a counter, and so may any text if
// there are not more frames than cameras.
bool IsCertain(const Place& place, const std::vector<NameParts>& names,
               const RigInput& input) {
  std::map<std::string, std::pair<int, int>> sizes;
  for (size_t i = 0; i < names.size(); ++i) {
    const Camera& camera = input.CameraOf(static_cast<int>(i));
    const std::pair<int, int> size(camera.width_px, camera.height_px);
    const auto first = sizes.emplace(names[i][place.position], size).first;
    if (first->second != size) return false;
  }
  const bool may_count = AnyOf(place.cameras, [](const std::string& name) {
    return ToLower(name).find("image") != std::string::npos;
  });
  return place.is_called_like_cameras && !may_count &&
         place.num_frames > place.cameras.size() &&
         ShareOf(place, names) >= kMinComplete;
}

// The rules of all places that certainly tell cameras apart: of each, and of
// all together.
std::vector<std::string> CertainRules(const RigInput& input,
                                      const std::vector<NameParts>& names,
                                      const std::vector<Place>& places) {
  std::vector<Place> certain;
  for (const Place& place : places) {
    if (IsCertain(place, names, input)) certain.push_back(place);
  }
  std::vector<std::vector<Place>> choices;
  if (certain.size() > 1) choices.push_back(certain);
  for (const Place& place : certain) choices.push_back({place});
  std::vector<std::string> rules;
  for (const std::vector<Place>& choice : choices) {
    const std::string rule = RuleOf(names.front(), choice);
    if (Fits(rule, names, input, choice)) rules.push_back(rule);
  }
  return rules;
}

std::vector<ImageKeys> KeysByCamera(const std::vector<NameParts>& names,
                                    size_t position) {
  return Transformed(names, [&](const NameParts& parts) {
    return ImageKeys{"", parts[position], "", parts[position], ""};
  });
}

std::optional<RigRuleSuggestion> Suggest(const RigInput& input,
                                         const std::vector<NameParts>& names) {
  std::vector<Place> places;
  for (size_t p = 0; p < names.front().size(); ++p) {
    if (const auto place = RatePlace(names, p)) places.push_back(*place);
  }
  if (places.empty()) return std::nullopt;
  const Place& best = *std::max_element(places.begin(), places.end());
  RigRuleSuggestion suggestion;
  suggestion.rule = RuleOf(names.front(), {best});
  if (!Fits(suggestion.rule, names, input, {best})) return std::nullopt;
  suggestion.cameras = "'" + Joined(best.cameras, "', '") + "'";
  suggestion.text = "the names of images tell the cameras " +
                    suggestion.cameras +
                    " apart; if these are mounted on one rig, set "
                    "rig_name_rule '" +
                    suggestion.rule + "'";
  suggestion.certain_rules = CertainRules(input, names, places);
  const double share = ShareOf(best, names);
  suggestion.is_likely = best.is_called_like_cameras;
  if (suggestion.is_likely && share >= kMinShared) return suggestion;
  if (suggestion.is_likely) {
    const auto by_time =
        SuggestFramesByTime(input, KeysByCamera(names, best.position));
    if (by_time) {
      suggestion.text += "; " + *by_time;
      return suggestion;
    }
  }
  suggestion.is_likely = false;
  if (share >= kMinComplete && best.num_frames > best.cameras.size()) {
    return suggestion;
  }
  return std::nullopt;
}

// The best level must exceed the next by this factor in images that share
// frames. If a tenth of 100 images is missing at random, two equal levels never
// differ as much (docs/results/constants.md).
constexpr double kMinSharedRatio = 1.1;

struct Name {
  std::vector<std::string> folders;
  std::string file;
};

// A level of folders that may identify the camera.
struct Level {
  size_t position = 0;    // in Name::folders
  size_t num_shared = 0;  // images in frames with another image
  bool is_called_like_cameras = false;
  bool has_one_camera_per_folder = false;
};

// The names without extensions, if they remain distinct.
std::vector<Name> SplitNames(const RigInput& input) {
  std::set<std::string> stems;
  for (const ImageRow& image : input.contents.images) {
    stems.insert(WithoutExtension(image.name));
  }
  const bool drop_extensions = stems.size() == input.contents.images.size();
  std::vector<Name> names;
  for (const ImageRow& image : input.contents.images) {
    Name name;
    name.folders =
        SplitPath(drop_extensions ? WithoutExtension(image.name) : image.name);
    name.file = name.folders.back();
    name.folders.pop_back();
    names.push_back(std::move(name));
  }
  return names;
}

std::string NameWithoutLevel(const Name& name, size_t level) {
  std::string rest;
  for (size_t i = 0; i < name.folders.size(); ++i) {
    if (i != level) rest += name.folders[i] + "/";
  }
  return rest + name.file;
}

// Scores a level of folders; nullopt if all its folders have one name.
std::optional<Level> RateLevel(const RigInput& input,
                               const std::vector<Name>& names,
                               const std::vector<int>& images, size_t level) {
  std::map<std::string, int> first_image_of_folder;
  std::map<std::string, size_t> frame_sizes;
  Level rated;
  rated.position = level;
  rated.has_one_camera_per_folder = true;
  for (const int image : images) {
    const int first =
        first_image_of_folder.emplace(names[image].folders[level], image)
            .first->second;
    rated.has_one_camera_per_folder &=
        HaveEqualIntrinsics(input.CameraOf(first), input.CameraOf(image));
    ++frame_sizes[NameWithoutLevel(names[image], level)];
  }
  if (first_image_of_folder.size() < 2) return std::nullopt;
  for (const auto& [frame, size] : frame_sizes) {
    if (size > 1) rated.num_shared += size;
  }
  const auto num_called = CountIf(first_image_of_folder, [](const auto& entry) {
    return IsCalledLikeCamera(entry.first);
  });
  rated.is_called_like_cameras =
      2 * static_cast<size_t>(num_called) > first_image_of_folder.size();
  return rated;
}

// Keeps the levels with the property, if any has it.
template <class Predicate>
void Prefer(const Predicate& has_property, std::vector<Level>* levels) {
  if (NoneOf(*levels, has_property)) return;
  EraseIf(levels, [&](const Level& level) { return !has_property(level); });
}

// The levels of folders that may identify the camera. The names of `images` are
// equally deep. Empty if no frame would have two images. Without `by_name`,
// frames do not depend on names, so every level qualifies.
std::vector<Level> FindLevels(const RigInput& input,
                              const std::vector<Name>& names,
                              const std::vector<int>& images, bool by_name) {
  std::vector<Level> levels;
  const size_t depth = names[images.front()].folders.size();
  size_t max_num_shared = 0;
  for (size_t i = 0; i < depth; ++i) {
    const auto level = RateLevel(input, names, images, i);
    if (level && (level->num_shared > 0 || !by_name)) levels.push_back(*level);
  }
  Prefer([](const Level& l) { return l.is_called_like_cameras; }, &levels);
  for (const Level& level : levels) {
    max_num_shared = std::max(max_num_shared, level.num_shared);
  }
  if (by_name) {
    Prefer(
        [&](const Level& l) {
          return kMinSharedRatio * static_cast<double>(l.num_shared) >
                 static_cast<double>(max_num_shared);
        },
        &levels);
  }
  Prefer([](const Level& l) { return l.has_one_camera_per_folder; }, &levels);
  return levels;
}

[[noreturn]] void ThrowAmbiguous(const RigInput& input,
                                 const std::string& image_name,
                                 const Name& example,
                                 const std::vector<Level>& levels) {
  throw Error(input.Name() + ": image names do not show whether '" +
              example.folders[levels[0].position] + "' or '" +
              example.folders[levels[1].position] + "' of '" + image_name +
              "' is the camera of a rig; set rig_name_rule or "
              "rig_config_path");
}

ImageKeys MakeKeys(const Name& name, const std::string& image_name,
                   const std::optional<Level>& level) {
  ImageKeys keys;
  // Outer folders without common camera names belong to different rigs, which
  // share no frames.
  const bool has_camera_name = level && level->has_one_camera_per_folder;
  keys.sensor_name = has_camera_name ? name.folders[level->position]
                                     : Joined(name.folders, "/");
  keys.frame_name =
      level ? NameWithoutLevel(name, level->position) : image_name;
  const std::string depth = std::to_string(name.folders.size()) + "/";
  keys.rig = depth;
  if (level && !has_camera_name) {
    Name outer = name;
    outer.file.clear();
    keys.rig += NameWithoutLevel(outer, level->position);
  }
  keys.sensor = depth + keys.sensor_name;
  keys.frame = depth + keys.frame_name;
  return keys;
}

// The cameras and frames implied by folders. `by_name`: see FindLevels.
std::vector<ImageKeys> KeysByFolders(const RigInput& input, bool by_name) {
  const std::vector<Name> names = SplitNames(input);
  std::map<size_t, std::vector<int>> images_of_depth;
  for (size_t i = 0; i < names.size(); ++i) {
    images_of_depth[names[i].folders.size()].push_back(static_cast<int>(i));
  }
  std::vector<ImageKeys> keys(names.size());
  for (const auto& [depth, images] : images_of_depth) {
    const auto levels = FindLevels(input, names, images, by_name);
    const auto name_of = [&](int image) -> const std::string& {
      return input.contents.images[image].name;
    };
    if (levels.size() > 1) {
      ThrowAmbiguous(input, name_of(images.front()), names[images.front()],
                     levels);
    }
    std::optional<Level> level;
    if (!levels.empty()) level = levels.front();
    for (const int image : images) {
      keys[image] = MakeKeys(names[image], name_of(image), level);
    }
  }
  return keys;
}

// Throws Error if folders are frames: there are more folders than frames, and
// the files in them are named like cameras, as in 000017/left.jpg.
void CheckFoldersAreCameras(const RigInput& input,
                            const RigAssignment& assignment) {
  const auto num_called =
      static_cast<size_t>(CountIf(assignment.sensors, [](const auto& sensor) {
        return IsCalledLikeCamera(sensor.name);
      }));
  const size_t num_sensors = assignment.sensors.size();
  if (num_sensors <= assignment.frames.size() || 2 * num_called > num_sensors) {
    return;
  }
  const auto rule = SuggestRigRule(input);
  if (!rule || !rule->is_likely) return;
  throw Error(input.Name() + ": by their folders, images would be of " +
              std::to_string(num_sensors) + " cameras in " +
              std::to_string(assignment.frames.size()) + " frames, but " +
              rule->text + "; otherwise, set it to none");
}

bool AreMostImagesSingle(const RigAssignment& assignment) {
  std::vector<size_t> frame_sizes(assignment.frames.size(), 0);
  for (const int frame : assignment.frame_of_image) ++frame_sizes[frame];
  const auto num_single = static_cast<size_t>(
      std::count(frame_sizes.begin(), frame_sizes.end(), 1));
  return 2 * num_single >= assignment.frame_of_image.size();
}

// Suggests how to form rigs from images that are single although their times or
// names would form frames.
void SuggestRigs(const RigInput& input,
                 const std::optional<RigRuleSuggestion>& rule,
                 const Context& context) {
  try {
    const auto suggestion =
        SuggestFramesByTime(input, KeysByFolders(input, false));
    if (suggestion) return context.Warning(*suggestion);
  } catch (const Error&) {
    // Ambiguous folders suggest nothing.
  }
  if (rule && rule->is_likely) context.Warning(rule->text);
  if (rule && !rule->is_likely) context.Info(rule->text);
}

// The rigs of cameras that names in one folder tell apart, without a rule of
// the user; nullopt if that is not certain.
std::optional<RigAssignment> AssignByFoundRule(
    const RigInput& input, const std::optional<RigRuleSuggestion>& found,
    const TimedImages* times, const Context& context) {
  if (!found) return std::nullopt;
  if (found->certain_rules.size() > 1) {
    throw Error(input.Name() +
                ": the names of images tell cameras apart in several ways; set "
                "rig_name_rule to '" +
                Joined(found->certain_rules, "' or '") +
                "', or to none if the images are single");
  }
  const bool is_certain = times == nullptr
                              ? found->certain_rules.size() == 1 &&
                                    found->certain_rules.front() == found->rule
                              : found->is_likely;
  if (!is_certain) return std::nullopt;
  context.Info("the names of images tell the cameras " + found->cameras +
               " of a rig apart, as by rig_name_rule '" + found->rule +
               "'; set it to none if the images are single");
  return AssignByRule(input, found->rule, times, context);
}

}  // namespace

std::optional<RigRuleSuggestion> SuggestRigRule(const RigInput& input) {
  for (const bool splits_words : {false, true}) {
    std::vector<NameParts> names;
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

RigAssignment AssignByFolders(const RigInput& input, const TimedImages* times,
                              const Context& context) {
  std::vector<ImageKeys> keys = KeysByFolders(input, times == nullptr);
  if (times != nullptr) {
    const bool is_flat = AllOf(keys, [&](const ImageKeys& key) {
      return key.sensor == keys[0].sensor;
    });
    const auto rule = is_flat ? SuggestRigRule(input) : std::nullopt;
    auto found = AssignByFoundRule(input, rule, times, context);
    if (found) return *std::move(found);
    SetFramesByTime(input, *times, context, &keys);
  }
  RigAssignment assignment = AssignByKeys(input, keys);
  assignment.source =
      times == nullptr ? "image names" : "image folders and times";
  if (times != nullptr) return assignment;
  CheckFoldersAreCameras(input, assignment);
  if (!AreMostImagesSingle(assignment)) return assignment;
  const auto rule = SuggestRigRule(input);
  auto found = AssignByFoundRule(input, rule, times, context);
  if (found) return *std::move(found);
  SuggestRigs(input, rule, context);
  return assignment;
}

}  // namespace mgsfm
