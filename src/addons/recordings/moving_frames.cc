// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/moving_frames.h"

#include <iterator>

#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "priors/timed_samples.h"

namespace mgsfm {

void MovingFrames::Add(const TransformMessage& transform, int64_t time_ns) {
  names_.insert({transform.child, transform.parent});
  parents_of_[transform.child][transform.parent].emplace(
      time_ns, transform.parent_from_child);
}

std::vector<MovingFrames::Link> MovingFrames::ChainOf(
    const std::string& body, const std::string& world,
    const FrameTree& fixed) const {
  std::vector<Link> chain;
  std::set<std::string> passed;
  std::string frame = body;
  while (frame != world) {
    if (!passed.insert(frame).second) {
      throw Error("has a cycle of frames through '" + frame +
                  "'; choose another position_topic");
    }
    const auto* parent = fixed.FindParent(frame);
    const auto moving = parents_of_.find(frame);
    if (parent != nullptr) {
      chain.push_back({&parent->second});
      frame = parent->first;
    } else if (moving == parents_of_.end()) {
      break;
    } else if (moving->second.size() > 1) {
      const auto first = moving->second.begin();
      throw Error("has the frame '" + frame + "' in both '" + first->first +
                  "' and '" + std::next(first)->first +
                  "'; choose another body_frame or position_topic");
    } else {
      Link& link = chain.emplace_back();
      link.moving = &moving->second.begin()->second;
      for (const auto& [time_ns, parent_from_child] : *link.moving) {
        link.samples.push_back({Seconds(time_ns), parent_from_child.Inverse()});
      }
      link.max_gap_s = MaxGapSeconds(link.samples);
      frame = moving->second.begin()->first;
    }
  }
  const bool moves =
      AnyOf(chain, [](const Link& link) { return link.moving != nullptr; });
  if (!moves || (!world.empty() && frame != world)) {
    throw Error("does not tell where the frame '" + body + "' is in " +
                (world.empty() ? "any other" : "'" + world + "'") +
                "; set body_frame and world_frame to two of its frames " +
                Joined(names_, ", "));
  }
  return chain;
}

std::map<int64_t, Rigid3> MovingFrames::PosesOf(const std::string& body,
                                                const std::string& world,
                                                const FrameTree& fixed) const {
  const std::vector<Link> chain = ChainOf(body, world, fixed);
  const Poses* fastest = nullptr;
  for (const Link& link : chain) {
    const bool is_faster =
        link.moving && (!fastest || link.moving->size() > fastest->size());
    if (is_faster) fastest = link.moving;
  }
  Poses poses;
  for (const auto& [time_ns, unused] : *fastest) {
    Rigid3 world_from_body;
    bool is_known = true;
    for (const Link& link : chain) {
      if (link.fixed) {
        world_from_body = *link.fixed * world_from_body;
        continue;
      }
      const auto place =
          FindBetween(link.samples, link.max_gap_s, Seconds(time_ns));
      is_known = place.has_value();
      if (!place) break;
      world_from_body = Interpolate(*place).Inverse() * world_from_body;
    }
    if (is_known) poses.emplace(time_ns, world_from_body);
  }
  if (!poses.empty()) return poses;
  throw Error("has no time at which all frames above '" + body +
              "' are known; set world_frame to a frame nearer to it");
}

}  // namespace mgsfm
