// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "allocations/allocations.h"
#include "database/database_reader.h"
#include "foundation/base/sample_options.h"
#include "mgsfm/database/database.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/model_scene.h"
#include "mgsfm/models/trajectory_io.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/rigs/rig_config.h"
#include "mgsfm/simulator/simulation.h"
#include "rigs/image_times.h"
#include "support/temp_dir.h"

namespace mgsfm {

struct Reader {
  std::string name;
  std::string path;  // a file, or a folder of files
  std::function<void()> read;
};

// A file of each kind, of a simulated drive.
class SampleFiles {
 public:
  explicit SampleFiles(int num_frames) {
    static const bool is_hooked = [] {
      HookSqliteAllocations();
      return true;
    }();
    (void)is_hooked;
    SimulationOptions options;
    options.num_frames = num_frames;
    options.num_points_per_frame = 30;
    simulation_ = Simulate(options);
    // Strings of up to 15 bytes need no allocation.
    for (Image& image : simulation_.scene.images) {
      image.name = "drive_in_the_morning/" + image.name;
    }
    WriteDatabase(
        Path("a.db"),
        MakeDatabaseContents(simulation_.scene, simulation_.view_graph),
        DatabaseSchema::k312);
    for (const ModelFormat format :
         {ModelFormat::kBinary, ModelFormat::kText}) {
      const std::string folder = ModelFolder(format);
      std::filesystem::create_directory(folder);
      WriteModel(folder, simulation_.scene, simulation_.ground_truth, format);
    }
    WriteRigConfig(Path("rigs.json"), simulation_.scene,
                   simulation_.ground_truth);
    WriteTexts();
  }

  const Simulation& simulation() const { return simulation_; }

  std::vector<Reader> Readers() const {
    const std::string bin = ModelFolder(ModelFormat::kBinary);
    const std::string txt = ModelFolder(ModelFormat::kText);
    return {
        MakeReader("a.db", [](auto& path) { (void)ReadDatabase(path, {}); }),
        {"binary model", bin, [bin] { (void)ReadModel(bin); }},
        {"text model", txt, [txt] { (void)ReadModel(txt); }},
        {"scene of a model", bin, [bin] { (void)LoadModelScene(bin, {}, {}); }},
        MakeReader("rigs.json", [](auto& path) { (void)ReadRigConfig(path); }),
        MakeReader("names.txt", [](auto& path) { (void)ReadImageList(path); }),
        MakeReader("kitti.txt", [](auto& path) { (void)ReadKittiPoses(path); }),
        MakeReader("tum.txt", [](auto& path) { (void)ReadTumPoses(path); }),
        MakeReader("pairs.txt", [this](auto& path) { ReadPairs(path); }),
        MakeReader("matches.txt", [this](auto& path) { ReadMatches(path); }),
        MakeReader("positions.txt",
                   [this](auto& path) {
                     PosePriorOptions options;
                     options.ref_images_path = path;
                     (void)ReadPositionPriors(simulation_.scene, "", options);
                   }),
        MakeReader("positions.txt",
                   [this](auto& path) {
                     PosePriorOptions options;
                     options.gravity_path = path;
                     (void)ReadGravity(simulation_.scene, "", options);
                   }),
        MakeReader("times.txt",
                   [this](auto& path) {
                     Scene scene = simulation_.scene;
                     ReadImageTimestamps(path, &scene);
                   }),
        MakeReader("config.ini", [](auto& path) {
          SampleOptions options;
          LoadOptions(std::filesystem::path(path), ListOptions(&options));
        })};
  }

 private:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string ModelFolder(ModelFormat format) const {
    return Path(std::string(EnumName(format)));
  }
  template <class Function>
  Reader MakeReader(const std::string& name, const Function& read) const {
    return {name, Path(name), [path = Path(name), read] { read(path); }};
  }
  std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const Image& image : simulation_.scene.images) {
      names.push_back(image.name);
    }
    return names;
  }
  void ReadPairs(const std::string& path) const;
  void ReadMatches(const std::string& path) const;
  static SampleOptions MakeOptions() {
    SampleOptions options;
    options.input_path = std::string("a");
    options.title = std::string("a title");
    return options;
  }
  void WriteTexts() const {
    std::string names, kitti, tum, pairs, matches, positions, times;
    const std::vector<std::string> image_names = Names();
    for (size_t i = 0; i < image_names.size(); ++i) {
      const std::string& name = image_names[i];
      const std::string number = std::to_string(i + 1);
      const std::string& next = image_names[(i + 1) % image_names.size()];
      names += name + "\n";
      kitti += "1 0 0 " + number + " 0 1 0 0 0 0 1 0\n";
      tum += number + " 1 2 3 0 0 0 1\n";
      pairs += name + " " + next + "\n";
      matches += name + " " + next + "\n0 0\n1 1\n\n";
      positions += name + " " + number + " 2 3\n";
      times += name + " " +
               std::to_string(simulation_.scene.images[i].frame_idx) + "\n";
    }
    WriteTextFile(Path("names.txt"), names);
    WriteTextFile(Path("kitti.txt"), kitti);
    WriteTextFile(Path("tum.txt"), tum);
    WriteTextFile(Path("pairs.txt"), pairs);
    WriteTextFile(Path("matches.txt"), matches);
    WriteTextFile(Path("positions.txt"), positions);
    WriteTextFile(Path("times.txt"), times);
    WriteTextFile(Path("config.ini"), SampleDump(MakeOptions()));
  }

  const TempDir dir_;
  Simulation simulation_;
};

}  // namespace mgsfm
