// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "command.h"
#include "commands.h"
#include "matching/image_retrieval.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/models/scene_loading.h"

namespace mgsfm {
namespace {

struct VocabTreeBuilderOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Read the features of this database, which is not changed."};
  Option<std::string> vocab_tree_path{"vocab_tree_path", "", Required(),
                                      "Write the tree to this file."};
  Option<int> max_num_images{
      "max_num_images", -1, AtLeast(-1), "images",
      "Train on this many images, spaced evenly by name; -1 uses all."};
  Option<int> max_num_features{
      "max_num_features", 2000, AtLeast(-1), "features",
      "Sample from this many features per image, the largest first; -1 uses "
      "all."};
  VocabularyTrainingOptions training;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, vocab_tree_path, max_num_images, max_num_features,
          training);
  }
};

// Images by name, without rigs: the tree depends on the features only.
Scene ReadSample(const FeatureDatabase& database, int max_num_images,
                 const Context& context) {
  DatabaseContents contents = database.ReadStructure(context);
  std::vector<ImageRow> images = std::move(contents.images);
  std::sort(
      images.begin(), images.end(),
      [](const ImageRow& a, const ImageRow& b) { return a.name < b.name; });
  const size_t size = images.size();
  const size_t num_chosen =
      max_num_images < 0 ? size
                         : std::min(size, static_cast<size_t>(max_num_images));
  Scene scene;
  for (size_t k = 0; k < num_chosen; ++k) {
    const ImageRow& image = images[k * size / num_chosen];
    scene.images.push_back({image.id, image.name, 0, 0, 0, {}, {}});
  }
  return scene;
}

int RunVocabTreeBuilder(const VocabTreeBuilderOptions& options,
                        const Context& context) {
  const FeatureDatabase database(options.database_path,
                                 FeatureDatabase::OpenMode::kReadOnly);
  const Scene scene = ReadSample(database, options.max_num_images, context);
  std::optional<Vocabulary> vocabulary;
  if (!scene.images.empty()) {
    vocabulary = TrainVocabulary(database, scene, options.training,
                                 options.max_num_features, context);
  }
  if (!vocabulary) {
    throw Error("database '" + *options.database_path +
                "' has no features; run feature_extractor first");
  }
  database.CheckUnchanged();
  vocabulary->Write(options.vocab_tree_path);
  context.Info(std::to_string(vocabulary->num_words()) + " visual words from " +
               std::to_string(scene.images.size()) + " images");
  return kExitSuccess;
}

}  // namespace

Command VocabTreeBuilderCommand() {
  return MakeCommand("vocab_tree_builder",
                     "Trains a vocabulary tree for image retrieval.",
                     RunVocabTreeBuilder);
}

}  // namespace mgsfm
