// SPDX-License-Identifier: BSD-3-Clause
// No command replaces a file that it did not write, nor one that it reads.
#include "cli/program_runs.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class OutputSafety : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  void CopyDatabase(const std::string& name) const {
    fs::create_directories((dir_.path() / name).parent_path());
    fs::copy_file(DemoDatabase(), Path(name));
  }
  void CopyModel(const std::string& name) const {
    fs::create_directories(dir_.path() / name);
    fs::copy(DemoTruth(), dir_.path() / name, fs::copy_options::recursive);
  }
  void Put(const std::string& name) const {
    fs::create_directories((dir_.path() / name).parent_path());
    WriteTextFile(dir_.path() / name, "mine");
  }
  // One line that names the file and the option; no file has changed.
  void ExpectRefused(const std::string& arguments, const std::string& file,
                     const std::string& option) const {
    const Files before = FilesIn(dir_.path());
    const CommandOutput output = RunMgsfm(arguments);
    EXPECT_EQ(output.exit_code, 1) << arguments;
    EXPECT_THAT(LastWord(output),
                AllOf(HasSubstr(file), HasSubstr("--" + option),
                      HasSubstr("choose another")))
        << arguments << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before) << arguments;
  }

  const TempDir dir_;
};

TEST_F(OutputSafety, TheMapperReplacesOnlyTheFilesOfModels) {
  CopyDatabase("work/0/database.db");
  CopyModel("work/0");
  CopyModel("work/3");
  Put("work/0/photos/a.jpg");
  Put("work/0/images.txt");
  Put("work/notes.txt");
  const std::string database = ReadTextFile(Path("work/0/database.db"));
  const CommandOutput output =
      RunMgsfm("mapper --database_path " + Path("work/0/database.db") +
               " --output_path " + Path("work"));
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_TRUE(ReadTextFile(Path("work/0/database.db")) == database);
  EXPECT_EQ(ReadTextFile(Path("work/0/photos/a.jpg")), "mine");
  EXPECT_EQ(ReadTextFile(Path("work/notes.txt")), "mine");
  EXPECT_TRUE(fs::exists(Path("work/0/rig_config.json")));
  EXPECT_FALSE(fs::exists(Path("work/0/images.txt")));
  EXPECT_FALSE(fs::exists(Path("work/3")));
}

TEST_F(OutputSafety, AnAdjustedModelStaysAmongOtherFiles) {
  CopyDatabase("work/0/database.db");
  CopyModel("work/0");
  Put("work/0/photos/a.jpg");
  Put("work/0/points3D.txt");
  const std::string database = ReadTextFile(Path("work/0/database.db"));
  const CommandOutput output =
      RunMgsfm("bundle_adjuster --input_path " + Path("work/0") +
               " --output_path " + Path("work/0"));
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_TRUE(ReadTextFile(Path("work/0/database.db")) == database);
  EXPECT_EQ(ReadTextFile(Path("work/0/photos/a.jpg")), "mine");
  EXPECT_FALSE(fs::exists(Path("work/0/points3D.txt")));
}

TEST_F(OutputSafety, InputsOfTheMapperAreNotReplaced) {
  CopyModel("out/0");
  CopyDatabase("in.db");
  CopyDatabase("report/report.json");
  Put("out/1/images.txt");
  const std::string mapper = "mapper --database_path " + Path("in.db") +
                             " --output_path " + Path("out") + " ";
  ExpectRefused(mapper + "--input_path " + Path("out/0"), Path("out/0/"),
                "input_path");
  ExpectRefused(mapper + "--rig_config_path " + Path("out/0"), Path("out/0/"),
                "rig_config_path");
  for (const char* option : {"image_list_path", "image_timestamps_path",
                             "gravity_path", "ref_images_path"}) {
    ExpectRefused(mapper + "--" + option + " " + Path("out/1/images.txt"),
                  Path("out/1/images.txt"), option);
  }
  fs::create_directory_symlink(Path("out"), Path("link"));
  ExpectRefused(mapper + "--image_list_path " + Path("link/1/images.txt"),
                "images.txt", "image_list_path");
  ExpectRefused("mapper --database_path " + Path("report/report.json") +
                    " --output_path " + Path("report"),
                Path("report/report.json"), "database_path");
  WriteTextFile(Path("out/0/cameras.txt"), "num_threads = 1\n");
  ExpectRefused(mapper + "--config_path " + Path("out/0/cameras.txt"),
                Path("out/0/cameras.txt"), "config_path");
}

TEST_F(OutputSafety, InputsOfOtherCommandsAreNotReplaced) {
  CopyModel("model");
  CopyDatabase("in.db");
  WriteTextFile(Path("model/frames.txt"), "num_threads = 1\n");
  const std::string config = " --config_path " + Path("model/frames.txt");
  ExpectRefused("bundle_adjuster --input_path " + DemoTruth() +
                    " --output_path " + Path("model") + config,
                Path("model/frames.txt"), "config_path");
  ExpectRefused("point_triangulator --database_path " + Path("in.db") +
                    " --input_path " + DemoTruth() + " --output_path " +
                    Path("model") + config,
                Path("model/frames.txt"), "config_path");
  for (const char* option : {"json", "svg_path"}) {
    const std::string evaluator = "model_evaluator --input_path " +
                                  Path("model") + " --gt_path " + DemoTruth() +
                                  " --" + option + " ";
    ExpectRefused(evaluator + Path("model/images.bin"),
                  Path("model/images.bin"), option);
    ExpectRefused(
        evaluator + Path("in.db") + " --database_path " + Path("in.db"),
        Path("in.db"), option);
  }
  fs::create_directories(Path("images"));
  WriteTextFile(Path("empty.txt"), "");
  ExpectRefused("feature_extractor --image_path " + Path("images") +
                    " --database_path " + Path("empty.txt") +
                    " --config_path " + Path("empty.txt"),
                Path("empty.txt"), "config_path");
  Put("drive/cameras.txt");
  ExpectRefused("simulate --output_path " + Path("drive") +
                    " --trajectory_path " + Path("drive/cameras.txt"),
                Path("drive/cameras.txt"), "trajectory_path");
}

TEST_F(OutputSafety, TablesAndPlotsAreFilesOfTheirOwn) {
  const std::string evaluator = "model_evaluator --input_path " + DemoTruth() +
                                " --gt_path " + DemoTruth();
  CopyModel("other");
  for (const char* option : {"json", "svg_path"}) {
    ExpectRefused(evaluator + " --" + option + " " + Path("other/images.bin"),
                  Path("other/images.bin"), option);
  }
  ExpectRefused(
      evaluator + " --json " + Path("a") + " --svg_path " + Path("other/../a"),
      Path("a"), "json");
}

// A mistyped path must not cost a database or an image.
TEST_F(OutputSafety, FilesReplaceNoDatabaseAndNoImage) {
  CopyDatabase("other.db");
  fs::create_directories(Path("images"));
  WriteTextFile(Path("images/a.pgm"), "P5 2 1 255\nab");
  const std::string model = " --input_path " + DemoTruth();
  for (const std::string file : {"other.db", "images/a.pgm"}) {
    for (const std::string option : {"json", "svg_path"}) {
      ExpectRefused("model_evaluator" + model + " --gt_path " + DemoTruth() +
                        " --" + option + " " + Path(file),
                    Path(file), option);
    }
    const std::string output = " --output_path " + Path(file);
    ExpectRefused("report" + model + " --image_path " + Path("images") + output,
                  Path(file), "output_path");
    ExpectRefused("model_converter --output_type ply" + model + output,
                  Path(file), "output_path");
    ExpectRefused("exhaustive_matcher --database_path " + DemoDatabase() +
                      " --output_pairs_path " + Path(file),
                  Path(file), "output_pairs_path");
    ExpectRefused("vocab_tree_builder --database_path " + DemoDatabase() +
                      " --vocab_tree_path " + Path(file),
                  Path(file), "vocab_tree_path");
  }
}

}  // namespace
}  // namespace mgsfm
