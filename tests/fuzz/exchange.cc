// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstdlib>

#include "exchange/exchange_formats.h"
#include "fuzz/fuzz_model.h"

namespace mgsfm {
namespace {

// No number of a text is NaN or infinite; names of images may look so.
void CheckNumbers(const ExportedFile& file) {
  const std::string& text = file.content;
  if (text.rfind("ply", 0) == 0) return;  // binary; its points are checked
  size_t begin = 0;
  while ((begin = text.find_first_not_of(" \t\n,[]{}:", begin)) !=
         std::string::npos) {
    const size_t end =
        std::min(text.find_first_of(" \t\n,[]{}:", begin), text.size());
    const std::string word = text.substr(begin, end - begin);
    FUZZ_CHECK(word != "nan" && word != "-nan" && word != "inf" &&
               word != "-inf");
    begin = end;
  }
}

void Export(const ModelScene& model, const ExchangeFormat& format,
            TrajectoryPoses poses) {
  std::vector<ExportedFile> files;
  const ExportInput input{model.scene, model.reconstruction, poses,
                          Eigen::Vector3d(47.0, 8.0, 400.0)};
  if (!Accepts([&] { files = format.write(input); })) return;
  FUZZ_CHECK(!files.empty());
  for (const ExportedFile& file : files) {
    FUZZ_CHECK(file.suffix.find("..") == std::string::npos);
    CheckNumbers(file);
  }
}

}  // namespace

// A model in text, in all formats of other programs.
void FuzzExchange(const std::string& input) {
  namespace fs = std::filesystem;
  const fs::path folder = FuzzFolder() / "exchange";
  fs::create_directories(folder);
  const std::vector<std::string> files = SplitFiles(input, 5);
  for (size_t i = 0; i < files.size(); ++i) {
    const fs::path path = folder / (std::string(kModelStems[i]) + ".txt");
    fs::remove(path);
    if (i < 3 || !files[i].empty()) WriteTextFile(path, files[i]);
  }
  ModelScene model;
  if (!Accepts([&] { model = LoadModelScene(folder, {}, {}); })) return;
  for (const std::string& name : ExchangeFormatNames()) {
    const ExchangeFormat& format = *FindExchangeFormat(name);
    Export(model, format, TrajectoryPoses::kFrame);
    Export(model, format, TrajectoryPoses::kCamera);
  }
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(exchange, mgsfm::FuzzExchange)
