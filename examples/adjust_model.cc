// SPDX-License-Identifier: BSD-3-Clause
// Refines a COLMAP model by bundle adjustment of poses, rigs and points, with
// fixed intrinsics, and reports how well the observations fit.
//   adjust_model MODEL_FOLDER OUTPUT_FOLDER
#include <cstdio>
#include <exception>
#include <filesystem>

#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/model_scene.h"

namespace {

void AdjustModel(const std::filesystem::path& input_path,
                 const std::filesystem::path& output_path) {
  const mgsfm::Context context;
  const mgsfm::ModelScene input =
      mgsfm::LoadModelScene(input_path, {}, context);

  mgsfm::BundleAdjustmentOptions options;
  options.refine_focal_length = mgsfm::RefineMode::kNo;
  options.refine_extra_params = mgsfm::RefineMode::kNo;
  const mgsfm::BundleResult result =
      mgsfm::AdjustBundle(input.scene, input.reconstruction, options, context);

  for (const mgsfm::SolveSummary& solve : result.summary.solves) {
    std::printf("cost %g -> %g in %d iterations: %s\n", solve.initial_cost,
                solve.final_cost, solve.num_iterations, solve.message.c_str());
  }
  std::filesystem::create_directories(output_path);
  mgsfm::WriteModel(output_path, input.scene, result.estimate,
                    mgsfm::ModelFormat::kBinary);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 1;
  try {
    AdjustModel(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
