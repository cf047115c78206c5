// SPDX-License-Identifier: BSD-3-Clause
// Every value that an option may have gives a finite model, or one line that
// tells why there is none. Each option is set to both ends of its range, with
// all others at their defaults.
#include <algorithm>
#include <cmath>

#include "cli/program_runs.h"
#include "commands.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AnyOf;
using testing::Eq;
using testing::HasSubstr;
using testing::Not;

TEST(OptionRanges, AreFiniteAndContainTheDefaults) {
  for (const Command& command : AllCommands()) {
    command.list([&](const OptionList& options) {
      for (const OptionEntry& entry : options) {
        const bool is_real = std::holds_alternative<double>(entry.get());
        const bool is_count =
            std::holds_alternative<int>(entry.get()) && !entry.unit.empty();
        if (!is_real && !is_count) continue;
        const Range range = entry.UsableRange();
        EXPECT_TRUE(std::isfinite(range.min) && std::isfinite(range.max))
            << command.name << entry.name;
        EXPECT_NO_THROW(
            ParseOptionValue(entry, FormatOptionValue(entry.default_value)))
            << command.name << entry.name;
      }
    });
  }
}

// The ends of the range of a number, and all values of a choice.
std::vector<std::string> Extremes(const OptionEntry& entry) {
  if (!entry.choices.empty()) return entry.choices;
  const OptionValue value = entry.default_value;
  const Range range = entry.UsableRange();
  std::vector<OptionValue> values;
  if (std::holds_alternative<bool>(value)) {
    values = {false, true};
  } else if (std::holds_alternative<int>(value)) {
    for (const double end : {range.min, range.max}) {
      if (std::isfinite(end)) values.emplace_back(static_cast<int>(end));
    }
  } else if (std::holds_alternative<double>(value)) {
    values = {
        range.min_is_open ? std::nextafter(range.min, range.max) : range.min,
        range.max_is_open ? std::nextafter(range.max, range.min) : range.max};
  }
  std::vector<std::string> texts;
  for (const OptionValue& end : values) texts.push_back(FormatOptionValue(end));
  return texts;
}

// The default needs no run of its own: it is part of all others.
std::vector<std::string> UnusualExtremes(const OptionEntry& entry) {
  std::vector<std::string> texts = Extremes(entry);
  texts.erase(std::remove(texts.begin(), texts.end(),
                          FormatOptionValue(entry.default_value)),
              texts.end());
  return texts;
}

class OptionExtremes : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  // Runs the command with each option at each extreme. Models are at `model`.
  void Sweep(const Command& command, const std::string& arguments,
             const std::string& model, const std::string& copied_database = "",
             const std::vector<std::string>& skipped_units = {}) const {
    std::vector<std::string> flags = {""};
    command.list([&](const OptionList& options) {
      for (const OptionEntry& entry : options) {
        if (std::count(skipped_units.begin(), skipped_units.end(), entry.unit) >
            0) {
          continue;
        }
        for (const std::string& text : UnusualExtremes(entry)) {
          flags.push_back(" --" + entry.name + " " + text);
        }
      }
    });
    for (const std::string& flag : flags) {
      fs::remove_all(Path("out"));
      if (!copied_database.empty()) {
        fs::copy_file(copied_database, Path("work.db"),
                      fs::copy_options::overwrite_existing);
      }
      const CommandOutput output =
          RunMgsfm(command.name + " " + arguments + flag +
                   " --log_level error --num_threads 2");
      EXPECT_THAT(output.exit_code, AnyOf(Eq(0), Eq(1), Eq(2)))
          << command.name << flag << output.err;
      EXPECT_THAT(output.err, Not(HasSubstr("internal error"))) << flag;
      if (model.empty() || !fs::exists(model + "/images.bin")) continue;
      EXPECT_NO_THROW((void)ReadModel(model)) << command.name << flag;
    }
  }
  void MakeDrive() const {
    ASSERT_EQ(RunMgsfm("simulate --output_path " + Path("drive") +
                       " --rig stereo --num_frames 5 --num_points_per_frame "
                       "60 --max_num_features 60 --pixel_noise 0.5")
                  .exit_code,
              0);
  }

  const TempDir dir_;
};

Command CommandOf(const std::string& name) {
  const std::vector<Command> all = AllCommands();
  const auto found = std::find_if(
      all.begin(), all.end(),
      [&](const Command& command) { return command.name == name; });
  MGSFM_CHECK_MSG(found != all.end(), "no command '" + name + "'");
  return *found;
}

TEST_F(OptionExtremes, Mapper) {
  MakeDrive();
  Sweep(MapperCommand(),
        "--database_path " + Path("drive/database.db") + " --output_path " +
            Path("out"),
        Path("out/0"));
}

TEST_F(OptionExtremes, CommandsOnModels) {
  MakeDrive();
  const std::string model = "--input_path " + Path("drive/truth") + " ";
  Sweep(BundleAdjusterCommand(), model + "--output_path " + Path("out"),
        Path("out"));
  Sweep(PointTriangulatorCommand(),
        model + "--database_path " + Path("drive/database.db") +
            " --output_path " + Path("out"),
        Path("out"));
  Sweep(ModelEvaluatorCommand(), model + "--gt_path " + Path("drive/truth"),
        "");
}

TEST_F(OptionExtremes, ExtractionAndMatching) {
  const fs::path source = MGSFM_SOURCE_DIR "/data/rendered_rig/images";
  int num_images = 0;
  for (const auto& entry : fs::recursive_directory_iterator(source)) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_regular_file() || name > "000002") continue;
    const fs::path copy =
        Path("images") / entry.path().lexically_relative(source);
    fs::create_directories(copy.parent_path());
    fs::copy_file(entry.path(), copy);
    ++num_images;
  }
  ASSERT_GE(num_images, 4);
  WriteTextFile(Path("small.ini"),
                "[SiftExtraction]\nmax_image_size = 160\n"
                "max_num_features = 200\n");
  const std::string images =
      " --image_path " + Path("images") + " --config_path " + Path("small.ini");
  ASSERT_EQ(
      RunMgsfm("feature_extractor --database_path " + Path("base.db") + images)
          .exit_code,
      0);
  Sweep(CommandOf("feature_extractor"),
        "--database_path " + Path("out") + images, "");
  for (const char* name :
       {"exhaustive_matcher", "sequential_matcher", "vocab_tree_matcher"}) {
    Sweep(CommandOf(name), "--database_path " + Path("work.db"), "",
          Path("base.db"));
  }
}

TEST_F(OptionExtremes, ToolsOnModels) {
  MakeDrive();
  const std::string model = Path("drive/truth");
  const std::string output = " --output_path " + Path("out");
  Sweep(ModelAlignerCommand(),
        "--input_path " + model + " --ref_model_path " + model + output,
        Path("out"));
  Sweep(ModelMergerCommand(),
        "--input_path1 " + model + " --input_path2 " + model + output,
        Path("out"));
  Sweep(ModelConverterCommand(),
        "--input_path " + model + output + " --output_type txt", "");
}

// Larger counts make larger drives, which only memory limits.
TEST_F(OptionExtremes, Simulation) {
  WriteTextFile(Path("small.ini"),
                "num_frames = 4\nnum_points_per_frame = 20\n"
                "max_num_features = 20\n");
  Sweep(SimulateCommand(),
        "--output_path " + Path("out") + " --config_path " + Path("small.ini"),
        Path("out/truth"), "", {"frames", "points", "features", "m"});
}

}  // namespace
}  // namespace mgsfm
