// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <regex>

#include "io/rigs/rig_inference.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

enum class GroupKind { kPlain, kCamera, kFrame, kRig };

// A regular expression whose groups may be named. std::regex knows no names, so
// they are taken out and the kinds of the groups are kept, in order.
struct NameRule {
  std::regex regex;
  std::vector<GroupKind> groups;
};

[[noreturn]] void ThrowRuleError(const std::string& rule,
                                 const std::string& problem) {
  throw Error("rig_name_rule '" + rule + "': " + problem);
}

GroupKind KindOfGroup(const std::string& rule, const std::string& name) {
  if (name == "camera") return GroupKind::kCamera;
  if (name == "frame") return GroupKind::kFrame;
  if (name == "rig") return GroupKind::kRig;
  ThrowRuleError(rule, "a group is called '" + name +
                           "', but only camera, frame and rig are known");
}

// Position of the last character of what begins at `begin`, if that can hold
// brackets that open no group: an escape, or a class such as [(].
size_t EndOfLiteral(const std::string& rule, size_t begin) {
  if (rule[begin] == '\\') return std::min(begin + 1, rule.size() - 1);
  if (rule[begin] != '[') return begin;
  for (size_t i = begin + 1; i < rule.size(); ++i) {
    if (rule[i] == '\\') {
      ++i;
    } else if (rule[i] == ']') {
      return i;
    }
  }
  return rule.size() - 1;
}

NameRule ParseRule(const std::string& rule) {
  NameRule parsed;
  std::string unnamed;
  for (size_t i = 0; i < rule.size(); ++i) {
    const size_t end = EndOfLiteral(rule, i);
    unnamed += rule.substr(i, end + 1 - i);
    if (rule[i] != '(') {
      i = end;
      continue;
    }
    if (rule.compare(i, 3, "(?<") == 0) {
      const size_t close = rule.find('>', i);
      if (close == std::string::npos) ThrowRuleError(rule, "'>' is missing");
      parsed.groups.push_back(
          KindOfGroup(rule, rule.substr(i + 3, close - i - 3)));
      i = close;
    } else if (rule.compare(i, 2, "(?") != 0) {
      parsed.groups.push_back(GroupKind::kPlain);
    }
  }
  if (std::count(parsed.groups.begin(), parsed.groups.end(),
                 GroupKind::kCamera) == 0) {
    ThrowRuleError(rule,
                   "has no group (?<camera>...); other values are auto "
                   "and none");
  }
  try {
    parsed.regex = std::regex(unnamed, std::regex::ECMAScript);
  } catch (const std::regex_error& error) {
    ThrowRuleError(rule,
                   std::string("is no regular expression: ") + error.what());
  }
  return parsed;
}

// The texts of all groups of a kind, joined.
std::string JoinGroups(const std::smatch& match, const NameRule& rule,
                       GroupKind kind) {
  std::string joined;
  for (size_t i = 0; i < rule.groups.size(); ++i) {
    if (rule.groups[i] != kind) continue;
    joined += (joined.empty() ? "" : "/") + match.str(i + 1);
  }
  return joined;
}

// The name with the camera groups taken out.
std::string WithoutCamera(const std::string& name, const std::smatch& match,
                          const NameRule& rule) {
  Mask is_kept(name.size(), true);
  for (size_t i = 0; i < rule.groups.size(); ++i) {
    if (rule.groups[i] != GroupKind::kCamera || !match[i + 1].matched) continue;
    const auto begin = static_cast<size_t>(match.position(i + 1));
    is_kept.Fill(begin, begin + match.length(i + 1), false);
  }
  std::string rest;
  for (size_t i = 0; i < name.size(); ++i) {
    if (is_kept[i]) rest += name[i];
  }
  return rest;
}

ImageKeys MakeKeys(const std::string& name, const std::smatch& match,
                   const NameRule& rule) {
  const bool has_frame_group =
      std::count(rule.groups.begin(), rule.groups.end(), GroupKind::kFrame) > 0;
  const std::string rig = JoinGroups(match, rule, GroupKind::kRig);
  ImageKeys keys;
  keys.sensor_name = JoinGroups(match, rule, GroupKind::kCamera);
  keys.frame_name = has_frame_group ? JoinGroups(match, rule, GroupKind::kFrame)
                                    : WithoutCamera(name, match, rule);
  keys.sensor = rig + "\n" + keys.sensor_name;
  keys.frame = rig + "\n" + keys.frame_name;
  return keys;
}

}  // namespace

RigAssignment AssignByRule(const RigInput& input, const std::string& rule) {
  const NameRule parsed = ParseRule(rule);
  std::vector<ImageKeys> keys;
  for (const ImageRow& image : input.contents.images) {
    std::smatch match;
    if (!std::regex_match(image.name, match, parsed.regex)) {
      ThrowRuleError(rule, "does not match the image name '" + image.name +
                               "'; it must match all names as a whole");
    }
    keys.push_back(MakeKeys(image.name, match, parsed));
  }
  RigAssignment assignment = AssignByKeys(input, keys);
  assignment.source = "image names by the rule '" + rule + "'";
  return assignment;
}

}  // namespace mgsfm
