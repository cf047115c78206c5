// SPDX-License-Identifier: BSD-3-Clause
#include "translation/scale_averaging.h"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/parallel.h"
#include "math/graph.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"
#include "math/spanning_tree.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

constexpr int kMinNumCommon = 5;
constexpr int kMaxNumLinks = 3;  // of one pair in one image, best first
constexpr double kMinRatioSigma = 0.03;
constexpr double kMinScaleSigma = 0.05;
constexpr double kMaxScaleSigma = 1.0;
// Far below what the ratios are good for.
constexpr double kMinStep = 1e-4;
constexpr double kRidge = 1e-6;

struct ScaleLink {
  int motion1;
  int motion2;
  double log_ratio;  // log(scale2 / scale1)
  double sigma;
};

// One end of a motion: its depths in one image.
struct MotionEnd {
  int motion_idx;
  int side;
};

bool MakeLink(const std::vector<DepthSample>& depths1,
              const std::vector<DepthSample>& depths2,
              std::vector<double>* scratch, ScaleLink* link) {
  scratch->clear();
  for (size_t a = 0, b = 0; a < depths1.size() && b < depths2.size();) {
    if (depths1[a].keypoint_idx < depths2[b].keypoint_idx) {
      ++a;
    } else if (depths2[b].keypoint_idx < depths1[a].keypoint_idx) {
      ++b;
    } else {
      scratch->push_back(depths1[a++].log_depth - depths2[b++].log_depth);
    }
  }
  if (scratch->size() < kMinNumCommon) return false;
  link->log_ratio = Median(*scratch);
  for (double& value : *scratch) value = std::abs(value - link->log_ratio);
  const double spread = RobustSigma<1>(*scratch);
  // The median of n normal values has 1.25 times the error of their mean.
  link->sigma =
      std::hypot(1.25 * spread / std::sqrt(scratch->size()), kMinRatioSigma);
  return true;
}

// Links between the pairs of one image: for each, the most certain ones.
std::vector<ScaleLink> LinkPairsOfImage(
    const std::vector<BaselineDirection>& motions,
    const std::vector<MotionEnd>& ends) {
  std::vector<ScaleLink> all;
  std::vector<std::vector<int>> links_of_end(ends.size());
  std::vector<double> scratch;
  for (size_t a = 0; a < ends.size(); ++a) {
    for (size_t b = a + 1; b < ends.size(); ++b) {
      ScaleLink link{ends[a].motion_idx, ends[b].motion_idx, 0.0, 0.0};
      if (!MakeLink(motions[ends[a].motion_idx].depths[ends[a].side],
                    motions[ends[b].motion_idx].depths[ends[b].side], &scratch,
                    &link)) {
        continue;
      }
      links_of_end[a].push_back(static_cast<int>(all.size()));
      links_of_end[b].push_back(static_cast<int>(all.size()));
      all.push_back(link);
    }
  }
  Mask is_kept(all.size(), false);
  for (std::vector<int>& links : links_of_end) {
    std::sort(links.begin(), links.end(), [&](int x, int y) {
      return all[x].sigma != all[y].sigma ? all[x].sigma < all[y].sigma : x < y;
    });
    if (links.size() > kMaxNumLinks) links.resize(kMaxNumLinks);
    for (const int link : links) is_kept[link] = true;
  }
  std::vector<ScaleLink> kept;
  for (size_t i = 0; i < all.size(); ++i) {
    if (is_kept[i]) kept.push_back(all[i]);
  }
  return kept;
}

std::vector<ScaleLink> LinkPairs(const std::vector<BaselineDirection>& motions,
                                 int num_images, int num_threads) {
  std::vector<std::vector<MotionEnd>> ends(num_images);
  for (size_t i = 0; i < motions.size(); ++i) {
    if (motions[i].kind != BaselineKind::kDirection) continue;
    ends[motions[i].image_idx1].push_back({static_cast<int>(i), 0});
    ends[motions[i].image_idx2].push_back({static_cast<int>(i), 1});
  }
  std::vector<std::vector<ScaleLink>> of_image(num_images);
  ParallelFor(num_images, num_threads, [&](size_t image_idx) {
    of_image[image_idx] = LinkPairsOfImage(motions, ends[image_idx]);
  });
  std::vector<ScaleLink> links;
  for (const auto& some : of_image) {
    links.insert(links.end(), some.begin(), some.end());
  }
  return links;
}

class ScaleAverager {
 public:
  ScaleAverager(int num_motions, const std::vector<ScaleLink>& links,
                int num_threads)
      : links_(links),
        log_scale_(Eigen::VectorXd::Zero(num_motions)),
        solver_(num_threads) {
    edges_.reserve(links.size());
    for (const ScaleLink& link : links_) {
      edges_.push_back({link.motion1, link.motion2, 1.0 / link.sigma});
    }
  }

  void Run() {
    if (links_.empty()) return;
    InitialiseFromForest();
    MakePattern();
    constexpr int kMaxNumRounds = 20;
    for (int round = 0; round < kMaxNumRounds; ++round) {
      const double loss_scale = std::max(3.0, 30.0 * std::pow(0.5, round));
      const double step = Update({RobustLossType::kCauchy, loss_scale});
      if (loss_scale == 3.0 && step < kMinStep) break;
    }
  }

  const std::vector<GraphEdge>& edges() const { return edges_; }
  const Eigen::VectorXd& log_scale() const { return log_scale_; }

  std::vector<double> Sigmas() const {
    std::vector<std::vector<double>> errors(log_scale_.size());
    for (const ScaleLink& link : links_) {
      const double error = std::abs(Residual(link));
      errors[link.motion1].push_back(error);
      errors[link.motion2].push_back(error);
    }
    std::vector<double> sigmas(log_scale_.size(), kMinScaleSigma);
    for (size_t i = 0; i < sigmas.size(); ++i) {
      if (errors[i].empty()) continue;
      sigmas[i] =
          std::min(std::hypot(RobustSigma<1>(errors[i]), kMinScaleSigma),
                   kMaxScaleSigma);
    }
    return sigmas;
  }

 private:
  double Residual(const ScaleLink& link) const {
    return log_scale_[link.motion2] - log_scale_[link.motion1] - link.log_ratio;
  }

  void InitialiseFromForest() {
    const int size = static_cast<int>(log_scale_.size());
    const auto forest = MaximumSpanningForest(size, edges_);
    for (const ForestStep& step : WalkForest(size, edges_, forest)) {
      if (!step.from) continue;
      const ScaleLink& link = links_[step.from->edge];
      const double sign = link.motion2 == step.node ? 1.0 : -1.0;
      log_scale_[step.node] =
          log_scale_[step.from->parent] + sign * link.log_ratio;
    }
  }

  // Where a link is in the values of H.
  struct LinkEntries {
    int diagonal1;
    int diagonal2;
    int off_diagonal;
  };

  // The lower triangle of H and where the links are in it; the same in all
  // rounds.
  void MakePattern() {
    const Eigen::Index size = log_scale_.size();
    std::vector<Eigen::Triplet<double>> triplets;
    for (Eigen::Index i = 0; i < size; ++i) triplets.emplace_back(i, i, 0.0);
    for (const ScaleLink& link : links_) {
      const auto [low, high] = std::minmax(link.motion1, link.motion2);
      triplets.emplace_back(high, low, 0.0);
    }
    H_.resize(size, size);
    H_.setFromTriplets(triplets.begin(), triplets.end());
    for (const ScaleLink& link : links_) {
      const auto [low, high] = std::minmax(link.motion1, link.motion2);
      const int* begin = H_.innerIndexPtr() + H_.outerIndexPtr()[low];
      const int* end = H_.innerIndexPtr() + H_.outerIndexPtr()[low + 1];
      entries_.push_back({H_.outerIndexPtr()[link.motion1],
                          H_.outerIndexPtr()[link.motion2],
                          static_cast<int>(std::lower_bound(begin, end, high) -
                                           H_.innerIndexPtr())});
    }
    solver_.Analyze(H_);
  }

  // One weighted least-squares step; returns the largest change. The gauge of
  // each group, one common offset, is fixed by a negligible ridge on the step.
  double Update(const RobustLoss& loss) {
    const Eigen::Index size = log_scale_.size();
    Eigen::VectorXd rhs = Eigen::VectorXd::Zero(size);
    double* values = H_.valuePtr();
    std::fill_n(values, H_.nonZeros(), 0.0);
    for (Eigen::Index i = 0; i < size; ++i) {
      values[H_.outerIndexPtr()[i]] = kRidge;
    }
    for (size_t k = 0; k < links_.size(); ++k) {
      const ScaleLink& link = links_[k];
      const double difference = Residual(link);
      const double residual = difference / link.sigma;
      const double weight =
          loss.Weight(residual * residual) / (link.sigma * link.sigma);
      values[entries_[k].diagonal1] += weight;
      values[entries_[k].diagonal2] += weight;
      values[entries_[k].off_diagonal] -= weight;
      rhs[link.motion1] += weight * difference;
      rhs[link.motion2] -= weight * difference;
    }
    if (!solver_.Factorize(H_)) return 0.0;
    Eigen::VectorXd step(size);
    solver_.Solve(rhs, step);
    log_scale_ += step;
    return step.cwiseAbs().maxCoeff();
  }

  const std::vector<ScaleLink>& links_;
  std::vector<GraphEdge> edges_;
  Eigen::VectorXd log_scale_;
  std::vector<LinkEntries> entries_;  // per link
  Eigen::SparseMatrix<double> H_;
  SparseCholesky solver_;
};

double MedianLogDepth(const BaselineDirection& motion) {
  std::vector<double> log_depths;
  for (const DepthSample& d : motion.depths[0]) {
    log_depths.push_back(d.log_depth);
  }
  return Median(std::move(log_depths));
}

// Numbers the groups by descending size, then by first motion.
void NumberGroups(const std::vector<BaselineDirection>& motions,
                  const ConnectedComponents& parts, PairScales* scales) {
  std::vector<int> sizes(parts.num_components, 0);
  for (size_t i = 0; i < motions.size(); ++i) {
    sizes[parts.component[i]] += motions[i].kind == BaselineKind::kDirection;
  }
  std::vector<int> order(parts.num_components);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return sizes[a] > sizes[b]; });
  std::vector<int> group_of_part(parts.num_components);
  for (int group = 0; group < parts.num_components; ++group) {
    group_of_part[order[group]] = group;
    if (sizes[order[group]] > 0) {
      scales->group_sizes.push_back(sizes[order[group]]);
    }
  }
  scales->group.assign(motions.size(), -1);
  for (size_t i = 0; i < motions.size(); ++i) {
    if (motions[i].kind != BaselineKind::kDirection) continue;
    scales->group[i] = group_of_part[parts.component[i]];
  }
}

// From logarithms with a free offset per group to scales in common units.
void SetScales(const std::vector<BaselineDirection>& motions,
               const Eigen::VectorXd& log_scale, int num_threads,
               PairScales* scales) {
  std::vector<double> median_log_depth(motions.size());
  ParallelFor(motions.size(), num_threads, [&](size_t i) {
    if (scales->group[i] >= 0) median_log_depth[i] = MedianLogDepth(motions[i]);
  });
  const size_t num_groups = scales->group_sizes.size();
  std::vector<std::vector<double>> log_depths(num_groups);
  for (size_t i = 0; i < motions.size(); ++i) {
    if (scales->group[i] < 0) continue;
    log_depths[scales->group[i]].push_back(log_scale[i] + median_log_depth[i]);
  }
  std::vector<double> offsets(num_groups);
  for (size_t g = 0; g < num_groups; ++g) offsets[g] = Median(log_depths[g]);
  std::vector<double> in_depths;  // log scales of group 0, in typical depths
  for (size_t i = 0; i < motions.size(); ++i) {
    if (scales->group[i] == 0) in_depths.push_back(log_scale[i] - offsets[0]);
  }
  const double unit = Median(in_depths);
  scales->typical_depth = std::exp(-unit);
  scales->scale.assign(motions.size(), 0.0);
  for (size_t i = 0; i < motions.size(); ++i) {
    const int group = scales->group[i];
    if (group < 0) continue;
    scales->scale[i] = std::exp(log_scale[i] - offsets[group] - unit);
  }
}

}  // namespace

PairScales AverageScales(const std::vector<BaselineDirection>& motions,
                         int num_images, const Context& context) {
  const std::vector<ScaleLink> links =
      LinkPairs(motions, num_images, context.num_threads);
  const int num_motions = static_cast<int>(motions.size());
  ScaleAverager averager(num_motions, links, context.num_threads);
  averager.Run();
  PairScales scales;
  NumberGroups(motions, FindConnectedComponents(num_motions, averager.edges()),
               &scales);
  scales.sigma_log = averager.Sigmas();
  if (scales.group_sizes.empty()) {
    scales.scale.assign(motions.size(), 0.0);
    return scales;
  }
  SetScales(motions, averager.log_scale(), context.num_threads, &scales);
  return scales;
}

}  // namespace mgsfm
