// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/import_formats.h"
#include "fuzz/fuzz_model.h"

namespace mgsfm {
namespace {

// The first character tells the formats apart.
const char* FileNameFor(const std::string& text) {
  if (text[0] == 'N') return "in.nvm";
  return text[0] == '#' ? "in.out" : "transforms.json";
}

}  // namespace

// A model of another program, with a file that it may name: Bundler's list of
// images, or the points of nerfstudio. Two images lie beside it.
void FuzzImporters(const std::string& input) {
  namespace fs = std::filesystem;
  const fs::path folder = FuzzFolder() / "importers";
  if (!fs::exists(folder)) {
    fs::create_directories(folder);
    for (const char* name : {"a.pgm", "b.pgm"}) {
      WriteTextFile(folder / name, "P5 100 80 255\n");
    }
  }
  const std::vector<std::string> files = SplitFiles(input, 2);
  const fs::path path = folder / FileNameFor(files[0]);
  WriteTextFile(path, files[0]);
  WriteTextFile(folder / "list.txt", files[1]);
  WriteTextFile(folder / "points.ply", files[1]);
  Model model;
  if (!Accepts([&] {
        model = GuessImportFormat(path)->read(
            {path, folder, folder / "list.txt"}, Context());
      })) {
    return;
  }
  FuzzCheckReadsBack(model, path, ModelFormat::kBinary);
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(importers, mgsfm::FuzzImporters)
