// SPDX-License-Identifier: BSD-3-Clause
#include "base/grouped_warnings.h"

#include <cctype>

namespace mgsfm {

std::string KindOfMessage(const std::string& message) {
  std::string kind;
  for (size_t i = 0; i < message.size(); ++i) {
    const bool is_digit =
        std::isdigit(static_cast<unsigned char>(message[i])) != 0;
    if (message[i] == '\'') {
      const size_t end = message.find('\'', i + 1);
      if (end != std::string::npos) i = end;
    } else if (is_digit || message[i] == '.') {
      continue;
    }
    kind += message[i];
  }
  return kind;
}

void GroupedWarnings::Add(const std::string& message) {
  const auto [group, is_new] =
      group_of_kind_.emplace(KindOfMessage(message), groups_.size());
  if (is_new) groups_.push_back({message, 0});
  ++groups_[group->second].count;
}

void GroupedWarnings::Log(const Context& context) const {
  for (const Group& group : groups_) {
    context.Warning(group.first +
                    (group.count == 1
                         ? ""
                         : " (the first of " + std::to_string(group.count) +
                               " such warnings)"));
  }
}

}  // namespace mgsfm
