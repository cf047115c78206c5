// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/features/feature_import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hdf5.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "io/test_database.h"
#include "mgsfm/matching/matching.h"
#include "mgsfm/simulator/simulation.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// IEEE half precision, in which hloc stores keypoints by default.
hid_t HalfType() {
  const hid_t type = H5Tcopy(H5T_IEEE_F32LE);
  H5Tset_fields(type, 15, 10, 5, 0, 10);
  H5Tset_size(type, 2);
  H5Tset_ebias(type, 15);
  return type;
}

// Writes datasets as h5py does, with their groups.
class Hdf5Writer {
 public:
  explicit Hdf5Writer(const std::string& path)
      : file_(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT)),
        with_groups_(H5Pcreate(H5P_LINK_CREATE)) {
    H5Pset_create_intermediate_group(with_groups_, 1);
  }
  ~Hdf5Writer() {
    H5Pclose(with_groups_);
    H5Fclose(file_);
  }
  template <class T>
  void Write(const std::string& name, const std::vector<hsize_t>& sizes,
             hid_t stored, hid_t native, const std::vector<T>& values) {
    const hid_t space =
        H5Screate_simple(static_cast<int>(sizes.size()), sizes.data(), nullptr);
    const hid_t dataset = H5Dcreate2(file_, name.c_str(), stored, space,
                                     with_groups_, H5P_DEFAULT, H5P_DEFAULT);
    if (!values.empty()) {
      H5Dwrite(dataset, native, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
    }
    H5Dclose(dataset);
    H5Sclose(space);
  }
  void Floats(const std::string& name, const std::vector<hsize_t>& sizes,
              const std::vector<float>& values, hid_t stored) {
    Write(name, sizes, stored, H5T_NATIVE_FLOAT, values);
  }
  void Ints(const std::string& name, const std::vector<hsize_t>& sizes,
            const std::vector<int32_t>& values) {
    Write(name, sizes, H5T_STD_I16LE, H5T_NATIVE_INT32, values);
  }

 private:
  hid_t file_;
  hid_t with_groups_;
};

std::string WithDashes(std::string name) {
  std::replace(name.begin(), name.end(), '/', '-');
  return name;
}

class FeatureImportTest : public testing::Test {
 protected:
  FeatureImportTest() {
    options_.import_path = Path("features.h5");
    options_.matches_path = Path("matches.h5");
  }
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  FeatureImportSummary Import() {
    FeatureDatabase database(Path("a.db"),
                             FeatureDatabase::OpenMode::kOrCreate);
    return ImportFeatures(options_, &database, Context());
  }
  std::string ImportError() {
    return ErrorOf([&] { Import(); });
  }
  static void WriteSoundImage(const std::string& name, Hdf5Writer* file) {
    file->Floats(name + "/keypoints", {1, 2}, {1, 2}, H5T_IEEE_F32LE);
    file->Ints(name + "/image_size", {2}, {640, 480});
  }
  // Two images of three keypoints with descriptors of four numbers.
  void WriteSmallFiles(const std::vector<int32_t>& matches) const {
    Hdf5Writer features(Path("features.h5"));
    for (const std::string name : {"a/1.png", "b/1.png"}) {
      features.Floats(name + "/keypoints", {3, 2}, {1, 2, 3.5, 4, 50, 60},
                      HalfType());
      features.Floats(name + "/descriptors", {4, 3},
                      {0, 1, 2, 10, 11, 12, 20, 21, 22, 30, 31, 32},
                      H5T_IEEE_F32LE);
      features.Ints(name + "/image_size", {2}, {640, 480});
    }
    Hdf5Writer file(Path("matches.h5"));
    file.Ints("a-1.png/b-1.png/matches0", {matches.size()}, matches);
  }

  const TempDir dir_;
  FeatureImportOptions options_;
};

TEST_F(FeatureImportTest, MasksThatHideNothingAreRefused) {
  WriteSmallFiles({0, 1, 2});
  options_.reader.camera_mask_path = Path("mask.png");
  EXPECT_THAT(ImportError(),
              HasSubstr("ImageReader.camera_mask_path hides no"));
  options_.reader.camera_mask_path = "";
  options_.reader.mask_path = Path("masks");
  EXPECT_THAT(ImportError(), HasSubstr("ImageReader.mask_path hides no"));
}

TEST_F(FeatureImportTest, ReadsKeypointsDescriptorsAndMatches) {
  WriteSmallFiles({2, -1, 0});
  const FeatureImportSummary summary = Import();
  EXPECT_EQ(summary.num_images, 2u);
  EXPECT_EQ(summary.num_features, 6u);
  EXPECT_EQ(summary.num_matches, 2u);
  const FeatureDatabase database(Path("a.db"),
                                 FeatureDatabase::OpenMode::kExisting);
  const DatabaseContents contents = database.ReadStructure(Context());
  ASSERT_EQ(contents.images.size(), 2u);
  EXPECT_EQ(contents.images[0].name, "a/1.png");
  EXPECT_EQ(contents.cameras[0].width_px, 640);
  const ImageId id1 = contents.images[0].id, id2 = contents.images[1].id;
  const auto keypoints = database.ReadKeypoints(id1);
  ASSERT_EQ(keypoints.size(), 3u);
  EXPECT_EQ(keypoints[1].x_px, 4.0f);  // half a pixel more
  EXPECT_EQ(keypoints[1].y_px, 4.5f);
  const std::vector<Match> matches = database.ReadMatches(id1, id2);
  ASSERT_EQ(matches.size(), 2u);
  EXPECT_EQ(matches[0].keypoint_idx1, 0u);
  EXPECT_EQ(matches[0].keypoint_idx2, 2u);
  EXPECT_THAT(ErrorOf([&] { (void)database.ReadDescriptors(id1); }),
              HasSubstr("not SIFT"));
}

TEST_F(FeatureImportTest, ASecondImportChangesNothing) {
  WriteSmallFiles({2, -1, 0});
  Import();
  const FeatureImportSummary again = Import();
  EXPECT_EQ(again.num_present, 2u);
  EXPECT_EQ(again.num_features, 0u);
}

TEST_F(FeatureImportTest, BadFilesAreRefused) {
  EXPECT_THAT(ImportError(), HasSubstr("there is no file"));
  WriteTextFile(Path("features.h5"), "no HDF5");
  EXPECT_THAT(ImportError(), HasSubstr("is not an HDF5 file"));
  WriteSmallFiles({2, -1});
  EXPECT_THAT(ImportError(),
              AllOf(HasSubstr("a-1.png/b-1.png"), HasSubstr("2 entries"),
                    HasSubstr("3 keypoints")));
  WriteSmallFiles({3, -1, 0});
  EXPECT_THAT(ImportError(), HasSubstr("matches keypoint 3"));
  {
    Hdf5Writer file(Path("matches.h5"));
    file.Ints("a-1.png/c.png/matches0", {3}, {0, 1, 2});
  }
  EXPECT_THAT(ImportError(), HasSubstr("has an image without features"));
  {
    Hdf5Writer file(Path("features.h5"));
    file.Floats("a/1.png/keypoints", {2, 3}, {1, 2, 3, 4, 5, 6}, HalfType());
  }
  EXPECT_THAT(ImportError(),
              AllOf(HasSubstr("'a/1.png'"), HasSubstr("3 columns")));
  {
    Hdf5Writer file(Path("features.h5"));
    file.Floats("a/1.png/keypoints", {1, 2}, {1, 2}, HalfType());
  }
  EXPECT_THAT(ImportError(), HasSubstr("has no image_size"));
  {
    Hdf5Writer file(Path("features.h5"));
    file.Floats("other", {1, 2}, {1, 2}, HalfType());
  }
  EXPECT_THAT(ImportError(), HasSubstr("no image with keypoints"));
}

TEST_F(FeatureImportTest, SizesMustAgree) {
  options_.matches_path = "";
  const auto write = [&](const std::vector<int32_t>& size) {
    Hdf5Writer file(Path("features.h5"));
    file.Floats("a.png/keypoints", {1, 2}, {300, 2}, H5T_IEEE_F32LE);
    file.Ints("a.png/image_size", {2}, size);
  };
  write({200, 100});
  EXPECT_THAT(ImportError(), HasSubstr("keypoint outside of its 200 x 100 px"));
  // An image of the database without features.
  {
    FeatureDatabase database(Path("a.db"),
                             FeatureDatabase::OpenMode::kOrCreate);
    const CameraId camera = database.AddCamera({CameraId(0),
                                                CameraModelId::kSimplePinhole,
                                                640,
                                                480,
                                                {500, 320, 240},
                                                false});
    database.AddImage("a.png", camera);
  }
  write({320, 240});
  EXPECT_THAT(ImportError(), AllOf(HasSubstr("image_size 320 x 240 px"),
                                   HasSubstr("the database has 640 x 480")));
  write({640, 480});
  EXPECT_EQ(Import().num_features, 1u);
}

// Datasets of other shapes, types and values. Nothing of the file is kept, not
// even its sound images.
TEST_F(FeatureImportTest, DatasetsThatAreNoFeaturesAreNamed) {
  options_.matches_path = "";
  const std::vector<float> six = {1, 2, 3, 4, 5, 6};
  const float inf = std::numeric_limits<float>::infinity();
  const auto expect_refused = [&](const std::string& problem,
                                  const auto& write) {
    {
      Hdf5Writer file(Path("features.h5"));
      WriteSoundImage("a/0.png", &file);
      WriteSoundImage("a/2.png", &file);
      write(&file);
    }
    EXPECT_THAT(ImportError(),
                AllOf(HasSubstr(Path("features.h5")), HasSubstr("a/1.png"),
                      HasSubstr(problem), HasSubstr("again")));
    EXPECT_FALSE(std::filesystem::exists(Path("a.db"))) << problem;
  };
  expect_refused("is not a vector or matrix", [&](Hdf5Writer* file) {
    file->Floats("a/1.png/keypoints", {1, 3, 2}, six, H5T_IEEE_F32LE);
  });
  expect_refused("cannot be read as numbers", [](Hdf5Writer* file) {
    const hid_t text = H5Tcopy(H5T_C_S1);
    file->Write<char>("a/1.png/keypoints", {2}, text, text, {'a', 'b'});
    H5Tclose(text);
  });
  expect_refused("more than 268435456 values", [](Hdf5Writer* file) {
    file->Floats("a/1.png/keypoints", {1 << 28, 2}, {}, H5T_IEEE_F32LE);
  });
  expect_refused("keypoint that is not finite", [&](Hdf5Writer* file) {
    file->Floats("a/1.png/keypoints", {1, 2}, {1, inf}, H5T_IEEE_F32LE);
  });
  expect_refused("2 descriptors for 3 keypoints", [&](Hdf5Writer* file) {
    file->Floats("a/1.png/keypoints", {3, 2}, six, H5T_IEEE_F32LE);
    file->Floats("a/1.png/descriptors", {3, 2}, six, H5T_IEEE_F32LE);
  });
  for (const std::vector<int32_t>& size :
       {std::vector<int32_t>{640}, {640, 0}, {-1, 480}}) {
    expect_refused("image_size", [&](Hdf5Writer* file) {
      file->Floats("a/1.png/keypoints", {3, 2}, six, H5T_IEEE_F32LE);
      file->Ints("a/1.png/image_size", {size.size()}, size);
    });
  }
  expect_refused("has a control character", [&](Hdf5Writer* file) {
    file->Floats("a/1.png\n/keypoints", {3, 2}, six, H5T_IEEE_F32LE);
  });
}

TEST_F(FeatureImportTest, PairsThatFitNoImagesAreNamed) {
  const auto expect_refused = [&](const std::string& group,
                                  const std::vector<hsize_t>& sizes,
                                  const std::string& problem) {
    WriteSmallFiles({});
    {
      Hdf5Writer file(Path("matches.h5"));
      file.Ints(group + "/matches0", sizes, {0, 1, 2});
    }
    EXPECT_THAT(ImportError(), AllOf(HasSubstr(Path("matches.h5")),
                                     HasSubstr(group), HasSubstr(problem)));
    EXPECT_FALSE(std::filesystem::exists(Path("a.db"))) << group;
  };
  expect_refused("a-1.png/a-1.png", {3}, "is of one image; remove it");
  expect_refused("a-1.png", {3}, "give the features that were matched");
  expect_refused("a-1.png/b-1.png", {3, 1}, "is not a vector; match it again");
}

// In files of matches, '-' stands for '/'.
TEST_F(FeatureImportTest, NamesThatMatchesCannotTellApart) {
  WriteSmallFiles({2, -1, 0});
  {
    Hdf5Writer file(Path("features.h5"));
    WriteSoundImage("a/1.png", &file);
    WriteSoundImage("a-1.png", &file);
  }
  EXPECT_THAT(ImportError(),
              AllOf(HasSubstr("'a/1.png'"), HasSubstr("'a-1.png'"),
                    HasSubstr("apart"), HasSubstr("rename one")));
  // Without matches, they are two images.
  options_.matches_path = "";
  EXPECT_EQ(Import().num_images, 2u);
}

// hloc may write a pair in both orders; the first one is taken.
TEST_F(FeatureImportTest, PairsInBothOrdersAreOne) {
  WriteSmallFiles({2, -1, 0});
  {
    Hdf5Writer file(Path("matches.h5"));
    file.Ints("a-1.png/b-1.png/matches0", {3}, {2, -1, 0});
    file.Ints("b-1.png/a-1.png/matches0", {3}, {2, -1, 0});
  }
  const FeatureImportSummary summary = Import();
  EXPECT_EQ(summary.num_pairs, 1u);
  EXPECT_EQ(summary.num_matches, 2u);
}

// The matches of a simulated drive survive verification, without descriptors.
TEST_F(FeatureImportTest, ImportedMatchesAreVerified) {
  SimulationOptions simulated;
  simulated.num_frames = 5;
  const Simulation drive = Simulate(simulated);
  const Scene& scene = drive.scene;
  {
    Hdf5Writer features(*options_.import_path);
    for (const Image& image : scene.images) {
      std::vector<float> values;
      for (const Eigen::Vector2f& keypoint : image.keypoints_px) {
        values.push_back(keypoint.x() - 0.5f);
        values.push_back(keypoint.y() - 0.5f);
      }
      features.Floats(image.name + "/keypoints", {values.size() / 2, 2}, values,
                      H5T_IEEE_F32LE);
      const Camera& camera = scene.cameras[image.camera_idx];
      features.Ints(image.name + "/image_size", {2},
                    {camera.width_px, camera.height_px});
    }
    Hdf5Writer matches(*options_.matches_path);
    for (const ImagePair& pair : drive.view_graph.pairs) {
      const Image& image1 = scene.images[pair.image_idx1];
      std::vector<int32_t> partners(image1.keypoints_px.size(), -1);
      for (const Match& match : pair.matches) {
        partners[match.keypoint_idx1] =
            static_cast<int32_t>(match.keypoint_idx2);
      }
      matches.Ints(WithDashes(image1.name) + "/" +
                       WithDashes(scene.images[pair.image_idx2].name) +
                       "/matches0",
                   {partners.size()}, partners);
    }
  }
  options_.reader.camera_model = "PINHOLE";
  const FeatureImportSummary summary = Import();
  EXPECT_EQ(summary.num_pairs, drive.view_graph.pairs.size());
  FeatureDatabase database(Path("a.db"), FeatureDatabase::OpenMode::kExisting);
  const Scene imported =
      LoadScene(database.ReadStructure(Context()), {}, Context()).scene;
  const PairMatchingSummary verified =
      VerifyMatches(&database, imported, {}, Context());
  EXPECT_EQ(verified.num_pairs, summary.num_pairs);
  EXPECT_GT(verified.num_verified, summary.num_pairs * 9 / 10);
}

}  // namespace
}  // namespace mgsfm
