// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/pair_selection.h"

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"

namespace mgsfm {
namespace {

// A place is revisited within this distance after at least this path length.
constexpr double kLoopRadius_m = 25.0;
constexpr double kMinLoopLength_m = 60.0;
// Maximum number of images of the original matched with an image of the copy.
constexpr int kMaxNumOriginals = 6, kMaxNumOriginalsAtCuts = 12;

std::vector<std::vector<int>> ImagesOfFrames(
    const Drive& drive, const std::vector<Exposure>& exposures) {
  std::vector<std::vector<int>> images(drive.num_frames());
  for (const int i : Indices(exposures.size())) {
    images[exposures[i].frame].push_back(i);
  }
  return images;
}

void SortUnique(std::vector<PairPlan>* plans) {
  std::sort(plans->begin(), plans->end());
  const auto is_same = [](const PairPlan& a, const PairPlan& b) {
    return a.image1 == b.image1 && a.image2 == b.image2;
  };
  plans->erase(std::unique(plans->begin(), plans->end(), is_same),
               plans->end());
}

// Pairs of a number and an item: the largest number first.
template <class Pairs>
void SortByNumber(Pairs* pairs) {
  std::sort(pairs->begin(), pairs->end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second < b.second;
  });
}

PairPlan Ordered(int image1, int image2) {
  return {std::min(image1, image2), std::max(image1, image2)};
}

// Earlier frames of the same place, as indices into the drive.
class LoopFinder {
 public:
  LoopFinder(const Drive& drive, const World& world)
      : grid_(CellGrid::OfPoints(Positions(drive, world), kLoopRadius_m)) {
    positions_ = Positions(drive, world);
    for (int frame = 0; frame < drive.num_frames(); ++frame) {
      ways_.push_back(world.road.ArcAt(drive, drive.TimeOfFrame(frame)));
    }
  }

  std::vector<int> EarlierFrames(int frame) const {
    std::vector<int> frames;
    grid_.ForEachNear(positions_[frame], kLoopRadius_m, [&](int other) {
      if (ways_[frame] - ways_[other] > kMinLoopLength_m &&
          (positions_[frame] - positions_[other]).norm() < kLoopRadius_m) {
        frames.push_back(other);
      }
    });
    return frames;
  }

 private:
  static std::vector<Eigen::Vector2d> Positions(const Drive& drive,
                                                const World& world) {
    std::vector<Eigen::Vector2d> positions;
    for (int frame = 0; frame < drive.num_frames(); ++frame) {
      positions.emplace_back(
          (world.road.level_from_world() * drive.PoseOfFrame(frame).Center())
              .head<2>());
    }
    return positions;
  }

  CellGrid grid_;
  std::vector<Eigen::Vector2d> positions_;
  std::vector<double> ways_;
};

// The images with most points in common, as (number, image), best first.
std::vector<std::pair<int, int>> Best(std::vector<std::pair<int, int>> partners,
                                      int max_num) {
  SortByNumber(&partners);
  if (static_cast<int>(partners.size()) > max_num) partners.resize(max_num);
  return partners;
}

// The images with the most points in common, except neighbors, at most one per
// camera and stretch of neighbors, whatever the shape of the path.
std::vector<PairPlan> CovisibleOf(const Footage& footage, int image) {
  const SimulationOptions& options = footage.options;
  const Photographs& photographs = footage.photographs;
  const int num_points = static_cast<int>(footage.world.points.size());
  const Exposure& exposure = photographs.exposures[image];
  const auto are_neighbors = [&](const Exposure& a, const Exposure& b) {
    return std::abs(a.frame - b.frame) <= options.num_matched_frames;
  };
  std::vector<std::pair<int, int>> partners;
  for (int other = 0; other < static_cast<int>(photographs.exposures.size());
       ++other) {
    const Exposure& of_other = photographs.exposures[other];
    if (of_other.frame >= exposure.frame || are_neighbors(exposure, of_other)) {
      continue;
    }
    const int num_common = NumCommonPoints(
        photographs.features[image], photographs.features[other], num_points);
    if (num_common >= options.min_num_matches) {
      partners.emplace_back(num_common, other);
    }
  }
  std::vector<PairPlan> plans;
  std::vector<int> chosen;
  const int num_partners = static_cast<int>(partners.size());
  for (const auto& [num_common, other] :
       Best(std::move(partners), num_partners)) {
    const Exposure& of_other = photographs.exposures[other];
    const bool is_near = AnyOf(chosen, [&](int best) {
      return photographs.exposures[best].camera == of_other.camera &&
             are_neighbors(photographs.exposures[best], of_other);
    });
    if (is_near) continue;
    chosen.push_back(other);
    plans.push_back(Ordered(image, other));
    if (static_cast<int>(chosen.size()) == options.max_num_loop_images) break;
  }
  return plans;
}

void PlanLoops(const Footage& footage, const Context& context,
               std::vector<PairPlan>* plans) {
  const SimulationOptions& options = footage.options;
  const Photographs& photographs = footage.photographs;
  std::optional<LoopFinder> finder;
  if (!footage.drive.is_level) {
    finder.emplace(footage.drive, footage.world);
  }
  const std::vector<std::vector<int>> images_of_frames =
      ImagesOfFrames(footage.drive, photographs.exposures);
  const int num_points = static_cast<int>(footage.world.points.size());
  std::vector<std::vector<PairPlan>> found(photographs.exposures.size());
  const auto find = [&](size_t image) {
    if (!finder) {
      found[image] = CovisibleOf(footage, static_cast<int>(image));
      return;
    }
    const Exposure& exposure = photographs.exposures[image];
    std::vector<std::pair<int, int>> partners;
    for (const int frame : finder->EarlierFrames(exposure.frame)) {
      for (const int other : images_of_frames[frame]) {
        if (!options.match_different_sensors &&
            photographs.exposures[other].camera != exposure.camera) {
          continue;
        }
        const int num_common =
            NumCommonPoints(photographs.features[image],
                            photographs.features[other], num_points);
        if (num_common >= options.min_num_matches) {
          partners.emplace_back(num_common, other);
        }
      }
    }
    for (const auto& [num_common, other] :
         Best(std::move(partners), options.max_num_loop_images)) {
      found[image].push_back(Ordered(static_cast<int>(image), other));
    }
  };
  ParallelFor(found.size(), context, "simulation: loops", find, 16);
  for (const std::vector<PairPlan>& some : found) {
    plans->insert(plans->end(), some.begin(), some.end());
  }
}

// The points of a duplicate structure that each image observes, by appearance.
struct View {
  int image;
  std::vector<int> appearances;
};
struct Views {
  std::vector<View> of_original;
  std::vector<View> of_copy;
};

std::vector<Views> FindViews(const World& world,
                             const Photographs& photographs) {
  std::vector<Views> views(world.copy_from_original.size());
  const int num_points = static_cast<int>(world.points.size());
  for (const int image : Indices(photographs.features.size())) {
    for (const int identity : photographs.features[image].identities) {
      if (identity >= num_points) break;
      const WorldPoint& point = world.points[identity];
      if (point.duplicate < 0) continue;
      std::vector<View>& list = point.is_copy
                                    ? views[point.duplicate].of_copy
                                    : views[point.duplicate].of_original;
      if (list.empty() || list.back().image != image) {
        list.push_back({image, {}});
      }
      list.back().appearances.push_back(point.appearance);
    }
  }
  return views;
}

// Of two ascending sequences.
template <class Iterator>
int NumCommon(Iterator begin1, Iterator end1, Iterator begin2, Iterator end2) {
  int num_common = 0;
  while (begin1 != end1 && begin2 != end2) {
    const bool is_common = *begin1 == *begin2;
    const bool is_behind = *begin1 < *begin2;
    num_common += is_common ? 1 : 0;
    begin1 += is_common || is_behind ? 1 : 0;
    begin2 += is_common || !is_behind ? 1 : 0;
  }
  return num_common;
}

// The pairs of one structure, those with the most common points first.
std::vector<std::pair<int, PairPlan>> RankedPairs(
    const SimulationOptions& options, const Views& views, int duplicate,
    const std::vector<PairPlan>& plans) {
  std::vector<std::pair<int, PairPlan>> ranked;
  for (const View& copy : views.of_copy) {
    std::vector<std::pair<int, int>> partners;
    for (const View& original : views.of_original) {
      const PairPlan plan = Ordered(copy.image, original.image);
      const int num_common =
          NumCommon(copy.appearances.begin(), copy.appearances.end(),
                    original.appearances.begin(), original.appearances.end());
      if (num_common < options.min_num_matches || plan.image1 == plan.image2 ||
          std::binary_search(plans.begin(), plans.end(), plan)) {
        continue;
      }
      partners.emplace_back(num_common, original.image);
    }
    for (const auto& [num_common, original] :
         Best(std::move(partners), options.weak_cut_spacing > 0
                                       ? kMaxNumOriginalsAtCuts
                                       : kMaxNumOriginals)) {
      PairPlan plan = Ordered(copy.image, original);
      plan.duplicate = duplicate;
      plan.first_sees_copy = plan.image1 == copy.image;
      ranked.emplace_back(num_common, plan);
    }
  }
  SortByNumber(&ranked);
  return ranked;
}

}  // namespace

int NumCommonPoints(const SimulatedFeatures& features1,
                    const SimulatedFeatures& features2, int num_points) {
  const std::vector<int>& ids1 = features1.identities;
  const std::vector<int>& ids2 = features2.identities;
  return NumCommon(
      ids1.begin(), std::lower_bound(ids1.begin(), ids1.end(), num_points),
      ids2.begin(), std::lower_bound(ids2.begin(), ids2.end(), num_points));
}

std::vector<PairPlan> PlanNeighbors(const SimulationOptions& options,
                                    const Drive& drive,
                                    const std::vector<Exposure>& exposures) {
  const int max_gap = options.num_matched_frames;
  const int max_gap_across = options.num_matched_frames_across;
  const std::vector<std::vector<int>> images = ImagesOfFrames(drive, exposures);
  const int num_frames = drive.num_frames();
  std::vector<PairPlan> plans;
  for (int frame = 0; frame < num_frames; ++frame) {
    for (int gap = 0; gap <= max_gap; ++gap) {
      int other_frame = frame + gap;
      if (other_frame >= num_frames) {
        if (!drive.is_closed || 2 * gap > num_frames) break;
        other_frame -= num_frames;
      }
      for (const int i : images[frame]) {
        for (const int j : images[other_frame]) {
          const bool is_same = exposures[i].camera == exposures[j].camera;
          const bool is_matched = is_same || (options.match_different_sensors &&
                                              gap <= max_gap_across);
          if (i != j && is_matched) plans.push_back(Ordered(i, j));
        }
      }
    }
  }
  SortUnique(&plans);
  return plans;
}

std::vector<PairPlan> PlanPairs(const Footage& footage,
                                const Context& context) {
  std::vector<PairPlan> plans = PlanNeighbors(footage.options, footage.drive,
                                              footage.photographs.exposures);
  if (footage.options.max_num_loop_images > 0) {
    PlanLoops(footage, context, &plans);
    SortUnique(&plans);
  }
  return plans;
}

std::vector<PairPlan> PlanDuplicatedPairs(const Footage& footage,
                                          const std::vector<PairPlan>& plans,
                                          int num_pairs) {
  const std::vector<Views> views =
      FindViews(footage.world, footage.photographs);
  std::vector<PairPlan> duplicated;
  for (size_t i = 0; i < views.size(); ++i) {
    const auto ranked =
        RankedPairs(footage.options, views[i], static_cast<int>(i), plans);
    // Remaining structures compensate for those with too few pairs.
    const size_t num_structures = views.size() - i;
    const size_t num_wanted =
        (num_pairs - duplicated.size() + num_structures - 1) / num_structures;
    for (size_t j = 0; j < std::min(num_wanted, ranked.size()); ++j) {
      duplicated.push_back(ranked[j].second);
    }
  }
  SortUnique(&duplicated);
  return duplicated;
}

}  // namespace mgsfm
