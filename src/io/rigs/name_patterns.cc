// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/name_patterns.h"

#include <re2/re2.h>

#include <algorithm>
#include <cctype>
#include <set>

#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "rigs/rig_inference.h"

namespace mgsfm {
namespace {

constexpr char kStar = '*';

enum class CharKind { kLetter, kDigit, kSeparator };

CharKind KindOf(char c) {
  const auto byte = static_cast<unsigned char>(c);
  if (std::isdigit(byte) != 0) return CharKind::kDigit;
  // Letters of other alphabets have several bytes.
  return std::isalpha(byte) != 0 || byte >= 0x80 ? CharKind::kLetter
                                                 : CharKind::kSeparator;
}

bool IsSeparator(const std::string& part) {
  return KindOf(part.front()) == CharKind::kSeparator;
}

using Parts = std::vector<std::string>;

// The common parts of all names of a group; nullopt where they differ. nullopt
// as a whole if names have different numbers of parts.
using CommonParts = std::vector<std::optional<std::string>>;

std::optional<CommonParts> FindCommonParts(
    const std::vector<std::string>& names, bool splits_words) {
  CommonParts common;
  for (const std::string& name : names) {
    const Parts parts = SplitNameParts(name, splits_words);
    if (common.empty()) common.assign(parts.begin(), parts.end());
    if (parts.size() != common.size()) return std::nullopt;
    for (size_t i = 0; i < parts.size(); ++i) {
      if (common[i] != parts[i]) common[i].reset();
    }
  }
  return common;
}

std::string ToPattern(const CommonParts& parts) {
  std::string pattern;
  for (const auto& part : parts) {
    const bool follows_star = !pattern.empty() && pattern.back() == kStar;
    if (part) {
      pattern += *part;
    } else if (!follows_star) {
      pattern += kStar;
    }
  }
  return pattern;
}

// The common start and end of all names.
std::string PatternOfEnds(const std::vector<std::string>& names) {
  const std::string& first = names.front();
  size_t start = first.size(), end = first.size();
  for (const std::string& name : names) {
    const auto differs = std::mismatch(first.begin(), first.begin() + start,
                                       name.begin(), name.end());
    start = static_cast<size_t>(differs.first - first.begin());
    const auto differs_at_end = std::mismatch(
        first.rbegin(), first.rbegin() + end, name.rbegin(), name.rend());
    end = static_cast<size_t>(differs_at_end.first - first.rbegin());
  }
  if (start == first.size()) return first;
  end = std::min(end, first.size() - start);
  // The digits of a counter belong to the star.
  while (start > 0 && KindOf(first[start - 1]) == CharKind::kDigit) --start;
  while (end > 0 && KindOf(first[first.size() - end]) == CharKind::kDigit) {
    --end;
  }
  return first.substr(0, start) + kStar + first.substr(first.size() - end);
}

// The distinguishing parts at all positions, with the parts of their words.
std::optional<std::vector<std::string>> JoinTellingParts(
    const NameGroups& groups, bool splits_words) {
  std::vector<CommonParts> common;
  for (const auto& [camera, names] : groups) {
    const auto parts = FindCommonParts(names, splits_words);
    if (!parts || (!common.empty() && parts->size() != common[0].size())) {
      return std::nullopt;
    }
    common.push_back(*parts);
  }
  const auto all_have = [&](size_t i) {
    return AllOf(common, [&](const auto& parts) {
      return parts[i] && !IsSeparator(*parts[i]);
    });
  };
  std::vector<std::string> telling(groups.size());
  for (size_t i = 0; i < common[0].size(); ++i) {
    size_t end = i;
    bool tells = false;
    for (; end < common[0].size() && all_have(end); ++end) {
      for (const auto& parts : common) tells |= parts[end] != common[0][end];
    }
    for (size_t g = 0; tells && g < groups.size(); ++g) {
      std::string word;
      for (size_t k = i; k < end; ++k) word += *common[g][k];
      telling[g] += (telling[g].empty() ? "" : "/") + word;
    }
    i = std::max(i, end);
  }
  const std::set<std::string> distinct(telling.begin(), telling.end());
  if (distinct.size() != telling.size()) return std::nullopt;
  return telling;
}

// Unnamed groups are ignored.
struct NameRule {
  explicit NameRule(const std::string& rule);

  RE2 regex;
  std::map<int, std::string> groups;  // "camera", "frame" or "rig", by number

  bool HasGroup(const std::string& name) const {
    return AnyOf(groups,
                 [&](const auto& group) { return group.second == name; });
  }
};

// The texts of the groups of a match, by number; null for groups without a
// match.
using Texts = std::vector<re2::StringPiece>;

[[noreturn]] void ThrowRuleError(const std::string& rule,
                                 const std::string& problem) {
  throw Error("rig_name_rule '" + rule + "': " + problem);
}

// A unique name for each group, as RE2 requires: (?<camera>...) becomes
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

// RE2 takes linear time in the length of a name, whatever the rule.
NameRule::NameRule(const std::string& rule)
    : regex(WithUniqueNames(rule), RE2::Quiet) {
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

// The name of the image without the camera groups.
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

ImageKeys KeysOfMatch(const std::string& name, const Texts& texts,
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

std::vector<std::string> SplitNameParts(const std::string& name,
                                        bool splits_words) {
  Parts parts;
  for (size_t i = 0; i < name.size(); ++i) {
    const CharKind kind = KindOf(name[i]);
    const CharKind before = i == 0 ? CharKind::kSeparator : KindOf(name[i - 1]);
    const bool continues = kind != CharKind::kSeparator &&
                           before != CharKind::kSeparator &&
                           (kind == before || !splits_words);
    if (continues) {
      parts.back() += name[i];
    } else {
      parts.emplace_back(1, name[i]);
    }
  }
  return parts;
}

std::optional<std::string> MatchNamePattern(const std::string& name,
                                            const std::string& pattern) {
  std::string found;
  size_t position = 0, begin = 0;
  while (true) {
    const size_t star = pattern.find(kStar, begin);
    const std::string text = pattern.substr(begin, star - begin);
    const bool is_last = star == std::string::npos;
    size_t at = begin == 0 ? 0 : name.find(text, position);
    if (is_last && begin > 0 && name.size() >= position + text.size()) {
      at = name.size() - text.size();
    }
    if (at == std::string::npos || name.compare(at, text.size(), text) != 0) {
      return std::nullopt;
    }
    if (begin > 0) {
      found +=
          (found.empty() ? "" : "_") + name.substr(position, at - position);
    }
    position = at + text.size();
    if (is_last) break;
    begin = star + 1;
  }
  if (position != name.size()) return std::nullopt;
  return found;
}

std::vector<std::vector<std::string>> FindNamePatterns(
    const NameGroups& groups) {
  std::vector<std::vector<std::string>> ways;
  for (const bool splits_words : {false, true}) {
    std::vector<std::string> patterns;
    for (const auto& [camera, names] : groups) {
      const auto parts = FindCommonParts(names, splits_words);
      if (!parts) break;
      patterns.push_back(ToPattern(*parts));
    }
    if (patterns.size() == groups.size()) ways.push_back(std::move(patterns));
  }
  ways.push_back(Transformed(
      groups, [](const auto& group) { return PatternOfEnds(group.second); }));
  return ways;
}

std::optional<std::vector<std::string>> FindTellingParts(
    const NameGroups& groups) {
  for (const bool splits_words : {false, true}) {
    if (auto parts = JoinTellingParts(groups, splits_words)) return parts;
  }
  return std::nullopt;
}

RigAssignment AssignByRule(const RigInput& input, const std::string& rule,
                           const TimedImages* times, const Context& context) {
  const NameRule parsed(rule);
  Texts texts(1 + static_cast<size_t>(parsed.regex.NumberOfCapturingGroups()));
  std::vector<ImageKeys> keys;
  for (const ImageRow& image : input.contents.images) {
    if (!parsed.regex.Match(image.name, 0, image.name.size(), RE2::ANCHOR_BOTH,
                            texts.data(), static_cast<int>(texts.size()))) {
      ThrowRuleError(rule, "does not match the image name '" + image.name +
                               "'; it must match all names as a whole");
    }
    keys.push_back(KeysOfMatch(image.name, texts, parsed));
  }
  if (times != nullptr) SetFramesByTime(input, *times, context, &keys);
  RigAssignment assignment = AssignByKeys(input, keys);
  assignment.source = "image names by the rule '" + rule + "'";
  return assignment;
}

}  // namespace mgsfm
