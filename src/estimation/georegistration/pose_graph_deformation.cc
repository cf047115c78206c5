// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/pose_graph_deformation.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include "base/ranges.h"
#include "geometry/so3.h"
#include "georegistration/position_registration.h"
#include "math/robust_loss.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Vector7d = Eigen::Matrix<double, 7, 1>;

// The model agrees with the positions if this quantile of their distances is at
// most kMaxDistance standard deviations. For normal noise in three dimensions
// the quantile is 2.03; it reaches 3 with 23 % of outliers.
constexpr double kQuantile = 0.75;
constexpr double kMaxDistance = 3.0;
// Stiffness of the edges, from stiff to soft, in steps of 4.
constexpr double kSigmas[] = {DegToRad(0.01), DegToRad(0.04), DegToRad(0.16),
                              DegToRad(0.64)};
// Regularizes coordinates that neither edges nor positions determine.
constexpr double kDamping = 1e-9;

// A frame and the similarity that it applies to its surroundings.
struct Node {
  int frame_idx = 0;
  Vector3d old_center;
  Vector3d center;
  Quaterniond rotation = Quaterniond::Identity();
  double log_scale = 0.0;

  Vector3d Transform(const Vector3d& offset) const {
    return std::exp(log_scale) * (rotation * offset);
  }
};

struct Edge {
  int node1 = 0;
  int node2 = 0;
  Vector3d offset;  // between the centers, in the initial model
  double length = 1.0;
};

struct PositionTerm {
  int image_idx = 0;
  int node = 0;
  Vector3d offset;  // from the frame to the antenna, in the initial model
  Vector3d position;
  Matrix3d sqrt_information;
};

struct PoseGraph {
  std::vector<std::optional<int>> node_of_frame;
  std::vector<Node> nodes;
  std::vector<Edge> edges;
  std::vector<PositionTerm> positions;
  double typical_sigma = 1.0;  // of the positions
};

void AddNodes(const Scene& scene, const Reconstruction& model,
              PoseGraph* graph) {
  graph->node_of_frame.resize(scene.frames.size());
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    if (!model.rig_from_world[f]) continue;
    graph->node_of_frame[f] = static_cast<int>(graph->nodes.size());
    Node node;
    node.frame_idx = static_cast<int>(f);
    node.old_center = node.center = model.rig_from_world[f]->Center();
    graph->nodes.push_back(node);
  }
}

void AddEdges(const Scene& scene, const ViewGraph& view_graph,
              const Mask& pair_is_used, PoseGraph* graph) {
  std::set<std::pair<int, int>> connected;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!pair_is_used[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    const auto node1 =
        graph->node_of_frame[scene.images[pair.image_idx1].frame_idx];
    const auto node2 =
        graph->node_of_frame[scene.images[pair.image_idx2].frame_idx];
    if (!node1 || !node2 || *node1 == *node2) continue;
    connected.insert(std::minmax(*node1, *node2));
  }
  const std::vector<Node>& nodes = graph->nodes;
  std::vector<double> lengths;
  for (const auto& [node1, node2] : connected) {
    Edge edge{node1, node2, nodes[node2].old_center - nodes[node1].old_center,
              0.0};
    edge.length = edge.offset.norm();
    lengths.push_back(edge.length);
    graph->edges.push_back(edge);
  }
  if (lengths.empty()) return;
  const double median = Median(std::move(lengths));
  for (Edge& edge : graph->edges) {
    // Frames of a standing rig must not be infinitely stiff.
    edge.length = std::max(edge.length, 0.1 * median);
  }
}

void AddPositions(const Scene& scene, const PositionPriors& priors,
                  const Reconstruction& model, PoseGraph* graph) {
  std::vector<double> sigmas;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const auto pose = model.CamFromWorld(scene, image_idx);
    if (!pose || !priors.images[i]) continue;
    const PositionMeasurement& prior = *priors.images[i];
    const int node = graph->node_of_frame[scene.images[i].frame_idx].value();
    graph->positions.push_back(
        {image_idx, node,
         prior.PointInWorld(*pose) - graph->nodes[node].old_center,
         prior.position,
         prior.covariance.llt().matrixL().solve(Matrix3d::Identity())});
    sigmas.push_back(std::sqrt(prior.covariance.trace() / 3.0));
  }
  if (!sigmas.empty()) graph->typical_sigma = Median(std::move(sigmas));
}

Vector3d ResidualOf(const PoseGraph& graph, const PositionTerm& term) {
  const Node& node = graph.nodes[term.node];
  return term.sqrt_information *
         (node.center + node.Transform(term.offset) - term.position);
}

// A quantile of the distances to the positions, in standard deviations.
double DistanceQuantile(const PoseGraph& graph, double q) {
  std::vector<double> distances = Transformed(
      graph.positions,
      [&](const PositionTerm& term) { return ResidualOf(graph, term).norm(); });
  return Quantile(std::move(distances), q);
}

// The images whose position agrees with the model.
std::vector<int> ListInliers(const PoseGraph& graph) {
  const double bound = OutlierBound(DistanceQuantile(graph, 0.5));
  std::vector<int> image_idxs;
  for (const PositionTerm& term : graph.positions) {
    if (ResidualOf(graph, term).norm() <= bound) {
      image_idxs.push_back(term.image_idx);
    }
  }
  return image_idxs;
}

// The normal equations of one Gauss-Newton step. All matrices of a graph have
// the same pattern, so one symbolic factorization suffices.
class GaussNewtonEquations {
 public:
  GaussNewtonEquations(int num_unknowns_per_node, int num_threads)
      : num_unknowns_per_node_(num_unknowns_per_node), solver_(num_threads) {}

  void Clear(size_t num_nodes) {
    triplets_.clear();
    gradient_.setZero(num_unknowns_per_node_ *
                      static_cast<Eigen::Index>(num_nodes));
  }

  // Adds a residual that depends on the first num_nodes of two nodes; its
  // Jacobian has 7 columns per node: center, rotation (Q <- Exp(w) Q), log of
  // scale. Keeps zeros, so that the pattern does not change.
  template <int kRows>
  void AddTerm(const std::array<int, 2>& nodes, int num_nodes,
               const Eigen::Matrix<double, kRows, 14>& jacobian,
               const Eigen::Matrix<double, kRows, 1>& residual);

  // nullopt if the matrix is not positive definite.
  std::optional<Eigen::VectorXd> Solve();

 private:
  const int num_unknowns_per_node_;               // 7, or 6 without scale
  std::vector<Eigen::Triplet<double>> triplets_;  // of the lower triangle
  Eigen::VectorXd gradient_;
  SparseCholesky solver_;
  bool is_analyzed_ = false;
};

template <int kRows>
void GaussNewtonEquations::AddTerm(
    const std::array<int, 2>& nodes, int num_nodes,
    const Eigen::Matrix<double, kRows, 14>& jacobian,
    const Eigen::Matrix<double, kRows, 1>& residual) {
  const Eigen::Matrix<double, 14, 14> product = jacobian.transpose() * jacobian;
  const Eigen::Matrix<double, 14, 1> gradient = jacobian.transpose() * residual;
  const int size = num_unknowns_per_node_;
  const int num_columns = 7 * num_nodes;
  const auto unknown = [&](int column) {
    return size * nodes[column / 7] + column % 7;
  };
  for (int i = 0; i < num_columns; ++i) {
    if (i % 7 >= size) continue;
    const int row = unknown(i);
    gradient_[row] += gradient[i];
    for (int j = 0; j < num_columns; ++j) {
      if (j % 7 >= size || unknown(j) > row) continue;
      triplets_.emplace_back(row, unknown(j), product(i, j));
    }
  }
}

std::optional<Eigen::VectorXd> GaussNewtonEquations::Solve() {
  const auto size = gradient_.size();
  for (int i = 0; i < size; ++i) triplets_.emplace_back(i, i, 0.0);
  Eigen::SparseMatrix<double> matrix(size, size);
  matrix.setFromTriplets(triplets_.begin(), triplets_.end());
  for (int i = 0; i < size; ++i) {
    double& diagonal = matrix.coeffRef(i, i);
    diagonal = std::max(diagonal * (1.0 + kDamping), kDamping);
  }
  if (!is_analyzed_) solver_.Analyze(matrix);
  is_analyzed_ = true;
  if (!solver_.Factorize(matrix)) return std::nullopt;
  Eigen::VectorXd step(size);
  solver_.Solve(-gradient_, step);
  if (!step.allFinite()) return std::nullopt;
  return step;
}

void AddEdgeTerms(const PoseGraph& graph, double sigma,
                  GaussNewtonEquations* equations) {
  for (const Edge& edge : graph.edges) {
    const Node& a = graph.nodes[edge.node1];
    const Node& b = graph.nodes[edge.node2];
    const Vector3d by_a = a.Transform(edge.offset);
    const Vector3d by_b = b.Transform(edge.offset);
    const Vector3d rotation = LogSO3(a.rotation.conjugate() * b.rotation);
    Vector7d residual;
    residual << (b.center - a.center - 0.5 * (by_a + by_b)) / edge.length,
        rotation, b.log_scale - a.log_scale;
    Eigen::Matrix<double, 7, 14> J = Eigen::Matrix<double, 7, 14>::Zero();
    const double inverse = 1.0 / edge.length;
    J.block<3, 3>(0, 0) = -inverse * Matrix3d::Identity();
    J.block<3, 3>(0, 7) = inverse * Matrix3d::Identity();
    J.block<3, 3>(0, 3) = 0.5 * inverse * CrossMatrix(by_a);
    J.block<3, 3>(0, 10) = 0.5 * inverse * CrossMatrix(by_b);
    J.block<3, 1>(0, 6) = -0.5 * inverse * by_a;
    J.block<3, 1>(0, 13) = -0.5 * inverse * by_b;
    J.block<3, 3>(3, 10) = InverseRightJacobianSO3(rotation) *
                           b.rotation.conjugate().toRotationMatrix();
    J.block<3, 3>(3, 3) = -J.block<3, 3>(3, 10);
    J(6, 6) = -1.0;
    J(6, 13) = 1.0;
    equations->AddTerm<7>({edge.node1, edge.node2}, 2, J / sigma,
                          residual / sigma);
  }
}

void AddPositionTerms(const PoseGraph& graph, GaussNewtonEquations* equations) {
  // 2.8 is the 95 % quantile of the norm of a standard normal 3-vector. The
  // scale grows with the median, so that a segment that has drifted does not
  // count as outliers.
  const RobustLoss loss = {RobustLossType::kCauchy,
                           std::max(2.8, 2.0 * DistanceQuantile(graph, 0.5))};
  for (const PositionTerm& term : graph.positions) {
    const Node& node = graph.nodes[term.node];
    const Vector3d offset = node.Transform(term.offset);
    const Vector3d residual = ResidualOf(graph, term);
    const double weight = std::sqrt(loss.Weight(residual.squaredNorm()));
    Eigen::Matrix<double, 3, 14> J = Eigen::Matrix<double, 3, 14>::Zero();
    J.block<3, 3>(0, 0) = term.sqrt_information;
    J.block<3, 3>(0, 3) = -term.sqrt_information * CrossMatrix(offset);
    J.block<3, 1>(0, 6) = term.sqrt_information * offset;
    equations->AddTerm<3>({term.node, term.node}, 1, weight * J,
                          weight * residual);
  }
}

// Takes a Gauss-Newton step. Returns the largest displacement of a frame in
// standard deviations of the positions; nullopt if there is no solution.
std::optional<double> TakeStep(double sigma, int num_unknowns_per_node,
                               GaussNewtonEquations* equations,
                               PoseGraph* graph) {
  equations->Clear(graph->nodes.size());
  AddEdgeTerms(*graph, sigma, equations);
  AddPositionTerms(*graph, equations);
  const std::optional<Eigen::VectorXd> step = equations->Solve();
  if (!step) return std::nullopt;
  const int size = num_unknowns_per_node;
  double largest = 0.0;
  for (size_t i = 0; i < graph->nodes.size(); ++i) {
    const auto change =
        step->segment(size * static_cast<Eigen::Index>(i), size);
    Node& node = graph->nodes[i];
    node.center += change.head<3>();
    node.rotation = (ExpSO3(change.segment<3>(3)) * node.rotation).normalized();
    if (size == 7) node.log_scale += change[6];
    largest = std::max(largest, change.head<3>().norm());
  }
  return largest / graph->typical_sigma;
}

// Returns false if the graph needs no deformation or cannot be improved.
bool Deform(bool scale_drifts, const Context& context, PoseGraph* graph) {
  if (graph->positions.empty() || graph->edges.empty()) return false;
  const double first_distance = DistanceQuantile(*graph, kQuantile);
  if (first_distance <= kMaxDistance) return false;
  const int num_unknowns_per_node = scale_drifts ? 7 : 6;
  GaussNewtonEquations equations(num_unknowns_per_node, context.num_threads);
  double distance = first_distance;
  size_t num_inliers = ListInliers(*graph).size();
  for (const double sigma : kSigmas) {
    for (int i = 0; i < 8; ++i) {
      context.CheckInterrupted();
      const std::optional<double> displacement =
          TakeStep(sigma, num_unknowns_per_node, &equations, graph);
      if (!displacement) return false;
      // This criterion usually ends the loop. The displacement is in standard
      // deviations of positions.
      if (*displacement <= 1e-3) break;
    }
    distance = DistanceQuantile(*graph, kQuantile);
    const size_t num_before =
        std::exchange(num_inliers, ListInliers(*graph).size());
    if (distance <= kMaxDistance && num_inliers <= num_before) break;
  }
  return distance < first_distance;
}

void WriteBack(const PoseGraph& graph, const Scene& scene,
               Reconstruction* model) {
  for (const Node& node : graph.nodes) {
    auto& pose = model->rig_from_world[node.frame_idx];
    pose = Rigid3::FromRotationAndCenter(
        (pose->rotation * node.rotation.conjugate()).normalized(), node.center);
  }
  for (Point3D& point : model->points) {
    Vector3d sum = Vector3d::Zero();
    int count = 0;
    for (const Observation& o : point.track) {
      const auto idx = graph.node_of_frame[scene.images[o.image_idx].frame_idx];
      if (!idx) continue;
      const Node& node = graph.nodes[*idx];
      sum +=
          node.center + node.Transform(point.point_in_world - node.old_center);
      ++count;
    }
    if (count > 0) point.point_in_world = sum / count;
  }
}

ModelDeformation Summarize(const PoseGraph& graph) {
  ModelDeformation deformation;
  for (const Node& node : graph.nodes) {
    deformation.max_shift =
        std::max(deformation.max_shift, (node.center - node.old_center).norm());
    deformation.max_rotation_deg = std::max(
        deformation.max_rotation_deg,
        RadToDeg(AngleBetween(node.rotation, Quaterniond::Identity())));
  }
  return deformation;
}

// Scale does not drift in a rig that sees the scene from several centers.
bool ScaleDrifts(const Reconstruction& model, bool is_metric) {
  return !is_metric &&
         AllOf(model.sensor_from_rig, [](const std::optional<Rigid3>& pose) {
           return !pose || pose->translation.isZero(0.0);
         });
}

}  // namespace

std::optional<ModelDeformation> DeformToPriors(const DeformationInput& input,
                                               const Context& context,
                                               PositionPriors* used,
                                               Reconstruction* reconstruction) {
  PoseGraph graph;
  AddNodes(input.scene, *reconstruction, &graph);
  AddEdges(input.scene, input.view_graph, input.pair_is_used, &graph);
  AddPositions(input.scene, input.priors, *reconstruction, &graph);
  if (!Deform(ScaleDrifts(*reconstruction, input.is_metric), context, &graph)) {
    return std::nullopt;
  }
  WriteBack(graph, input.scene, reconstruction);
  for (const int image_idx : ListInliers(graph)) {
    used->images[image_idx] = input.priors.images[image_idx];
  }
  return Summarize(graph);
}

}  // namespace mgsfm
