// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "mgsfm/base/error.h"

namespace mgsfm {

// A temporary folder, removed with its contents by the destructor.
class TempDir {
 public:
  TempDir() {
    std::string name =
        (std::filesystem::temp_directory_path() / "mgsfm_XXXXXX").string();
    MGSFM_CHECK(mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~TempDir() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline std::string ReadTextFile(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  MGSFM_CHECK_MSG(file.good(), path.string());
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

inline void WriteTextFile(const std::filesystem::path& path,
                          const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  MGSFM_CHECK_MSG(file.good(), path.string());
}

}  // namespace mgsfm
