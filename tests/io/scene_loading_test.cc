// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/scene_loading.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <set>

#include "io/test_database.h"
#include "mgsfm/rigs/rig_config.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

using Names = std::vector<std::string>;

LoadedScene Load(const DatabaseContents& contents,
                 const std::string& rule = "auto") {
  return LoadScene(contents, LoadingBy(rule), Context());
}

Scene LoadNames(const Names& names, const std::string& rule = "auto") {
  return Load(MakeContents(names), rule).scene;
}

std::string LoadError(const DatabaseContents& contents,
                      const std::string& rule = "auto") {
  return ErrorOf([&] { (void)Load(contents, rule); });
}

// The names of the sensors of each rig, the reference first.
std::vector<Names> Rigs(const Scene& scene) {
  std::vector<Names> rigs;
  for (const Rig& rig : scene.rigs) {
    rigs.push_back({scene.sensors[rig.ref_sensor_idx].name});
    for (const int sensor_idx : rig.sensor_idxs) {
      if (sensor_idx == rig.ref_sensor_idx) continue;
      rigs.back().push_back(scene.sensors[sensor_idx].name);
    }
  }
  return rigs;
}

void ExpectSameScene(const Scene& a, const Scene& b, bool with_frame_names) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (size_t i = 0; i < a.cameras.size(); ++i) {
    EXPECT_EQ(a.cameras[i].model, b.cameras[i].model);
    EXPECT_EQ(a.cameras[i].params, b.cameras[i].params);
  }
  ASSERT_EQ(a.sensors.size(), b.sensors.size());
  for (size_t i = 0; i < a.sensors.size(); ++i) {
    EXPECT_EQ(a.sensors[i].name, b.sensors[i].name);
    EXPECT_EQ(a.sensors[i].rig_idx, b.sensors[i].rig_idx);
    EXPECT_EQ(a.sensors[i].camera_idx, b.sensors[i].camera_idx);
    EXPECT_EQ(a.sensors[i].sensor_from_rig.has_value(),
              b.sensors[i].sensor_from_rig.has_value());
  }
  EXPECT_EQ(Rigs(a), Rigs(b));
  EXPECT_EQ(NamesOfFrames(a), NamesOfFrames(b));
  for (size_t i = 0; with_frame_names && i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].name, b.frames[i].name);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].camera_idx, b.images[i].camera_idx);
    EXPECT_EQ(a.images[i].sensor_idx, b.images[i].sensor_idx);
    EXPECT_EQ(a.images[i].keypoints_px, b.images[i].keypoints_px);
  }
}

// Equal to the bit but for what an inversion rounds.
void ExpectSameViewGraph(const ViewGraph& a, const ViewGraph& b) {
  ASSERT_EQ(a.pairs.size(), b.pairs.size());
  for (size_t i = 0; i < a.pairs.size(); ++i) {
    EXPECT_EQ(a.pairs[i].image_idx1, b.pairs[i].image_idx1);
    EXPECT_EQ(a.pairs[i].image_idx2, b.pairs[i].image_idx2);
    EXPECT_EQ(a.pairs[i].config, b.pairs[i].config);
    EXPECT_EQ(a.pairs[i].F, b.pairs[i].F);
    EXPECT_EQ(a.pairs[i].E, b.pairs[i].E);
    EXPECT_TRUE(a.pairs[i].H->isApprox(*b.pairs[i].H, 1e-12));
    EXPECT_LT(AngleBetween(a.pairs[i].relative_pose->cam2_from_cam1,
                           b.pairs[i].relative_pose->cam2_from_cam1),
              1e-12);
    EXPECT_TRUE(a.pairs[i].relative_pose->translation_direction->isApprox(
        *b.pairs[i].relative_pose->translation_direction, 1e-12));
    ExpectSameMatches(a.pairs[i].matches, b.pairs[i].matches);
  }
}

template <class T>
void Shuffle(std::vector<T>* items, Random* random) {
  for (size_t i = items->size(); i > 1; --i) {
    std::swap((*items)[i - 1],
              (*items)[random->Index(static_cast<uint32_t>(i))]);
  }
}

// The same database under other ids and with its rows in another order.
DatabaseContents Renumber(DatabaseContents contents, uint64_t seed) {
  Random random(seed);
  std::vector<uint32_t> ids(contents.images.size() + contents.cameras.size());
  std::iota(ids.begin(), ids.end(), 5u);
  Shuffle(&ids, &random);
  std::map<ImageId, ImageId> image_ids;
  std::map<CameraId, CameraId> camera_ids;
  for (ImageRow& image : contents.images) {
    image_ids.emplace(image.id, ImageId(ids.back()));
    image.id = ImageId(ids.back());
    ids.pop_back();
  }
  for (Camera& camera : contents.cameras) {
    camera_ids.emplace(camera.id, CameraId(ids.back() * 1000));
    camera.id = CameraId(ids.back() * 1000);
    ids.pop_back();
  }
  for (ImageRow& image : contents.images) {
    image.camera_id = camera_ids.at(image.camera_id);
  }
  for (TwoViewGeometryRow& pair : contents.pairs) {
    pair.image_id1 = image_ids.at(pair.image_id1);
    pair.image_id2 = image_ids.at(pair.image_id2);
    if (pair.image_id2 < pair.image_id1) SwapImages(&pair);
  }
  Shuffle(&contents.images, &random);
  Shuffle(&contents.cameras, &random);
  Shuffle(&contents.pairs, &random);
  return contents;
}

const Names kStereo = {"cam1/0.png", "cam0/0.png", "cam0/1.png",
                       "cam1/1.png", "cam1/2.png", "phone/7.png"};

TEST(FolderInferenceTest, FoldersAreCamerasAndFilesAreFrames) {
  const Scene scene = LoadNames(kStereo);
  EXPECT_THAT(Rigs(scene), ElementsAre(Names{"cam1", "cam0"}, Names{"phone"}));
  EXPECT_THAT(NamesOfFrames(scene),
              ElementsAre(Names{"cam0/0.png", "cam1/0.png"},
                          Names{"cam0/1.png", "cam1/1.png"},
                          Names{"cam1/2.png"}, Names{"phone/7.png"}));
  EXPECT_EQ(scene.frames[0].name, "0");
  EXPECT_FALSE(scene.sensors[0].sensor_from_rig.has_value());
  EXPECT_TRUE(scene.sensors[1].sensor_from_rig.has_value());
}

TEST(FolderInferenceTest, OneFolderIsARigOfOne) {
  for (const std::string folder : {"", "cam0/", "a/b/"}) {
    const Scene scene = LoadNames({folder + "0.png", folder + "1.png"});
    EXPECT_EQ(scene.rigs.size(), 1u);
    EXPECT_EQ(scene.sensors.size(), 1u);
    EXPECT_EQ(scene.frames.size(), 2u);
  }
}

TEST(FolderInferenceTest, FoldersWithoutCommonNamesShareNothing) {
  const Scene scene = LoadNames({"a/0.png", "b/1.png", "c/2.png", "3.png"});
  EXPECT_EQ(scene.rigs.size(), 4u);
  EXPECT_EQ(scene.frames.size(), 4u);
}

TEST(FolderInferenceTest, EqualNamesInSubsequencesAreDifferentFrames) {
  for (const bool camera_is_first : {true, false}) {
    Names names;
    for (const std::string camera : {"cam1", "cam2"}) {
      for (const std::string sequence : {"seqA", "seqB", "seqC"}) {
        const std::string folder =
            camera_is_first ? camera + "/" + sequence : sequence + "/" + camera;
        names.push_back(folder + "/0001.jpg");
        names.push_back(folder + "/0002.jpg");
      }
    }
    const Scene scene = LoadNames(names);
    EXPECT_THAT(Rigs(scene), ElementsAre(Names{"cam1", "cam2"}));
    EXPECT_EQ(scene.frames.size(), 6u);
    for (const Names& frame : NamesOfFrames(scene)) EXPECT_EQ(frame.size(), 2u);
  }
}

TEST(FolderInferenceTest, SharedFramesTellTheLevelOfCameras) {
  Names names;
  for (const std::string camera : {"x", "y"}) {
    for (int i = 0; i < 5; ++i) {
      names.push_back("a/" + camera + "/data/" + std::to_string(i) + ".png");
    }
    names.push_back("b/" + camera + "/data/0.png");
  }
  EXPECT_THAT(Rigs(LoadNames(names)), ElementsAre(Names{"x", "y"}));
}

TEST(FolderInferenceTest, IntrinsicsTellTheLevelOfCameras) {
  const Names names = {"a/x/0.png", "a/y/0.png", "b/x/0.png", "b/y/0.png"};
  DatabaseContents contents = MakeContents(names);
  EXPECT_THAT(LoadError(contents), testing::AllOf(HasSubstr("'a' or 'x'"),
                                                  HasSubstr("rig_name_rule")));
  contents.cameras[1].params[0] = contents.cameras[3].params[0] = 700.0;
  EXPECT_THAT(Rigs(Load(contents).scene), ElementsAre(Names{"x", "y"}));
}

TEST(FolderInferenceTest, DifferentCamerasOfOneNameAreOfDifferentRigs) {
  const Names names = {"one/cam0/0.png", "one/cam1/0.png", "two/cam0/0.png",
                       "two/cam1/0.png", "one/cam0/1.png", "two/cam1/1.png"};
  EXPECT_THAT(Rigs(LoadNames(names)), ElementsAre(Names{"cam0", "cam1"}));
  DatabaseContents contents = MakeContents(names);
  contents.cameras[2].params[0] = 800.0;
  EXPECT_THAT(Rigs(Load(contents).scene),
              ElementsAre(Names{"one/cam0", "one/cam1"},
                          Names{"two/cam1", "two/cam0"}));
}

TEST(FolderInferenceTest, SharedIntrinsicsAreDifferentSensors) {
  DatabaseContents contents = MakeContents(kStereo);
  for (ImageRow& image : contents.images) image.camera_id = CameraId(2);
  const Scene scene = Load(contents).scene;
  ASSERT_EQ(scene.cameras.size(), 1u);
  EXPECT_EQ(scene.cameras[0].id, CameraId(2));
  ASSERT_EQ(scene.sensors.size(), 3u);
  for (const Sensor& sensor : scene.sensors) EXPECT_EQ(sensor.camera_idx, 0);
}

TEST(FolderInferenceTest, EqualCamerasOfAFolderAreJoined) {
  DatabaseContents contents = MakeContents(kStereo);
  Camera other = contents.cameras[0];
  other.id = CameraId(50);
  contents.cameras.push_back(other);
  FindImage(&contents, "cam1/1.png").camera_id = other.id;
  std::vector<std::string> warnings;
  Context context;
  context.log = [&](LogLevel level, const std::string& message) {
    if (level == LogLevel::kWarning) warnings.push_back(message);
  };
  const Scene scene = LoadScene(contents, {}, context).scene;
  EXPECT_EQ(scene.cameras.size(), 3u);
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("'cam1'")));

  contents.cameras.back().params[0] += 1.0;
  EXPECT_THAT(LoadError(contents),
              testing::AllOf(HasSubstr("cam1/1.png"),
                             HasSubstr("single_camera_per_folder")));
  EXPECT_EQ(Load(contents, "none").scene.cameras.size(), 4u);
}

TEST(FolderInferenceTest, ImagesOfRigsOfOneKeepTheirCameras) {
  DatabaseContents contents = MakeContents({"0.png", "1.png", "2.png"});
  contents.cameras.push_back(contents.cameras[0]);
  contents.cameras.back().id = CameraId(9);
  contents.cameras.back().params[0] = 900.0;
  contents.images[1].camera_id = CameraId(9);
  const Scene scene = Load(contents).scene;
  EXPECT_EQ(scene.rigs.size(), 2u);
  EXPECT_EQ(scene.cameras[scene.images[1].camera_idx].params[0], 900.0);
}

TEST(FolderInferenceTest, ExtensionsMayDiffer) {
  EXPECT_EQ(LoadNames({"cam0/0.png", "cam1/0.jpg"}).frames.size(), 1u);
  EXPECT_EQ(LoadNames({"cam0/0.png", "cam0/0.jpg"}).frames.size(), 2u);
}

TEST(RuleInferenceTest, NoneMakesSingleImages) {
  const Scene scene = LoadNames(kStereo, "none");
  EXPECT_EQ(scene.rigs.size(), 3u);
  EXPECT_EQ(scene.frames.size(), kStereo.size());
}

TEST(RuleInferenceTest, GroupsTellCameraFrameAndRig) {
  Scene scene = LoadNames({"left_0.png", "right_0.png", "right_1.png"},
                          "(?<camera>left|right)_.*");
  EXPECT_THAT(Rigs(scene), ElementsAre(Names{"right", "left"}));
  EXPECT_EQ(scene.frames.size(), 2u);

  scene = LoadNames({"a-0_x.png", "b-0_y.png", "b-1_x.png"},
                    R"((?<camera>[(a-z])-(?<frame>\d+)_(x|y)\.png)");
  EXPECT_THAT(Rigs(scene), ElementsAre(Names{"b", "a"}));
  EXPECT_EQ(scene.frames.size(), 2u);

  scene = LoadNames({"car/s/a/0.png", "car/s/b/0.png", "car/t/a/0.png",
                     "van/s/a/0.png", "van/s/b/0.png"},
                    "(?<rig>[^/]+)/(?<frame>[^/]+)/(?<camera>.)/(?<frame>.*)");
  EXPECT_THAT(Rigs(scene), ElementsAre(Names{"a", "b"}, Names{"a", "b"}));
  EXPECT_THAT(NamesOfFrames(scene),
              ElementsAre(Names{"car/s/a/0.png", "car/s/b/0.png"},
                          Names{"car/t/a/0.png"},
                          Names{"van/s/a/0.png", "van/s/b/0.png"}));
}

// With backtracking, such rules would take longer than the universe is old.
TEST(RuleInferenceTest, TakesLinearTime) {
  const std::string name = std::string(4000, 'a') + "!";
  for (const char* rule :
       {"(?<camera>(a+)+)b", "(?<camera>(a|a?)+)b", "(?<camera>(a*)*)*b"}) {
    EXPECT_THAT(LoadError(MakeContents({name}), rule),
                HasSubstr("does not match"));
  }
  EXPECT_EQ(LoadNames({name}, "(?P<camera>(a+)+)!").sensors[0].name.size(), 0u);
}

TEST(RuleInferenceTest, NamesWhatIsWrong) {
  const DatabaseContents contents = MakeContents(kStereo);
  EXPECT_THAT(LoadError(contents, "(?<camera>cam.)/.*"),
              HasSubstr("'phone/7.png'"));
  EXPECT_THAT(LoadError(contents, "(?<cam>.*)/.*"), HasSubstr("'cam'"));
  EXPECT_THAT(LoadError(contents, "(.*)/.*"), HasSubstr("no group"));
  EXPECT_THAT(LoadError(contents, "\\(?<camera>x"), HasSubstr("no group"));
  EXPECT_THAT(LoadError(contents, "(?<camera>.*"), HasSubstr("expression"));
  EXPECT_THAT(LoadError(contents, "(?<camera"), HasSubstr("'>'"));
  EXPECT_THAT(LoadError(MakeContents({"a/0_0.png", "a/0_1.png", "b/0_0.png"}),
                        "(?<camera>.)/(?<frame>.)_.*"),
              testing::AllOf(HasSubstr("a/0_0.png"), HasSubstr("a/0_1.png")));
}

// kStereo with the rig in the tables; cam0 is the reference.
DatabaseContents StereoWithTables() {
  DatabaseContents contents = MakeContents(kStereo);
  const auto id_of = [&](const std::string& name) {
    return FindImage(&contents, name).id;
  };
  contents.rigs.push_back(
      {RigId(6),
       CameraId(2),
       {{CameraId(1), Rigid3{ExpSO3({0, 0.1, 0}), Eigen::Vector3d(1, 0, 0)}},
        {CameraId(2), Rigid3()}}});
  contents.rigs.push_back({RigId(2), CameraId(3), {{CameraId(3), Rigid3()}}});
  contents.frames = {
      {FrameId(11),
       RigId(6),
       {{CameraId(1), id_of("cam1/0.png")},
        {CameraId(2), id_of("cam0/0.png")}}},
      {FrameId(4),
       RigId(6),
       {{CameraId(1), id_of("cam1/2.png")},
        {CameraId(2), id_of("cam0/1.png")}}},
      {FrameId(5), RigId(6), {{CameraId(1), id_of("cam1/1.png")}}},
      {FrameId(8), RigId(2), {{CameraId(3), id_of("phone/7.png")}}}};
  return contents;
}

TEST(TableRigsTest, TablesGoBeforeNames) {
  const LoadedScene loaded = Load(StereoWithTables());
  const Scene& scene = loaded.scene;
  EXPECT_THAT(loaded.rig_source, HasSubstr("database"));
  EXPECT_THAT(Rigs(scene), ElementsAre(Names{"cam0", "cam1"}, Names{"phone"}));
  EXPECT_THAT(NamesOfFrames(scene),
              ElementsAre(Names{"cam0/0.png", "cam1/0.png"},
                          Names{"cam0/1.png", "cam1/2.png"},
                          Names{"cam1/1.png"}, Names{"phone/7.png"}));
  EXPECT_EQ(scene.rigs[0].id, RigId(6));
  EXPECT_EQ(scene.frames[1].id, FrameId(4));
  EXPECT_EQ(scene.sensors[1].sensor_from_rig->translation.x(), 1.0);
}

TEST(TableRigsTest, TrivialTablesSayNothing) {
  DatabaseContents contents = MakeContents(kStereo);
  const Scene expected = Load(contents).scene;
  for (const Camera& camera : contents.cameras) {
    contents.rigs.push_back(
        {RigId(camera.id.value()), camera.id, {{camera.id, Rigid3()}}});
  }
  for (const ImageRow& image : contents.images) {
    contents.frames.push_back({FrameId(image.id.value()),
                               RigId(image.camera_id.value()),
                               {{image.camera_id, image.id}}});
  }
  ExpectSameScene(Load(contents).scene, expected, true);
}

TEST(TableRigsTest, AReferenceWithoutImagesIsReplaced) {
  DatabaseContents contents = StereoWithTables();
  const Rigid3 cam1_from_rig{ExpSO3({0.1, 0, 0}), Eigen::Vector3d(0, 2, 0)};
  const Rigid3 cam0_from_rig{ExpSO3({0, 0.3, 0}), Eigen::Vector3d(1, 1, 0)};
  for (const bool reference_is_camera : {true, false}) {
    RigRow& rig = contents.rigs[0];
    rig.sensors = {{CameraId(1), cam1_from_rig}, {CameraId(2), cam0_from_rig}};
    rig.ref_camera_id.reset();
    if (reference_is_camera) {
      rig.ref_camera_id = CameraId(40);
      rig.sensors.push_back({CameraId(40), Rigid3()});
    }
    const Scene scene = Load(contents).scene;
    EXPECT_THAT(Rigs(scene)[0], ElementsAre("cam1", "cam0"));
    const Rigid3 expected = cam0_from_rig * cam1_from_rig.Inverse();
    EXPECT_LT(
        (scene.sensors[0].sensor_from_rig->translation - expected.translation)
            .norm(),
        1e-12);
  }
}

TEST(TableRigsTest, NamesWhatIsWrong) {
  DatabaseContents contents = StereoWithTables();
  contents.frames[2].data.clear();
  EXPECT_THAT(LoadError(contents), HasSubstr("rigs, such as 'cam1/1.png'"));
  contents = StereoWithTables();
  contents.frames[2].data.push_back(contents.frames[0].data[1]);
  EXPECT_THAT(LoadError(contents), HasSubstr("'cam0/0.png' is in two frames"));
  contents = StereoWithTables();
  contents.frames[2].rig_id = RigId(77);
  EXPECT_THAT(LoadError(contents), HasSubstr("rig 77"));
  contents = StereoWithTables();
  contents.frames[2].data[0].camera_id = CameraId(3);
  EXPECT_THAT(LoadError(contents), HasSubstr("camera 3"));
  contents = StereoWithTables();
  contents.cameras[0].params[0] += 1.0;
  std::swap(contents.frames[0].data[0].camera_id,
            contents.frames[0].data[1].camera_id);
  EXPECT_THAT(LoadError(contents), HasSubstr("has other intrinsics"));
  contents = StereoWithTables();
  contents.frames[2].data[0].image_id = ImageId(99);
  EXPECT_THAT(LoadError(contents), HasSubstr("image 99"));
  contents = StereoWithTables();
  contents.frames[0].data.push_back(contents.frames[2].data[0]);
  contents.frames[2].data.clear();
  EXPECT_THAT(LoadError(contents),
              testing::AllOf(HasSubstr("cam1/0.png"), HasSubstr("cam1/1.png"),
                             HasSubstr("one frame")));
}

TEST(TableRigsTest, SensorNamesTellThemApart) {
  const auto sensor_names = [](const Names& names) {
    DatabaseContents contents = MakeContents(names);
    RigRow rig{RigId(1), CameraId(101), {}};
    for (uint32_t i = 0; i < 2; ++i) {
      rig.sensors.push_back({CameraId(101 + i), std::nullopt});
      for (uint32_t j = 0; j < 2; ++j) {
        if (i == 0) contents.frames.push_back({FrameId(j), RigId(1), {}});
        contents.frames[j].data.push_back(
            {CameraId(101 + i), contents.images[2 * i + j].id});
      }
    }
    contents.rigs.push_back(rig);
    return Rigs(Load(contents).scene);
  };
  EXPECT_THAT(sensor_names({"c0/0.png", "c0/1.png", "c1/0.png", "c1/1.png"}),
              ElementsAre(Names{"c0", "c1"}));
  EXPECT_THAT(
      sensor_names({"s/a/0.png", "t/a/0.png", "s/b/0.png", "t/b/0.png"}),
      ElementsAre(Names{"a", "b"}));
  EXPECT_THAT(sensor_names({"l_0.png", "l_1.png", "r_0.png", "r_1.png"}),
              ElementsAre(Names{"l", "r"}));
  EXPECT_THAT(sensor_names({"0.png", "1.png", "2.png", "3.png"}),
              ElementsAre(Names{"sensor1", "sensor2"}));
}

class SceneLoadingTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  TempDir dir_;
};

TEST_F(SceneLoadingTest, ConfigGoesBeforeTables) {
  RigConfig rig;
  rig.cameras.resize(2);
  rig.cameras[0].image_prefix = "cam1/";
  rig.cameras[0].is_reference = true;
  rig.cameras[1].image_prefix = "cam0/";
  rig.cameras[1].camera_model = CameraModelId::kPinhole;
  rig.cameras[1].camera_params = {600.0, 601.0, 320.0, 240.0};
  WriteRigConfig(Path("rig.json"), {rig});
  DatabaseContents contents = StereoWithTables();
  for (ImageRow& image : contents.images) image.camera_id = CameraId(1);
  const LoadedScene loaded =
      LoadScene(contents, LoadingBy("none", Path("rig.json")), Context());
  const Scene& scene = loaded.scene;
  EXPECT_THAT(loaded.rig_source, HasSubstr("rig.json"));
  EXPECT_THAT(Rigs(scene), ElementsAre(Names{"cam1", "cam0"}, Names{"phone"}));
  EXPECT_EQ(scene.frames.size(), 4u);
  // The replaced intrinsics are a camera of their own.
  const int camera0 = scene.sensors[0].camera_idx;
  const int camera1 = scene.sensors[1].camera_idx;
  EXPECT_EQ(scene.cameras.size(), 2u);
  EXPECT_EQ(scene.cameras[camera0].params[1], 601.0);
  EXPECT_TRUE(scene.cameras[camera0].has_prior_focal_length);
  EXPECT_EQ(scene.cameras[camera1].model, CameraModelId::kSimpleRadial);
  EXPECT_FALSE(scene.cameras[camera0].id == scene.cameras[camera1].id);
}

TEST_F(SceneLoadingTest, IdsAndRowOrderDoNotMatter) {
  DatabaseContents contents =
      MakeContents({"cam1/0.png", "cam0/0.png", "cam0/1.png", "cam1/1.png",
                    "cam2/1.png", "cam2/5.png", "s/left/3.png", "s/right/3.png",
                    "s/right/4.png", "s/left/4.png", "single.png"});
  for (size_t i = 0; i < contents.cameras.size(); ++i) {
    contents.cameras[i].params[0] += static_cast<double>(i);
  }
  const LoadedScene expected = Load(contents);
  EXPECT_EQ(expected.scene.rigs.size(), 3u);
  for (uint64_t seed = 0; seed < 5; ++seed) {
    const DatabaseContents renumbered = Renumber(contents, seed);
    const LoadedScene loaded = Load(renumbered);
    ExpectSameScene(loaded.scene, expected.scene, true);
    ExpectSameViewGraph(loaded.view_graph, expected.view_graph);
    for (const Image& image : loaded.scene.images) {
      const auto row = std::find_if(
          renumbered.images.begin(), renumbered.images.end(),
          [&](const ImageRow& other) { return other.name == image.name; });
      EXPECT_EQ(image.id, row->id);
      EXPECT_EQ(loaded.scene.cameras[image.camera_idx].id, row->camera_id);
    }
  }
}

TEST_F(SceneLoadingTest, ThreadsDoNotMatter) {
  WriteDatabase(Path("a.db"), MakeContents(kStereo), DatabaseSchema::k38);
  const LoadedScene expected = LoadScene(Path("a.db"), {}, Context());
  Context context;
  context.num_threads = 3;
  const LoadedScene loaded = LoadScene(Path("a.db"), {}, context);
  ExpectSameScene(loaded.scene, expected.scene, true);
  ExpectSameViewGraph(loaded.view_graph, expected.view_graph);
}

TEST_F(SceneLoadingTest, SchemasGiveTheSameScene) {
  // The same rig from names in the old schema and from tables in the new.
  const LoadedScene from_names = Load(MakeContents(kStereo));
  const DatabaseContents contents =
      MakeDatabaseContents(from_names.scene, from_names.view_graph);
  WriteDatabase(Path("38.db"), contents, DatabaseSchema::k38);
  WriteDatabase(Path("312.db"), contents, DatabaseSchema::k312);
  const LoadedScene old_schema = LoadScene(Path("38.db"), {}, Context());
  const LoadedScene new_schema = LoadScene(Path("312.db"), {}, Context());
  EXPECT_EQ(old_schema.rig_source, "image names");
  EXPECT_NE(new_schema.rig_source, "image names");
  ExpectSameScene(old_schema.scene, from_names.scene, true);
  ExpectSameScene(new_schema.scene, from_names.scene, true);
  ExpectSameViewGraph(old_schema.view_graph, from_names.view_graph);
  ExpectSameViewGraph(new_schema.view_graph, from_names.view_graph);
}

TEST_F(SceneLoadingTest, SharedIntrinsicsSurviveTheTables) {
  DatabaseContents contents = MakeContents(kStereo);
  for (ImageRow& image : contents.images) image.camera_id = CameraId(1);
  const LoadedScene expected = Load(contents);
  WriteDatabase(Path("a.db"),
                MakeDatabaseContents(expected.scene, expected.view_graph),
                DatabaseSchema::k312);
  const LoadedScene loaded = LoadScene(Path("a.db"), {}, Context());
  EXPECT_EQ(loaded.scene.cameras.size(), 1u);
  ExpectSameScene(loaded.scene, expected.scene, true);
}

TEST_F(SceneLoadingTest, PairsAreSortedAndKeptWithMatchesOnly) {
  DatabaseContents contents = MakeContents({"c.png", "b.png", "a.png"});
  contents.pairs[0].matches.clear();
  contents.pairs[1].cam2_from_cam1->translation.setZero();
  contents.pairs[2].config = TwoViewConfig::kWatermark;
  contents.pairs[2].cam2_from_cam1.reset();
  const ViewGraph view_graph = Load(contents).view_graph;
  ASSERT_EQ(view_graph.pairs.size(), 2u);
  const ImagePair& ab = view_graph.pairs[0];
  EXPECT_EQ(ab.image_idx1, 0);
  EXPECT_EQ(ab.image_idx2, 1);
  EXPECT_EQ(ab.config, TwoViewConfig::kWatermark);
  EXPECT_FALSE(ab.relative_pose.has_value());
  EXPECT_EQ(ab.matches[3].keypoint_idx1,
            contents.pairs[2].matches[3].keypoint_idx2);
  EXPECT_EQ(*ab.F, contents.pairs[2].F->transpose());
  const ImagePair& ac = view_graph.pairs[1];
  EXPECT_EQ(ac.image_idx2, 2);
  ASSERT_TRUE(ac.relative_pose.has_value());
  EXPECT_FALSE(ac.relative_pose->translation_direction.has_value());
}

TEST_F(SceneLoadingTest, MatchesWithoutGeometriesHaveTheSameOrder) {
  const DatabaseContents contents =
      Renumber(MakeContents({"c.png", "b.png", "a.png", "d.png"}), 1);
  WriteDatabase(Path("a.db"), contents, DatabaseSchema::k38);
  const LoadedScene expected = LoadScene(Path("a.db"), {}, Context());
  DatabaseSelection selection;
  selection.has_geometries = false;
  const LoadedMatches loaded = LoadMatches(
      ReadDatabase(Path("a.db"), Context(), selection), {}, Context());
  ExpectSameScene(loaded.scene, expected.scene, true);
  ASSERT_EQ(loaded.pairs.size(), expected.view_graph.pairs.size());
  for (size_t i = 0; i < loaded.pairs.size(); ++i) {
    const ImagePair& pair = expected.view_graph.pairs[i];
    EXPECT_EQ(loaded.pairs[i].image_idx1, pair.image_idx1);
    EXPECT_EQ(loaded.pairs[i].image_idx2, pair.image_idx2);
    ASSERT_EQ(loaded.pairs[i].matches.size(), pair.matches.size());
    for (size_t k = 0; k < pair.matches.size(); ++k) {
      EXPECT_EQ(loaded.pairs[i].matches[k].keypoint_idx1,
                pair.matches[k].keypoint_idx1);
      EXPECT_EQ(loaded.pairs[i].matches[k].keypoint_idx2,
                pair.matches[k].keypoint_idx2);
    }
  }
}

}  // namespace
}  // namespace mgsfm
