// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"

namespace mgsfm {

// The common part of all messages of one cause: the text without numbers and
// quoted names.
std::string KindOfMessage(const std::string& message);

// Merges all warnings with the same cause into one: the first message and the
// number of messages.
class GroupedWarnings {
 public:
  void Add(const std::string& message);
  // Sorted by the first message of each kind.
  void Log(const Context& context) const;

 private:
  struct Group {
    std::string first;
    size_t count = 0;
  };
  std::vector<Group> groups_;
  std::map<std::string, size_t> group_of_kind_;
};

}  // namespace mgsfm
