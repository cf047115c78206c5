// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/imported_model.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "exchange/import_formats.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"
#include "scene/intrinsics_check.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

constexpr std::string_view kBlanks = " \t\n\v\f";
constexpr size_t kMaxQuoted = 40;  // half of a line of a terminal

}  // namespace

ImportText::ImportText(const std::filesystem::path& path)
    : path_(path), text_(ReadText(path)) {}

void ImportText::Throw(const std::string& problem) const {
  throw Error("'" + path_.string() + "', line " + std::to_string(line_) + ": " +
              problem);
}

void ImportText::ThrowUnexpected(const char* expected,
                                 std::string_view found) const {
  Throw(std::string("expected ") + expected + ", but " +
        (found.empty() ? "the file ends; it is truncated, export it again"
                       : "found '" + Printable(found.substr(0, kMaxQuoted)) +
                             "'; correct the line, or export the file again"));
}

std::string_view ImportText::Word(const char* expected) {
  const std::string_view text = text_;
  const size_t first =
      std::min(text.find_first_not_of(kBlanks, position_), text.size());
  const std::string_view blanks = text.substr(position_, first - position_);
  line_ += static_cast<int>(std::count(blanks.begin(), blanks.end(), '\n'));
  const size_t end = std::min(text.find_first_of(kBlanks, first), text.size());
  position_ = end;
  if (first == end) ThrowUnexpected(expected, {});
  return text.substr(first, end - first);
}

double ImportText::Number(const char* expected) {
  const std::string_view word = Word(expected);
  const std::optional<double> number = ParseDouble(word);
  if (!number) ThrowUnexpected(expected, word);
  return *number;
}

uint64_t ImportText::Count(const char* expected) {
  const std::string_view word = Word(expected);
  uint64_t count = 0;
  const auto [end, error] =
      std::from_chars(word.data(), word.data() + word.size(), count);
  const bool is_count =
      error == std::errc() && end == word.data() + word.size();
  if (!is_count) ThrowUnexpected(expected, word);
  return count;
}

uint8_t ImportText::Color(const char* expected) {
  const uint64_t value = Count(expected);
  if (value > std::numeric_limits<uint8_t>::max()) {
    ThrowUnexpected(expected, std::to_string(value));
  }
  return static_cast<uint8_t>(value);
}

std::string_view ImportText::RestOfLine() {
  const std::string_view text = text_;
  const size_t end = std::min(text.find('\n', position_), text.size());
  const std::string_view rest = text.substr(position_, end - position_);
  position_ = end;
  return TrimBlanks(rest);
}

std::string_view ImportText::NextLine() {
  while (position_ < text_.size()) {
    if (text_[position_] == '\n') {
      ++position_;
      ++line_;
    }
    const std::string_view line = RestOfLine();
    if (!line.empty()) return line;
  }
  return {};
}

namespace {

namespace fs = std::filesystem;

void ThrowIf(const std::optional<std::string>& problem, const fs::path& path,
             const std::string& element) {
  if (!problem) return;
  throw Error("'" + path.string() + "': " + element + ' ' + *problem +
              "; correct it, or export the model again");
}

void CheckValues(const ImportedModel& imported, const fs::path& path) {
  if (imported.images.empty()) {
    throw Error("'" + path.string() +
                "' has no image with a pose; export a model with images");
  }
  for (const ImportedImage& image : imported.images) {
    const std::string label = "image '" + Printable(image.name) + "'";
    ThrowIf(WhyUnusable(image.name), path, "the name of " + label);
    ThrowIf(WhyImplausible(image.cam_from_world), path, "the pose of " + label);
    ThrowIf(WhyImplausible(image.camera), path, "the camera of " + label);
    const auto problem = FindIntrinsicsProblem(image.camera);
    ThrowIf(problem && problem->is_certain ? std::optional(problem->text)
                                           : std::nullopt,
            path, "the camera of " + label);
  }
  for (size_t i = 0; i < imported.points.size(); ++i) {
    const ImportedPoint& point = imported.points[i];
    const std::string label = "point " + std::to_string(i + 1);
    ThrowIf(WhyImplausible(point.point_in_world), path, label);
    for (const ImportedObservation& o : point.track) {
      ThrowIf(WhyImplausible(o.pixel), path, "an observation of " + label);
    }
  }
}

void AddPoints(const std::vector<ImportedPoint>& points,
               const std::vector<size_t>& position_of_place, Model* model) {
  for (const ImportedPoint& from : points) {
    ModelPoint point;
    point.id = model->points.size() + 1;
    point.point_in_world = from.point_in_world;
    point.color = from.color;
    for (const ImportedObservation& o : from.track) {
      const size_t position = position_of_place[o.image_place];
      std::vector<ModelKeypoint>& keypoints = model->keypoints[position];
      point.track.push_back({model->poses.images[position].id,
                             static_cast<uint32_t>(keypoints.size())});
      keypoints.push_back({o.pixel, point.id});
    }
    model->points.push_back(std::move(point));
  }
}

}  // namespace

Model MakeModel(ImportedModel imported, const fs::path& path) {
  CheckValues(imported, path);
  std::vector<size_t> places = Indices<size_t>(imported.images.size());
  SortBy(
      &places, [&](size_t i) -> const auto& {
        return imported.images[i].name;
      });
  Model model;
  // Cameras are numbered in the order of their images.
  std::map<
      std::tuple<std::string, CameraModelId, int, int, std::vector<double>>,
      CameraId>
      id_of_camera;
  std::vector<size_t> position_of_place(places.size());
  for (size_t position = 0; position < places.size(); ++position) {
    const ImportedImage& image = imported.images[places[position]];
    if (position > 0 && model.poses.images.back().name == image.name) {
      throw Error("'" + path.string() + "' has two images '" + image.name +
                  "'; give each image once");
    }
    position_of_place[places[position]] = position;
    const Camera& camera = image.camera;
    const auto [entry, is_new] = id_of_camera.emplace(
        std::tuple(image.name.substr(0, image.name.rfind('/') + 1),
                   camera.model, camera.width_px, camera.height_px,
                   camera.params),
        CameraId(static_cast<uint32_t>(model.cameras.size()) + 1));
    if (is_new) {
      model.cameras.push_back(camera);
      model.cameras.back().id = entry->second;
    }
    model.poses.images.push_back(
        {ImageId(static_cast<uint32_t>(places[position]) + 1), image.name,
         entry->second, image.cam_from_world});
  }
  model.keypoints.resize(places.size());
  AddPoints(imported.points, position_of_place, &model);
  return model;
}

Camera MakeRadialCamera(double focal_length_px,
                        const Eigen::Vector2d& principal_point_px, double k1,
                        double k2, const Eigen::Vector2i& size_px) {
  Camera camera{
      kUnnumbered,
      CameraModelId::kSimplePinhole,
      size_px.x(),
      size_px.y(),
      {focal_length_px, principal_point_px.x(), principal_point_px.y()}};
  if (k1 != 0.0 || k2 != 0.0) {
    camera.model = CameraModelId::kSimpleRadial;
    camera.params.push_back(k1);
  }
  if (k2 != 0.0) {
    camera.model = CameraModelId::kRadial;
    camera.params.push_back(k2);
  }
  return camera;
}

std::optional<Eigen::Vector2i> FindSizeOfImage(const fs::path& file) {
  const std::optional<ImageSize> size = ReadImageSizeOf(file);
  if (!size) return std::nullopt;
  return Eigen::Vector2i(static_cast<int>(size->width),
                         static_cast<int>(size->height));
}

Eigen::Vector2i ReadSizeOfImage(const fs::path& image_path,
                                const std::string& image_name,
                                const fs::path& path) {
  if (image_path.empty()) {
    throw Error("'" + path.string() + "' lacks the size of image '" +
                Printable(image_name) +
                "'; give the folder of the images (image_path)");
  }
  const fs::path file = image_path / image_name;
  std::error_code ignored;  // of names that are too long
  if (!fs::exists(file, ignored)) {
    throw Error("image '" + Printable(image_name) + "' of '" + path.string() +
                "' is not in the folder '" + image_path.string() +
                "'; give the folder that the names of images start from "
                "(image_path)");
  }
  const auto size = FindSizeOfImage(file);
  if (!size) {
    throw Error("image '" + file.string() +
                "' is damaged or of an unknown format; replace it");
  }
  return *size;
}

namespace {

constexpr ImportFormat kFormats[] = {
    {"nvm", ReadNvm, ".nvm"},
    {"bundler", ReadBundler, ".out"},
    {"nerfstudio", ReadNerfstudio, ".json"},
};

}  // namespace

const ImportFormat* FindImportFormat(const std::string& name) {
  for (const ImportFormat& format : kFormats) {
    if (format.name == ToLower(name)) return &format;
  }
  return nullptr;
}

std::vector<std::string> ImportFormatNames() {
  return Transformed(kFormats, [](const ImportFormat& format) {
    return std::string(format.name);
  });
}

const ImportFormat* GuessImportFormat(const std::filesystem::path& path) {
  const std::string extension = ToLower(path.extension().string());
  for (const ImportFormat& format : kFormats) {
    if (format.extension == extension) return &format;
  }
  return nullptr;
}

}  // namespace mgsfm
