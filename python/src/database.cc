// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Core>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.h"
#include "bindings.h"
#include "cameras.h"
#include "database/database_rows.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm::python {
namespace {

namespace py = pybind11;
using Eigen::Matrix3d;
using Eigen::Vector3d;

std::optional<Matrix3d> ReadMatrixOrNone(const py::handle& value) {
  if (value.is_none()) return std::nullopt;
  const auto array = py::cast<ArrayIn<double>>(value);
  CheckShape(array, "a matrix", 3, 3);
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
      array.data());
}

Vector3d ReadVector(const py::handle& value, const char* name) {
  const auto array = py::cast<ArrayIn<double>>(value);
  CheckShape(array, name, 3);
  return Vector3d(array.data());
}

py::array_t<uint32_t> MatchesToArray(const std::vector<Match>& matches) {
  std::vector<uint32_t> rows;
  for (const Match& match : matches) {
    rows.push_back(match.keypoint_idx1);
    rows.push_back(match.keypoint_idx2);
  }
  return MakeArray(std::move(rows), 2);
}

std::vector<Match> ReadMatchArray(const ArrayIn<uint32_t>& rows) {
  CheckShape(rows, "matches", -1, 2);
  std::vector<Match> matches;
  for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
    matches.push_back({rows.at(i, 0), rows.at(i, 1)});
  }
  return matches;
}

// Rows of x, y; of x, y, scale and orientation; or of x, y and affine shape.
std::vector<FeatureKeypoint> ReadKeypointArray(const ArrayIn<float>& rows) {
  const bool is_matrix = rows.ndim() == 2;
  const py::ssize_t num_columns = is_matrix ? rows.shape(1) : 0;
  if (num_columns != 2 && num_columns != 4 && num_columns != 6) {
    throw Error("keypoints must have the shape (N, 2), (N, 4) or (N, 6)");
  }
  std::vector<FeatureKeypoint> keypoints;
  for (py::ssize_t i = 0; i < rows.shape(0); ++i) {
    const float* row = rows.data(i, 0);
    FeatureKeypoint keypoint{row[0], row[1]};
    if (num_columns == 4) {
      keypoint = FeatureKeypoint::FromScale(row[0], row[1], row[2], row[3]);
    } else if (num_columns == 6) {
      keypoint = {row[0], row[1], row[2], row[3], row[4], row[5]};
    }
    keypoints.push_back(keypoint);
  }
  return keypoints;
}

// (id, model, width, height, params, has_prior_focal_length)
Camera ReadCamera(const py::tuple& row) {
  const auto [id, model, width_px, height_px, params, has_prior] = py::cast<
      std::tuple<uint32_t, std::string, int, int, ArrayIn<double>, bool>>(row);
  Intrinsics intrinsics = ReadIntrinsics(model, params);
  return {CameraId(id),
          intrinsics.model,
          width_px,
          height_px,
          std::move(intrinsics.params),
          has_prior};
}

py::dict ToPython(const DatabaseContents& contents) {
  py::list cameras, images, rigs, frames;
  for (const Camera& camera : contents.cameras) {
    cameras.append(py::make_tuple(
        camera.id.value(), std::string(InfoOf(camera.model).name),
        camera.width_px, camera.height_px, MakeArray(camera.params),
        camera.has_prior_focal_length));
  }
  for (const ImageRow& image : contents.images) {
    images.append(
        py::make_tuple(image.id.value(), image.name, image.camera_id.value()));
  }
  for (const RigRow& rig : contents.rigs) {
    py::list sensors;
    for (const RigSensorRow& sensor : rig.sensors) {
      sensors.append(py::make_tuple(sensor.camera_id.value(),
                                    rig.ref_camera_id == sensor.camera_id,
                                    ToArrayOrNone(sensor.sensor_from_rig)));
    }
    rigs.append(py::make_tuple(rig.id.value(), sensors));
  }
  for (const FrameRow& frame : contents.frames) {
    py::list data;
    for (const FrameDataRow& row : frame.data) {
      data.append(py::make_tuple(row.camera_id.value(), row.image_id.value()));
    }
    frames.append(py::make_tuple(frame.id.value(), frame.rig_id.value(), data));
  }
  py::dict result;
  result["cameras"] = cameras;
  result["images"] = images;
  result["rigs"] = rigs;
  result["frames"] = frames;
  return result;
}

std::vector<RigRow> ReadRigs(const py::list& rows) {
  std::vector<RigRow> rigs;
  for (const py::handle item : rows) {
    const auto [id, sensors] = py::cast<std::pair<uint32_t, py::list>>(item);
    RigRow rig{RigId(id), std::nullopt, {}};
    for (const py::handle sensor : sensors) {
      const auto [camera_id, is_reference, pose] =
          py::cast<std::tuple<uint32_t, bool, py::object>>(sensor);
      if (is_reference) rig.ref_camera_id = CameraId(camera_id);
      rig.sensors.push_back({CameraId(camera_id), ReadOptionalPose(pose)});
    }
    if (!rig.ref_camera_id) {
      throw Error("rig " + std::to_string(id) +
                  " has no reference sensor; call add_ref_sensor");
    }
    rigs.push_back(std::move(rig));
  }
  return rigs;
}

std::vector<FrameRow> ReadFrames(const py::list& rows) {
  std::vector<FrameRow> frames;
  for (const py::handle item : rows) {
    const auto [id, rig_id, data] =
        py::cast<std::tuple<uint32_t, uint32_t,
                            std::vector<std::pair<uint32_t, uint32_t>>>>(item);
    FrameRow frame{FrameId(id), RigId(rig_id), {}};
    for (const auto& [camera_id, image_id] : data) {
      frame.data.push_back({CameraId(camera_id), ImageId(image_id)});
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

// A database until it is closed, and its transaction if there is one.
class OpenDatabase {
 public:
  OpenDatabase(const std::string& path, bool is_read_only)
      : database_(std::make_unique<FeatureDatabase>(
            path, is_read_only ? FeatureDatabase::OpenMode::kReadOnly
                               : FeatureDatabase::OpenMode::kOrCreate)),
        path_(path),
        is_read_only_(is_read_only) {}

  void Close() {
    transaction_.reset();
    database_.reset();
  }
  FeatureDatabase& Get() {
    if (!database_) throw Error("the database '" + path_ + "' is closed");
    return *database_;
  }
  FeatureDatabase& GetForWriting() {
    if (is_read_only_) {
      throw Error("the database '" + path_ + "' is open read-only");
    }
    return Get();
  }
  void Begin() {
    if (transaction_) {
      throw Error("'" + path_ + "': transactions cannot be nested");
    }
    transaction_ = std::make_unique<DatabaseTransaction>(&GetForWriting());
  }
  void Commit() {
    if (transaction_) transaction_->Commit();
    transaction_.reset();
  }
  void Rollback() { transaction_.reset(); }

 private:
  std::unique_ptr<FeatureDatabase> database_;
  std::unique_ptr<DatabaseTransaction> transaction_;
  std::string path_;
  bool is_read_only_;
};

// Arrays of the ids of both images, and of the numbers of matches.
py::tuple CountPairs(const std::vector<PairCount>& pairs) {
  std::vector<uint32_t> ids;
  std::vector<int64_t> counts;
  for (const PairCount& pair : pairs) {
    ids.push_back(pair.image_id1.value());
    ids.push_back(pair.image_id2.value());
    counts.push_back(static_cast<int64_t>(pair.num_matches));
  }
  return py::make_tuple(MakeArray(std::move(ids), 2),
                        MakeArray(std::move(counts)));
}

// (config, F, E, H, cam2_from_cam1, matches) or None.
py::object ReadGeometry(OpenDatabase& self, uint32_t id1, uint32_t id2) {
  const auto pair = self.Get().ReadTwoViewGeometry(ImageId(id1), ImageId(id2));
  if (!pair) return py::none();
  return py::make_tuple(static_cast<int>(pair->config), ToArrayOrNone(pair->F),
                        ToArrayOrNone(pair->E), ToArrayOrNone(pair->H),
                        ToArrayOrNone(pair->cam2_from_cam1),
                        MatchesToArray(pair->matches));
}

void WriteGeometry(OpenDatabase& self, uint32_t id1, uint32_t id2,
                   const py::tuple& row) {
  TwoViewGeometryRow pair{ImageId(id1), ImageId(id2)};
  pair.config = static_cast<TwoViewConfig>(row[0].cast<int>());
  pair.F = ReadMatrixOrNone(row[1]);
  pair.E = ReadMatrixOrNone(row[2]);
  pair.H = ReadMatrixOrNone(row[3]);
  pair.cam2_from_cam1 = ReadOptionalPose(row[4]);
  pair.matches = ReadMatchArray(py::cast<ArrayIn<uint32_t>>(row[5]));
  self.GetForWriting().WriteTwoViewGeometry(pair);
}

// Tuples (image_id, coordinate system, position, covariance, gravity).
py::list ReadPriors(OpenDatabase& self) {
  py::list priors;
  for (const PosePriorRow& prior : self.Get().ReadPosePriors()) {
    priors.append(py::make_tuple(
        prior.image_id.value(), static_cast<int>(prior.coordinate_system),
        ToArray(prior.position), ToArrayOrNone(prior.covariance),
        ToArrayOrNone(prior.gravity)));
  }
  return priors;
}

void WritePrior(OpenDatabase& self, const py::tuple& row) {
  PosePriorRow prior;
  prior.image_id = ImageId(row[0].cast<uint32_t>());
  prior.coordinate_system =
      static_cast<PosePriorRow::CoordinateSystem>(row[1].cast<int>());
  prior.position = ReadVector(row[2], "position");
  prior.covariance = ReadMatrixOrNone(row[3]);
  if (!row[4].is_none()) prior.gravity = ReadVector(row[4], "gravity");
  self.GetForWriting().WritePosePrior(prior);
}

py::array_t<float> ReadKeypoints(OpenDatabase& self, uint32_t image_id) {
  std::vector<float> rows;
  for (const FeatureKeypoint& k : self.Get().ReadKeypoints(ImageId(image_id))) {
    rows.insert(rows.end(), {k.x_px, k.y_px, k.a11, k.a12, k.a21, k.a22});
  }
  return MakeArray(std::move(rows), 6);
}

py::array_t<uint8_t> ReadDescriptors(OpenDatabase& self, uint32_t image_id) {
  const DescriptorMatrix matrix = self.Get().ReadDescriptors(ImageId(image_id));
  return MakeArray(
      std::vector<uint8_t>(matrix.data(), matrix.data() + matrix.size()),
      matrix.cols());
}

void WriteDescriptors(OpenDatabase& self, uint32_t image_id,
                      const ArrayIn<uint8_t>& rows) {
  CheckShape(rows, "descriptors of SIFT", -1, 128);
  self.GetForWriting().WriteDescriptors(
      ImageId(image_id), Eigen::Map<const DescriptorMatrix>(
                             rows.data(), rows.shape(0), rows.shape(1)));
}

template <class Id>
std::optional<Id> CheckId(std::optional<uint32_t> id) {
  if (!id) return std::nullopt;
  if (*id < 1 || *id >= kMaxNumIds) {
    throw Error("the id " + std::to_string(*id) + " is not in [1, 2^31 - 2]");
  }
  return Id(*id);
}

void BindRows(py::class_<OpenDatabase>* database) {
  database->def("read_structure", [](OpenDatabase& self) {
    return ToPython(self.Get().ReadStructure(Context()));
  });
  database->def("add_camera", [](OpenDatabase& self, const py::tuple& row,
                                 std::optional<uint32_t> id) {
    return self.GetForWriting()
        .AddCamera(ReadCamera(row), CheckId<CameraId>(id))
        .value();
  });
  database->def("update_camera", [](OpenDatabase& self, const py::tuple& row) {
    self.GetForWriting().UpdateCamera(ReadCamera(row));
  });
  database->def("add_image",
                [](OpenDatabase& self, const std::string& name,
                   uint32_t camera_id, std::optional<uint32_t> id) {
                  return self.GetForWriting()
                      .AddImage(name, CameraId(camera_id), CheckId<ImageId>(id))
                      .value();
                });
  database->def("write_rigs_and_frames", [](OpenDatabase& self,
                                            const py::list& rigs,
                                            const py::list& frames) {
    self.GetForWriting().WriteRigsAndFrames(ReadRigs(rigs), ReadFrames(frames));
  });
  database->def("read_priors", &ReadPriors);
  database->def("write_prior", &WritePrior);
}

void BindFeatures(py::class_<OpenDatabase>* database) {
  database->def("count_keypoints", [](OpenDatabase& self) {
    std::vector<std::pair<uint32_t, size_t>> counts;
    for (const auto& [id, count] : self.Get().CountKeypoints()) {
      counts.emplace_back(id.value(), count);
    }
    return counts;
  });
  database->def("has_keypoints", [](OpenDatabase& self, uint32_t image_id) {
    return self.Get().HasKeypoints(ImageId(image_id));
  });
  database->def("has_descriptors", [](OpenDatabase& self, uint32_t image_id) {
    return self.Get().HasDescriptors(ImageId(image_id));
  });
  database->def("has_matches",
                [](OpenDatabase& self, uint32_t id1, uint32_t id2) {
                  return self.Get().HasMatches(ImageId(id1), ImageId(id2));
                });
  database->def(
      "has_geometry", [](OpenDatabase& self, uint32_t id1, uint32_t id2) {
        return self.Get().HasTwoViewGeometry(ImageId(id1), ImageId(id2));
      });
  database->def("read_keypoints", &ReadKeypoints);
  database->def("write_keypoints", [](OpenDatabase& self, uint32_t image_id,
                                      const ArrayIn<float>& rows) {
    self.GetForWriting().WriteKeypoints(ImageId(image_id),
                                        ReadKeypointArray(rows));
  });
  database->def("read_descriptors", &ReadDescriptors);
  database->def("write_descriptors", &WriteDescriptors);
  database->def("count_matches", [](OpenDatabase& self) {
    return CountPairs(self.Get().CountMatches());
  });
  database->def("count_inlier_matches", [](OpenDatabase& self) {
    return CountPairs(self.Get().CountInlierMatches());
  });
  database->def("read_matches", [](OpenDatabase& self, uint32_t id1,
                                   uint32_t id2) {
    return MatchesToArray(self.Get().ReadMatches(ImageId(id1), ImageId(id2)));
  });
  database->def("write_matches",
                [](OpenDatabase& self, uint32_t id1, uint32_t id2,
                   const ArrayIn<uint32_t>& rows) {
                  self.GetForWriting().WriteMatches(ImageId(id1), ImageId(id2),
                                                    ReadMatchArray(rows));
                });
  database->def("read_geometry", &ReadGeometry);
  database->def("write_geometry", &WriteGeometry);
  database->def("delete_matches", [](OpenDatabase& self) {
    self.GetForWriting().DeleteMatches();
  });
  database->def("delete_geometries", [](OpenDatabase& self) {
    self.GetForWriting().DeleteTwoViewGeometries();
  });
}

}  // namespace

void BindDatabase(py::module_* module) {
  py::class_<OpenDatabase> database(*module, "OpenDatabase");
  database.def(py::init<const std::string&, bool>(), py::arg("path"),
               py::arg("is_read_only"));
  database.def("close", &OpenDatabase::Close);
  database.def("begin", &OpenDatabase::Begin);
  database.def("commit", &OpenDatabase::Commit);
  database.def("rollback", &OpenDatabase::Rollback);
  BindRows(&database);
  BindFeatures(&database);
}

}  // namespace mgsfm::python
