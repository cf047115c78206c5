// SPDX-License-Identifier: BSD-3-Clause
#include "priors/pose_graph_deformation.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "geometry/so3.h"
#include "math/robust_loss.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "priors/position_registration.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Vector7d = Eigen::Matrix<double, 7, 1>;

// Of three quarters of the positions, some of which are outliers: without these
// it would be 2.03.
constexpr double kShare = 0.75;
constexpr double kMaxDistance = 3.0;
// Of the loss, which must not take a stretch that drifted for outliers.
constexpr double kMinLossScale = 2.8;
constexpr double kMedianFactor = 2.0;
constexpr double kSigmas[] = {DegToRad(0.01), DegToRad(0.04), DegToRad(0.16),
                              DegToRad(0.64)};
constexpr int kMaxNumSteps = 8;
constexpr double kStepTolerance = 1e-3;  // standard deviations
constexpr double kMinRelativeLength = 0.1;
constexpr double kDamping = 1e-9;

// What a frame carries along.
struct Node {
  int frame_idx = 0;
  Vector3d old_center;
  Vector3d center;
  Quaterniond turn = Quaterniond::Identity();
  double log_scale = 0.0;

  Vector3d Move(const Vector3d& offset) const {
    return std::exp(log_scale) * (turn * offset);
  }
};

struct Link {
  int node1 = 0;
  int node2 = 0;
  Vector3d offset;
  double length = 1.0;
};

struct Position {
  int image_idx = 0;
  int node = 0;
  Vector3d offset;  // of the camera from the frame, before
  Vector3d measured;
  Matrix3d sqrt_information;
};

class ModelBender {
 public:
  ModelBender(const Scene& scene, const ViewGraph& view_graph,
              const Mask& pair_is_used, const PositionPriors& priors,
              bool scale_drifts, const Context& context,
              const Reconstruction& model)
      : num_unknowns_per_node_(scale_drifts ? 7 : 6),
        context_(context),
        solver_(context.num_threads) {
    AddNodes(scene, model);
    AddLinks(scene, view_graph, pair_is_used);
    AddPositions(scene, priors, model);
  }

  // False if the model needs not, or cannot, be bent.
  bool Bend();

  // Images whose position the model agrees with.
  std::vector<int> ListInliers() const;
  void WriteBack(const Scene& scene, Reconstruction* model) const;
  ModelDeformation Describe() const;

 private:
  void AddNodes(const Scene& scene, const Reconstruction& model);
  void AddLinks(const Scene& scene, const ViewGraph& view_graph,
                const Mask& pair_is_used);
  void AddPositions(const Scene& scene, const PositionPriors& priors,
                    const Reconstruction& model);
  // The length of the longest move in standard deviations of the positions;
  // negative if the equations could not be solved.
  double Step(double sigma);
  void AddLinkTerms(double sigma);
  void AddPositionTerms();
  bool Solve(Eigen::VectorXd* step);
  template <int kRows>
  void AddTerm(const std::array<int, 2>& nodes,
               const Eigen::Matrix<double, kRows, 14>& jacobian,
               const Eigen::Matrix<double, kRows, 1>& residual);

  Vector3d Residual(const Position& position) const {
    const Node& node = nodes_[position.node];
    return position.sqrt_information *
           (node.center + node.Move(position.offset) - position.measured);
  }
  double Distance(const Position& position) const {
    return Residual(position).norm();
  }
  // That so large a share of the positions does not exceed.
  double DistanceOf(double share) const {
    std::vector<double> distances;
    distances.reserve(positions_.size());
    for (const Position& p : positions_) distances.push_back(Distance(p));
    return Quantile(std::move(distances), share);
  }

  const int num_unknowns_per_node_;
  const Context& context_;
  std::vector<int> node_of_frame_;
  std::vector<Node> nodes_;
  std::vector<Link> links_;
  std::vector<Position> positions_;
  double typical_sigma_ = 1.0;

  std::vector<Eigen::Triplet<double>> triplets_;
  Eigen::VectorXd gradient_;
  SparseCholesky solver_;
  bool is_analyzed_ = false;
};

void ModelBender::AddNodes(const Scene& scene, const Reconstruction& model) {
  node_of_frame_.assign(scene.frames.size(), -1);
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    if (!model.rig_from_world[f]) continue;
    node_of_frame_[f] = static_cast<int>(nodes_.size());
    Node node;
    node.frame_idx = static_cast<int>(f);
    node.old_center = node.center = model.rig_from_world[f]->Center();
    nodes_.push_back(node);
  }
}

void ModelBender::AddLinks(const Scene& scene, const ViewGraph& view_graph,
                           const Mask& pair_is_used) {
  std::set<std::pair<int, int>> linked;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (!pair_is_used[i]) continue;
    const ImagePair& pair = view_graph.pairs[i];
    const int node1 = node_of_frame_[scene.images[pair.image_idx1].frame_idx];
    const int node2 = node_of_frame_[scene.images[pair.image_idx2].frame_idx];
    if (node1 < 0 || node2 < 0 || node1 == node2) continue;
    linked.insert(std::minmax(node1, node2));
  }
  std::vector<double> lengths;
  for (const auto& [node1, node2] : linked) {
    Link link{node1, node2, nodes_[node2].old_center - nodes_[node1].old_center,
              0.0};
    link.length = link.offset.norm();
    lengths.push_back(link.length);
    links_.push_back(link);
  }
  if (links_.empty()) return;
  const double median = Median(std::move(lengths));
  for (Link& link : links_) {
    link.length = std::max(link.length, kMinRelativeLength * median);
  }
}

void ModelBender::AddPositions(const Scene& scene, const PositionPriors& priors,
                               const Reconstruction& model) {
  std::vector<double> sigmas;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const auto pose = model.CamFromWorld(scene, image_idx);
    if (!pose || !priors.images[i]) continue;
    const PositionMeasurement& prior = *priors.images[i];
    const int node = node_of_frame_[scene.images[i].frame_idx];
    positions_.push_back(
        {image_idx, node, pose->Center() - nodes_[node].old_center,
         prior.position,
         prior.covariance.llt().matrixL().solve(Matrix3d::Identity())});
    sigmas.push_back(std::sqrt(prior.covariance.trace() / 3.0));
  }
  if (!sigmas.empty()) typical_sigma_ = Median(std::move(sigmas));
}

bool ModelBender::Bend() {
  if (positions_.empty() || links_.empty()) return false;
  const double first_distance = DistanceOf(kShare);
  if (first_distance <= kMaxDistance) return false;
  double distance = first_distance;
  size_t num_inliers = ListInliers().size();
  for (const double sigma : kSigmas) {
    for (int i = 0; i < kMaxNumSteps; ++i) {
      context_.CheckInterrupted();
      const double move = Step(sigma);
      if (move < 0.0) return false;
      if (move <= kStepTolerance) break;
    }
    distance = DistanceOf(kShare);
    const size_t num_before = std::exchange(num_inliers, ListInliers().size());
    if (distance <= kMaxDistance && num_inliers <= num_before) break;
  }
  return distance < first_distance;
}

// Keeps the entries of both nodes in the lower triangle, zeros included, so
// that all matrices have one pattern.
template <int kRows>
void ModelBender::AddTerm(const std::array<int, 2>& nodes,
                          const Eigen::Matrix<double, kRows, 14>& jacobian,
                          const Eigen::Matrix<double, kRows, 1>& residual) {
  const Eigen::Matrix<double, 14, 14> product = jacobian.transpose() * jacobian;
  const Eigen::Matrix<double, 14, 1> gradient = jacobian.transpose() * residual;
  const int size = num_unknowns_per_node_;
  const auto unknown = [&](int column) {
    const int node = nodes[column / 7];
    return node < 0 || column % 7 >= size ? -1 : size * node + column % 7;
  };
  for (int i = 0; i < 14; ++i) {
    const int row = unknown(i);
    if (row < 0) continue;
    gradient_[row] += gradient[i];
    for (int j = 0; j < 14; ++j) {
      const int column = unknown(j);
      if (column < 0 || column > row) continue;
      triplets_.emplace_back(row, column, product(i, j));
    }
  }
}

// Columns of a node: its centre, its turn (Q <- Exp(w) Q), its scale.
void ModelBender::AddLinkTerms(double sigma) {
  for (const Link& link : links_) {
    const Node& a = nodes_[link.node1];
    const Node& b = nodes_[link.node2];
    const Vector3d by_a = a.Move(link.offset), by_b = b.Move(link.offset);
    const Vector3d turn = LogSO3(a.turn.conjugate() * b.turn);
    Vector7d residual;
    residual << (b.center - a.center - 0.5 * (by_a + by_b)) / link.length, turn,
        b.log_scale - a.log_scale;
    Eigen::Matrix<double, 7, 14> J = Eigen::Matrix<double, 7, 14>::Zero();
    const double inverse = 1.0 / link.length;
    J.block<3, 3>(0, 0) = -inverse * Matrix3d::Identity();
    J.block<3, 3>(0, 7) = inverse * Matrix3d::Identity();
    J.block<3, 3>(0, 3) = 0.5 * inverse * CrossMatrix(by_a);
    J.block<3, 3>(0, 10) = 0.5 * inverse * CrossMatrix(by_b);
    J.block<3, 1>(0, 6) = -0.5 * inverse * by_a;
    J.block<3, 1>(0, 13) = -0.5 * inverse * by_b;
    J.block<3, 3>(3, 10) =
        InverseRightJacobianSO3(turn) * b.turn.conjugate().toRotationMatrix();
    J.block<3, 3>(3, 3) = -J.block<3, 3>(3, 10);
    J(6, 6) = -1.0;
    J(6, 13) = 1.0;
    AddTerm<7>({link.node1, link.node2}, J / sigma, residual / sigma);
  }
}

void ModelBender::AddPositionTerms() {
  const RobustLoss loss = {
      RobustLossType::kCauchy,
      std::max(kMinLossScale, kMedianFactor * DistanceOf(0.5))};
  for (const Position& position : positions_) {
    const Node& node = nodes_[position.node];
    const Vector3d offset = node.Move(position.offset);
    const Vector3d residual = Residual(position);
    const double weight = std::sqrt(loss.Weight(residual.squaredNorm()));
    Eigen::Matrix<double, 3, 14> J = Eigen::Matrix<double, 3, 14>::Zero();
    J.block<3, 3>(0, 0) = position.sqrt_information;
    J.block<3, 3>(0, 3) = -position.sqrt_information * CrossMatrix(offset);
    J.block<3, 1>(0, 6) = position.sqrt_information * offset;
    AddTerm<3>({position.node, -1}, weight * J, weight * residual);
  }
}

bool ModelBender::Solve(Eigen::VectorXd* step) {
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
  if (!solver_.Factorize(matrix)) return false;
  step->resize(size);
  solver_.Solve(-gradient_, *step);
  return step->allFinite();
}

double ModelBender::Step(double sigma) {
  const int size = num_unknowns_per_node_;
  triplets_.clear();
  gradient_.setZero(size * static_cast<Eigen::Index>(nodes_.size()));
  AddLinkTerms(sigma);
  AddPositionTerms();
  Eigen::VectorXd step;
  if (!Solve(&step)) return -1.0;
  double longest = 0.0;
  for (size_t i = 0; i < nodes_.size(); ++i) {
    const auto part = step.segment(size * static_cast<Eigen::Index>(i), size);
    Node& node = nodes_[i];
    node.center += part.head<3>();
    node.turn = (ExpSO3(part.segment<3>(3)) * node.turn).normalized();
    if (size == 7) node.log_scale += part[6];
    longest = std::max(longest, part.head<3>().norm());
  }
  return longest / typical_sigma_;
}

void ModelBender::WriteBack(const Scene& scene, Reconstruction* model) const {
  for (const Node& node : nodes_) {
    auto& pose = model->rig_from_world[node.frame_idx];
    pose = Rigid3::FromRotationAndCenter(
        (pose->rotation * node.turn.conjugate()).normalized(), node.center);
  }
  for (Point3D& point : model->points) {
    Vector3d sum = Vector3d::Zero();
    int count = 0;
    for (const Observation& o : point.track) {
      const int idx = node_of_frame_[scene.images[o.image_idx].frame_idx];
      if (idx < 0) continue;
      const Node& node = nodes_[idx];
      sum += node.center + node.Move(point.point_in_world - node.old_center);
      ++count;
    }
    if (count > 0) point.point_in_world = sum / count;
  }
}

std::vector<int> ModelBender::ListInliers() const {
  const double bound = OutlierBound(DistanceOf(0.5));
  std::vector<int> image_idxs;
  for (const Position& position : positions_) {
    if (Distance(position) <= bound) image_idxs.push_back(position.image_idx);
  }
  return image_idxs;
}

ModelDeformation ModelBender::Describe() const {
  ModelDeformation deformation;
  for (const Node& node : nodes_) {
    deformation.max_shift =
        std::max(deformation.max_shift, (node.center - node.old_center).norm());
    deformation.max_rotation_deg =
        std::max(deformation.max_rotation_deg,
                 RadToDeg(AngleBetween(node.turn, Quaterniond::Identity())));
  }
  return deformation;
}

// Lengths in a rig that is seen at once do not drift.
bool ScaleDrifts(const Reconstruction& model, bool is_metric) {
  return !is_metric &&
         std::all_of(model.sensor_from_rig.begin(), model.sensor_from_rig.end(),
                     [](const std::optional<Rigid3>& pose) {
                       return !pose || pose->translation.isZero(0.0);
                     });
}

}  // namespace

std::optional<ModelDeformation> DeformToPriors(
    const Scene& scene, const ViewGraph& view_graph, const Mask& pair_is_used,
    const PositionPriors& priors, bool is_metric, const Context& context,
    PositionPriors* used, Reconstruction* reconstruction) {
  ModelBender bender(scene, view_graph, pair_is_used, priors,
                     ScaleDrifts(*reconstruction, is_metric), context,
                     *reconstruction);
  if (!bender.Bend()) return std::nullopt;
  bender.WriteBack(scene, reconstruction);
  for (const int image_idx : bender.ListInliers()) {
    used->images[image_idx] = priors.images[image_idx];
  }
  return bender.Describe();
}

}  // namespace mgsfm
