// SPDX-License-Identifier: BSD-3-Clause
#include "base/file_reading.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <mutex>
#include <optional>
#include <system_error>
#include <utility>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

[[noreturn]] void ThrowReadError(const std::string& what, int reason) {
  std::string remedy;
  if (reason == ENOENT || reason == ENOTDIR) remedy = "; check the path";
  if (reason == EACCES) remedy = "; check its permissions";
  if (reason == EIO) remedy = "; check its disk";
  throw Error(what + " cannot be read (" +
              std::generic_category().message(reason) + ")" + remedy);
}

bool IsDevice(const struct stat& status) {
  return S_ISCHR(status.st_mode) || S_ISBLK(status.st_mode);
}

// Closes the file at the end of its scope.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

// The contents of pipes, e.g. of a process substitution: a pipe can be read
// only once, but several steps read some inputs. The key has the inode, because
// a long-running process may see different pipes under one path.
struct PipeContents {
  std::mutex mutex;
  std::map<std::pair<std::string, ino_t>, std::string> contents;
};
PipeContents& ReadPipes() {
  static PipeContents pipes;
  return pipes;
}

std::optional<std::string> FindPipe(const std::string& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0 || !S_ISFIFO(status.st_mode)) {
    return std::nullopt;
  }
  PipeContents& pipes = ReadPipes();
  const std::lock_guard<std::mutex> lock(pipes.mutex);
  const auto found = pipes.contents.find({path, status.st_ino});
  if (found == pipes.contents.end()) return std::nullopt;
  return found->second;
}

// The size is a hint only: pipes have none, and files may grow. A Linux pipe
// holds 64 KiB, which is also the maximum of one read call.
std::string ReadDescriptor(int file, const struct stat& status,
                           const std::string& what, size_t max_size) {
  std::string content;
  size_t num_read = 0;
  while (num_read < max_size) {
    if (num_read == content.size()) {
      const auto size = static_cast<size_t>(std::max<off_t>(0, status.st_size));
      content.resize(std::min(
          max_size,
          std::max({size + 1, num_read + size_t{1 << 16}, 2 * num_read})));
    }
    const ssize_t result =
        read(file, content.data() + num_read, content.size() - num_read);
    if (result == 0) break;
    if (result < 0 && errno == EINTR) continue;
    if (result < 0) ThrowReadError(what, errno);
    num_read += static_cast<size_t>(result);
    // Far more than a person types. Devices such as /dev/zero have no end.
    if (num_read > (1 << 20) && IsDevice(status)) {
      throw Error(what + " is a device, not a file; give a file");
    }
  }
  content.resize(num_read);
  return content;
}

}  // namespace

std::string ReadFile(const std::filesystem::path& path, const std::string& what,
                     size_t max_size) {
  const std::string name = what.empty() ? "'" + path.string() + "'" : what;
  if (const auto content = FindPipe(path)) {
    return content->substr(0, max_size);
  }
  const Descriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (file.get() < 0 || fstat(file.get(), &status) != 0) {
    ThrowReadError(name, errno);
  }
  if (!S_ISFIFO(status.st_mode)) {
    return ReadDescriptor(file.get(), status, name, max_size);
  }
  const std::string content = ReadDescriptor(
      file.get(), status, name, std::numeric_limits<size_t>::max());
  PipeContents& pipes = ReadPipes();
  const std::lock_guard<std::mutex> lock(pipes.mutex);
  pipes.contents[{path, status.st_ino}] = content;
  return content.substr(0, max_size);
}

}  // namespace mgsfm
