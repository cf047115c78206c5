// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>

#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Named frames with constant poses in their parents: a forest.
class FrameTree {
 public:
  // A later pose of the same child replaces an earlier one.
  void Add(const std::string& parent, const std::string& child,
           const Rigid3& parent_from_child);
  bool IsEmpty() const { return parent_of_.empty(); }
  // nullopt if nothing connects the frames.
  std::optional<Rigid3> Between(const std::string& to,
                                const std::string& from) const;
  // The root of the tree of a frame, and root_from_frame.
  std::pair<std::string, Rigid3> RootFrom(std::string frame) const;
  // The parent of a frame, and parent_from_frame; null for a root.
  const std::pair<std::string, Rigid3>* FindParent(
      const std::string& frame) const;

 private:
  std::map<std::string, std::pair<std::string, Rigid3>> parent_of_;
};

}  // namespace mgsfm
