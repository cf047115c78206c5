// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "database/sqlite_database.h"
#include "mgsfm/database/database.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {

// Ids in a COLMAP database are in [0, kMaxNumIds).
constexpr int64_t kMaxNumIds = 2147483647;

// The id of the pair of two images: id1 < id2.
inline int64_t PairId(int64_t id1, int64_t id2) {
  return kMaxNumIds * id1 + id2;
}

// The COLMAP version whose tables and columns a database gets.
enum class TableLayout {
  k38,        // user_version 3800
  k312,       // 3900
  k38And312,  // 3900: what a file of 3.8 is after 3.12 has opened it
};

// Creates missing tables, and sets the user_version of a new database.
void CreateTables(TableLayout layout, SqliteDatabase* database);

// Encoding of single rows of a COLMAP database, shared by all readers and
// writers. Decoding checks the values; `name` identifies the row in messages.

// The sensor_type of a camera.
constexpr int64_t kCameraSensorType = 0;

// Remedies for damaged rows.
constexpr const char* kExtractAgain = "; extract the features again";
constexpr const char* kMatchAgain = "; match the images again";
constexpr const char* kConfigureAgain = "; configure the rigs again";

// ---------------------------------------------------------------- reading

// Quaternion (w, x, y, z) and translation. Returns nullopt if a value is not
// finite or the quaternion is zero, which COLMAP writes for "no pose".
std::optional<Rigid3> PoseFromNumbers(const double* qvec, const double* tvec);

// Numbers of a row with rows, cols and data in the columns 1 to 3.
struct KeypointBlob {
  const char* data = nullptr;  // valid until the next step
  size_t rows = 0;
  size_t cols = 0;  // 2, 4 or 6 floats
};
KeypointBlob DecodeKeypoints(const SqliteStatement& row,
                             const std::string& path, const std::string& name);
std::vector<Match> DecodeMatches(const SqliteStatement& row,
                                 const std::string& path,
                                 const std::string& name);

// "SELECT pair_id, ... FROM `table`" with the columns that the next reads, NULL
// for those that old versions lack.
std::string TwoViewGeometryQuery(const SqliteDatabase& database,
                                 const std::string& table);
void DecodeTwoViewGeometry(const SqliteStatement& row, const std::string& path,
                           const std::string& name, TwoViewGeometryRow* pair);

// "SELECT image, position, covariance, coordinate system, gravity FROM
// pose_priors", for all layouts of the table; that of 3.8 is in `images` and is
// not read.
std::string PosePriorQuery(const SqliteDatabase& database);
// "SELECT image, gravity FROM pose_priors", likewise; "" if it has none.
std::string PriorGravityQuery(const SqliteDatabase& database);
std::optional<Eigen::Vector3d> DecodeVector3(const BlobView& blob);
// The position is not finite if the row has none; gravity is finite or none.
PosePriorRow DecodePosePrior(const SqliteStatement& row);

// ---------------------------------------------------------------- writing

// Parameters 1 to 5: all but the id.
void BindCamera(const Camera& camera, SqliteStatement* row);

// Parameters 1 to 4 of matches and of two-view geometries: id, rows, data, as
// the number of columns is always 2.
void BindMatches(int64_t pair_id, const std::vector<Match>& matches,
                 SqliteStatement* row);

// Runs `row`, whose parameters are those of BindMatches and then config, F, E,
// H, qvec, tvec. What is missing is NULL or, as versions before 4.0 demand,
// zeros and the identity. image_id1 < image_id2.
void WriteTwoViewGeometryRow(const TwoViewGeometryRow& pair, bool none_is_null,
                             SqliteStatement* row);

void WriteRigRows(const std::vector<RigRow>& rigs, SqliteDatabase* database);
void WriteFrameRows(const std::vector<FrameRow>& frames,
                    SqliteDatabase* database);

// Accepts 2, 4 (scale and orientation) or 6 columns, and completes the shape.
std::vector<FeatureKeypoint> MakeFeatureKeypoints(const KeypointBlob& blob);

constexpr int kSiftColumns = 128;

// A row with rows, cols and data in the columns 1 to 3; `name` is that of the
// image. Throws Error unless the descriptors are SIFT's.
DescriptorMatrix DecodeDescriptors(const SqliteStatement& row,
                                   const std::string& path,
                                   const std::string& name);

}  // namespace mgsfm
