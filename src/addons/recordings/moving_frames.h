// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/models/trajectory_io.h"
#include "recordings/recording_cameras.h"

namespace mgsfm {

// The frames of a topic /tf, which move relative to their parents.
class MovingFrames {
 public:
  // The first of two transforms at one time counts.
  void Add(const TransformMessage& transform, int64_t time_ns);

  // The poses world_from_body along the chain of parents from the body to the
  // world, or to the topmost frame if `world` is empty; frames of `fixed` do
  // not move. The times are those of the frame that has the most; others are
  // interpolated, as in timed_samples.h. Throws Error, whose message continues
  // the name of the topic, if no chain connects the two, if a frame has two
  // parents or if there is no time at which the whole chain is known.
  std::map<int64_t, Rigid3> PosesOf(const std::string& body,
                                    const std::string& world,
                                    const FrameTree& fixed) const;

 private:
  using Poses = std::map<int64_t, Rigid3>;
  // A frame of a chain relative to the one above: fixed, or with samples.
  struct Link {
    const Rigid3* fixed = nullptr;  // parent_from_child
    const Poses* moving = nullptr;
    std::vector<TimedPose> samples = {};  // child_from_parent
    double max_gap_s = 0.0;
  };

  std::vector<Link> ChainOf(const std::string& body, const std::string& world,
                            const FrameTree& fixed) const;

  std::set<std::string> names_;
  // parent_from_child by time, by child and parent.
  std::map<std::string, std::map<std::string, Poses>> parents_of_;
};

}  // namespace mgsfm
