// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/rig_scores.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "bundle_adjustment/point_filters.h"
#include "bundle_adjustment/problem_builder.h"
#include "bundle_adjustment/solve.h"
#include "geometry/so3.h"
#include "rig_solver/image_poses.h"
#include "rig_solver/pose_covariances.h"
#include "rig_solver/residuals.h"
#include "rig_solver/rig_equations.h"
#include "soft_rig/deviations.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr int kColumns = RigScores::kNumColumns;

// Sums over rows are contiguous.
using Rows =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// The derivatives of one observation, weighted by the loss.
struct Linearized {
  int frame = 0;
  int first_column = -1;  // of its sensor
  double weight = 0.0;    // rho'
  Vector2d residual;
  Eigen::Matrix<double, 2, 3> point;
  Eigen::Matrix<double, 2, 6> of_frame;
  Eigen::Matrix<double, 2, kColumns> of_sensor;
  int focal_column = -1;  // of its camera
  Vector2d of_focal;
  int readout_column = -1;  // of its sensor
  Vector2d of_readout;
};

struct ScoreColumns {
  // The first one; -1: none.
  std::vector<int> of_sensor, of_camera, of_readout;
  std::vector<PoseMask> masks;  // per sensor that has columns
  int count = 0;
};

// Sums over the points of a part; of symmetric matrices, the lower triangle.
struct Sums {
  Sums(int num_unknowns, int num_columns, int num_blocks)
      : rhs(Rows::Zero(num_unknowns, num_columns + 1)),
        noise(Rows::Zero(num_columns, num_columns)),
        noise_of_points(noise),
        scores(MatrixXd::Zero(num_columns, num_blocks)),
        information(num_blocks, noise),
        shift(3, num_columns + 1),
        of_observation(num_columns),
        of_point(num_columns) {}

  Rows rhs, noise, noise_of_points;
  MatrixXd scores;
  std::vector<Rows> information;  // per block
  double weight = 0.0, squared_weight = 0.0;

  // The current point: its observations, the derivatives of their residuals
  // with respect to the columns (two rows each, with the residuals in the last
  // column), its motion, and its scores.
  std::vector<Linearized> observations;
  std::vector<double> derivatives;
  Rows shift;
  VectorXd of_observation, of_point;
};

Vector2d PrincipalPoint(const Camera& camera) {
  const auto& idxs = InfoOf(camera.model).principal_point_idxs;
  return {camera.params[idxs[0]], camera.params[idxs[1]]};
}

class ScoreBuilder {
 public:
  ScoreBuilder(const Scene& scene, const TimedRig& rig,
               const BuiltProblem& built, const ScoreColumns& columns,
               const Context& context)
      : scene_(scene),
        rig_(rig),
        built_(built),
        columns_(columns),
        context_(context),
        equations_(built.problem, {}, context),
        num_columns_(columns.count) {
    ComputeImagePoses(built_.problem, built_.state, &poses_);
  }

  bool Build(RigScores* result);

 private:
  bool Linearize(size_t observation, const Vector3d& point,
                 const RobustLoss& loss, Linearized* result) const;
  void LinearizeColumns(const PixelObservation& observation, const Vector3d& y,
                        const Eigen::Matrix<double, 2, 3>& J,
                        Linearized* result) const;
  void LinearizePoint(size_t point,
                      std::vector<Linearized>* observations) const;
  Eigen::Map<Rows> SetRows(Sums* sums) const;
  // Calls add(sums) for the observations of each point, and merges the sums.
  template <class Add>
  Sums Sum(const Sums& zero, const Add& add) const;
  // Calls function(row of derivatives, unknown of the frame, derivative of the
  // residual with respect to it).
  template <class Function>
  void ForEachFrameDerivative(const std::vector<Linearized>& observations,
                              const Function& function) const;
  void AddRhs(Sums* sums) const;
  void AddScores(Sums* sums) const;
  int FirstRow(int block) const {
    return equations_.structure().block_first[block];
  }

  const Scene& scene_;
  const TimedRig& rig_;
  const BuiltProblem& built_;
  const ScoreColumns& columns_;
  const Context& context_;
  RigEquations<PixelResidual> equations_;
  const int num_columns_;
  std::vector<ImagePose> poses_;
  Rows solution_;  // of the frames
};

bool ScoreBuilder::Linearize(size_t observation, const Vector3d& point,
                             const RobustLoss& loss, Linearized* result) const {
  const BundleProblem& problem = built_.problem;
  const PixelObservation& o = problem.observations[observation];
  const RigProblemBase::Image& image = problem.images[o.image];
  const ImagePose& pose = poses_[o.image];
  const Eigen::Map<const RowMajor3> R(pose.cam_from_world);
  const Eigen::Map<const RowMajor3> S(pose.sensor_from_frame);
  const Vector3d y = R * (point - Eigen::Map<const Vector3d>(pose.center));
  const Vector3d x = y + Eigen::Map<const Vector3d>(pose.translation);
  double P[6];
  if (!PixelResidual::Linearize(pose, x.data(), o.pixel.data(),
                                result->residual.data(), P, nullptr)) {
    return false;
  }
  result->weight = LossWeight(loss, result->residual.squaredNorm());
  const double root = std::sqrt(result->weight);
  const Eigen::Matrix<double, 2, 3> J =
      root * Eigen::Map<const Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(P);
  result->residual *= root;
  result->frame = image.frame;
  result->point = J * R;
  Eigen::Matrix<double, 2, 6> of_frame;
  of_frame << -J * CrossMatrix(y) * S, -J * R;
  result->of_frame = of_frame * problem.frame_masks[image.frame].asDiagonal();
  LinearizeColumns(o, y, J, result);
  return true;
}

// `y` is the point in the axes of the camera, relative to the center of the
// rig; `J` the derivative of the weighted residual.
void ScoreBuilder::LinearizeColumns(const PixelObservation& o,
                                    const Vector3d& y,
                                    const Eigen::Matrix<double, 2, 3>& J,
                                    Linearized* result) const {
  const int image_idx = built_.image_idxs[o.image];
  const Image& image = scene_.images[image_idx];
  const Camera& camera = rig_.model.cameras[image.camera_idx];
  result->focal_column = columns_.of_camera[image.camera_idx];
  if (result->focal_column >= 0) {
    result->of_focal =
        result->residual +
        std::sqrt(result->weight) *
            (Vector2d(o.pixel[0], o.pixel[1]) - PrincipalPoint(camera));
  }
  const ImagePose& pose = poses_[o.image];
  const Eigen::Map<const RowMajor3> R(pose.cam_from_world);
  const Rigid3& sensor = *rig_.model.sensor_from_rig[image.sensor_idx];
  const PoseVector& rate = rig_.rates[image_idx];
  const Vector2d of_time =
      J * ((sensor.rotation * rate.head<3>()).cross(y) - R * rate.tail<3>());
  result->readout_column = columns_.of_readout[image.sensor_idx];
  if (result->readout_column >= 0) {
    result->of_readout = (o.pixel[1] / camera.height_px - 0.5) * of_time;
  }
  result->first_column = columns_.of_sensor[image.sensor_idx];
  if (result->first_column < 0) return;
  const PoseMask& mask = columns_.masks[result->first_column / kColumns];
  Eigen::Matrix<double, 2, 6> of_pose;
  of_pose << -J * CrossMatrix(y), J;
  result->of_sensor << of_pose * mask.asDiagonal(),
      rig_.estimates_delays ? of_time : Vector2d::Zero();
}

void ScoreBuilder::LinearizePoint(size_t point,
                                  std::vector<Linearized>* observations) const {
  const BundleProblem& problem = built_.problem;
  const size_t begin = problem.point_begin[point];
  const size_t end = problem.point_begin[point + 1];
  const RobustLoss loss = problem.LossOfPoint(end - begin);
  observations->clear();
  for (size_t o = begin; o < end; ++o) {
    Linearized linearized;
    if (Linearize(o, built_.state.points[point], loss, &linearized)) {
      observations->push_back(linearized);
    }
  }
}

template <class Add>
Sums ScoreBuilder::Sum(const Sums& zero, const Add& add) const {
  std::vector<Sums> parts(kNumParts, zero);
  const size_t num_points = built_.problem.num_points();
  ParallelFor(
      kNumParts, context_.num_threads,
      [&](size_t part) {
        const size_t end = num_points * (part + 1) / kNumParts;
        for (size_t p = num_points * part / kNumParts; p < end; ++p) {
          LinearizePoint(p, &parts[part].observations);
          add(&parts[part]);
        }
      },
      1);
  for (size_t part = 1; part < kNumParts; ++part) {
    parts[0].rhs += parts[part].rhs;
    for (size_t b = 0; b < zero.information.size(); ++b) {
      parts[0].information[b] += parts[part].information[b];
    }
    parts[0].scores += parts[part].scores;
    parts[0].noise += parts[part].noise;
    parts[0].noise_of_points += parts[part].noise_of_points;
    parts[0].weight += parts[part].weight;
    parts[0].squared_weight += parts[part].squared_weight;
  }
  return std::move(parts[0]);
}

Eigen::Map<Rows> ScoreBuilder::SetRows(Sums* sums) const {
  const size_t num_rows = 2 * sums->observations.size();
  sums->derivatives.assign(num_rows * (num_columns_ + 1), 0.0);
  Eigen::Map<Rows> e(sums->derivatives.data(),
                     static_cast<Eigen::Index>(num_rows), num_columns_ + 1);
  for (size_t i = 0; i < sums->observations.size(); ++i) {
    const Linearized& o = sums->observations[i];
    auto rows = e.middleRows<2>(2 * i);
    rows.rightCols<1>() = o.residual;
    if (o.first_column >= 0) {
      rows.middleCols<kColumns>(o.first_column) = o.of_sensor;
    }
    if (o.focal_column >= 0) rows.col(o.focal_column) = o.of_focal;
    if (o.readout_column >= 0) rows.col(o.readout_column) = o.of_readout;
  }
  return e;
}

// Removes the part of the derivatives that the motion of the point absorbs.
void RemovePoint(Sums* sums, Eigen::Map<Rows>* e) {
  Matrix3d V = Matrix3d::Zero();
  Rows& shift = sums->shift;
  shift.setZero();
  for (size_t i = 0; i < sums->observations.size(); ++i) {
    const auto& P = sums->observations[i].point;
    V += P.transpose() * P;
    for (int d = 0; d < 2; ++d) {
      for (int k = 0; k < 3; ++k) {
        shift.row(k) += P(d, k) * e->row(2 * i + d);
      }
    }
  }
  V.diagonal() *= 1.0 + kCovarianceDamping;
  const Matrix3d inverse = V.ldlt().solve(Matrix3d::Identity());
  for (size_t i = 0; i < sums->observations.size(); ++i) {
    const Eigen::Matrix<double, 2, 3> of_shift =
        sums->observations[i].point * inverse;
    for (int d = 0; d < 2; ++d) {
      for (int k = 0; k < 3; ++k) {
        e->row(2 * i + d) -= of_shift(d, k) * shift.row(k);
      }
    }
  }
}

// The lower triangle of matrix += x x^T.
template <class Row>
void AddSquare(const Row& x, Rows* matrix) {
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    matrix->row(i).head(i + 1) += x[i] * x.head(i + 1);
  }
}

template <class Function>
void ScoreBuilder::ForEachFrameDerivative(
    const std::vector<Linearized>& observations,
    const Function& function) const {
  const RigStructure& s = equations_.structure();
  for (size_t i = 0; i < observations.size(); ++i) {
    const Linearized& o = observations[i];
    const int block = s.frame_block[o.frame];
    if (block == kNoBlock) continue;
    for (int d = 0; d < 2; ++d) {
      for (int k = 0; k < s.pose_size; ++k) {
        function(2 * i + d, FirstRow(block) + k,
                 o.of_frame(d, 6 - s.pose_size + k));
      }
    }
  }
}

void ScoreBuilder::AddRhs(Sums* sums) const {
  Eigen::Map<Rows> e = SetRows(sums);
  RemovePoint(sums, &e);
  ForEachFrameDerivative(sums->observations,
                         [&](size_t row, int unknown, double derivative) {
                           sums->rhs.row(unknown) += derivative * e.row(row);
                         });
}

void ScoreBuilder::AddScores(Sums* sums) const {
  Eigen::Map<Rows> e = SetRows(sums);
  ForEachFrameDerivative(sums->observations,
                         [&](size_t row, int unknown, double derivative) {
                           e.row(row) -= derivative * solution_.row(unknown);
                         });
  RemovePoint(sums, &e);
  sums->of_point.setZero();
  for (size_t i = 0; i < sums->observations.size(); ++i) {
    const Linearized& o = sums->observations[i];
    const int block = rig_.block_of_frame[built_.frame_idxs[o.frame]];
    sums->of_observation.setZero();
    for (int d = 0; d < 2; ++d) {
      const auto row = e.row(2 * i + d);
      AddSquare(row.head(num_columns_), &sums->information[block]);
      sums->of_observation += row[num_columns_] * row.head(num_columns_);
    }
    sums->scores.col(block) += sums->of_observation;
    sums->of_point += sums->of_observation;
    AddSquare(sums->of_observation, &sums->noise);
    sums->weight += o.weight;
    // The derivative of the Cauchy loss, averaged over both directions.
    sums->squared_weight += o.weight * o.weight;
  }
  AddSquare(sums->of_point, &sums->noise_of_points);
}

bool ScoreBuilder::Build(RigScores* result) {
  const RigStructure& s = equations_.structure();
  if (s.is_iterative || s.num_unknowns == 0) return false;
  equations_.SetState(built_.state);
  if (!equations_.Linearize(kCovarianceDamping) || !equations_.Factorize())
    return false;
  const int num_blocks = 1 + *std::max_element(rig_.block_of_frame.begin(),
                                               rig_.block_of_frame.end());
  const Sums zero(s.num_unknowns, num_columns_, num_blocks);
  MatrixXd solution = Sum(zero, [&](Sums* sums) { AddRhs(sums); }).rhs;
  equations_.SolveColumns(solution, &solution);
  solution_ = solution;
  const Sums sums = Sum(zero, [&](Sums* sums) { AddScores(sums); });
  result->information = MatrixXd::Zero(num_columns_, num_columns_);
  for (const Rows& information : sums.information) {
    result->block_information.emplace_back(
        information.selfadjointView<Eigen::Lower>());
    result->information += result->block_information.back();
  }
  result->noise = sums.noise.selfadjointView<Eigen::Lower>();
  result->noise_of_points =
      sums.noise_of_points.selfadjointView<Eigen::Lower>();
  result->scores = sums.scores;
  result->efficiency = sums.squared_weight / sums.weight;
  result->frame_idxs = built_.frame_idxs;
  for (size_t f = 0; f < built_.frame_idxs.size(); ++f) {
    Eigen::Matrix<double, 6, Eigen::Dynamic> response =
        Eigen::Matrix<double, 6, Eigen::Dynamic>::Zero(6, num_columns_ + 1);
    if (const int block = s.frame_block[f]; block != kNoBlock) {
      response.bottomRows(s.pose_size) =
          -solution_.middleRows(FirstRow(block), s.pose_size);
    }
    result->frame_response.push_back(std::move(response));
  }
  return true;
}

// Errors of known poses would be mistaken for delays: v t is a translation.
BundleAdjustmentOptions RefiningKnownPoses(BundleAdjustmentOptions options) {
  options.refine_sensor_from_rig = RefineMode::kYes;
  return options;
}

ScoreColumns NumberColumns(const Scene& scene, const TimedRig& rig,
                           const BuiltProblem& built, RigGauge gauge,
                           const BundleAdjustmentOptions& options,
                           RigScores* result) {
  const std::vector<int> none(scene.sensors.size(), -1);
  ScoreColumns columns{
      none, std::vector<int>(scene.cameras.size(), -1), none, {}, 0};
  std::vector<bool> is_seen(scene.sensors.size(), false);
  std::vector<bool> has_focal_length(scene.cameras.size(), false);
  for (const int i : built.image_idxs) {
    const Image& image = scene.images[i];
    const CameraModelInfo& model =
        InfoOf(scene.cameras[image.camera_idx].model);
    is_seen[image.sensor_idx] = true;
    has_focal_length[image.camera_idx] = !model.focal_length_idxs.empty();
  }
  for (size_t k = 0; k < is_seen.size(); ++k) {
    const int sensor_idx = static_cast<int>(k);
    if (!is_seen[k] || scene.IsReference(sensor_idx)) continue;
    columns.of_sensor[k] = columns.count;
    columns.count += kColumns;
    columns.masks.push_back(gauge != RigGauge::kFixedScale
                                ? RefineSensor(scene, sensor_idx, options).mask
                                : PoseMask::Ones());
    result->sensor_idxs.push_back(sensor_idx);
  }
  for (size_t c = 0; c < has_focal_length.size(); ++c) {
    const bool has_column = gauge == RigGauge::kFixedScale ||
                            (gauge == RigGauge::kKnownShape &&
                             RefinesFocalLength(scene.cameras[c], options));
    if (!has_column || !has_focal_length[c]) continue;
    columns.of_camera[c] = columns.count++;
    result->camera_idxs.push_back(static_cast<int>(c));
  }
  for (size_t k = 0; k < is_seen.size(); ++k) {
    if (!rig.estimates_readouts || !is_seen[k]) continue;
    columns.of_readout[k] = columns.count++;
    result->readout_sensor_idxs.push_back(static_cast<int>(k));
  }
  return columns;
}

void FixGaugeOfFrames(const Scene& scene, const std::vector<int>& sensor_idxs,
                      RigGauge gauge, BuiltProblem* built) {
  BundleProblem& problem = built->problem;
  const bool is_known = AnyOf(sensor_idxs, [&](int sensor_idx) {
    return scene.sensors[sensor_idx].sensor_from_rig.has_value();
  });
  std::fill(problem.frame_masks.begin(), problem.frame_masks.end(),
            PoseMask::Ones());
  if (is_known && gauge == RigGauge::kKnownPoses) {
    FixGauge(built->state, &problem);
  } else {
    FixGaugeAndScale(built->state, &problem);
  }
}

}  // namespace

KnownColumns FindKnownColumns(const Scene& scene, const RigScores& scores,
                              const Reconstruction& model,
                              const BundleAdjustmentOptions& options) {
  const BundleAdjustmentOptions adjusted = RefiningKnownPoses(options);
  const VectorXd zero = VectorXd::Zero(scores.scores.rows());
  KnownColumns known{zero, zero};
  for (size_t k = 0; k < scores.sensor_idxs.size(); ++k) {
    const int sensor_idx = scores.sensor_idxs[k];
    const RefinedSensor refined = RefineSensor(scene, sensor_idx, adjusted);
    if (!refined.prior) continue;
    PoseVector information;
    information << Vector3d::Constant(1.0 / refined.prior->sigma_rad),
        Vector3d::Constant(1.0 / refined.prior->sigma_length);
    const auto first = static_cast<Eigen::Index>(kColumns * k);
    known.information.segment<6>(first) =
        (scores.sigma_px * information).cwiseAbs2().cwiseProduct(refined.mask);
    known.deviation.segment<6>(first) = UpdateBetween(
        refined.prior->sensor_from_rig, *model.sensor_from_rig[sensor_idx]);
  }
  for (size_t c = 0; c < scores.camera_idxs.size(); ++c) {
    const Camera& camera = scene.cameras[scores.camera_idxs[c]];
    const int focal = InfoOf(camera.model).focal_length_idxs.front();
    const double sigma = camera.has_prior_focal_length
                             ? options.focal_length_prior_sigma
                             : options.focal_length_start_sigma;
    const auto column =
        static_cast<Eigen::Index>(kColumns * scores.sensor_idxs.size() + c);
    known.information[column] = std::pow(scores.sigma_px / sigma, 2);
    known.deviation[column] =
        std::log(model.cameras[scores.camera_idxs[c]].params[focal] /
                 camera.params[focal]);
  }
  return known;
}

std::optional<RigScores> ComputeRigScores(
    const Scene& scene, const TimedRig& rig,
    const BundleAdjustmentOptions& options, const Context& context,
    RigGauge gauge) {
  BundleAdjustmentOptions adjusted =
      rig.estimates_delays ? RefiningKnownPoses(options) : options;
  const double sigma_px =
      KeypointSigmaPx(scene, rig.model, context.num_threads);
  adjusted.loss_scale_px = LossScalePx(options, sigma_px);
  adjusted.refine_principal_point = RefineMode::kNo;
  adjusted.refine_extra_params = RefineMode::kNo;
  BundleAdjustmentOptions held = adjusted;
  held.refine_focal_length = RefineMode::kNo;
  BuiltProblem built = BuildProblem(scene, rig.model, held, RefinedParts::kAll);
  BundleProblem& problem = built.problem;
  problem.sensor_priors.clear();
  std::fill(problem.sensor_masks.begin(), problem.sensor_masks.end(),
            PoseMask::Zero());
  const bool has_priors = gauge != RigGauge::kFixedScale;
  RigScores result;
  const ScoreColumns columns =
      NumberColumns(scene, rig, built, gauge, adjusted, &result);
  if (columns.count == 0) return std::nullopt;
  FixGaugeOfFrames(scene, result.sensor_idxs, gauge, &built);
  ScoreBuilder builder(scene, rig, built, columns, context);
  if (!builder.Build(&result)) return std::nullopt;
  result.sigma_px = sigma_px;
  result.scores_of_priors = VectorXd::Zero(result.scores.rows());
  result.information_of_priors = result.scores_of_priors;
  if (has_priors) {
    const KnownColumns known =
        FindKnownColumns(scene, result, rig.model, adjusted);
    result.information.diagonal() += known.information;
    result.information_of_priors = known.information;
    result.scores_of_priors = known.information.cwiseProduct(known.deviation);
  }
  return result;
}

MatrixXd InvertInformation(MatrixXd information) {
  MatrixXd M = std::move(information);
  VectorXd scale = M.diagonal();
  for (double& s : scale) s = s > 0.0 ? 1.0 / std::sqrt(s) : 1.0;
  M = (scale.asDiagonal() * M * scale.asDiagonal()).eval();
  // Relative to the diagonal of an information matrix.
  M.diagonal().array() += 1e-9;
  return scale.asDiagonal() *
         M.ldlt().solve(MatrixXd::Identity(M.rows(), M.cols())) *
         scale.asDiagonal();
}

VectorXd NewtonStep(const RigScores& scores) {
  return -InvertInformation(scores.information) *
         (scores.scores.rowwise().sum() + scores.scores_of_priors) /
         scores.efficiency;
}

MatrixXd Jackknife(const RigScores& scores) {
  const auto num_blocks = scores.scores.cols();
  MatrixXd covariance =
      MatrixXd::Zero(scores.scores.rows(), scores.scores.rows());
  for (Eigen::Index b = 0; b < num_blocks; ++b) {
    const VectorXd change =
        InvertInformation(scores.information - scores.block_information[b]) *
        scores.scores.col(b) / scores.efficiency;
    covariance += change * change.transpose();
  }
  return covariance * (num_blocks - 1.0) / num_blocks;
}

MatrixXd CovarianceBy(const MatrixXd& noise, const RigScores& scores) {
  const MatrixXd inverse =
      InvertInformation(scores.information) / scores.efficiency;
  return inverse * noise * inverse;
}

// The approximation of Wallace (1959).
bool IsCertain(double t, Eigen::Index num_blocks) {
  const double degrees = static_cast<double>(num_blocks) - 1.0;
  const double z = (8.0 * degrees + 1.0) / (8.0 * degrees + 3.0) *
                   std::sqrt(degrees * std::log1p(t * t / degrees));
  return z > 3.891;
}

void HoldColumn(Eigen::Index column, RigScores* scores) {
  scores->information.row(column).setZero();
  scores->information.col(column).setZero();
  scores->scores.row(column).setZero();
  scores->scores_of_priors[column] = 0.0;
  for (MatrixXd& information : scores->block_information) {
    information.row(column).setZero();
    information.col(column).setZero();
  }
}

}  // namespace mgsfm
