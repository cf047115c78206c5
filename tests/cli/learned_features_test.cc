// SPDX-License-Identifier: BSD-3-Clause
// Databases of COLMAP 4.2 with features other than SIFT, from matches to a
// model. Tables have the columns that COLMAP 4.2 gives them.
#include <sqlite3.h>

#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/random.h"
#include "cli/program_runs.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

// Types of COLMAP 4.2.
constexpr int kAlikedN16Rot = 1;
constexpr int kNumBytes = 128 * sizeof(float);

class Sqlite {
 public:
  explicit Sqlite(const std::string& path) {
    MGSFM_CHECK(sqlite3_open(path.c_str(), &database_) == SQLITE_OK);
  }
  ~Sqlite() { sqlite3_close(database_); }
  Sqlite(const Sqlite&) = delete;
  Sqlite& operator=(const Sqlite&) = delete;

  void Execute(const std::string& sql) {
    char* message = nullptr;
    const int code =
        sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, &message);
    MGSFM_CHECK_MSG(code == SQLITE_OK, message == nullptr ? sql : message);
  }
  // Calls `use` with each row.
  template <class Function>
  void ForEach(const std::string& sql, const Function& use) {
    sqlite3_stmt* row = nullptr;
    MGSFM_CHECK(sqlite3_prepare_v2(database_, sql.c_str(), -1, &row, nullptr) ==
                SQLITE_OK);
    while (sqlite3_step(row) == SQLITE_ROW) use(row);
    sqlite3_finalize(row);
  }
  void WriteBlob(const std::string& sql, const void* data, size_t size) {
    sqlite3_stmt* row = nullptr;
    MGSFM_CHECK(sqlite3_prepare_v2(database_, sql.c_str(), -1, &row, nullptr) ==
                SQLITE_OK);
    sqlite3_bind_blob(row, 1, data, static_cast<int>(size), SQLITE_STATIC);
    MGSFM_CHECK(sqlite3_step(row) == SQLITE_DONE);
    sqlite3_finalize(row);
  }

 private:
  sqlite3* database_ = nullptr;
};

struct Keypoints {
  int64_t image_id = 0;
  int rows = 0;
  int cols = 0;
  std::vector<float> values;
};

std::vector<Keypoints> ReadKeypoints(Sqlite* database) {
  std::vector<Keypoints> all;
  database->ForEach(
      "SELECT image_id, rows, cols, data FROM keypoints", [&](auto* row) {
        Keypoints keypoints{sqlite3_column_int64(row, 0),
                            sqlite3_column_int(row, 1),
                            sqlite3_column_int(row, 2),
                            {}};
        keypoints.values.resize(keypoints.rows * keypoints.cols);
        std::memcpy(keypoints.values.data(), sqlite3_column_blob(row, 3),
                    keypoints.values.size() * sizeof(float));
        all.push_back(std::move(keypoints));
      });
  return all;
}

// Learned keypoints have no shape: two columns. COLMAP itself writes six, other
// tools four.
void WriteKeypoints(const Keypoints& old, int cols, Sqlite* database) {
  std::vector<float> values;
  for (int i = 0; i < old.rows; ++i) {
    const float shape[6] = {old.values[i * old.cols],
                            old.values[i * old.cols + 1],
                            1.0f,
                            0.0f,
                            0.0f,
                            1.0f};
    values.insert(values.end(), shape, shape + cols);
  }
  database->WriteBlob(
      "UPDATE keypoints SET cols = " + std::to_string(cols) +
          ", data = ?1 WHERE image_id = " + std::to_string(old.image_id),
      values.data(), values.size() * sizeof(float));
}

void WriteFloatDescriptors(const Keypoints& keypoints, Random* random,
                           Sqlite* database) {
  std::vector<float> values(static_cast<size_t>(keypoints.rows) * 128);
  for (float& value : values) value = static_cast<float>(random->Normal());
  database->WriteBlob(
      "INSERT INTO descriptors (image_id, rows, cols, data, type) VALUES (" +
          std::to_string(keypoints.image_id) + ", " +
          std::to_string(keypoints.rows) + ", " + std::to_string(kNumBytes) +
          ", ?1, " + std::to_string(kAlikedN16Rot) + ")",
      values.data(), values.size() * sizeof(float));
}

// Replaces what a simulated drive has by what COLMAP 4.2 writes for ALIKED
// features with LightGlue, before verification.
void MakeLearned(const std::string& path) {
  Sqlite database(path);
  database.Execute(
      "DELETE FROM matches; INSERT INTO matches SELECT pair_id, rows, cols, "
      "data FROM two_view_geometries; DROP TABLE two_view_geometries;"
      "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY NOT NULL, "
      "rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB, config INTEGER "
      "NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB, camera1 BLOB, "
      "camera2 BLOB);"
      "DROP TABLE descriptors; CREATE TABLE descriptors (image_id INTEGER "
      "PRIMARY KEY NOT NULL, rows INTEGER NOT NULL, cols INTEGER NOT NULL, "
      "data BLOB, type INTEGER NOT NULL DEFAULT 0, FOREIGN KEY(image_id) "
      "REFERENCES images(image_id) ON DELETE CASCADE);"
      "DROP TABLE IF EXISTS pose_priors; CREATE TABLE pose_priors "
      "(pose_prior_id INTEGER PRIMARY KEY NOT NULL, corr_data_id INTEGER NOT "
      "NULL, corr_sensor_id INTEGER NOT NULL, corr_sensor_type INTEGER NOT "
      "NULL, position BLOB, position_covariance BLOB, gravity BLOB, "
      "coordinate_system INTEGER NOT NULL);"
      "PRAGMA user_version = 4020000");
  Random random(5);
  const std::vector<Keypoints> all = ReadKeypoints(&database);
  for (size_t i = 0; i < all.size(); ++i) {
    WriteKeypoints(all[i], 2 + 2 * static_cast<int>(i % 3), &database);
    WriteFloatDescriptors(all[i], &random, &database);
  }
}

std::string DescriptorsOf(const std::string& path) {
  Sqlite database(path);
  std::string bytes;
  database.ForEach(
      "SELECT image_id, type, cols, data FROM descriptors", [&](auto* row) {
        bytes += std::to_string(sqlite3_column_int(row, 1)) + " ";
        bytes.append(static_cast<const char*>(sqlite3_column_blob(row, 3)),
                     sqlite3_column_bytes(row, 3));
      });
  return bytes;
}

TEST(LearnedFeatures, AreVerifiedAndMapped) {
  const TempDir dir;
  const auto path = [&](const std::string& name) {
    return (dir.path() / name).string();
  };
  const CommandOutput simulated =
      RunMgsfm("simulate --num_frames 12 --output_path " + path("drive"));
  ASSERT_EQ(simulated.exit_code, 0) << simulated.err;
  const std::string database = path("drive/database.db");
  MakeLearned(database);
  const std::string descriptors = DescriptorsOf(database);

  const CommandOutput verified =
      RunMgsfm("geometric_verifier --database_path " + database);
  ASSERT_EQ(verified.exit_code, 0) << verified.err;
  const CommandOutput mapped = RunMgsfm("mapper --database_path " + database +
                                        " --output_path " + path("sparse"));
  ASSERT_EQ(mapped.exit_code, 0) << mapped.err;
  const CommandOutput evaluated = RunMgsfm(
      "model_evaluator --input_path " + path("sparse/0") + " --gt_path " +
      path("drive/truth") + " --json " + path("errors.json"));
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  const auto errors = nlohmann::json::parse(ReadTextFile(path("errors.json")));
  EXPECT_EQ(errors.at("num_registered"), errors.at("num_images")) << errors;
  EXPECT_LT(errors.at("position_m").at("mean"), 0.05) << errors;
  // No command changes what it cannot read.
  EXPECT_EQ(DescriptorsOf(database), descriptors);
}

TEST(LearnedFeatures, MatchersThatNeedSiftSaySo) {
  const TempDir dir;
  const std::string drive = (dir.path() / "drive").string();
  ASSERT_EQ(
      RunMgsfm("simulate --num_frames 4 --output_path " + drive).exit_code, 0);
  MakeLearned(drive + "/database.db");
  Sqlite(drive + "/database.db").Execute("DELETE FROM matches");
  const CommandOutput output =
      RunMgsfm("exhaustive_matcher --database_path " + drive + "/database.db");
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(LastWord(output), HasSubstr("are not SIFT's"));
}

}  // namespace
}  // namespace mgsfm
