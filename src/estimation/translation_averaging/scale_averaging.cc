// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/scale_averaging.h"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "math/graph.h"
#include "math/robust_loss.h"
#include "math/robust_scale.h"
#include "math/spanning_tree.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// Maximum number of links of one pair in one image, most certain first. It
// bounds the time: the pairs of an image are about equally redundant.
constexpr int kMaxNumLinks = 3;
// Errors that remain however many keypoints vote: 3 % of a ratio, 5 % of a
// length.
constexpr double kMinRatioSigma = 0.03;
constexpr double kMinScaleSigma = 0.05;
// The error of expected lengths; links by matches have 40 times the weight.
constexpr double kExpectedLengthSigma = 0.2;
// Cauchy loss in standard deviations of a link: from kFirstLossScale, halved
// each round, to kCauchyScaleInSigmas, which takes four rounds; further rounds
// converge.
constexpr double kFirstLossScale = 30.0;

struct ScaleLink {
  int pair1;
  int pair2;
  double log_ratio;  // log(scale2 / scale1)
  double sigma;
  bool is_expected = false;  // by a hint

  double Residual(const Eigen::VectorXd& log_scale) const {
    return log_scale[pair2] - log_scale[pair1] - log_ratio;
  }
};

// A pair and its depths in one of its images.
struct PairEnd {
  int pair_idx;
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
  if (scratch->size() < kMinNumOfMedian) return false;
  link->log_ratio = Median(*scratch);
  for (double& value : *scratch) value = std::abs(value - link->log_ratio);
  const double sigma = RobustSigma<1>(*scratch);
  // The median of n normal values has sqrt(pi / 2) = 1.25 times the error of
  // their mean.
  link->sigma =
      std::hypot(1.25 * sigma / std::sqrt(scratch->size()), kMinRatioSigma);
  return true;
}

// The most certain links between the pairs of one image.
std::vector<ScaleLink> LinkPairsOfImage(
    const std::vector<BaselineDirection>& baselines,
    const std::vector<PairEnd>& ends) {
  std::vector<ScaleLink> all;
  std::vector<std::vector<int>> links_of_end(ends.size());
  std::vector<double> scratch;
  for (size_t a = 0; a < ends.size(); ++a) {
    for (size_t b = a + 1; b < ends.size(); ++b) {
      ScaleLink link{ends[a].pair_idx, ends[b].pair_idx, 0.0, 0.0};
      if (!MakeLink(baselines[ends[a].pair_idx].depths[ends[a].side],
                    baselines[ends[b].pair_idx].depths[ends[b].side], &scratch,
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

std::vector<ScaleLink> LinkPairs(
    const std::vector<BaselineDirection>& baselines, int num_images,
    int num_threads) {
  std::vector<std::vector<PairEnd>> ends(num_images);
  for (size_t i = 0; i < baselines.size(); ++i) {
    if (baselines[i].kind != BaselineKind::kDirection) continue;
    ends[baselines[i].image_idx1].push_back({static_cast<int>(i), 0});
    ends[baselines[i].image_idx2].push_back({static_cast<int>(i), 1});
  }
  std::vector<std::vector<ScaleLink>> of_image(num_images);
  ParallelFor(num_images, num_threads, [&](size_t image_idx) {
    of_image[image_idx] = LinkPairsOfImage(baselines, ends[image_idx]);
  });
  std::vector<ScaleLink> links;
  for (const auto& some : of_image) {
    links.insert(links.end(), some.begin(), some.end());
  }
  return links;
}

// Links each pair to the first one of its set with a direction.
void LinkEqualLengths(const std::vector<BaselineDirection>& baselines,
                      const std::vector<std::vector<int>>& equal,
                      std::vector<ScaleLink>* links) {
  for (const std::vector<int>& pair_idxs : equal) {
    std::optional<int> first;
    for (const int i : pair_idxs) {
      if (baselines[i].kind != BaselineKind::kDirection) continue;
      // The error of lengths that are equal if the cameras of the rig trigger
      // simultaneously; as large as kMinScaleSigma.
      if (first) links->push_back({*first, i, 0.0, 0.05});
      if (!first) first = i;
    }
  }
}

// Links each pair with an expected length to a node for their unit.
void LinkExpectedLengths(const std::vector<BaselineDirection>& baselines,
                         const std::vector<std::optional<double>>& expected,
                         int unit_node, std::vector<ScaleLink>* links) {
  for (size_t i = 0; i < expected.size(); ++i) {
    if (!expected[i] || baselines[i].kind != BaselineKind::kDirection) continue;
    links->push_back({unit_node, static_cast<int>(i), std::log(*expected[i]),
                      kExpectedLengthSigma, true});
  }
}

std::vector<GraphEdge> EdgesOf(const std::vector<ScaleLink>& links) {
  return Transformed(links, [](const ScaleLink& link) {
    return GraphEdge{link.pair1, link.pair2, 1.0 / link.sigma};
  });
}

Eigen::VectorXd ChainAlongForest(int num_pairs,
                                 const std::vector<ScaleLink>& links,
                                 const std::vector<GraphEdge>& edges) {
  Eigen::VectorXd log_scale = Eigen::VectorXd::Zero(num_pairs);
  const auto forest = MaximumSpanningForest(num_pairs, edges);
  for (const ForestStep& step : WalkForest(num_pairs, edges, forest)) {
    if (!step.from) continue;
    const ScaleLink& link = links[step.from->edge];
    const double sign = link.pair2 == step.node ? 1.0 : -1.0;
    log_scale[step.node] = log_scale[step.from->parent] + sign * link.log_ratio;
  }
  return log_scale;
}

// Positions of a link in the values of the normal matrix H.
struct LinkEntries {
  int diagonal1;
  int diagonal2;
  int off_diagonal;
};

// The lower triangle of H and the entries of the links, constant over the
// rounds.
struct ScaleEquations {
  Eigen::SparseMatrix<double> H;
  std::vector<LinkEntries> entries;
};

ScaleEquations MakeEquations(int num_pairs,
                             const std::vector<ScaleLink>& links) {
  ScaleEquations equations;
  std::vector<Eigen::Triplet<double>> triplets;
  for (int i = 0; i < num_pairs; ++i) triplets.emplace_back(i, i, 0.0);
  for (const ScaleLink& link : links) {
    const auto [low, high] = std::minmax(link.pair1, link.pair2);
    triplets.emplace_back(high, low, 0.0);
  }
  Eigen::SparseMatrix<double>& H = equations.H;
  H.resize(num_pairs, num_pairs);
  H.setFromTriplets(triplets.begin(), triplets.end());
  for (const ScaleLink& link : links) {
    const auto [low, high] = std::minmax(link.pair1, link.pair2);
    const int* begin = H.innerIndexPtr() + H.outerIndexPtr()[low];
    const int* end = H.innerIndexPtr() + H.outerIndexPtr()[low + 1];
    equations.entries.push_back(
        {H.outerIndexPtr()[link.pair1], H.outerIndexPtr()[link.pair2],
         static_cast<int>(std::lower_bound(begin, end, high) -
                          H.innerIndexPtr())});
  }
  return equations;
}

// Fills H and returns the right-hand side of a weighted least-squares step.
Eigen::VectorXd Linearize(const std::vector<ScaleLink>& links,
                          const Eigen::VectorXd& log_scale,
                          const RobustLoss& loss, ScaleEquations* equations) {
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(log_scale.size());
  Eigen::SparseMatrix<double>& H = equations->H;
  double* values = H.valuePtr();
  std::fill_n(values, H.nonZeros(), 0.0);
  for (Eigen::Index i = 0; i < log_scale.size(); ++i) {
    // Fixes the gauge of each group; negligible compared with the link weights.
    values[H.outerIndexPtr()[i]] = 1e-6;
  }
  for (size_t k = 0; k < links.size(); ++k) {
    const ScaleLink& link = links[k];
    const LinkEntries& entries = equations->entries[k];
    const double difference = link.Residual(log_scale);
    const double residual = difference / link.sigma;
    const double weight =
        loss.Weight(residual * residual) / (link.sigma * link.sigma);
    values[entries.diagonal1] += weight;
    values[entries.diagonal2] += weight;
    values[entries.off_diagonal] -= weight;
    rhs[link.pair1] += weight * difference;
    rhs[link.pair2] -= weight * difference;
  }
  return rhs;
}

Eigen::VectorXd AverageLinks(int num_pairs, const std::vector<ScaleLink>& links,
                             const std::vector<GraphEdge>& edges,
                             int num_threads) {
  if (links.empty()) return Eigen::VectorXd::Zero(num_pairs);
  Eigen::VectorXd log_scale = ChainAlongForest(num_pairs, links, edges);
  ScaleEquations equations = MakeEquations(num_pairs, links);
  SparseCholesky solver(num_threads);
  solver.Analyze(equations.H);
  for (int round = 0; round < 20; ++round) {
    const double loss_scale =
        std::max(kCauchyScaleInSigmas, kFirstLossScale * std::pow(0.5, round));
    const Eigen::VectorXd rhs = Linearize(
        links, log_scale, {RobustLossType::kCauchy, loss_scale}, &equations);
    double max_step = 0.0;
    if (solver.Factorize(equations.H)) {
      Eigen::VectorXd step(num_pairs);
      solver.Solve(rhs, step);
      log_scale += step;
      max_step = step.cwiseAbs().maxCoeff();
    }
    // Stopping rule on log(scale), far below kMinRatioSigma.
    if (loss_scale == kCauchyScaleInSigmas && max_step < 1e-4) break;
  }
  return log_scale;
}

// Per pair, from the residuals of its links by matches; from the error of the
// expected length if nothing else links the pair.
std::vector<double> ScaleSigmas(const std::vector<ScaleLink>& links,
                                const Eigen::VectorXd& log_scale) {
  std::vector<std::vector<double>> errors(log_scale.size());
  for (const ScaleLink& link : links) {
    if (link.is_expected) continue;
    const double error = std::abs(link.Residual(log_scale));
    errors[link.pair1].push_back(error);
    errors[link.pair2].push_back(error);
  }
  std::vector<double> sigmas(log_scale.size(), kMinScaleSigma);
  for (const ScaleLink& link : links) {
    if (!link.is_expected) continue;
    sigmas[link.pair2] = kExpectedLengthSigma;
  }
  for (size_t i = 0; i < sigmas.size(); ++i) {
    if (errors[i].empty()) continue;
    // A factor of e; a length less certain than this is as good as unknown.
    sigmas[i] =
        std::min(std::hypot(RobustSigma<1>(errors[i]), kMinScaleSigma), 1.0);
  }
  return sigmas;
}

// Zero, i.e. one baseline, for directions of pairs without matches. Such a pair
// forms its own group.
double MedianLogDepth(const BaselineDirection& baseline) {
  if (baseline.depths[0].empty()) return 0.0;
  return Median(Transformed(baseline.depths[0], [](const DepthSample& d) {
    return double{d.log_depth};
  }));
}

// Groups in descending order of size, then by first pair.
struct ScaleGroups {
  std::vector<int> sizes;
  std::vector<std::optional<int>> group_of_pair;  // of kDirection
};

ScaleGroups NumberGroups(const std::vector<BaselineDirection>& baselines,
                         const ConnectedComponents& components) {
  std::vector<int> sizes(components.num_components, 0);
  for (size_t i = 0; i < baselines.size(); ++i) {
    sizes[components.component[i]] +=
        baselines[i].kind == BaselineKind::kDirection;
  }
  std::vector<int> order = Indices(components.num_components);
  StableSortDescendingBy(&order, [&](int a) { return sizes[a]; });
  ScaleGroups groups;
  std::vector<int> group_of_component(components.num_components);
  for (int group = 0; group < components.num_components; ++group) {
    group_of_component[order[group]] = group;
    if (sizes[order[group]] > 0) groups.sizes.push_back(sizes[order[group]]);
  }
  groups.group_of_pair.resize(baselines.size());
  for (size_t i = 0; i < baselines.size(); ++i) {
    if (baselines[i].kind != BaselineKind::kDirection) continue;
    groups.group_of_pair[i] = group_of_component[components.component[i]];
  }
  return groups;
}

// Chooses the unit of each group, which log_scale does not determine: equal
// median depths, and 1 for the median scale of group 0.
PairScales ChooseUnits(const std::vector<BaselineDirection>& baselines,
                       const ScaleGroups& groups,
                       const Eigen::VectorXd& log_scale,
                       const std::vector<double>& sigmas, int num_threads) {
  PairScales scales;
  scales.pairs.resize(baselines.size());
  scales.group_sizes = groups.sizes;
  if (groups.sizes.empty()) return scales;
  std::vector<double> median_log_depth(baselines.size());
  ParallelFor(baselines.size(), num_threads, [&](size_t i) {
    if (groups.group_of_pair[i]) {
      median_log_depth[i] = MedianLogDepth(baselines[i]);
    }
  });
  std::vector<std::vector<double>> log_depths(groups.sizes.size());
  for (size_t i = 0; i < baselines.size(); ++i) {
    const std::optional<int>& group = groups.group_of_pair[i];
    if (group) log_depths[*group].push_back(log_scale[i] + median_log_depth[i]);
  }
  std::vector<double> offsets;
  for (const auto& depths : log_depths) offsets.push_back(Median(depths));
  std::vector<double> in_depths;  // log scales of group 0, in typical depths
  for (size_t i = 0; i < baselines.size(); ++i) {
    if (groups.group_of_pair[i] == 0) {
      in_depths.push_back(log_scale[i] - offsets[0]);
    }
  }
  const double unit = Median(in_depths);
  scales.typical_depth = std::exp(-unit);
  for (size_t i = 0; i < baselines.size(); ++i) {
    const std::optional<int>& group = groups.group_of_pair[i];
    if (!group) continue;
    scales.pairs[i] = PairScale{std::exp(log_scale[i] - offsets[*group] - unit),
                                sigmas[i], *group};
  }
  return scales;
}

}  // namespace

PairScales AverageScales(const std::vector<BaselineDirection>& baselines,
                         int num_images, const Context& context,
                         const LengthHints& hints) {
  std::vector<ScaleLink> links =
      LinkPairs(baselines, num_images, context.num_threads);
  const int unit_node = static_cast<int>(baselines.size());
  const int num_nodes = unit_node + (hints.expected.empty() ? 0 : 1);
  LinkEqualLengths(baselines, hints.equal_pairs, &links);
  LinkExpectedLengths(baselines, hints.expected, unit_node, &links);
  const std::vector<GraphEdge> edges = EdgesOf(links);
  const Eigen::VectorXd log_scale =
      AverageLinks(num_nodes, links, edges, context.num_threads);
  const ScaleGroups groups =
      NumberGroups(baselines, FindConnectedComponents(num_nodes, edges));
  return ChooseUnits(baselines, groups, log_scale,
                     ScaleSigmas(links, log_scale), context.num_threads);
}

MeasuredBaselines MeasureBaselines(
    const std::vector<BaselineDirection>& directions, const PairScales& scales,
    const std::vector<double>& group_factor) {
  MeasuredBaselines measured(directions.size());
  for (size_t i = 0; i < directions.size(); ++i) {
    const std::optional<PairScale>& pair = scales.pairs[i];
    if (!pair) continue;
    const double unit = group_factor[pair->group];
    const double length = pair->scale * unit;
    measured[i] = {length * directions[i].direction,
                   scales.typical_depth * unit, pair->group == 0};
  }
  return measured;
}

CameraCenters ComputeCameraCenters(const PositionProblem& problem,
                                   const Positions& positions) {
  CameraCenters centers(problem.world_from_cam.size());
  for (size_t i = 0; i < centers.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    if (positions.IsPlaced(problem, image_idx)) {
      centers[i] = positions.CamCenter(problem, image_idx);
    }
  }
  return centers;
}

BaselineComparison CompareWith(const PositionProblem& problem,
                               const std::vector<BaselineDirection>& directions,
                               const PairScales& scales,
                               const std::vector<double>& group_factor,
                               const Positions& positions) {
  return {MeasureBaselines(directions, scales, group_factor),
          ComputeCameraCenters(problem, positions)};
}

}  // namespace mgsfm
