// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/frame_tree.h"

namespace mgsfm {

void FrameTree::Add(const std::string& parent, const std::string& child,
                    const Rigid3& parent_from_child) {
  parent_of_[child] = {parent, parent_from_child};
}

std::pair<std::string, Rigid3> FrameTree::RootFrom(std::string frame) const {
  Rigid3 root_from_frame;
  // A cycle ends after as many steps as there are transforms.
  for (size_t i = 0; i < parent_of_.size(); ++i) {
    const auto* parent = FindParent(frame);
    if (parent == nullptr) break;
    root_from_frame = parent->second * root_from_frame;
    frame = parent->first;
  }
  return {frame, root_from_frame};
}

const std::pair<std::string, Rigid3>* FrameTree::FindParent(
    const std::string& frame) const {
  const auto found = parent_of_.find(frame);
  return found == parent_of_.end() ? nullptr : &found->second;
}

std::optional<Rigid3> FrameTree::Between(const std::string& to,
                                         const std::string& from) const {
  const auto [root_of_to, root_from_to] = RootFrom(to);
  const auto [root_of_from, root_from_from] = RootFrom(from);
  if (root_of_to != root_of_from) return std::nullopt;
  return root_from_to.Inverse() * root_from_from;
}

}  // namespace mgsfm
