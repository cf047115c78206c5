// SPDX-License-Identifier: BSD-3-Clause
#include <re2/re2.h>

#include <algorithm>
#include <map>

#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "rigs/frames_by_time.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

// Groups that have no name are not used.
struct NameRule {
  explicit NameRule(const std::string& rule);

  RE2 regex;
  std::map<int, std::string> groups;  // "camera", "frame" or "rig", by number

  bool HasGroup(const std::string& name) const {
    return std::any_of(groups.begin(), groups.end(),
                       [&](const auto& group) { return group.second == name; });
  }
};

// The texts of the groups of a match, by number. Those that match nothing are
// null.
using Texts = std::vector<re2::StringPiece>;

[[noreturn]] void ThrowRuleError(const std::string& rule,
                                 const std::string& problem) {
  throw Error("rig_name_rule '" + rule + "': " + problem);
}

// A name of its own for each group, as RE2 demands: (?<camera>...) becomes
// (?P<camera_17>...), with its position in the rule.
std::string WithUniqueNames(const std::string& rule) {
  std::string unique;
  for (size_t i = 0; i < rule.size(); ++i) {
    const size_t prefix_size = rule.compare(i, 3, "(?<") == 0    ? 3
                               : rule.compare(i, 4, "(?P<") == 0 ? 4
                                                                 : 0;
    const size_t end = rule.find('>', i);
    if (rule[i] == '\\' && i + 1 < rule.size()) {
      unique += rule.substr(i++, 2);
    } else if (prefix_size == 0) {
      unique += rule[i];
    } else if (end == std::string::npos) {
      ThrowRuleError(rule, "'>' is missing");
    } else {
      const std::string name =
          rule.substr(i + prefix_size, end - i - prefix_size);
      if (name != "camera" && name != "frame" && name != "rig") {
        ThrowRuleError(rule, "a group is called '" + name +
                                 "', but only camera, frame and rig are known");
      }
      unique += "(?P<" + name + '_' + std::to_string(i) + '>';
      i = end;
    }
  }
  return unique;
}

// RE2 writes no messages to the standard error stream.
RE2::Options QuietOptions() {
  RE2::Options options;
  options.set_log_errors(false);
  return options;
}

// RE2 takes time linear in the length of a name, whatever the rule.
NameRule::NameRule(const std::string& rule)
    : regex(WithUniqueNames(rule), QuietOptions()) {
  if (!regex.ok()) {
    ThrowRuleError(rule,
                   "is not a regular expression of RE2: " + regex.error());
  }
  for (const auto& [number, name] : regex.CapturingGroupNames()) {
    groups[number] = name.substr(0, name.find('_'));
  }
  if (!HasGroup("camera")) {
    ThrowRuleError(rule,
                   "has no group (?<camera>...); other values are auto "
                   "and none");
  }
}

// The texts of all groups of a name, joined.
std::string JoinGroups(const Texts& texts, const NameRule& rule,
                       const std::string& name) {
  std::string joined;
  for (const auto& [number, group] : rule.groups) {
    if (group != name) continue;
    joined += (joined.empty() ? "" : "/") + std::string(texts[number]);
  }
  return joined;
}

// The name of the image with the camera groups taken out.
std::string WithoutCamera(const std::string& name, const Texts& texts,
                          const NameRule& rule) {
  Mask is_kept(name.size(), true);
  for (const auto& [number, group] : rule.groups) {
    if (group != "camera" || texts[number].empty()) continue;
    const auto begin = static_cast<size_t>(texts[number].data() - name.data());
    is_kept.Fill(begin, begin + texts[number].size(), false);
  }
  std::string rest;
  for (size_t i = 0; i < name.size(); ++i) {
    if (is_kept[i]) rest += name[i];
  }
  return rest;
}

ImageKeys MakeKeys(const std::string& name, const Texts& texts,
                   const NameRule& rule) {
  const std::string rig = JoinGroups(texts, rule, "rig");
  ImageKeys keys;
  keys.sensor_name = JoinGroups(texts, rule, "camera");
  keys.frame_name = rule.HasGroup("frame") ? JoinGroups(texts, rule, "frame")
                                           : WithoutCamera(name, texts, rule);
  keys.rig = rig;
  keys.sensor = rig + "\n" + keys.sensor_name;
  keys.frame = rig + "\n" + keys.frame_name;
  return keys;
}

}  // namespace

RigAssignment AssignByRule(const RigInput& input, const std::string& rule,
                           const FrameTimes* times, const Context& context) {
  const NameRule parsed(rule);
  Texts texts(1 + static_cast<size_t>(parsed.regex.NumberOfCapturingGroups()));
  std::vector<ImageKeys> keys;
  for (const ImageRow& image : input.contents.images) {
    if (!parsed.regex.Match(image.name, 0, image.name.size(), RE2::ANCHOR_BOTH,
                            texts.data(), static_cast<int>(texts.size()))) {
      ThrowRuleError(rule, "does not match the image name '" + image.name +
                               "'; it must match all names as a whole");
    }
    keys.push_back(MakeKeys(image.name, texts, parsed));
  }
  if (times != nullptr) SetFramesByTime(input, *times, context, &keys);
  RigAssignment assignment = AssignByKeys(input, keys);
  assignment.source = "image names by the rule '" + rule + "'";
  return assignment;
}

}  // namespace mgsfm
