// SPDX-License-Identifier: BSD-3-Clause
#include "rigs/name_patterns.h"

#include <algorithm>
#include <cctype>
#include <set>

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

// The parts that all names of a group have, nullopt where they differ. nullopt
// if names have different numbers of parts.
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

// The start and the end that all names have.
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

// The telling parts at all positions, with the parts of their words.
std::optional<std::vector<std::string>> JoinTellingParts(
    const NameGroups& groups, bool splits_words) {
  std::vector<CommonParts> common;
  for (const std::vector<std::string>& names : groups) {
    const auto parts = FindCommonParts(names, splits_words);
    if (!parts || (!common.empty() && parts->size() != common[0].size())) {
      return std::nullopt;
    }
    common.push_back(*parts);
  }
  const auto all_have = [&](size_t i) {
    return std::all_of(common.begin(), common.end(), [&](const auto& parts) {
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
    for (const std::vector<std::string>& names : groups) {
      const auto parts = FindCommonParts(names, splits_words);
      if (!parts) break;
      patterns.push_back(ToPattern(*parts));
    }
    if (patterns.size() == groups.size()) ways.push_back(std::move(patterns));
  }
  std::vector<std::string> of_ends;
  for (const auto& names : groups) of_ends.push_back(PatternOfEnds(names));
  ways.push_back(std::move(of_ends));
  return ways;
}

std::optional<std::vector<std::string>> FindTellingParts(
    const NameGroups& groups) {
  for (const bool splits_words : {false, true}) {
    if (auto parts = JoinTellingParts(groups, splits_words)) return parts;
  }
  return std::nullopt;
}

}  // namespace mgsfm
