// SPDX-License-Identifier: BSD-3-Clause
#include "priors/position_files.h"

#include <algorithm>
#include <map>
#include <optional>
#include <string_view>

#include "base/text.h"
#include "base/text_lines.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/models/trajectory_io.h"
#include "rigs/image_times.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

// Returns the name, which may have blanks, and sets the three numbers after it.
std::string SplitLine(const TextLines& lines, const std::string& columns,
                      Eigen::Vector3d* value) {
  const auto split = SplitNamedWords(lines.line(), 3);
  if (!split) lines.Throw("expected 'image_name " + columns + "'");
  for (int k = 0; k < 3; ++k) {
    const std::string_view word = split->words[static_cast<size_t>(k)];
    const std::optional<double> number = ParseDouble(word);
    if (!number) {
      lines.Throw("has '" + Printable(word) +
                  "' where a finite number should be; correct it");
    }
    (*value)[k] = *number;
  }
  return split->name;
}

}  // namespace

std::vector<NamedVector> ReadNamedVectors(const Scene& scene,
                                          const std::string& path,
                                          const std::string& columns,
                                          const std::string& option,
                                          UnknownImages others) {
  const auto idx_of_name = IndexByName(scene.images);
  TextLines lines(path, "'" + path + "' (" + option + ")");
  std::vector<NamedVector> vectors;
  Mask is_named(scene.images.size(), false);
  while (lines.NextContent()) {
    NamedVector vector;
    vector.line_number = lines.number();
    const std::string name = SplitLine(lines, columns, &vector.value);
    const auto found = idx_of_name.find(name);
    if (found == idx_of_name.end()) {
      if (others == UnknownImages::kIgnore) continue;
      lines.Throw("names the image '" + name +
                  "', which the database does not have; delete the line, or "
                  "correct the name");
    }
    vector.image_idx = found->second;
    if (is_named[vector.image_idx]) {
      lines.Throw("names '" + name + "' again; delete one of the lines");
    }
    is_named[vector.image_idx] = true;
    vectors.push_back(vector);
  }
  return vectors;
}

namespace {

using Poses = std::vector<std::pair<int, Rigid3>>;

// The largest gap that is interpolated, in median intervals
// (docs/reference/formats.md).
constexpr double kMaxGapRatio = 10.0;

// The image of the reference sensor, or else the first image.
int MainImage(const Scene& scene, const Frame& frame) {
  for (const int image_idx : frame.image_idxs) {
    if (scene.IsReference(scene.images[image_idx].sensor_idx)) return image_idx;
  }
  return frame.image_idxs.front();
}

Poses PosesByFrame(const Scene& scene, const std::string& path) {
  const std::vector<Rigid3> poses = ReadKittiPoses(path);
  if (poses.size() != scene.frames.size()) {
    throw Error("'" + path + "' has " + std::to_string(poses.size()) +
                " poses, but there are " + std::to_string(scene.frames.size()) +
                " frames; give one line of 12 numbers for each frame");
  }
  const std::vector<int> order = OrderOfFrames(scene);
  Poses of_frames;
  for (size_t i = 0; i < order.size(); ++i) {
    of_frames.emplace_back(order[i], poses[i]);
  }
  return of_frames;
}

double TimeOf(const Image& image, const std::string& path) {
  if (image.timestamp_s) return *image.timestamp_s;
  if (const auto time_ns = TimeInName(image.name)) {
    return 1e-9 * static_cast<double>(*time_ns);
  }
  throw Error("'" + path + "' has poses by time, but image '" + image.name +
              "' has no time in its name; set image_timestamps_path");
}

double MedianInterval(const std::vector<TimedPose>& poses) {
  std::vector<double> intervals_s;
  for (size_t i = 1; i < poses.size(); ++i) {
    intervals_s.push_back(poses[i].timestamp_s - poses[i - 1].timestamp_s);
  }
  return Median(std::move(intervals_s));
}

// The pose at a time; nullopt outside the trajectory and in its gaps.
std::optional<Rigid3> Interpolate(const std::vector<TimedPose>& poses,
                                  double max_gap_s, double time_s) {
  const auto after = std::lower_bound(
      poses.begin(), poses.end(), time_s,
      [](const TimedPose& pose, double t) { return pose.timestamp_s < t; });
  if (after == poses.end()) return std::nullopt;
  if (after->timestamp_s == time_s) return after->cam_from_world;
  if (after == poses.begin()) return std::nullopt;
  const auto before = std::prev(after);
  const double gap_s = after->timestamp_s - before->timestamp_s;
  if (gap_s > max_gap_s) return std::nullopt;
  const double share = (time_s - before->timestamp_s) / gap_s;
  return Rigid3::FromRotationAndCenter(
      before->cam_from_world.rotation.slerp(share,
                                            after->cam_from_world.rotation),
      (1.0 - share) * before->cam_from_world.Center() +
          share * after->cam_from_world.Center());
}

Poses PosesByTime(const Scene& scene, const std::string& path,
                  const std::vector<TimedPose>& poses) {
  const double max_gap_s =
      poses.size() < 2 ? 0.0 : kMaxGapRatio * MedianInterval(poses);
  Poses of_frames;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const Image& image = scene.images[MainImage(scene, scene.frames[i])];
    const auto pose = Interpolate(poses, max_gap_s, TimeOf(image, path));
    if (pose) of_frames.emplace_back(static_cast<int>(i), *pose);
  }
  if (of_frames.empty()) {
    throw Error("'" + path +
                "' has no pose at the time of any image; give both on one "
                "clock, for instance with image_timestamps_path");
  }
  return of_frames;
}

}  // namespace

PositionFileFormat DetectPositionFormat(const std::string& path) {
  TextLines lines(path, "'" + path + "' (ref_images_path)");
  if (lines.NextContent()) {
    const auto numbers = ParseNumbers(lines.line());
    const size_t num_numbers = numbers ? numbers->size() : 0;
    if (num_numbers == 12) return PositionFileFormat::kKitti;
    if (num_numbers == 8) return PositionFileFormat::kTum;
  }
  return PositionFileFormat::kNamed;
}

Poses ReadTrajectoryPoses(const Scene& scene, const std::string& path,
                          PositionFileFormat format) {
  MGSFM_CHECK(format != PositionFileFormat::kNamed);
  if (format == PositionFileFormat::kKitti) return PosesByFrame(scene, path);
  return PosesByTime(scene, path,
                     format == PositionFileFormat::kTum ? ReadTumPoses(path)
                                                        : ReadEurocPoses(path));
}

std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format) {
  std::vector<std::pair<int, Eigen::Vector3d>> positions;
  for (const auto& [frame_idx, pose] :
       ReadTrajectoryPoses(scene, path, format)) {
    positions.emplace_back(MainImage(scene, scene.frames[frame_idx]),
                           pose.Center());
  }
  return positions;
}

}  // namespace mgsfm
