// SPDX-License-Identifier: BSD-3-Clause
#include "database/merged_structure.h"

#include <limits>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "database/database_rows.h"
#include "database/sqlite_database.h"
#include "math/union_find.h"

namespace mgsfm {
namespace {

constexpr size_t kNone = std::numeric_limits<size_t>::max();

auto Intrinsics(const Camera& camera) {
  return std::tie(camera.model, camera.width_px, camera.height_px,
                  camera.params, camera.has_prior_focal_length);
}

std::string DescribeIntrinsics(const Camera& camera) {
  std::string text =
      SizeText(camera.width_px, camera.height_px) + " pixels, parameters";
  for (const double param : camera.params) text += ' ' + std::to_string(param);
  return text;
}

auto Values(const FrameDataRow& data) {
  return std::tie(data.camera_id, data.image_id);
}

// Throws Error for rows that refer to cameras or rigs that do not exist.
void CheckReferences(const StructureInput& input) {
  std::set<CameraId> cameras;
  std::set<RigId> rigs;
  for (const Camera& camera : input.contents.cameras) cameras.insert(camera.id);
  const auto fail = [&](const std::string& problem) {
    ThrowDatabaseError(input.path, problem + kConfigureAgain);
  };
  const auto check_camera = [&](const std::string& name, CameraId id) {
    if (cameras.count(id) > 0) return;
    fail(name + " has the camera " + std::to_string(id.value()) +
         ", which does not exist");
  };
  for (const RigRow& rig : input.contents.rigs) {
    rigs.insert(rig.id);
    const std::string name = "rig " + std::to_string(rig.id.value());
    if (!rig.ref_camera_id)
      fail(name + " has a reference that is not a camera");
    check_camera(name, *rig.ref_camera_id);
    for (const RigSensorRow& sensor : rig.sensors) {
      check_camera(name, sensor.camera_id);
    }
  }
  for (const FrameRow& frame : input.contents.frames) {
    const std::string name = "frame " + std::to_string(frame.id.value());
    if (rigs.count(frame.rig_id) == 0) {
      fail(name + " has the rig " + std::to_string(frame.rig_id.value()) +
           ", which does not exist");
    }
    for (const FrameDataRow& data : frame.data) {
      check_camera(name, data.camera_id);
    }
  }
}

std::string NameIn(const StructureInput& input, const std::string& name) {
  return input.prefix + name;
}

// The images of all inputs, without their cameras.
MergedStructure MergeImages(const std::vector<StructureInput>& inputs) {
  MergedStructure merged;
  std::vector<std::string> names;
  for (size_t i = 0; i < inputs.size(); ++i) {
    for (const ImageRow& image : inputs[i].contents.images) {
      names.push_back(NameIn(inputs[i], image.name));
    }
  }
  const size_t num_before = names.size();
  SortUnique(&names);
  merged.has_common_images = names.size() < num_before;
  for (size_t i = 0; i < inputs.size(); ++i) {
    auto& positions = merged.image_positions.emplace_back();
    for (const ImageRow& image : inputs[i].contents.images) {
      const auto found = std::lower_bound(names.begin(), names.end(),
                                          NameIn(inputs[i], image.name));
      positions.emplace(image.id.value(), found - names.begin());
    }
  }
  for (std::string& name : names) {
    const ImageId id(static_cast<uint32_t>(merged.images.size()) + 1);
    merged.images.push_back({id, std::move(name), CameraId(0), {}});
  }
  return merged;
}

// New ids of the cameras of each input.
using CameraIds = std::vector<std::map<CameraId, CameraId>>;

// Cameras that two inputs share, numbered by their first images.
class CameraMerger {
 public:
  // Both arguments must outlive this object.
  CameraMerger(const std::vector<StructureInput>& inputs,
               MergedStructure* merged)
      : inputs_(inputs), merged_(*merged), camera_ids_(inputs.size()) {}

  // Adds the cameras of all inputs and images; returns the new ids by input.
  CameraIds Merge();

 private:
  // A camera of one input and its known properties.
  struct CameraNode {
    size_t input = 0;
    const Camera* camera = nullptr;
    std::string image_name;      // one of its images, for messages
    size_t first_image = kNone;  // positions in the result
    // The same for the images that frames assign to it.
    size_t first_in_frame = kNone;
  };

  std::map<CameraId, size_t> AddNodes(size_t input);
  void JoinNodes(size_t input, const std::map<CameraId, size_t>& node_of_id);
  void Join(size_t node, const std::string& key) {
    const auto [other, is_new] = node_of_key_.emplace(key, node);
    if (!is_new) sets_->Union(node, other->second);
  }
  void CheckEqual(const CameraNode& a, const CameraNode& b) const;
  void NumberCameras();

  const std::vector<StructureInput>& inputs_;
  MergedStructure& merged_;
  std::vector<CameraNode> nodes_;
  std::optional<UnionFind> sets_;
  std::map<std::string, size_t> node_of_key_;
  CameraIds camera_ids_;
};

CameraIds CameraMerger::Merge() {
  std::vector<std::map<CameraId, size_t>> node_of_id;
  for (size_t i = 0; i < inputs_.size(); ++i) {
    node_of_id.push_back(AddNodes(i));
  }
  sets_.emplace(nodes_.size());
  for (size_t i = 0; i < inputs_.size(); ++i) JoinNodes(i, node_of_id[i]);
  NumberCameras();
  for (size_t i = 0; i < inputs_.size(); ++i) {
    for (const ImageRow& image : inputs_[i].contents.images) {
      const size_t position = merged_.image_positions[i].at(image.id.value());
      merged_.images[position].camera_id = camera_ids_[i].at(image.camera_id);
    }
  }
  return std::move(camera_ids_);
}

std::map<CameraId, size_t> CameraMerger::AddNodes(size_t input) {
  const DatabaseContents& contents = inputs_[input].contents;
  const auto& positions = merged_.image_positions[input];
  std::map<CameraId, size_t> node_of_id;
  for (const Camera& camera : contents.cameras) {
    node_of_id.emplace(camera.id, nodes_.size());
    nodes_.push_back({input, &camera, "", kNone, kNone});
  }
  for (const ImageRow& image : contents.images) {
    CameraNode& node = nodes_[node_of_id.at(image.camera_id)];
    node.image_name = image.name;
    node.first_image =
        std::min(node.first_image, positions.at(image.id.value()));
  }
  for (const FrameRow& frame : contents.frames) {
    for (const FrameDataRow& data : frame.data) {
      size_t& first = nodes_[node_of_id.at(data.camera_id)].first_in_frame;
      first = std::min(first, positions.at(data.image_id.value()));
    }
  }
  return node_of_id;
}

// Cameras with a common key are equal.
void CameraMerger::JoinNodes(size_t input,
                             const std::map<CameraId, size_t>& node_of_id) {
  const StructureInput& in = inputs_[input];
  std::map<std::string, std::set<size_t>> nodes_of_folder;
  for (const ImageRow& image : in.contents.images) {
    const size_t node = node_of_id.at(image.camera_id);
    Join(node, "image " + NameIn(in, image.name));
    nodes_of_folder[FolderOfName(image.name)].insert(node);
  }
  for (const auto& [id, name] : in.shard_cameras) {
    const auto found = node_of_id.find(id);
    if (found != node_of_id.end()) {
      Join(found->second, "image " + NameIn(in, name));
    }
  }
  for (const FrameRow& frame : in.contents.frames) {
    for (const FrameDataRow& data : frame.data) {
      const size_t position =
          merged_.image_positions[input].at(data.image_id.value());
      Join(node_of_id.at(data.camera_id),
           "sensor of " + merged_.images[position].name);
    }
  }
  if (in.vehicle.empty()) return;
  for (const auto& [folder, nodes] : nodes_of_folder) {
    // A folder with several cameras does not identify a camera.
    if (nodes.size() == 1) {
      Join(*nodes.begin(), "vehicle " + in.vehicle + '\n' + folder);
    }
  }
}

void CameraMerger::CheckEqual(const CameraNode& a, const CameraNode& b) const {
  if (Intrinsics(*a.camera) == Intrinsics(*b.camera)) return;
  const bool is_one_vehicle =
      !inputs_[a.input].vehicle.empty() &&
      inputs_[a.input].prefix != inputs_[b.input].prefix;
  ThrowDatabaseError(
      inputs_[b.input].path,
      "the camera of image '" + b.image_name + "' has " +
          DescribeIntrinsics(*b.camera) + ", but in '" + inputs_[a.input].path +
          "' " + DescribeIntrinsics(*a.camera) +
          (is_one_vehicle
               ? "; give the vehicle one calibration, or two names"
               : "; extract all images with the same options, or separate "
                 "them by image_prefix"));
}

void CameraMerger::NumberCameras() {
  std::map<size_t, CameraNode> merged;  // by the representative of the set
  for (size_t n = 0; n < nodes_.size(); ++n) {
    const auto [entry, is_new] = merged.emplace(sets_->Find(n), nodes_[n]);
    if (is_new) continue;
    CameraNode& node = entry->second;
    CheckEqual(node, nodes_[n]);
    node.first_image = std::min(node.first_image, nodes_[n].first_image);
    node.first_in_frame =
        std::min(node.first_in_frame, nodes_[n].first_in_frame);
  }
  std::vector<std::pair<CameraNode, size_t>> order;
  for (const auto& [set, node] : merged) order.emplace_back(node, set);
  StableSortBy(&order, [](const auto& entry) {
    const CameraNode& node = entry.first;
    return std::tuple_cat(std::tie(node.first_image, node.first_in_frame),
                          Intrinsics(*node.camera));
  });
  std::map<size_t, CameraId> id_of_set;
  for (const auto& [node, set] : order) {
    Camera camera = *node.camera;
    camera.id = CameraId(static_cast<uint32_t>(merged_.cameras.size()) + 1);
    id_of_set.emplace(set, camera.id);
    merged_.cameras.push_back(std::move(camera));
  }
  for (size_t n = 0; n < nodes_.size(); ++n) {
    camera_ids_[nodes_[n].input].emplace(nodes_[n].camera->id,
                                         id_of_set.at(sets_->Find(n)));
  }
}

class RigMerger {
 public:
  // All arguments must outlive this object.
  RigMerger(const std::vector<StructureInput>& inputs,
            const CameraIds& camera_ids, MergedStructure* merged)
      : inputs_(inputs), camera_ids_(camera_ids), merged_(*merged) {}

  // Adds the rigs and frames.
  void Merge() {
    for (size_t i = 0; i < inputs_.size(); ++i) MergeRigsAndFrames(i);
    NumberRigsAndFrames();
  }

 private:
  struct MergedRig {
    RigRow rig;
    size_t input = 0;
    size_t first_image = kNone;
  };
  struct MergedFrame {
    size_t rig = 0;
    size_t input = 0;
    std::vector<FrameDataRow> data;  // sorted by image
  };

  void MergeRigsAndFrames(size_t input);
  size_t MergeRig(size_t input, const RigRow& row);
  void MergeFrame(size_t input, size_t rig, const FrameRow& row);
  void NumberRigsAndFrames();
  CameraId NewId(size_t input, CameraId id) const {
    return camera_ids_[input].at(id);
  }

  const std::vector<StructureInput>& inputs_;
  const CameraIds& camera_ids_;
  MergedStructure& merged_;
  std::vector<MergedRig> rigs_;
  std::map<CameraId, size_t> rig_of_camera_;
  std::vector<MergedFrame> frames_;
  std::unordered_map<uint32_t, size_t> frame_of_image_;
};

void RigMerger::MergeRigsAndFrames(size_t input) {
  const DatabaseContents& contents = inputs_[input].contents;
  std::map<RigId, size_t> rig_of_id;
  for (const RigRow& rig : contents.rigs) {
    rig_of_id.emplace(rig.id, MergeRig(input, rig));
  }
  for (const FrameRow& frame : contents.frames) {
    if (!frame.data.empty()) {
      MergeFrame(input, rig_of_id.at(frame.rig_id), frame);
    }
  }
}

size_t RigMerger::MergeRig(size_t input, const RigRow& row) {
  const std::string what = "rig " + std::to_string(row.id.value());
  RigRow rig{RigId(0), NewId(input, *row.ref_camera_id), {}};
  for (const RigSensorRow& sensor : row.sensors) {
    rig.sensors.push_back(
        {NewId(input, sensor.camera_id), sensor.sensor_from_rig});
  }
  SortBy(&rig.sensors, &RigSensorRow::camera_id);
  for (const RigSensorRow& sensor : rig.sensors) {
    const auto found = rig_of_camera_.find(sensor.camera_id);
    if (found == rig_of_camera_.end()) continue;
    const MergedRig& other = rigs_[found->second];
    const auto values = [](const RigSensorRow& row) {
      return std::tie(row.camera_id, row.sensor_from_rig);
    };
    if (other.rig.ref_camera_id == rig.ref_camera_id &&
        AreEqualBy(rig.sensors, other.rig.sensors, values)) {
      return found->second;
    }
    ThrowDatabaseError(
        inputs_[input].path,
        what + " has " + std::to_string(rig.sensors.size()) +
            " cameras, of which one is in a different rig, or has another "
            "pose, in '" +
            inputs_[other.input].path +
            "'; configure both databases with the same rig_config, or give "
            "them different prefixes and vehicles");
  }
  for (const RigSensorRow& sensor : rig.sensors) {
    rig_of_camera_.emplace(sensor.camera_id, rigs_.size());
  }
  rigs_.push_back({std::move(rig), input, kNone});
  return rigs_.size() - 1;
}

void RigMerger::MergeFrame(size_t input, size_t rig, const FrameRow& row) {
  MergedFrame frame{rig, input, {}};
  for (const FrameDataRow& data : row.data) {
    const size_t position =
        merged_.image_positions[input].at(data.image_id.value());
    frame.data.push_back(
        {NewId(input, data.camera_id), merged_.images[position].id});
  }
  SortBy(&frame.data, &FrameDataRow::image_id);
  for (const FrameDataRow& data : frame.data) {
    const auto found = frame_of_image_.find(data.image_id.value());
    if (found == frame_of_image_.end()) continue;
    const MergedFrame& other = frames_[found->second];
    if (other.rig == rig && AreEqualBy(other.data, frame.data, Values)) return;
    ThrowDatabaseError(
        inputs_[input].path,
        "image '" + merged_.images[data.image_id.value() - 1].name +
            "' is in a frame of " + std::to_string(frame.data.size()) +
            " images, but in another frame in '" + inputs_[other.input].path +
            "'; configure the rigs of both in the same way");
  }
  for (const FrameDataRow& data : frame.data) {
    frame_of_image_.emplace(data.image_id.value(), frames_.size());
  }
  frames_.push_back(std::move(frame));
}

void RigMerger::NumberRigsAndFrames() {
  for (const MergedFrame& frame : frames_) {
    size_t& first = rigs_[frame.rig].first_image;
    first = std::min<size_t>(first, frame.data.front().image_id.value());
  }
  std::vector<size_t> order = Indices<size_t>(rigs_.size());
  SortBy(&order, [&](size_t a) {
    return std::tie(rigs_[a].first_image, *rigs_[a].rig.ref_camera_id);
  });
  for (size_t i = 0; i < order.size(); ++i) {
    rigs_[order[i]].rig.id = RigId(static_cast<uint32_t>(i) + 1);
    merged_.rigs.push_back(rigs_[order[i]].rig);
  }
  SortBy(&frames_,
         [](const MergedFrame& a) { return a.data.front().image_id; });
  for (MergedFrame& frame : frames_) {
    merged_.frames.push_back(
        {FrameId(static_cast<uint32_t>(merged_.frames.size()) + 1),
         rigs_[frame.rig].rig.id, std::move(frame.data)});
  }
}

}  // namespace

MergedStructure MergeStructures(const std::vector<StructureInput>& inputs) {
  for (const StructureInput& input : inputs) CheckReferences(input);
  MergedStructure merged = MergeImages(inputs);
  const CameraIds camera_ids = CameraMerger(inputs, &merged).Merge();
  RigMerger(inputs, camera_ids, &merged).Merge();
  return merged;
}

}  // namespace mgsfm
