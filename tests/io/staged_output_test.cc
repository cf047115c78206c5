// SPDX-License-Identifier: BSD-3-Clause
#include "files/staged_output.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <string>

#include "io/staged_output_fixtures.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST_F(StagedOutputTest, NothingIsLeftWithoutCommit) {
  for (const fs::path& target : {target_, target_ / "a" / "b"}) {
    {
      const StagedOutput output(target);
      Put(output.StagingDir() / "0" / "images.bin", "new");
      EXPECT_FALSE(fs::exists(target));
    }
    EXPECT_EQ(FilesIn(dir_.path()), Files());
  }
}

TEST_F(StagedOutputTest, OldModelStaysWithoutCommit) {
  Put(target_ / "0" / "images.bin", "old");
  Put(target_ / "report.json", "old");
  const Files before = FilesIn(dir_.path());
  {
    const StagedOutput output(target_);
    Put(output.StagingDir() / "0" / "images.bin", "new");
    EXPECT_EQ(ReadTextFile(target_ / "0" / "images.bin"), "old");
  }
  EXPECT_EQ(FilesIn(dir_.path()), before);
}

TEST_F(StagedOutputTest, ReplacesModelsAndKeepsOtherFiles) {
  Put(target_ / "0" / "images.bin", "old");
  Put(target_ / "0" / "points3D.bin", "old");
  Put(target_ / "1" / "images.txt", "old");
  fs::create_directory(target_ / "12");
  Put(target_ / "report.json", "old");
  Put(target_ / "notes.txt", "mine");
  Put(target_ / "007" / "photo.jpg", "mine");
  Put(target_ / "0_backup" / "images.bin", "mine");
  WriteNewModel(target_);
  EXPECT_EQ(FilesIn(dir_.path()), (Files{{"out/0/images.bin", "new"},
                                         {"out/report.json", "new"},
                                         {"out/notes.txt", "mine"},
                                         {"out/007/photo.jpg", "mine"},
                                         {"out/0_backup/images.bin", "mine"}}));
}

// A text model left beside a binary one would be read by some programs.
TEST_F(StagedOutputTest, AModelReplacesTheFilesOfOneOnly) {
  Put(target_ / "images.txt", "old");
  Put(target_ / "points3D.bin", "old");
  Put(target_ / "project.ini", "mine");
  Put(target_ / "notes.txt", "mine");
  Put(target_ / "0" / "images.bin", "mine");
  Put(target_ / "1" / "photo.jpg", "mine");
  {
    StagedOutput output(target_, OutputKind::kModel);
    Put(output.StagingDir() / "images.bin", "new");
    output.Commit();
  }
  EXPECT_EQ(FilesIn(dir_.path()), (Files{{"out/images.bin", "new"},
                                         {"out/project.ini", "mine"},
                                         {"out/notes.txt", "mine"},
                                         {"out/0/images.bin", "mine"},
                                         {"out/1/photo.jpg", "mine"}}));
}

TEST_F(StagedOutputTest, TakesTargetsInAllForms) {
  const Files expected = {{"0/images.bin", "new"}, {"report.json", "new"}};
  WriteNewModel(target_.string() + "/");
  EXPECT_EQ(FilesIn(target_), expected);
  WriteNewModel(target_ / "a" / ".." / "b" / "c" / "");
  EXPECT_EQ(FilesIn(target_ / "b" / "c"), expected);
  EXPECT_FALSE(fs::exists(target_ / "a"));

  // A link is followed: the folder that it points to is written.
  fs::create_directory(dir_.path() / "elsewhere");
  fs::create_directory_symlink(dir_.path() / "elsewhere", dir_.path() / "link");
  WriteNewModel(dir_.path() / "link");
  EXPECT_EQ(FilesIn(dir_.path() / "elsewhere"), expected);
  EXPECT_TRUE(fs::is_symlink(dir_.path() / "link"));
}

TEST_F(StagedOutputTest, RelativeTargetsStayWhereTheyWereGiven) {
  const fs::path previous = fs::current_path();
  fs::current_path(dir_.path());
  {
    StagedOutput output("relative");
    Put(output.StagingDir() / "0" / "images.bin", "new");
    fs::create_directory("other");
    fs::current_path("other");
    output.Commit();
  }
  fs::current_path(dir_.path() / "relative");
  WriteNewModel(".");
  fs::current_path(previous);
  EXPECT_EQ(FilesIn(dir_.path()), (Files{{"relative/0/images.bin", "new"},
                                         {"relative/report.json", "new"},
                                         {"other", ""}}));
}

TEST_F(StagedOutputTest, OthersMayReadTheModel) {
  WriteNewModel(target_);
  EXPECT_NE(fs::status(target_).permissions() & fs::perms::others_read,
            fs::perms::none);
}

TEST_F(StagedOutputTest, RefusesAFileAsTarget) {
  Put(target_, "mine");
  for (const fs::path& target : {target_, target_ / "below"}) {
    EXPECT_THAT(ErrorOf([&] { StagedOutput output(target); }),
                HasSubstr(target_.string()));
  }
  EXPECT_EQ(FilesIn(dir_.path()), (Files{{"out", "mine"}}));
}

// The sequences 00 to 21 of KITTI have such names.
TEST_F(StagedOutputTest, KeepsFoldersThatHoldNoModel) {
  Put(target_ / "10" / "image_0" / "000000.png", "mine");
  Put(target_ / "0" / "database.db", "mine");
  WriteNewModel(target_);
  EXPECT_EQ(FilesIn(target_), (Files{{"10/image_0/000000.png", "mine"},
                                     {"0/database.db", "mine"},
                                     {"0/images.bin", "new"},
                                     {"report.json", "new"}}));
}

TEST_F(StagedOutputTest, RefusesAFileInThePlaceOfAFolder) {
  Put(target_ / "0", "a file");
  EXPECT_THAT(ErrorOf([&] { StagedOutput output(target_); }),
              HasSubstr((target_ / "0").string()));
  EXPECT_EQ(FilesIn(target_), (Files{{"0", "a file"}}));
  fs::remove_all(target_);
  Put(target_ / "report.json" / "photo.jpg", "mine");
  EXPECT_THAT(ErrorOf([&] { StagedOutput output(target_); }),
              HasSubstr((target_ / "report.json").string()));
}

TEST_F(StagedOutputTest, RefusesAFolderThatCannotBeWritten) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  fs::create_directory(target_);
  fs::permissions(target_, fs::perms::owner_read | fs::perms::owner_exec);
  for (const fs::path& target : {target_, target_ / "a" / "b"}) {
    EXPECT_THAT(ErrorOf([&] { StagedOutput output(target); }),
                HasSubstr(target.string()));
  }
  fs::permissions(target_, fs::perms::owner_all);
}

// A killed process leaves such folders in the target, or beside a new one.
TEST_F(StagedOutputTest, RemovesWhatKilledRunsLeft) {
  const fs::path beside = dir_.path() / ".out.mgsfm-a1B2c3";
  Put(beside / "0" / "images.bin", "half");
  WriteNewModel(target_);
  const Files expected = {{"out/0/images.bin", "new"},
                          {"out/report.json", "new"}};
  EXPECT_EQ(FilesIn(dir_.path()), expected);

  Put(beside / "0" / "images.bin", "half");
  Put(target_ / ".out.mgsfm-xxxxxx" / "0" / "images.bin", "half");
  WriteNewModel(target_);
  EXPECT_EQ(FilesIn(dir_.path()), expected);
}

TEST_F(StagedOutputTest, KeepsFoldersOfOthersAndOfRunningProcesses) {
  const fs::path running = target_ / ".out.mgsfm-a1B2c3";
  Put(running / "0" / "images.bin", "half");
  Put(target_ / ".out.mgsfm-long_name" / "x", "mine");
  Put(target_ / ".other.mgsfm-a1B2c3" / "x", "other");
  fs::create_directory_symlink(dir_.path(), target_ / ".out.mgsfm-a_link");
  const FolderLock lock(running);
  ASSERT_EQ(lock.state(), FolderLock::State::kHeld);
  EXPECT_EQ(FolderLock(running).state(), FolderLock::State::kBusy);
  Files expected = FilesIn(target_);
  WriteNewModel(target_);
  expected["0/images.bin"] = expected["report.json"] = "new";
  EXPECT_EQ(FilesIn(target_), expected);
}

TEST_F(StagedOutputTest, FoldersThatCannotMoveAreRefused) {
  Put(target_ / "images.bin", "old");
  Put(dir_.path() / "run" / "notes.txt", "mine");
  fs::create_directory_symlink(target_, dir_.path() / "run" / "0");
  const Files before = FilesIn(dir_.path());
  EXPECT_THAT(ErrorOf([&] { StagedOutput output(dir_.path() / "run"); }),
              HasSubstr((dir_.path() / "run" / "0").string()));
  const fs::path previous = fs::current_path();
  fs::current_path(target_);
  EXPECT_THAT(ErrorOf([&] { StagedOutput output(".", OutputKind::kModel); }),
              HasSubstr("working folder"));
  fs::current_path(previous);
  EXPECT_EQ(FilesIn(dir_.path()), before);
}

// Lists of cameras and images of other programs are called like that, too.
TEST_F(StagedOutputTest, RefusesToReplaceFilesThatAreNoModel) {
  for (const char* name : {"cameras.txt", "rig_config.json"}) {
    Put(target_ / name, "mine");
    EXPECT_THAT(
        ErrorOf([&] { StagedOutput output(target_, OutputKind::kModel); }),
        HasSubstr((target_ / name).string()));
    EXPECT_EQ(FilesIn(target_), (Files{{name, "mine"}}));
    fs::remove_all(target_);
  }
}

TEST_F(StagedOutputTest, KnowsWhatItWouldReplace) {
  const auto replaces = [&](OutputKind kind, const fs::path& file) {
    return IsReplacedByOutput(target_, kind, target_ / file);
  };
  for (const OutputKind kind : {OutputKind::kRun, OutputKind::kModel}) {
    const bool is_run = kind == OutputKind::kRun;
    EXPECT_TRUE(replaces(kind, "report.json"));
    EXPECT_EQ(replaces(kind, "0/images.bin"), is_run);
    EXPECT_EQ(replaces(kind, "12/rig_config.json"), is_run);
    EXPECT_EQ(replaces(kind, "images.txt"), !is_run);
    EXPECT_FALSE(replaces(kind, "0/database.db"));
    EXPECT_FALSE(replaces(kind, "database.db"));
    EXPECT_FALSE(replaces(kind, "../images.bin"));
    EXPECT_FALSE(replaces(kind, "truth/images.bin"));
  }
}

}  // namespace
}  // namespace mgsfm
