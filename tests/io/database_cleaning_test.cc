// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_cleaning.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "database/sqlite_database.h"
#include "io/merged_databases.h"
#include "mgsfm/base/error.h"
#include "support/error_of.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(DatabaseMerging, CleaningDeletesWhatItSays) {
  using Rows = CleanedRows;
  for (const Rows rows :
       {Rows::kMatches, Rows::kFeatures, Rows::kImages, Rows::kAll}) {
    MakeDatabase("a.db", "seq1");
    CleanDatabase(Path("a.db"), rows);
    FeatureDatabase database = Open("a.db");
    EXPECT_TRUE(database.CountMatches().empty());
    EXPECT_TRUE(database.CountInlierMatches().empty());
    const size_t num_features = rows == Rows::kMatches ? 4 : 0;
    EXPECT_EQ(database.ImagesWithKeypoints().size(), num_features);
    EXPECT_EQ(database.ImagesWithDescriptors().size(), num_features);
    const DatabaseContents contents = database.ReadStructure(Context());
    const bool has_images = rows == Rows::kMatches || rows == Rows::kFeatures;
    EXPECT_EQ(contents.images.size(), has_images ? 4u : 0u);
    EXPECT_EQ(contents.frames.size(), has_images ? 2u : 0u);
    EXPECT_EQ(database.ReadPosePriors().size(), has_images ? 4u : 0u);
    EXPECT_EQ(contents.rigs.empty(), rows == Rows::kAll);
    EXPECT_EQ(contents.cameras.empty(), rows == Rows::kAll);
    fs::remove(Path("a.db"));
  }
  WriteTextFile(Path("c.db"), "no database");
  EXPECT_THROW(CleanDatabase(Path("c.db"), Rows::kAll), Error);
  EXPECT_THROW(CleanDatabase(Path("none.db"), Rows::kAll), Error);
  EXPECT_FALSE(fs::exists(Path("none.db")));
  SqliteDatabase::Create(Path("other.db")).Execute("CREATE TABLE images (a)");
  const std::string before = ReadTextFile(Path("other.db"));
  EXPECT_THAT(ErrorOf([&] { CleanDatabase(Path("other.db"), Rows::kAll); }),
              HasSubstr("is not a COLMAP database; choose another file"));
  EXPECT_EQ(ReadTextFile(Path("other.db")), before);
}

}  // namespace
}  // namespace mgsfm
