// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/moving_frames.h"

#include <iterator>
#include <set>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "priors/timed_samples.h"

namespace mgsfm {
namespace {

double Seconds(int64_t time_ns) { return 1e-9 * static_cast<double>(time_ns); }

std::vector<TimedPose> SamplesOf(const std::map<int64_t, Rigid3>& poses) {
  std::vector<TimedPose> samples;
  for (const auto& [time_ns, parent_from_child] : poses) {
    samples.push_back({Seconds(time_ns), parent_from_child.Inverse()});
  }
  return samples;
}

}  // namespace

void MovingFrames::Add(const TransformMessage& transform, int64_t time_ns) {
  parents_of_[transform.child][transform.parent].emplace(
      time_ns, transform.parent_from_child);
}

std::string MovingFrames::FrameNames() const {
  std::set<std::string> names;
  for (const auto& [child, parents] : parents_of_) {
    names.insert(child);
    for (const auto& [parent, poses] : parents) names.insert(parent);
  }
  return Joined(names, ", ");
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
      chain.push_back({&parent->second, nullptr});
      frame = parent->first;
    } else if (moving == parents_of_.end()) {
      break;
    } else if (moving->second.size() > 1) {
      const auto first = moving->second.begin();
      throw Error("has the frame '" + frame + "' in both '" + first->first +
                  "' and '" + std::next(first)->first +
                  "'; choose another body_frame or position_topic");
    } else {
      chain.push_back({nullptr, &moving->second.begin()->second});
      frame = moving->second.begin()->first;
    }
  }
  const bool moves =
      AnyOf(chain, [](const Link& link) { return link.moving != nullptr; });
  if (!moves || (!world.empty() && frame != world)) {
    throw Error("does not tell where the frame '" + body + "' is in " +
                (world.empty() ? "any other" : "'" + world + "'") +
                "; set body_frame and world_frame to two of its frames " +
                FrameNames());
  }
  return chain;
}

std::map<int64_t, Rigid3> MovingFrames::PosesOf(const std::string& body,
                                                const std::string& world,
                                                const FrameTree& fixed) const {
  const std::vector<Link> chain = ChainOf(body, world, fixed);
  std::vector<std::vector<TimedPose>> samples;  // per link; of fixed ones none
  const Poses* fastest = nullptr;
  for (const Link& link : chain) {
    samples.push_back(link.moving ? SamplesOf(*link.moving)
                                  : std::vector<TimedPose>());
    const bool is_faster =
        link.moving && (!fastest || link.moving->size() > fastest->size());
    if (is_faster) fastest = link.moving;
  }
  const std::vector<double> max_gaps_s =
      Transformed(samples, [](const auto& s) { return MaxGapSeconds(s); });
  Poses poses;
  for (const auto& [time_ns, unused] : *fastest) {
    Rigid3 world_from_body;
    bool is_known = true;
    for (size_t k = 0; k < chain.size() && is_known; ++k) {
      if (chain[k].fixed) {
        world_from_body = *chain[k].fixed * world_from_body;
        continue;
      }
      const auto place =
          FindBetween(samples[k], max_gaps_s[k], Seconds(time_ns));
      is_known = place.has_value();
      if (place) {
        world_from_body = Interpolate(*place).Inverse() * world_from_body;
      }
    }
    if (is_known) poses.emplace(time_ns, world_from_body);
  }
  if (!poses.empty()) return poses;
  throw Error("has no time at which all frames above '" + body +
              "' are known; set world_frame to a frame nearer to it");
}

}  // namespace mgsfm
