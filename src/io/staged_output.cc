// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/io/staged_output.h"

#include <unistd.h>

#include <algorithm>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

bool IsModelFolder(const fs::path& path) {
  const std::string name = path.filename().string();
  return !name.empty() && fs::is_directory(path) &&
         std::all_of(name.begin(), name.end(),
                     [](char c) { return c >= '0' && c <= '9'; });
}

// The moves made so far, undone in reverse order unless all succeeded.
class Moves {
 public:
  ~Moves() {
    if (is_done_) return;
    for (auto it = moves_.rbegin(); it != moves_.rend(); ++it) {
      std::error_code ignored;  // nothing more can be done for this entry
      fs::rename(it->second, it->first, ignored);
    }
  }
  void Move(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::rename(from, to, error);
    if (error) {
      throw Error("cannot move '" + from.string() + "' to '" + to.string() +
                  "': " + error.message());
    }
    moves_.emplace_back(from, to);
  }
  void Keep() { is_done_ = true; }

 private:
  std::vector<std::pair<fs::path, fs::path>> moves_;
  bool is_done_ = false;
};

}  // namespace

StagedOutput::StagedOutput(const fs::path& target)
    : target_(fs::absolute(target).lexically_normal()) {
  if (target_.filename().empty()) target_ = target_.parent_path();
  if (fs::exists(target_) && !fs::is_directory(target_)) {
    throw Error("the output path '" + target_.string() + "' is not a folder");
  }
  std::error_code error;
  fs::create_directories(target_.parent_path(), error);
  std::string name =
      (target_.parent_path() / ("." + target_.filename().string() + ".XXXXXX"))
          .string();
  if (error || mkdtemp(name.data()) == nullptr) {
    throw Error("cannot write beside the output path '" + target_.string() +
                "'");
  }
  staging_ = name;
  fs::permissions(staging_, fs::perms::owner_all | fs::perms::group_read |
                                fs::perms::group_exec | fs::perms::others_read |
                                fs::perms::others_exec);
}

StagedOutput::~StagedOutput() {
  std::error_code ignored;  // a destructor cannot report it
  fs::remove_all(staging_, ignored);
}

void StagedOutput::Commit() {
  std::error_code error;
  fs::create_directories(target_, error);
  const fs::path replaced = staging_ / ".replaced";
  if (!error) fs::create_directory(replaced, error);
  if (error) {
    throw Error("cannot create the folder '" + target_.string() +
                "': " + error.message());
  }
  std::vector<fs::path> entries, obsolete;
  for (const auto& entry : fs::directory_iterator(staging_)) {
    if (entry.path() != replaced) entries.push_back(entry.path());
  }
  for (const auto& entry : fs::directory_iterator(target_)) {
    const bool has_successor = fs::exists(staging_ / entry.path().filename());
    if (has_successor || IsModelFolder(entry.path())) {
      obsolete.push_back(entry.path());
    }
  }
  Moves moves;
  for (const fs::path& path : obsolete) {
    moves.Move(path, replaced / path.filename());
  }
  for (const fs::path& path : entries) {
    moves.Move(path, target_ / path.filename());
  }
  moves.Keep();
}

}  // namespace mgsfm
