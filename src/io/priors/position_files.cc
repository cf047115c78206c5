// SPDX-License-Identifier: BSD-3-Clause
#include "priors/position_files.h"

#include <algorithm>
#include <filesystem>
#include <string_view>

#include "base/format.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/models/trajectory_io.h"
#include "scene/item_lists.h"

namespace mgsfm {

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
    const auto split = SplitNamedWords(lines.line(), 3);
    if (!split) lines.Throw("expected 'image_name " + columns + "'");
    const std::string& name = split->name;
    NamedVector vector;
    vector.line_number = lines.number();
    for (int k = 0; k < 3; ++k) vector.value[k] = lines.Number(split->words[k]);
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

template <class Sample>
double MaxGapSeconds(const std::vector<Sample>& samples) {
  std::vector<double> intervals_s;
  for (size_t i = 1; i < samples.size(); ++i) {
    intervals_s.push_back(samples[i].timestamp_s - samples[i - 1].timestamp_s);
  }
  if (intervals_s.empty()) return 0.0;
  return kMaxGapRatio * Median(std::move(intervals_s));
}

// A time between two samples, as the share of the second.
template <class Sample>
struct Between {
  const Sample* before;
  const Sample* after;
  double share;
};

// nullopt outside the samples and in their gaps.
template <class Sample>
std::optional<Between<Sample>> FindBetween(const std::vector<Sample>& samples,
                                           double max_gap_s, double time_s) {
  const auto after = std::lower_bound(
      samples.begin(), samples.end(), time_s,
      [](const Sample& sample, double t) { return sample.timestamp_s < t; });
  if (after == samples.end()) return std::nullopt;
  if (after->timestamp_s == time_s) return {{&*after, &*after, 0.0}};
  if (after == samples.begin()) return std::nullopt;
  const auto before = std::prev(after);
  const double gap_s = after->timestamp_s - before->timestamp_s;
  if (gap_s > max_gap_s) return std::nullopt;
  return {{&*before, &*after, (time_s - before->timestamp_s) / gap_s}};
}

Rigid3 Interpolate(const Between<TimedPose>& place) {
  const Rigid3& before = place.before->cam_from_world;
  const Rigid3& after = place.after->cam_from_world;
  return Rigid3::FromRotationAndCenter(
      before.rotation.slerp(place.share, after.rotation),
      (1.0 - place.share) * before.Center() + place.share * after.Center());
}

TimedVector Interpolate(const Between<TimedVector>& place) {
  const TimedVector& before = *place.before;
  const TimedVector& after = *place.after;
  TimedVector vector;
  vector.value = (1.0 - place.share) * before.value + place.share * after.value;
  if (before.covariance && after.covariance) {
    vector.covariance = (1.0 - place.share) * *before.covariance +
                        place.share * *after.covariance;
  }
  return vector;
}

// Calls `use` with each frame, its main image and its place in the samples.
template <class Sample, class Use>
void ForEachFrame(const Scene& scene, const std::string& path,
                  const std::vector<Sample>& samples, double clock_offset_s,
                  const Use& use) {
  const double max_gap_s = MaxGapSeconds(samples);
  bool has_any = false;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const int image_idx = MainImage(scene, scene.frames[i]);
    const double time_s =
        TimeOf(scene.images[image_idx], path) + clock_offset_s;
    const auto place = FindBetween(samples, max_gap_s, time_s);
    if (!place) continue;
    has_any = true;
    use(static_cast<int>(i), image_idx, *place);
  }
  if (has_any) return;
  const std::string times =
      samples.empty()
          ? ""
          : Formatted(", which are %.3f to %.3f s", samples.front().timestamp_s,
                      samples.back().timestamp_s);
  throw Error("'" + path + "' has no value at the time of any image" + times +
              "; give both on one clock, for instance with "
              "image_timestamps_path or prior_clock_offset_s");
}

Poses PosesByTime(const Scene& scene, const std::string& path,
                  const std::vector<TimedPose>& poses, double clock_offset_s) {
  Poses of_frames;
  ForEachFrame(scene, path, poses, clock_offset_s,
               [&](int frame_idx, int /*image_idx*/, const auto& place) {
                 of_frames.emplace_back(frame_idx, Interpolate(place));
               });
  return of_frames;
}

bool IsEurocLine(std::string_view line) {
  const std::vector<std::string> fields = SplitFields(line, ',');
  // Its times are whole nanoseconds.
  return fields.size() >= 8 &&
         fields[0].find_first_not_of("0123456789") == std::string::npos &&
         std::all_of(fields.begin(), fields.end(), [](const auto& field) {
           return ParseDouble(field).has_value();
         });
}

}  // namespace

PositionFileFormat DetectPositionFormat(const std::string& path) {
  TextLines lines(path, "'" + path + "' (ref_images_path)");
  if (lines.NextContent()) {
    const auto numbers = ParseNumbers(lines.line());
    const size_t num_numbers = numbers ? numbers->size() : 0;
    if (num_numbers == 12) return PositionFileFormat::kKitti;
    if (num_numbers == 8) return PositionFileFormat::kTum;
    if (IsEurocLine(lines.line())) return PositionFileFormat::kEuroc;
  }
  if (std::filesystem::path(path).extension() == ".csv") {
    return PositionFileFormat::kCsv;
  }
  return PositionFileFormat::kNamed;
}

Poses ReadTrajectoryPoses(const Scene& scene, const std::string& path,
                          PositionFileFormat format, double clock_offset_s) {
  if (format == PositionFileFormat::kKitti) return PosesByFrame(scene, path);
  const bool is_tum = format == PositionFileFormat::kTum;
  MGSFM_CHECK(is_tum || format == PositionFileFormat::kEuroc);
  return PosesByTime(scene, path,
                     is_tum ? ReadTumPoses(path) : ReadEurocPoses(path),
                     clock_offset_s);
}

std::vector<std::pair<int, TimedVector>> InterpolateVectors(
    const Scene& scene, const std::string& path,
    const std::vector<TimedVector>& vectors, double clock_offset_s) {
  std::vector<std::pair<int, TimedVector>> of_images;
  ForEachFrame(scene, path, vectors, clock_offset_s,
               [&](int /*frame_idx*/, int image_idx, const auto& place) {
                 of_images.emplace_back(image_idx, Interpolate(place));
               });
  return of_images;
}

std::vector<std::pair<int, Eigen::Vector3d>> ReadTrajectoryPositions(
    const Scene& scene, const std::string& path, PositionFileFormat format,
    double clock_offset_s) {
  std::vector<std::pair<int, Eigen::Vector3d>> positions;
  for (const auto& [frame_idx, pose] :
       ReadTrajectoryPoses(scene, path, format, clock_offset_s)) {
    positions.emplace_back(MainImage(scene, scene.frames[frame_idx]),
                           pose.Center());
  }
  return positions;
}

}  // namespace mgsfm
