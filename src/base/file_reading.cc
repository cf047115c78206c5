// SPDX-License-Identifier: BSD-3-Clause
#include "base/file_reading.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

[[noreturn]] void ThrowReadError(const std::filesystem::path& path,
                                 const std::string& what, int reason) {
  std::string remedy;
  if (reason == ENOENT || reason == ENOTDIR) remedy = "; check the path";
  if (reason == EACCES) remedy = "; check its permissions";
  if (reason == EIO) remedy = "; check its disk";
  throw Error((what.empty() ? "'" + path.string() + "'" : what) +
              " cannot be read (" + std::generic_category().message(reason) +
              ")" + remedy);
}

// More than anybody types. Devices such as /dev/zero have no end.
constexpr size_t kMaxDeviceBytes = 1 << 20;

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

}  // namespace

std::string ReadFile(const std::filesystem::path& path, const std::string& what,
                     size_t max_size) {
  const Descriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (file.get() < 0 || fstat(file.get(), &status) != 0) {
    ThrowReadError(path, what, errno);
  }
  // The size is a hint only: pipes have none, and files may grow. A Linux pipe
  // holds 64 KiB, the most that one call can read from it.
  constexpr size_t kMinChunk = 1 << 16;
  std::string content;
  size_t num_read = 0;
  while (num_read < max_size) {
    if (num_read == content.size()) {
      const auto size = static_cast<size_t>(std::max<off_t>(0, status.st_size));
      content.resize(std::min(
          max_size, std::max({size + 1, num_read + kMinChunk, 2 * num_read})));
    }
    const ssize_t result =
        read(file.get(), content.data() + num_read, content.size() - num_read);
    if (result == 0) break;
    if (result < 0 && errno == EINTR) continue;
    if (result < 0) ThrowReadError(path, what, errno);
    num_read += static_cast<size_t>(result);
    if (num_read > kMaxDeviceBytes && IsDevice(status)) {
      throw Error((what.empty() ? "'" + path.string() + "'" : what) +
                  " is a device, not a file; give a file");
    }
  }
  content.resize(num_read);
  return content;
}

}  // namespace mgsfm
