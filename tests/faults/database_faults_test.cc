// SPDX-License-Identifier: BSD-3-Clause
// Commands that write databases.
#include "faults/fault_sweep.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

TEST_F(FaultTest, Extract) {
  PrepareImages();
  WriteTextFile(Before() / "notes.txt", "mine");
  Sweep({"feature_extractor",
         "feature_extractor --database_path a.db --image_path images "
         "--SiftExtraction.max_num_features 30 --num_threads 1",
         false, false, kManyRuns, "", "a.db"});
}

TEST_F(FaultTest, ConfigureRigs) {
  PrepareImages();
  Prepare(
      "feature_extractor --database_path a.db --image_path images "
      "--SiftExtraction.max_num_features 30");
  Sweep({"rig_configurator", "rig_configurator --database_path a.db"});
}

TEST_F(FaultTest, Match) {
  PrepareFeatures();
  Sweep({"exhaustive_matcher",
         "exhaustive_matcher --database_path a.db --num_threads 1", false});
}

TEST_F(FaultTest, MatchInSequence) {
  PrepareFeatures();
  Sweep({"sequential_matcher",
         "sequential_matcher --database_path a.db --num_threads 1", false,
         false, kFewRuns});
}

TEST_F(FaultTest, MatchBySimilarity) {
  PrepareFeatures();
  Prepare(
      "vocab_tree_builder --database_path a.db --vocab_tree_path tree.bin "
      "--num_visual_words 16");
  Sweep({"vocab_tree_matcher",
         "vocab_tree_matcher --database_path a.db --num_threads 1 "
         "--VocabTree.vocab_tree_path tree.bin",
         false, false, kFewRuns});
}

TEST_F(FaultTest, TrainVocabulary) {
  PrepareFeatures();
  Sweep({"vocab_tree_builder",
         "vocab_tree_builder --database_path a.db --vocab_tree_path tree.bin "
         "--num_visual_words 16 --num_threads 1",
         true, false, 2});
}

TEST_F(FaultTest, MatchByPosition) {
  PrepareFeatures();
  ExecuteSql(Before() / "a.db",
             "INSERT INTO pose_priors SELECT image_id, zeroblob(24), 1, NULL "
             "FROM images");
  Sweep({"spatial_matcher",
         "spatial_matcher --database_path a.db --num_threads 1", false, false,
         kFewRuns});
}

// A shard is a database of its own; the features are only read.
TEST_F(FaultTest, MatchAShare) {
  PrepareFeatures();
  Sweep({"matcher_share",
         "exhaustive_matcher --database_path a.db --num_threads 1 --shard 1/2 "
         "--shard_path share.db",
         false, false, 2});
}

TEST_F(FaultTest, SelectPairs) {
  PrepareFeatures();
  Sweep({"matcher_pairs",
         "exhaustive_matcher --database_path a.db --output_pairs_path p.txt",
         true, false, kFewRuns});
}

TEST_F(FaultTest, ImportMatches) {
  PrepareFeatures();
  WriteTextFile(Before() / "list.txt",
                "left/0.pgm left/1.pgm\n0 0\n1 1\n2 2\n\n");
  Sweep({"matches_importer",
         "matches_importer --database_path a.db --match_list_path list.txt "
         "--match_type raw --num_threads 1",
         false, false, kFewRuns});
}

TEST_F(FaultTest, Verify) {
  PrepareDrive();
  fs::rename(Before() / "sim" / "database.db", Before() / "a.db");
  ExecuteSql(Before() / "a.db", "DELETE FROM two_view_geometries");
  Sweep({"geometric_verifier",
         "geometric_verifier --database_path a.db --num_threads 1", false,
         false, kFewRuns});
}

TEST_F(FaultTest, CleanDatabase) {
  PrepareDrive();
  Sweep({"database_cleaner",
         "database_cleaner --database_path sim/database.db --type matches",
         true, false, 2});
}

TEST_F(FaultTest, MergeDatabases) {
  PrepareImages();
  for (const std::string side : {"left", "right"}) {
    fs::create_directories(Before() / side / side);
    for (int i = 0; i < 3; ++i) {
      WriteImage(Before() / side / side / (std::to_string(i) + ".pgm"), i);
    }
    Prepare("feature_extractor --database_path " + side +
            ".db --SiftExtraction.max_num_features 30 --image_path " + side);
  }
  Sweep({"database_merger",
         "database_merger --database_path1 left.db --database_path2 right.db "
         "--merged_database_path all.db",
         true, false, 2});
}

TEST_F(FaultTest, MergeShares) {
  PrepareFeatures();
  for (const std::string share : {"1", "2"}) {
    Prepare("exhaustive_matcher --database_path a.db --shard " + share +
            "/2 --shard_path " + share + ".db");
  }
  Sweep({"merger_of_shares",
         "database_merger --database_path a.db,1.db,2.db "
         "--merged_database_path all.db",
         true, false, kFewRuns});
}

TEST_F(FaultTest, ImportFeatures) {
  fs::create_directories(Before());
  fs::copy_file(MGSFM_SOURCE_DIR "/tests/fuzz/corpus/hloc/features",
                Before() / "features.h5");
  if (Run("feature_importer --database_path a.db --import_path features.h5",
          Before(), {})
          .exit_code != 0) {
    GTEST_SKIP() << "this build reads no HDF5";
  }
  fs::remove(Before() / "a.db");
  Sweep({"feature_importer",
         "feature_importer --database_path a.db --import_path features.h5",
         false, false, 2});
}

}  // namespace
}  // namespace mgsfm
