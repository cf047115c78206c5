// SPDX-License-Identifier: BSD-3-Clause
// Maps a COLMAP database with verified matches, shows progress, and stops at
// Ctrl-C without writing anything.
//   map_database DATABASE OUTPUT_FOLDER
#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <utility>

#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"

namespace {

std::atomic<bool> is_canceled{false};

void MapDatabase(const char* database_path,
                 const std::filesystem::path& output_path) {
  mgsfm::Context context;
  context.num_threads = 2;
  context.is_canceled = [] { return is_canceled.load(); };
  context.progress = [](const mgsfm::Progress& progress) {
    std::fprintf(stderr, "\r%.*s: %zu of %zu    ",
                 static_cast<int>(progress.stage.size()), progress.stage.data(),
                 progress.done, progress.total);
  };

  mgsfm::LoadedScene loaded = mgsfm::LoadScene(database_path, {}, context);
  mgsfm::MapperInput input;
  input.scene = std::move(loaded.scene);
  input.view_graph = std::move(loaded.view_graph);
  const mgsfm::MapperResult result = mgsfm::RunMapper(input, {}, context);

  for (size_t i = 0; i < result.models.size(); ++i) {
    const mgsfm::Reconstruction& model = result.models[i].reconstruction;
    const std::filesystem::path folder = output_path / std::to_string(i);
    std::filesystem::create_directories(folder);
    mgsfm::WriteModel(folder, input.scene, model, mgsfm::ModelFormat::kBinary);
    std::printf("\nmodel %zu: %zu points\n", i, model.points.size());
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 1;
  std::signal(SIGINT, [](int) { is_canceled = true; });
  try {
    MapDatabase(argv[1], argv[2]);
  } catch (const std::exception& error) {  // bad input, or interrupted
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
