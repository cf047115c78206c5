// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstring>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"
#include "mgsfm/base/ids.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"
#include "mgsfm/tracks/track_establishment.h"
#include "mgsfm/translation_averaging/translation_averaging.h"
#include "mgsfm/view_graph/focal_length_calibration.h"
#include "mgsfm/view_graph/view_graph_estimation.h"
#include "moving_objects/moving_objects.h"
#include "rotation_averaging/rotation_estimation.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {

// The bytes of plain data. A Sink has Write(data, size). Structs list the
// number of their fields below; the compiler rejects a wrong number, so no
// field can be forgotten.

template <class T>
constexpr int kNumFields = 0;  // not a struct of fields

template <>
inline constexpr int kNumFields<Camera> = 6;
template <>
inline constexpr int kNumFields<Sensor> = 4;
template <>
inline constexpr int kNumFields<Rig> = 3;
template <>
inline constexpr int kNumFields<Frame> = 4;
template <>
inline constexpr int kNumFields<Image> = 7;
template <>
inline constexpr int kNumFields<Scene> = 5;
template <>
inline constexpr int kNumFields<Rigid3> = 2;
template <>
inline constexpr int kNumFields<RelativePose> = 2;
template <>
inline constexpr int kNumFields<ImagePair> = 8;
template <>
inline constexpr int kNumFields<ViewGraph> = 1;
template <>
inline constexpr int kNumFields<PositionMeasurement> = 3;
template <>
inline constexpr int kNumFields<PositionPriors> = 3;
template <>
inline constexpr int kNumFields<GravityPriors> = 1;
template <>
inline constexpr int kNumFields<GravitySummary::Outlier> = 2;
template <>
inline constexpr int kNumFields<GravitySummary> = 4;
template <>
inline constexpr int kNumFields<ObservationGroups> = 2;
template <>
inline constexpr int kNumFields<RotationEstimate> = 4;
template <>
inline constexpr int kNumFields<PositionEstimate> = 3;
template <>
inline constexpr int kNumFields<Point3D> = 4;
template <>
inline constexpr int kNumFields<Reconstruction> = 5;
template <>
inline constexpr int kNumFields<RigMotion> = 2;
template <>
inline constexpr int kNumFields<SolveSummary> = 5;
template <>
inline constexpr int kNumFields<StageTime> = 4;
template <>
inline constexpr int kNumFields<FocalLengthEstimate> = 6;
template <>
inline constexpr int kNumFields<FocalLengthResult> = 2;
template <>
inline constexpr int kNumFields<ViewGraphSummary> = 9;
template <>
inline constexpr int kNumFields<ViewGraphResult> = 2;
template <>
inline constexpr int kNumFields<SensorRotationSummary> = 4;
template <>
inline constexpr int kNumFields<RotationSummary> = 11;
template <>
inline constexpr int kNumFields<TrackSummary> = 5;
template <>
inline constexpr int kNumFields<TrackResult> = 2;
template <>
inline constexpr int kNumFields<SensorTranslationSummary> = 3;
template <>
inline constexpr int kNumFields<TranslationSummary> = 15;
template <>
inline constexpr int kNumFields<BundleRound> = 6;
template <>
inline constexpr int kNumFields<DroppedFrame> = 2;
template <>
inline constexpr int kNumFields<BundleSummary> = 6;
template <>
inline constexpr int kNumFields<EstimatedRotations> = 4;
template <>
inline constexpr int kNumFields<MotionOfScene> = 5;
template <>
inline constexpr int kNumFields<PositionResult> = 5;

// Calls function(field) for each field of a struct.
template <class T, class Function>
void ForEachField(T& t, const Function& function) {
  const auto each = [&](auto&... fields) { (function(fields), ...); };
  constexpr int n = kNumFields<std::remove_const_t<T>>;
  if constexpr (n == 1) {
    auto& [a] = t;
    each(a);
  } else if constexpr (n == 2) {
    auto& [a, b] = t;
    each(a, b);
  } else if constexpr (n == 3) {
    auto& [a, b, c] = t;
    each(a, b, c);
  } else if constexpr (n == 4) {
    auto& [a, b, c, d] = t;
    each(a, b, c, d);
  } else if constexpr (n == 5) {
    auto& [a, b, c, d, e] = t;
    each(a, b, c, d, e);
  } else if constexpr (n == 6) {
    auto& [a, b, c, d, e, f] = t;
    each(a, b, c, d, e, f);
  } else if constexpr (n == 7) {
    auto& [a, b, c, d, e, f, g] = t;
    each(a, b, c, d, e, f, g);
  } else if constexpr (n == 8) {
    auto& [a, b, c, d, e, f, g, h] = t;
    each(a, b, c, d, e, f, g, h);
  } else if constexpr (n == 9) {
    auto& [a, b, c, d, e, f, g, h, i] = t;
    each(a, b, c, d, e, f, g, h, i);
  } else if constexpr (n == 11) {
    auto& [a, b, c, d, e, f, g, h, i, j, k] = t;
    each(a, b, c, d, e, f, g, h, i, j, k);
  } else {
    static_assert(n == 15, "list the number of fields of the struct");
    auto& [a, b, c, d, e, f, g, h, i, j, k, l, m, o, p] = t;
    each(a, b, c, d, e, f, g, h, i, j, k, l, m, o, p);
  }
}

// Vectors of these are one block of bytes.
template <class T>
constexpr bool kIsRaw =
    std::is_arithmetic_v<T> || std::is_enum_v<T> || std::is_same_v<T, Match> ||
    std::is_same_v<T, Observation> || std::is_same_v<T, Eigen::Vector2f> ||
    std::is_same_v<T, Eigen::Vector3d>;

template <class Sink, class T>
void WriteTo(Sink* sink, const T& value);

template <class Sink, class T>
void WriteItems(Sink* sink, const std::vector<T>& items) {
  WriteTo(sink, static_cast<uint64_t>(items.size()));
  if constexpr (kIsRaw<T>) {
    sink->Write(items.data(), items.size() * sizeof(T));
  } else {
    for (const T& item : items) WriteTo(sink, item);
  }
}
template <class Sink, class T>
void WriteValue(Sink* sink, const std::vector<T>& items) {
  WriteItems(sink, items);
}
template <class Sink>
void WriteValue(Sink* sink, const std::string& text) {
  WriteTo(sink, static_cast<uint64_t>(text.size()));
  sink->Write(text.data(), text.size());
}
template <class Sink>
void WriteValue(Sink* sink, const Mask& mask) {
  std::vector<uint8_t> flags;
  for (const bool flag : mask) flags.push_back(flag ? 1 : 0);
  WriteItems(sink, flags);
}
template <class Sink, class T>
void WriteValue(Sink* sink, const std::optional<T>& value) {
  WriteTo(sink, static_cast<uint8_t>(value ? 1 : 0));
  if (value) WriteTo(sink, *value);
}
template <class Sink, class Tag>
void WriteValue(Sink* sink, const Id<Tag>& id) {
  WriteTo(sink, id.value());
}
template <class Sink, class Scalar, int kRows, int kColumns>
void WriteValue(Sink* sink,
                const Eigen::Matrix<Scalar, kRows, kColumns>& matrix) {
  sink->Write(matrix.data(), sizeof(Scalar) * kRows * kColumns);
}
template <class Sink>
void WriteValue(Sink* sink, const Eigen::Quaterniond& q) {
  sink->Write(q.coeffs().data(), 4 * sizeof(double));
}
template <class Sink, class T>
std::enable_if_t<kIsRaw<T>> WriteValue(Sink* sink, const T& value) {
  sink->Write(&value, sizeof(T));
}
template <class Sink, class T>
std::enable_if_t<(kNumFields<T> > 0)> WriteValue(Sink* sink, const T& value) {
  ForEachField(value, [&](const auto& field) { WriteTo(sink, field); });
}

template <class Sink, class T>
void WriteTo(Sink* sink, const T& value) {
  WriteValue(sink, value);
}

class StringSink {
 public:
  void Write(const void* data, size_t size) {
    content.append(static_cast<const char*>(data), size);
  }
  std::string content;
};

}  // namespace mgsfm
