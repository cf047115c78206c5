// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "arrays.h"
#include "base/ranges.h"
#include "bindings.h"
#include "caller.h"
#include "command.h"
#include "mgsfm/base/options_io.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/translation_averaging/translation_averaging.h"
#include "scene/fields_json.h"

namespace mgsfm::python {
namespace {

namespace py = pybind11;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// ------------------------------------------------------------------ input

using RotationsIn = std::vector<std::optional<Quaterniond>>;

// Rows with NaN are nullopt.
RotationsIn ReadRotations(const py::dict& arrays, const char* key,
                          py::ssize_t num_rows) {
  const auto xyzw = GetArray<double>(arrays, key, num_rows, 4);
  RotationsIn rotations(xyzw.shape(0));
  for (py::ssize_t i = 0; i < xyzw.shape(0); ++i) {
    const Quaterniond q = ReadQuaternion(xyzw.data(i, 0));
    if (!q.coeffs().allFinite()) continue;
    if (!(q.norm() > 0.0)) {
      throw Error(std::string(key) + ": row " + std::to_string(i) + " is zero");
    }
    rotations[i] = q.normalized();
  }
  return rotations;
}

void CheckReference(const py::list& sensor_from_rig) {
  const auto pose = sensor_from_rig.empty()
                        ? std::nullopt
                        : ReadOptionalPose(sensor_from_rig[0]);
  if (!pose || pose->translation != Vector3d::Zero() ||
      !pose->rotation.isApprox(Quaterniond::Identity())) {
    throw Error(
        "sensor_from_rig: the first sensor is the reference; its pose must be "
        "the identity");
  }
}

// A rig without images. Its first sensor is the reference. Intrinsics play no
// part: the stages see rotations and directions only.
Scene MakeRigScene(const py::list& sensor_from_rig) {
  CheckReference(sensor_from_rig);
  Scene scene;
  scene.cameras.push_back(
      {CameraId(1), CameraModelId::kPinhole, 2, 2, {1.0, 1.0, 1.0, 1.0}, true});
  Rig rig{RigId(1), 0, {}};
  for (size_t s = 0; s < sensor_from_rig.size(); ++s) {
    rig.sensor_idxs.push_back(static_cast<int>(s));
    scene.sensors.push_back(
        {std::to_string(s), 0, 0, ReadOptionalPose(sensor_from_rig[s])});
  }
  scene.rigs.push_back(std::move(rig));
  return scene;
}

void AddImage(int frame_idx, int sensor_idx, Scene* scene) {
  const auto image_idx = static_cast<int>(scene->images.size());
  const std::string name = std::to_string(image_idx);
  if (frame_idx < 0 || sensor_idx < 0 ||
      sensor_idx >= static_cast<int>(scene->sensors.size())) {
    throw Error("image " + name + " has a frame or sensor out of range");
  }
  while (frame_idx >= static_cast<int>(scene->frames.size())) {
    const size_t next = scene->frames.size();
    scene->frames.push_back(
        {FrameId(static_cast<uint32_t>(next)), std::to_string(next), 0, {}});
  }
  Frame& frame = scene->frames[frame_idx];
  for (const int other_idx : frame.image_idxs) {
    if (scene->images[other_idx].sensor_idx == sensor_idx) {
      throw Error("images " + std::to_string(other_idx) + " and " + name +
                  " have the same frame and sensor");
    }
  }
  frame.image_idxs.push_back(image_idx);
  Image image{ImageId(static_cast<uint32_t>(image_idx)), name, 0, 0, 0, {}};
  image.sensor_idx = sensor_idx;
  image.frame_idx = frame_idx;
  scene->images.push_back(std::move(image));
}

// The view graph of the caller. Pairs are sorted; pair i of the caller is
// pairs[position[i]].
struct OwnGraph {
  Scene scene;
  ViewGraph view_graph;
  std::vector<size_t> position;
};

// The pair with the smaller index first, as ImagePair requires.
ImagePair MakePair(int image_idx1, int image_idx2,
                   const Quaterniond& cam2_from_cam1,
                   const Vector3d& translation) {
  ImagePair pair;
  Rigid3 pose{cam2_from_cam1, translation};
  if (image_idx1 > image_idx2) {
    std::swap(image_idx1, image_idx2);
    pose = pose.Inverse();
  }
  pair.image_idx1 = image_idx1;
  pair.image_idx2 = image_idx2;
  pair.relative_pose = RelativePose{pose.rotation, std::nullopt};
  const double length = pose.translation.norm();
  if (length > 0.0) {  // false for NaN, too
    pair.relative_pose->translation_direction = pose.translation / length;
  }
  return pair;
}

void CheckPairs(const std::vector<ImagePair>& sorted, size_t num_images) {
  for (size_t i = 0; i < sorted.size(); ++i) {
    const ImagePair& pair = sorted[i];
    const std::string name = "pair (" + std::to_string(pair.image_idx1) + ", " +
                             std::to_string(pair.image_idx2) + ")";
    if (pair.image_idx1 < 0 || pair.image_idx1 == pair.image_idx2 ||
        pair.image_idx2 >= static_cast<int>(num_images)) {
      throw Error(name + " is not of two images");
    }
    if (i > 0 && pair.image_idx1 == sorted[i - 1].image_idx1 &&
        pair.image_idx2 == sorted[i - 1].image_idx2) {
      throw Error(name + " is given twice");
    }
  }
}

void AddPairs(const py::dict& graph, OwnGraph* own) {
  const auto pairs = GetArray<int>(graph, "pairs", -1, 2);
  const py::ssize_t num_pairs = pairs.shape(0);
  const RotationsIn rotations = ReadRotations(graph, "rotations", num_pairs);
  const auto translations =
      GetArray<double>(graph, "translations", num_pairs, 3);
  const auto num_matches = GetArray<int>(graph, "num_matches", num_pairs);

  std::vector<ImagePair> unsorted;
  for (py::ssize_t i = 0; i < num_pairs; ++i) {
    if (!rotations[i]) {
      throw Error("rotations: row " + std::to_string(i) + " is not finite");
    }
    unsorted.push_back(MakePair(pairs.at(i, 0), pairs.at(i, 1), *rotations[i],
                                Vector3d(translations.data(i, 0))));
    // Rotation averaging reads their number alone.
    unsorted.back().matches.resize(std::max(0, num_matches.at(i)));
  }
  std::vector<size_t> order = Indices<size_t>(unsorted.size());
  const auto key = [&](size_t i) {
    return std::pair(unsorted[i].image_idx1, unsorted[i].image_idx2);
  };
  SortBy(&order, key);
  own->position.resize(order.size());
  for (size_t k = 0; k < order.size(); ++k) {
    own->position[order[k]] = k;
    own->view_graph.pairs.push_back(std::move(unsorted[order[k]]));
  }
  CheckPairs(own->view_graph.pairs, own->scene.images.size());
}

// `graph` has the keys frame_idxs, sensor_idxs, pairs, rotations, translations,
// num_matches; see pymgsfm.ViewGraph.
OwnGraph ReadGraph(const py::dict& graph, const py::list& sensor_from_rig) {
  OwnGraph own;
  own.scene = MakeRigScene(sensor_from_rig);
  const auto frame_idxs = GetArray<int>(graph, "frame_idxs", -1);
  const py::ssize_t num_images = frame_idxs.shape(0);
  const auto sensor_idxs = GetArray<int>(graph, "sensor_idxs", num_images);
  for (py::ssize_t i = 0; i < num_images; ++i) {
    AddImage(frame_idxs.at(i), sensor_idxs.at(i), &own.scene);
  }
  AddPairs(graph, &own);
  return own;
}

using NamedText = std::pair<std::string, std::string>;

template <class Options>
Options ReadOptions(const std::vector<NamedText>& values, Context* context) {
  AllOptions<Options> options;
  const OptionList list = ListOptions(&options);
  SetNamedOptions(list, values);
  CheckOptions(list);
  *context = ApplyCommonOptions(options.common, std::move(*context));
  return options.command;
}

// ------------------------------------------------------------------ output

// NaN rows where there is no value.
template <class Value>
py::array_t<double> ToRows(const std::vector<std::optional<Value>>& values,
                           int num_columns) {
  std::vector<double> rows;
  for (const std::optional<Value>& value : values) {
    if (value) {
      Append(*value, &rows);
    } else {
      rows.insert(rows.end(), num_columns, kNaN);
    }
  }
  return MakeArray(std::move(rows), num_columns);
}

// The values of a summary as in the report.
template <class Summary>
py::object ToPython(const Scene& scene, const Summary& summary) {
  return py::module_::import("json").attr("loads")(
      JsonFields(scene).ToJson(summary).dump());
}

py::dict AverageOwnRotations(const py::dict& graph,
                             const py::list& sensor_from_rig,
                             const std::vector<NamedText>& values,
                             const py::object& log,
                             const py::object& progress) {
  const OwnGraph own = ReadGraph(graph, sensor_from_rig);
  Caller caller(log, progress);
  const RotationResult rotations = caller.Run([&](Context context) {
    const auto options =
        ReadOptions<RotationAveragingOptions>(values, &context);
    const Mask pair_is_used(own.view_graph.pairs.size(), true);
    return AverageRotations({own.scene, own.view_graph, pair_is_used}, options,
                            context);
  });
  const RotationEstimate& estimate = rotations.estimate;
  std::vector<uint8_t> pair_is_inlier;
  for (const size_t k : own.position) {
    pair_is_inlier.push_back(estimate.pair_is_inlier[k]);
  }
  std::vector<int> components =
      Transformed(estimate.component,
                  [](const auto& component) { return component.value_or(-1); });
  py::dict result;
  result["rig_from_world"] = ToRows(estimate.rig_from_world, 4);
  result["sensor_from_rig"] = ToRows(estimate.sensor_from_rig, 4);
  result["pair_is_inlier"] = MakeArray(std::move(pair_is_inlier));
  result["components"] = MakeArray(std::move(components));
  result["sensors"] = ToPython(own.scene, rotations.summary.sensors);
  result["summary"] = ToPython(own.scene, rotations.summary);
  return result;
}

// Rotations as AverageOwnRotations returns them, of one component.
RotationEstimate ReadEstimate(const py::dict& rotations, const OwnGraph& own) {
  const int component = rotations["component"].cast<int>();
  const auto num_frames = static_cast<py::ssize_t>(own.scene.frames.size());
  RotationEstimate estimate;
  estimate.rig_from_world =
      ReadRotations(rotations, "rig_from_world", num_frames);
  estimate.sensor_from_rig =
      ReadRotations(rotations, "sensor_from_rig",
                    static_cast<py::ssize_t>(own.scene.sensors.size()));
  const auto components = GetArray<int>(rotations, "components", num_frames);
  estimate.component.resize(num_frames);
  for (py::ssize_t f = 0; f < num_frames; ++f) {
    if (components.at(f) == component) {
      estimate.component[f] = 0;
    } else {
      estimate.rig_from_world[f] = std::nullopt;
    }
  }
  const auto is_inlier =
      GetArray<uint8_t>(rotations, "pair_is_inlier",
                        static_cast<py::ssize_t>(own.position.size()));
  estimate.pair_is_inlier = Mask(own.position.size(), false);
  for (size_t i = 0; i < own.position.size(); ++i) {
    const ImagePair& pair = own.view_graph.pairs[own.position[i]];
    estimate.pair_is_inlier[own.position[i]] =
        is_inlier.at(static_cast<py::ssize_t>(i)) != 0 &&
        estimate.CamFromWorld(own.scene, pair.image_idx1) &&
        estimate.CamFromWorld(own.scene, pair.image_idx2);
  }
  return estimate;
}

py::dict AverageOwnTranslations(const py::dict& graph,
                                const py::list& sensor_from_rig,
                                const py::dict& rotations,
                                const std::vector<NamedText>& values,
                                const py::object& log,
                                const py::object& progress) {
  OwnGraph own = ReadGraph(graph, sensor_from_rig);
  for (ImagePair& pair : own.view_graph.pairs) pair.matches.clear();
  const RotationEstimate estimate = ReadEstimate(rotations, own);
  Bearings bearings;
  bearings.images.resize(own.scene.images.size());
  Caller caller(log, progress);
  const TranslationResult positions = caller.Run([&](Context context) {
    const auto options =
        ReadOptions<TranslationAveragingOptions>(values, &context);
    return AverageTranslations(
        {own.scene, bearings, own.view_graph, estimate, /*tracks=*/{}}, options,
        context);
  });
  py::dict result;
  result["centers"] = ToRows(positions.estimate.frame_center_in_world, 3);
  result["sensor_from_rig"] =
      ToRows(positions.estimate.sensor_from_rig_translation, 3);
  result["is_metric"] = positions.summary.is_metric;
  result["sensors"] = ToPython(own.scene, positions.summary.sensors);
  result["summary"] = ToPython(own.scene, positions.summary);
  return result;
}

}  // namespace

void BindStages(py::module_* module) {
  module->def("average_rotations", &AverageOwnRotations, py::arg("graph"),
              py::arg("sensor_from_rig"), py::arg("values"), py::arg("log"),
              py::arg("progress"));
  module->def("average_translations", &AverageOwnTranslations, py::arg("graph"),
              py::arg("sensor_from_rig"), py::arg("rotations"),
              py::arg("values"), py::arg("log"), py::arg("progress"));
}

}  // namespace mgsfm::python
