// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "base/fingerprint.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "report_page/encoding.h"
#include "report_page/page_selection.h"
#include "report_page/sections.h"

namespace mgsfm {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;
using Json = nlohmann::ordered_json;

// Frames of more images are thinned out, which bounds the size of the page.
constexpr size_t kMaxImages = 60000;
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

// Frames and images of the page, which may be fewer than those of the scene.
struct ShownImages {
  size_t frame_step = 1;
  std::vector<int> frame_idxs;
  std::vector<int> image_idxs;
  std::vector<std::optional<uint32_t>> shown_of_image;
};

ShownImages SelectImages(const Scene& scene) {
  ShownImages shown;
  shown.frame_step =
      std::max<size_t>(1, (scene.images.size() + kMaxImages - 1) / kMaxImages);
  shown.shown_of_image.resize(scene.images.size());
  for (size_t i = 0; i < scene.frames.size(); i += shown.frame_step) {
    shown.frame_idxs.push_back(static_cast<int>(i));
    for (const int image_idx : scene.frames[i].image_idxs) {
      shown.shown_of_image[image_idx] =
          static_cast<uint32_t>(shown.image_idxs.size());
      shown.image_idxs.push_back(image_idx);
    }
  }
  return shown;
}

Json ToJson(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

void Append(const Vector3d& v, std::vector<float>* values) {
  for (int i = 0; i < 3; ++i) values->push_back(static_cast<float>(v[i]));
}

void AppendNone(std::vector<float>* values) {
  values->insert(values->end(), 3, kNone);
}

// The mean direction that is up in upright images, as these mostly are.
Vector3d UpInWorld(const Scene& scene, const Projector& projector) {
  Vector3d up = Vector3d::Zero();
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto& pose = projector.CamFromWorld(static_cast<int>(i));
    if (pose) up -= pose->rotation.conjugate() * Vector3d::UnitY();
  }
  return up.norm() > 1e-6 ? Vector3d(up.normalized()) : Vector3d(0, -1, 0);
}

// Tangents of the angles to the left, upper, right and lower edge, bounded so
// that wide fields of view can be drawn as a pyramid.
Json ViewTangents(const Camera& camera) {
  constexpr double kMax = 1.2;  // a field of view of 100 degrees
  const auto tangent = [&](const Eigen::Vector2d& pixel) {
    const auto ray = RayFromPixel(camera.model, camera.params.data(), pixel);
    if (!ray || ray->z() <= 0.0) return kMax;
    return std::clamp(ray->head<2>().norm() / ray->z(), 0.05, kMax);
  };
  const auto width_px = static_cast<double>(camera.width_px);
  const auto height_px = static_cast<double>(camera.height_px);
  return {tangent({0.0, 0.5 * height_px}), tangent({0.5 * width_px, 0.0}),
          tangent({width_px, 0.5 * height_px}),
          tangent({0.5 * width_px, height_px})};
}

Json SensorsToJson(const PageModel& model) {
  const Scene& scene = model.input.scene;
  Json sensors = Json::array();
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const Sensor& sensor = scene.sensors[i];
    const Camera& camera =
        model.input.reconstruction.cameras[sensor.camera_idx];
    Json pose = nullptr;
    if (const auto& p = model.input.reconstruction.sensor_from_rig[i]) {
      const Eigen::Quaterniond& q = p->rotation;
      pose = {{"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}},
              {"translation", ToJson(p->translation)}};
    }
    sensors.push_back({{"name", Shorten(sensor.name, 200)},
                       {"width_px", camera.width_px},
                       {"height_px", camera.height_px},
                       {"view_tangents", ViewTangents(camera)},
                       {"sensor_from_rig", pose}});
  }
  return sensors;
}

void AddFrames(const PageModel& model, const ShownImages& shown,
               const Vector3d& origin, ArrayWriter* arrays) {
  std::vector<float> centers;
  std::vector<int16_t> rotations;
  for (const int frame_idx : shown.frame_idxs) {
    const auto& pose = model.input.reconstruction.rig_from_world[frame_idx];
    if (!pose) {
      AppendNone(&centers);
      rotations.insert(rotations.end(), 4, 0);
      continue;
    }
    Append(pose->Center() - origin, &centers);
    const Eigen::Quaterniond q = pose->rotation.conjugate();
    for (const double value : {q.w(), q.x(), q.y(), q.z()}) {
      rotations.push_back(static_cast<int16_t>(std::lround(value * 32767.0)));
    }
  }
  arrays->Add("frame_center", centers);
  arrays->Add("frame_world_from_rig", rotations);
}

void AddImages(const PageModel& model, const ShownImages& shown,
               ArrayWriter* arrays) {
  const Scene& scene = model.input.scene;
  std::vector<uint32_t> frames;
  std::vector<uint32_t> sensors;
  std::vector<uint32_t> num_points;
  std::vector<float> errors_px;
  for (const int image_idx : shown.image_idxs) {
    const Image& image = scene.images[image_idx];
    const ImageStatistics& statistics = model.statistics.images[image_idx];
    frames.push_back(static_cast<uint32_t>(image.frame_idx / shown.frame_step));
    sensors.push_back(static_cast<uint32_t>(image.sensor_idx));
    num_points.push_back(static_cast<uint32_t>(statistics.num_points));
    const auto error_px = statistics.MeanErrorPx();
    errors_px.push_back(error_px ? static_cast<float>(*error_px) : kNone);
  }
  arrays->Add("image_frame", frames);
  arrays->Add("image_sensor", sensors);
  arrays->Add("image_num_points", num_points);
  arrays->Add("image_error_px", errors_px);
}

void AddConfidence(const PageModel& model, const ShownImages& shown,
                   ArrayWriter* arrays) {
  if (model.input.frame_confidence.empty()) return;
  std::vector<float> values;
  for (const int i : shown.frame_idxs) {
    const auto& confidence = model.input.frame_confidence[i];
    values.push_back(confidence ? static_cast<float>(*confidence) : kNone);
  }
  arrays->Add("frame_confidence", values);
}

Json SeamsToJson(const PageModel& model, const ShownImages& shown) {
  std::set<std::pair<size_t, size_t>> pairs;
  for (const auto& [before, after] : SeamPlaces(model)) {
    pairs.emplace(before / shown.frame_step, after / shown.frame_step);
  }
  Json json = Json::array();
  for (const auto& [before, after] : pairs) json.push_back({before, after});
  return json;
}

// Reasons why frames have no pose: a list, and for each frame 0 or one plus an
// index into it.
Json AddReasons(const PageModel& model, const ShownImages& shown,
                ArrayWriter* arrays) {
  std::map<std::string, std::string> reason_of_name;
  for (const Json& frame : GetArray(model.report, "unregistered_frames")) {
    reason_of_name[GetText(frame, "name")] = GetText(frame, "reason");
  }
  std::map<std::string, uint8_t> number_of_reason;
  Json reasons = Json::array();
  std::vector<uint8_t> numbers;
  for (const int frame_idx : shown.frame_idxs) {
    const auto found =
        reason_of_name.find(model.input.scene.frames[frame_idx].name);
    numbers.push_back(0);
    if (found == reason_of_name.end()) continue;
    const size_t next = reasons.size() < 255 ? reasons.size() + 1 : 0;
    const auto [known, is_new] =
        number_of_reason.emplace(found->second, static_cast<uint8_t>(next));
    if (is_new && next > 0) reasons.push_back(Shorten(found->second, 300));
    numbers.back() = known->second;
  }
  arrays->Add("frame_reason", numbers);
  return reasons;
}

// The centers of frames in other poses, in the world of the model, and the
// errors of the alignment.
void AddComparison(const PageModel& model, const PoseComparison& comparison,
                   bool other_is_world, const ShownImages& shown,
                   const Vector3d& origin, const std::string& name,
                   ArrayWriter* arrays) {
  const auto& world_from_model = comparison.evaluation.world_from_model;
  if (!world_from_model) return;
  std::map<std::string, const ImagePoses*> poses_of_name;
  for (const ImagePoses& image : comparison.images) {
    poses_of_name[image.name] = &image;
  }
  std::vector<float> centers, position_errors, rotation_errors_deg;
  for (const int frame_idx : shown.frame_idxs) {
    const ImagePoses* poses = nullptr;
    for (const int i : model.input.scene.frames[frame_idx].image_idxs) {
      const auto found = poses_of_name.find(model.input.scene.images[i].name);
      if (found == poses_of_name.end()) continue;
      if (!poses || found->second->is_reference) poses = found->second;
    }
    if (!poses || (!other_is_world && !poses->cam_from_model)) {
      AppendNone(&centers);
    } else if (other_is_world) {
      Append(
          world_from_model->Inverse() * poses->cam_from_world.Center() - origin,
          &centers);
    } else {
      Append(*world_from_model * poses->cam_from_model->Center() - origin,
             &centers);
    }
    float position = kNone, rotation_deg = kNone;
    if (poses && poses->cam_from_model) {
      const Rigid3 aligned =
          TransformWorld(*world_from_model, *poses->cam_from_model);
      const Rigid3& world = poses->cam_from_world;
      position = static_cast<float>((aligned.Center() - world.Center()).norm());
      rotation_deg = static_cast<float>(
          RadToDeg(AngleBetween(aligned.rotation, world.rotation)));
    }
    position_errors.push_back(position);
    rotation_errors_deg.push_back(rotation_deg);
  }
  arrays->Add(name + "_center", centers);
  arrays->Add(name + "_position_error", position_errors);
  arrays->Add(name + "_rotation_error_deg", rotation_errors_deg);
}

// The points selected[begin] to selected[end - 1], with 21 bits per coordinate
// as fractions of the box.
void AddPoints(const PageModel& model, const std::vector<size_t>& selected,
               size_t begin, size_t end, const AlignedBox3d& box,
               ArrayWriter* arrays) {
  constexpr double kMax = (1 << 21) - 1;
  std::vector<uint32_t> positions;
  std::vector<uint8_t> colors, errors, lengths;
  const Vector3d sizes = box.sizes().cwiseMax(1e-300);
  for (size_t k = begin; k < end; ++k) {
    const Point3D& point = model.input.reconstruction.points[selected[k]];
    const Vector3d share =
        (point.point_in_world - box.min()).cwiseQuotient(sizes);
    uint64_t bits = 0;
    for (int axis = 2; axis >= 0; --axis) {
      bits = (bits << 21) |
             static_cast<uint64_t>(std::llround(share[axis] * kMax));
    }
    positions.push_back(static_cast<uint32_t>(bits));
    positions.push_back(static_cast<uint32_t>(bits >> 32));
    for (int c = 0; c < 3; ++c) colors.push_back(point.color[c]);
    const double error = 32.0 * point.error_px.value_or(0.0);
    errors.push_back(static_cast<uint8_t>(std::min(error, 255.0)));
    lengths.push_back(
        static_cast<uint8_t>(std::min<size_t>(point.track.size(), 255)));
  }
  arrays->Add("point_position", positions);
  arrays->Add("point_color", colors);
  arrays->Add("point_error", errors);
  arrays->Add("point_length", lengths);
}

void AppendVarint(uint64_t value, std::vector<uint8_t>* bytes) {
  for (; value >= 0x80; value >>= 7) {
    bytes->push_back(static_cast<uint8_t>(value | 0x80));
  }
  bytes->push_back(static_cast<uint8_t>(value));
}

// The observations of one point: their number, then for each the step of the
// image index, the place in the image in 1/255 of its size, and the error in
// 1/32 px, 255 if it is larger or unknown.
void AppendTrack(const PageModel& model, const ShownImages& shown,
                 const Point3D& point, std::vector<uint8_t>* bytes) {
  std::vector<std::pair<uint32_t, Observation>> track;
  for (const Observation& observation : point.track) {
    const auto& image = shown.shown_of_image[observation.image_idx];
    if (image) track.emplace_back(*image, observation);
  }
  std::sort(track.begin(), track.end());
  AppendVarint(track.size(), bytes);
  uint32_t last = 0;
  for (const auto& [shown_idx, observation] : track) {
    AppendVarint(shown_idx - last, bytes);
    last = shown_idx;
    const Image& image = model.input.scene.images[observation.image_idx];
    const Camera& camera = model.input.scene.cameras[image.camera_idx];
    const auto& keypoint_px = image.keypoints_px[observation.keypoint_idx];
    const auto share = [](double position, int size) {
      return static_cast<uint8_t>(
          std::clamp(255.0 * position / std::max(size, 1), 0.0, 255.0));
    };
    bytes->push_back(share(keypoint_px.x(), camera.width_px));
    bytes->push_back(share(keypoint_px.y(), camera.height_px));
    const auto residual_px =
        model.projector.ResidualPx(observation, point.point_in_world);
    const double error = residual_px ? 32.0 * residual_px->norm() : 255.0;
    bytes->push_back(static_cast<uint8_t>(std::min(error, 255.0)));
  }
}

// The tracks of the first points, as many as fit.
void AddTracks(const PageModel& model, const ShownImages& shown,
               const std::vector<size_t>& selected, size_t num_points,
               size_t max_bytes, ArrayWriter* arrays) {
  std::vector<uint8_t> bytes;
  uint32_t num_tracks = 0;
  for (size_t k = 0; k < num_points; ++k) {
    const size_t size = bytes.size();
    AppendTrack(model, shown, model.input.reconstruction.points[selected[k]],
                &bytes);
    if (bytes.size() > max_bytes) {
      bytes.resize(size);
      break;
    }
    ++num_tracks;
  }
  arrays->Add("num_tracks", std::vector<uint32_t>{num_tracks});
  arrays->Add("tracks", bytes);
}

void AddThumbnails(const std::vector<Thumbnail>& thumbnails,
                   const ShownImages& shown, ArrayWriter* arrays) {
  std::vector<uint32_t> images, sizes;
  std::vector<uint8_t> bytes;
  for (const Thumbnail& thumbnail : thumbnails) {
    const auto& image = shown.shown_of_image[thumbnail.image_idx];
    if (!image) continue;
    images.push_back(*image);
    sizes.push_back(static_cast<uint32_t>(thumbnail.jpeg.size()));
    bytes.insert(bytes.end(), thumbnail.jpeg.begin(), thumbnail.jpeg.end());
  }
  arrays->Add("thumbnail_image", images);
  arrays->Add("thumbnail_size", sizes);
  arrays->Add("thumbnail_jpeg", bytes);
}

// Writes the points from selected[begin] on into files that call
// mgsfmSidePoints() in web/src/side_points.js. `id` tells to which page they
// belong. Returns the entry of the header.
Json WriteSideFiles(const PageModel& model, const std::vector<size_t>& selected,
                    size_t begin, const AlignedBox3d& box,
                    const std::string& id, const ReportPageOptions& options,
                    const Context& context) {
  // About 9 MB in base64, which a browser parses at once.
  constexpr size_t kPointsPerFile = 500'000;
  Json names = Json::array();
  for (; begin < selected.size(); begin += kPointsPerFile) {
    context.CheckInterrupted();
    ArrayWriter arrays;
    AddPoints(model, selected, begin,
              std::min(begin + kPointsPerFile, selected.size()), box, &arrays);
    const Json header = {
        {"id", id}, {"index", names.size()}, {"arrays", arrays.directory()}};
    const std::string name = options.side_file_stem + ".points" +
                             std::to_string(names.size() + 1) + ".js";
    options.write_side_file(name, "mgsfmSidePoints(" + ToScriptJson(header) +
                                      ",\"" + ToBase64(arrays.bytes()) +
                                      "\");\n");
    names.push_back(name);
  }
  return {{"id", id}, {"names", names}, {"num_points", selected.size()}};
}

Json ShownNames(const Scene& scene, const ShownImages& shown,
                size_t max_bytes) {
  std::vector<std::string> names;
  for (const int i : shown.image_idxs) names.push_back(scene.images[i].name);
  return FrontCode(names, max_bytes);
}

// The parts that every page has: poses, names and statistics.
Json AddFixedParts(const PageModel& model, const ShownImages& shown,
                   const AlignedBox3d& box, size_t max_bytes,
                   ArrayWriter* arrays) {
  const Scene& scene = model.input.scene;
  const Vector3d origin = box.center();
  AddFrames(model, shown, origin, arrays);
  AddImages(model, shown, arrays);
  AddConfidence(model, shown, arrays);
  const std::vector<std::string> frame_names = Transformed(
      shown.frame_idxs, [&](int i) { return scene.frames[i].name; });
  Json header = {{"title", Shorten(model.input.title, 500)},
                 {"origin", ToJson(origin)},
                 {"box_min", ToJson(box.min() - origin)},
                 {"box_size", ToJson(box.sizes())},
                 {"up", ToJson(UpInWorld(scene, model.projector))},
                 {"unit", LengthUnit(model)},
                 {"north", nullptr},
                 {"image_url", nullptr},
                 {"num_points", model.input.reconstruction.points.size()},
                 {"frame_step", shown.frame_step},
                 {"sensors", SensorsToJson(model)},
                 {"frame_names", FrontCode(frame_names, max_bytes / 12)},
                 {"image_names", ShownNames(scene, shown, max_bytes / 6)},
                 {"reasons", AddReasons(model, shown, arrays)},
                 {"seams", SeamsToJson(model, shown)},
                 {"truth", nullptr},
                 {"other", nullptr}};
  if (model.input.is_east_north_up) header["north"] = {0.0, 1.0, 0.0};
  if (!model.input.image_url.empty()) {
    header["image_url"] = model.input.image_url;
  }
  if (model.input.truth) {
    AddComparison(model, *model.input.truth, true, shown, origin, "truth",
                  arrays);
    header["truth"] = {{"label", model.input.truth->label}};
  }
  if (model.input.positions) {
    AddComparison(model, *model.input.positions, false, shown, origin,
                  "measured", arrays);
  }
  if (model.input.other) {
    AddComparison(model, *model.input.other, false, shown, origin, "other",
                  arrays);
    header["other"] = {{"label", model.input.other->label}};
  }
  return header;
}

}  // namespace

SceneData MakeSceneData(const PageModel& model,
                        const ReportPageOptions& options,
                        const Context& context) {
  const Scene& scene = model.input.scene;
  const Reconstruction& reconstruction = model.input.reconstruction;
  const ShownImages shown = SelectImages(scene);
  const AlignedBox3d box = ShownBox(reconstruction);
  ArrayWriter arrays;
  Json header = AddFixedParts(model, shown, box, options.max_bytes, &arrays);
  const size_t num_fixed_bytes =
      ToScriptJson(header).size() + Base64Size(arrays.bytes().size());
  // Base64 needs 4 characters for 3 bytes.
  const auto max_bytes = static_cast<double>(options.max_bytes);
  const double num_left =
      0.74 * (max_bytes - std::min<double>(max_bytes, num_fixed_bytes));
  // Chosen by eye. Their sum of 0.99 leaves room for the directory of arrays.
  constexpr double kPointShare = 0.35, kTrackShare = 0.35,
                   kThumbnailShare = 0.29;
  // Position 8, color 3, error 1, length of the track 1.
  constexpr size_t kBytesPerPoint = 13;
  const auto share = [&](double part) {
    return static_cast<size_t>(part * num_left);
  };
  const size_t max_points = share(kPointShare) / kBytesPerPoint;
  const std::vector<size_t> selected = SelectPoints(
      reconstruction, box,
      options.write_side_file ? reconstruction.points.size() : max_points);
  const size_t num_points = std::min(max_points, selected.size());
  AddPoints(model, selected, 0, num_points, box, &arrays);
  AddTracks(model, shown, selected, num_points, share(kTrackShare), &arrays);
  AddThumbnails(MakeThumbnails(scene, model.input.image_path,
                               share(kThumbnailShare), context),
                shown, &arrays);
  const bool has_side_files = num_points < selected.size();
  if (has_side_files) {
    header["side_points"] = WriteSideFiles(
        model, selected, num_points, box,
        Fingerprint().Add(arrays.bytes()).ToString(), options, context);
  }
  header["arrays"] = arrays.directory();
  return {ToScriptJson(header), ToBase64(arrays.bytes()), has_side_files};
}

}  // namespace mgsfm
