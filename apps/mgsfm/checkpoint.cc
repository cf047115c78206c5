// SPDX-License-Identifier: BSD-3-Clause
#include "checkpoint.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <vector>

#include "base/file_reading.h"
#include "io/files/output_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kExtension = ".stage";
constexpr const char* kDraftExtension = ".mgsfm-draft";  // see ReplaceFile
constexpr uint64_t kMagic = 0x4B48434D46534D47ull;       // in every file
constexpr uint64_t kVersion = 2;

struct Header {
  uint64_t magic = kMagic;
  uint64_t version = kVersion;
  uint64_t hash_of_run = 0;
  uint64_t hash_of_content = 0;
  uint64_t size = 0;
};

// FNV-1a over words, which notices damage of a disk.
uint64_t HashContent(const char* data, size_t size) {
  uint64_t hash = 0xCBF29CE484222325ull;
  for (size_t i = 0; i < size; i += sizeof(uint64_t)) {
    uint64_t word = 0;
    std::memcpy(&word, data + i, std::min(sizeof(word), size - i));
    hash = (hash ^ word) * 0x100000001B3ull;
    hash ^= hash >> 29;
  }
  return hash;
}

// The files with an extension, ascending.
std::vector<fs::path> FilesWith(const std::string& extension,
                                const fs::path& folder,
                                std::error_code* error) {
  std::vector<fs::path> files;
  for (fs::directory_iterator it(folder, *error), end; !*error && it != end;
       it.increment(*error)) {
    if (it->path().extension() == extension) files.push_back(it->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::optional<Header> ReadHeader(const std::string& content) {
  Header header;
  if (content.size() < sizeof(header)) return std::nullopt;
  std::memcpy(&header, content.data(), sizeof(header));
  if (header.magic != kMagic) return std::nullopt;
  return header;
}

}  // namespace

Checkpoint::Checkpoint(const fs::path& folder, uint64_t hash_of_run,
                       const Context& context)
    : folder_(folder), hash_of_run_(hash_of_run), context_(context) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) {
    errno = error.value();
    ThrowWriteError(folder_);
  }
  lock_ = FolderLock(folder_);
  if (lock_.state() == FolderLock::State::kBusy) {
    throw Error("another run uses the checkpoint '" + folder_.string() +
                "'; wait for it, or choose another --checkpoint_path");
  }
  CheckOwner();
}

// One header suffices: all files of a folder are of one run.
void Checkpoint::CheckOwner() const {
  std::error_code error;
  const std::vector<fs::path> files = FilesWith(kExtension, folder_, &error);
  if (error) {
    throw Error("the checkpoint '" + folder_.string() + "' cannot be read (" +
                error.message() + "); check its disk and permissions");
  }
  for (const fs::path& path : files) {
    const std::optional<Header> header =
        ReadHeader(ReadFile(path, "", sizeof(Header)));
    if (!header) continue;
    if (header->version == kVersion && header->hash_of_run == hash_of_run_) {
      return;
    }
    throw Error("the checkpoint '" + folder_.string() +
                "' is of another database, other options or another version; "
                "remove it, or choose another --checkpoint_path");
  }
}

fs::path Checkpoint::PathOf(const std::string& name) const {
  std::string file;
  for (const char c : name) {
    if (c != ',') file += c == ' ' ? '_' : c;
  }
  return folder_ / (file + kExtension);
}

std::optional<std::string> Checkpoint::Load(const std::string& name) {
  const fs::path path = PathOf(name);
  if (!fs::exists(path)) return std::nullopt;
  std::string content = ReadFile(path);
  const std::optional<Header> header = ReadHeader(content);
  const bool is_intact =
      header && header->version == kVersion &&
      header->hash_of_run == hash_of_run_ &&
      header->size == content.size() - sizeof(Header) &&
      header->hash_of_content ==
          HashContent(content.data() + sizeof(Header), header->size);
  if (!is_intact) {
    context_.Warning("'" + path.string() +
                     "' is damaged and ignored; its stage runs again");
    return std::nullopt;
  }
  content.erase(0, sizeof(Header));
  return content;
}

void Checkpoint::Save(const std::string& name, const std::string& content) {
  Header header;
  header.hash_of_run = hash_of_run_;
  header.hash_of_content = HashContent(content.data(), content.size());
  header.size = content.size();
  std::string bytes(sizeof(header), '\0');
  std::memcpy(bytes.data(), &header, sizeof(header));
  bytes += content;
  ReplaceFile(PathOf(name), bytes, &operations_);
}

void Checkpoint::Remove() {
  for (const char* extension : {kExtension, kDraftExtension}) {
    std::error_code error;
    for (const fs::path& path : FilesWith(extension, folder_, &error)) {
      operations_.Remove(path);
    }
    if (error) {
      context_.Warning("the finished checkpoint '" + folder_.string() +
                       "' cannot be read and stays (" + error.message() +
                       "); remove it");
      return;
    }
  }
  std::error_code ignored;
  fs::remove(folder_, ignored);  // refused where it is not empty
}

}  // namespace mgsfm
