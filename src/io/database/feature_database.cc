// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/database/feature_database.h"

#include <algorithm>
#include <utility>

#include "database/database_reader.h"
#include "database/database_rows.h"
#include "database/database_shard.h"
#include "database/feature_database_impl.h"
#include "database/sqlite_database.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

int64_t PairIdOf(ImageId a, ImageId b) {
  MGSFM_CHECK_NE(a, b);
  return PairId(std::min(a, b).value(), std::max(a, b).value());
}

std::vector<Match> WithColumnsSwapped(std::vector<Match> matches) {
  for (Match& match : matches) {
    std::swap(match.keypoint_idx1, match.keypoint_idx2);
  }
  return matches;
}

}  // namespace

// -------------------------------------------------------------- reading

FeatureDatabase::FeatureDatabase(const std::string& path, OpenMode mode)
    : impl_(std::make_unique<Impl>(path, mode)) {}
FeatureDatabase::~FeatureDatabase() = default;
FeatureDatabase::FeatureDatabase(FeatureDatabase&&) noexcept = default;
FeatureDatabase& FeatureDatabase::operator=(FeatureDatabase&&) noexcept =
    default;

const std::string& FeatureDatabase::path() const { return impl_->path(); }

void FeatureDatabase::CheckUnchanged() const { impl_->CheckUnchanged(); }

DatabaseContents FeatureDatabase::ReadStructure(const Context& context) const {
  return mgsfm::ReadStructure(impl_->database(), context);
}

bool FeatureDatabase::HasKeypoints(ImageId image_id) const {
  return impl_->Has("keypoints", "image_id", image_id.value());
}

bool FeatureDatabase::HasDescriptors(ImageId image_id) const {
  return impl_->Has("descriptors", "image_id", image_id.value());
}

bool FeatureDatabase::HasMatches(ImageId image_id1, ImageId image_id2) const {
  return impl_->Has("matches", "pair_id", PairIdOf(image_id1, image_id2));
}

bool FeatureDatabase::HasTwoViewGeometry(ImageId image_id1,
                                         ImageId image_id2) const {
  return impl_->Has("two_view_geometries", "pair_id",
                    PairIdOf(image_id1, image_id2));
}

std::vector<ImageId> FeatureDatabase::ImagesWithKeypoints() const {
  return impl_->ListImages("keypoints");
}

std::vector<ImageId> FeatureDatabase::ImagesWithDescriptors() const {
  return impl_->ListImages("descriptors");
}

std::vector<std::pair<ImageId, size_t>> FeatureDatabase::CountKeypoints()
    const {
  std::vector<std::pair<ImageId, size_t>> counts;
  SqliteStatement row = impl_->database().Prepare(
      "SELECT image_id, rows FROM keypoints ORDER BY image_id");
  while (row.Step()) {
    counts.emplace_back(static_cast<uint32_t>(row.Int(0)),
                        static_cast<size_t>(std::max<int64_t>(0, row.Int(1))));
  }
  return counts;
}

std::vector<PairCount> FeatureDatabase::CountMatches() const {
  return impl_->ListPairs("matches");
}

std::vector<PairCount> FeatureDatabase::CountInlierMatches() const {
  return impl_->ListPairs("two_view_geometries");
}

std::vector<FeatureKeypoint> FeatureDatabase::ReadKeypoints(
    ImageId image_id) const {
  SqliteStatement row = impl_->Select(
      "SELECT image_id, rows, cols, data FROM keypoints WHERE image_id = ?1",
      image_id.value());
  if (!row.Step()) return {};
  return MakeFeatureKeypoints(DecodeKeypoints(
      row, path(), "the keypoints of " + impl_->ImageName(image_id)));
}

DescriptorMatrix FeatureDatabase::ReadDescriptors(ImageId image_id) const {
  SqliteStatement row = impl_->Select(
      "SELECT image_id, rows, cols, data FROM descriptors WHERE image_id = ?1",
      image_id.value());
  if (!row.Step()) return DescriptorMatrix(0, kSiftColumns);
  return DecodeDescriptors(row, path(), impl_->ImageName(image_id));
}

std::vector<Match> FeatureDatabase::ReadMatches(ImageId image_id1,
                                                ImageId image_id2) const {
  SqliteStatement row = impl_->Select(
      "SELECT pair_id, rows, cols, data FROM matches WHERE pair_id = ?1",
      PairIdOf(image_id1, image_id2));
  if (!row.Step()) return {};
  std::vector<Match> matches = DecodeMatches(
      row, path(),
      impl_->ImageName(image_id1) + " and " + impl_->ImageName(image_id2));
  return image_id2 < image_id1 ? WithColumnsSwapped(std::move(matches))
                               : matches;
}

std::optional<TwoViewGeometryRow> FeatureDatabase::ReadTwoViewGeometry(
    ImageId image_id1, ImageId image_id2) const {
  SqliteStatement row = impl_->Select(
      TwoViewGeometryQuery(impl_->database(), "two_view_geometries") +
          " WHERE pair_id = ?1",
      PairIdOf(image_id1, image_id2));
  if (!row.Step()) return std::nullopt;
  TwoViewGeometryRow pair{std::min(image_id1, image_id2),
                          std::max(image_id1, image_id2),
                          TwoViewConfig::kUndefined,
                          {},
                          {},
                          {},
                          {},
                          {}};
  DecodeTwoViewGeometry(
      row, path(),
      impl_->ImageName(image_id1) + " and " + impl_->ImageName(image_id2),
      &pair);
  if (image_id2 < image_id1) SwapImages(&pair);
  return pair;
}

std::vector<PosePriorRow> FeatureDatabase::ReadPosePriors() const {
  std::vector<PosePriorRow> priors;
  if (!impl_->database().HasTable("pose_priors")) return priors;
  SqliteStatement row =
      impl_->database().Prepare(PosePriorQuery(impl_->database()));
  while (row.Step()) {
    const PosePriorRow prior = DecodePosePrior(row);
    if (prior.position.allFinite()) priors.push_back(prior);
  }
  return priors;
}

// -------------------------------------------------------------- writing

CameraId FeatureDatabase::AddCamera(const Camera& camera) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT INTO cameras (model, width, height, params, prior_focal_length) "
      "VALUES (?1, ?2, ?3, ?4, ?5)");
  BindCamera(camera, &row);
  return CameraId(impl_->AddRow(&row));
}

void FeatureDatabase::UpdateCamera(const Camera& camera) {
  SqliteStatement row = impl_->file().Prepare(
      "UPDATE cameras SET model = ?1, width = ?2, height = ?3, params = ?4, "
      "prior_focal_length = ?5 WHERE camera_id = ?6");
  BindCamera(camera, &row);
  row.BindInt(6, camera.id.value());
  row.Run();
}

ImageId FeatureDatabase::AddImage(const std::string& name, CameraId camera_id) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT INTO images (name, camera_id) VALUES (?1, ?2)");
  row.BindText(1, name);
  row.BindInt(2, camera_id.value());
  return ImageId(impl_->AddRow(&row));
}

void FeatureDatabase::SetImageCamera(ImageId image_id, CameraId camera_id) {
  SqliteStatement row = impl_->file().Prepare(
      "UPDATE images SET camera_id = ?2 WHERE image_id = ?1");
  row.BindInt(1, image_id.value());
  row.BindInt(2, camera_id.value());
  row.Run();
}

void FeatureDatabase::WriteKeypoints(
    ImageId image_id, const std::vector<FeatureKeypoint>& keypoints) {
  static_assert(sizeof(FeatureKeypoint) == 6 * sizeof(float),
                "as in the database");
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO keypoints (image_id, rows, cols, data) "
      "VALUES (?1, ?2, 6, ?3)");
  row.BindInt(1, image_id.value());
  row.BindInt(2, static_cast<int64_t>(keypoints.size()));
  row.BindBlob(3, keypoints.data(), keypoints.size() * sizeof(FeatureKeypoint));
  row.Run();
}

void FeatureDatabase::WriteDescriptors(ImageId image_id,
                                       const DescriptorMatrix& descriptors) {
  // Feature types of COLMAP 4.
  constexpr int kUndefined = -1;
  constexpr int kSift = 0;
  SqliteStatement row = impl_->file().Prepare(
      impl_->descriptors_have_type()
          ? "INSERT OR REPLACE INTO descriptors "
            "(image_id, rows, cols, data, type) VALUES (?1, ?2, ?3, ?4, ?5)"
          : "INSERT OR REPLACE INTO descriptors "
            "(image_id, rows, cols, data) VALUES (?1, ?2, ?3, ?4)");
  row.BindInt(1, image_id.value());
  row.BindInt(2, descriptors.rows());
  row.BindInt(3, descriptors.cols());
  row.BindBlob(4, descriptors.data(), descriptors.size());
  if (impl_->descriptors_have_type()) {
    row.BindInt(5, descriptors.cols() == kSiftColumns ? kSift : kUndefined);
  }
  row.Run();
}

void FeatureDatabase::WritePosePrior(const PosePriorRow& prior) {
  impl_->InTransaction([&] { impl_->WritePrior(prior); });
}

void FeatureDatabase::WriteMatches(ImageId image_id1, ImageId image_id2,
                                   const std::vector<Match>& matches) {
  const std::vector<Match> swapped = image_id2 < image_id1
                                         ? WithColumnsSwapped(matches)
                                         : std::vector<Match>();
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO matches (pair_id, rows, cols, data) "
      "VALUES (?1, ?2, 2, ?3)");
  BindMatches(PairIdOf(image_id1, image_id2),
              image_id2 < image_id1 ? swapped : matches, &row);
  row.Run();
}

void FeatureDatabase::WriteTwoViewGeometry(const TwoViewGeometryRow& pair) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO two_view_geometries "
      "(pair_id, rows, cols, data, config, F, E, H, qvec, tvec) "
      "VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)");
  if (pair.image_id1 < pair.image_id2) {
    return WriteTwoViewGeometryRow(pair, impl_->none_is_null(), &row);
  }
  TwoViewGeometryRow swapped = pair;
  SwapImages(&swapped);
  WriteTwoViewGeometryRow(swapped, impl_->none_is_null(), &row);
}

void FeatureDatabase::AddSingleImageFrame(ImageId image_id,
                                          CameraId camera_id) {
  impl_->InTransaction([&] { impl_->AddFrame(image_id, camera_id); });
}

void FeatureDatabase::WriteRigsAndFrames(const std::vector<RigRow>& rigs,
                                         const std::vector<FrameRow>& frames) {
  impl_->InTransaction([&] { impl_->ReplaceRigsAndFrames(rigs, frames); });
}

std::optional<ShardManifest> FeatureDatabase::ReadShard() const {
  return ReadShardManifest(impl_->database());
}

void FeatureDatabase::WriteShard(const ShardManifest& manifest) {
  impl_->InTransaction([&] { WriteShardManifest(manifest, &impl_->file()); });
}

std::map<CameraId, std::string> FeatureDatabase::ReadShardCameras() const {
  return mgsfm::ReadShardCameras(impl_->database());
}

void FeatureDatabase::WriteShardCamera(CameraId camera_id,
                                       const std::string& image_name) {
  mgsfm::WriteShardCamera(camera_id, image_name, &impl_->file());
}

void FeatureDatabase::DeleteMatches() {
  impl_->file().Execute("DELETE FROM matches");
}

void FeatureDatabase::DeleteTwoViewGeometries() {
  impl_->file().Execute("DELETE FROM two_view_geometries");
}

DatabaseTransaction::DatabaseTransaction(FeatureDatabase* database)
    : database_(database) {
  database_->impl_->Begin();
}

DatabaseTransaction::~DatabaseTransaction() {
  if (is_open_) database_->impl_->Rollback();
}

void DatabaseTransaction::Commit() {
  database_->impl_->Commit();
  is_open_ = false;
}

}  // namespace mgsfm
