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

// The numbers of a row with rows, cols and data in columns 1 to 3.
struct KeypointBlob {
  const char* data = nullptr;  // valid until the next step
  size_t rows = 0;
  size_t cols = 0;  // 2, 4 or 6 floats
};
KeypointBlob DecodeKeypoints(const SqliteStatement& row,
                             const std::string& name);
std::vector<Match> DecodeMatches(const SqliteStatement& row,
                                 const std::string& name);

// "SELECT pair_id, ... FROM `table`" with the columns for the reads below; NULL
// for columns that old versions lack.
std::string TwoViewGeometryQuery(const SqliteDatabase& database,
                                 const std::string& table);
void DecodeTwoViewGeometry(const SqliteStatement& row, const std::string& name,
                           TwoViewGeometryRow* pair);

// All rows of pose_priors, by image, for all layouts of the table; that of 3.8
// is in `images` and is not read. The position is not finite if the row has
// none; gravity is finite or none.
std::vector<PosePriorRow> ReadPosePriorRows(const SqliteDatabase& database);

// ---------------------------------------------------------------- writing

// Runs `row`, whose parameters are model, width, height, params, prior focal
// length and, if it is given, the id.
void RunWithCamera(const Camera& camera, std::optional<CameraId> id,
                   SqliteStatement* row);

// Runs `row`, whose parameters are pair_id, rows, data, config, F, E, H, qvec
// and tvec. What is missing is NULL or, as versions before 4.0 demand, zeros
// and the identity. image_id1 < image_id2.
void WriteTwoViewGeometryRow(const TwoViewGeometryRow& pair, bool none_is_null,
                             SqliteStatement* row);

void WriteRigRows(const std::vector<RigRow>& rigs, SqliteDatabase* database);
void WriteFrameRows(const std::vector<FrameRow>& frames,
                    SqliteDatabase* database);

// Accepts 2, 4 (scale and orientation) or 6 columns, and completes the affine
// shape.
std::vector<FeatureKeypoint> MakeFeatureKeypoints(const KeypointBlob& blob);

constexpr int kSiftColumns = 128;

// A row with rows, cols and data in the columns 1 to 3; `name` is the name of
// the image. Throws Error unless the descriptors are SIFT's.
DescriptorMatrix DecodeDescriptors(const SqliteStatement& row,
                                   const std::string& name);

}  // namespace mgsfm
