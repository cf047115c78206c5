// SPDX-License-Identifier: BSD-3-Clause
#include "faults/system_calls.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstdarg>
#include <cstdio>
#include <functional>
#include <mutex>
#include <new>
#include <random>
#include <vector>

namespace mgsfm {
namespace {

// Shared with the parent process, which reads what a child has counted.
struct Counters {
  long num_calls = 0;
  CallKind kind_of_fault = CallKind::kWrite;
};

Counters& SharedCounters() {
  static Counters* const counters =
      new (mmap(nullptr, sizeof(Counters), PROT_READ | PROT_WRITE,
                MAP_SHARED | MAP_ANONYMOUS, -1, 0)) Counters;
  return *counters;
}

// Made before any process is.
[[maybe_unused]] const Counters& kCounters = SharedCounters();

// One change that a loss of power can undo, until it is synced.
struct Change {
  bool is_content = false;
  std::string path;  // of the file, or of the folder that holds the name
  std::function<void()> undo;
};

struct State {
  FaultPlan plan;
  bool is_active = false;
  bool has_failed = false;
  std::vector<Change> changes;
  int num_saved = 0;
};

State& TheState() {
  static auto* const state = new State;
  return *state;
}
std::recursive_mutex& TheMutex() {
  static auto* const mutex = new std::recursive_mutex;
  return *mutex;
}

// The function of the system that ours hides.
template <class Function>
Function* Real(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

// The calls made here are not counted.
class Uncounted {
 public:
  Uncounted() : lock_(TheMutex()), was_active_(TheState().is_active) {
    TheState().is_active = false;
  }
  ~Uncounted() { TheState().is_active = was_active_; }

 private:
  const std::lock_guard<std::recursive_mutex> lock_;
  const bool was_active_;
};

std::string Absolute(int folder_fd, const char* path) {
  if (path[0] == '/') return path;
  char target[PATH_MAX] = ".";
  const std::string link = folder_fd == AT_FDCWD
                               ? "/proc/self/cwd"
                               : "/proc/self/fd/" + std::to_string(folder_fd);
  const ssize_t size = readlink(link.c_str(), target, sizeof(target) - 1);
  return std::string(target, size > 0 ? static_cast<size_t>(size) : 0) + "/" +
         path;
}

std::string PathOf(int fd) {
  if (!TheState().is_active) return "";
  char target[PATH_MAX];
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  const ssize_t size = readlink(link.c_str(), target, sizeof(target));
  return std::string(target, size > 0 ? static_cast<size_t>(size) : 0);
}

bool IsWatched(const std::string& path) {
  const State& state = TheState();
  return state.is_active && path.rfind(state.plan.folder + "/", 0) == 0;
}

std::string FolderOf(const std::string& path) {
  std::string folder = path.substr(0, path.find_last_not_of('/') + 1);
  folder = folder.substr(0, folder.rfind('/'));
  return folder.substr(0, folder.find_last_not_of("/.") + 1);
}

bool Exists(const std::string& path) {
  struct stat status;
  return lstat(path.c_str(), &status) == 0;
}

void LosePower() {
  const Uncounted uncounted;
  State& state = TheState();
  std::mt19937 random(static_cast<unsigned>(state.plan.call));
  const PowerLoss loss = state.plan.loss;
  for (auto change = state.changes.rbegin(); change != state.changes.rend();
       ++change) {
    const bool is_lost = loss == PowerLoss::kAll ||
                         (change->is_content &&
                          (loss == PowerLoss::kContent || random() % 2 == 0));
    if (is_lost) change->undo();
  }
}

void Record(bool is_content, const std::string& path,
            const std::function<void()>& undo) {
  if (TheState().plan.fault == Fault::kPowerLoss) {
    TheState().changes.push_back({is_content, path, undo});
  }
}

// Remembers the bytes that a write replaces.
void RecordContent(int fd, const std::string& path, off_t offset, size_t size) {
  if (TheState().plan.fault != Fault::kPowerLoss) return;
  const Uncounted uncounted;
  struct stat status;
  if (fstat(fd, &status) != 0) return;
  const int reader = Real<int(const char*, int, ...)>("open")(
      ("/proc/self/fd/" + std::to_string(fd)).c_str(), O_RDWR | O_CLOEXEC);
  std::string before(size, '\0');
  const ssize_t num_read = Real<ssize_t(int, void*, size_t, off_t)>("pread64")(
      reader, before.data(), size, offset);
  before.resize(num_read > 0 ? static_cast<size_t>(num_read) : 0);
  Record(true, path, [reader, before, offset, old_size = status.st_size] {
    (void)!Real<ssize_t(int, const void*, size_t, off_t)>("pwrite64")(
        reader, before.data(), before.size(), offset);
    struct stat now;
    if (fstat(reader, &now) == 0 && now.st_size > old_size) {
      (void)!Real<int(int, off_t)>("ftruncate64")(reader, old_size);
    }
  });
}

// Keeps a file that loses its name, so that it can come back.
std::function<void()> KeepFile(const std::string& path) {
  State& state = TheState();
  const std::string saved =
      state.plan.folder + ".lost" + std::to_string(state.num_saved++);
  if (state.plan.fault != Fault::kPowerLoss || !Exists(path) ||
      Real<int(const char*, const char*)>("link")(path.c_str(),
                                                  saved.c_str()) != 0) {
    return [] {};
  }
  return [saved, path] {
    Real<int(const char*, const char*)>("rename")(saved.c_str(), path.c_str());
  };
}

void ForgetSynced(const std::string& path) {
  auto& changes = TheState().changes;
  changes.erase(
      std::remove_if(changes.begin(), changes.end(),
                     [&](const Change& change) { return change.path == path; }),
      changes.end());
}

bool IsCounted(CallKind kind, CountedCalls counted) {
  if (kind == CallKind::kLock || counted == CountedCalls::kLocks) {
    return kind == CallKind::kLock && counted == CountedCalls::kLocks;
  }
  return kind != CallKind::kRead || counted == CountedCalls::kChangesAndReads;
}

bool CountsReads() {
  return TheState().plan.counted == CountedCalls::kChangesAndReads;
}

// Counts a call; returns true if it has to fail, with errno set. `size` is the
// number of bytes of a read or write, which a short one halves.
bool IsFaulty(CallKind kind, const std::string& path, size_t* size = nullptr) {
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  if (!IsWatched(path)) return false;
  State& state = TheState();
  const FaultPlan& plan = state.plan;
  if (!IsCounted(kind, plan.counted)) return false;
  Counters& counters = SharedCounters();
  const bool is_now = counters.num_calls++ == plan.call;
  if (is_now) counters.kind_of_fault = kind;
  const bool is_repeated = plan.fault == Fault::kErrorAlways &&
                           state.has_failed && kind == counters.kind_of_fault;
  if (!is_now && !is_repeated) return false;
  state.has_failed = true;
  switch (plan.fault) {
    case Fault::kNone:
      return false;
    case Fault::kShort:
      if (size != nullptr) *size = (*size + 1) / 2;
      return false;
    case Fault::kPowerLoss:
      LosePower();
      _exit(kKilledExitCode);
    case Fault::kKill:
      _exit(kKilledExitCode);
    default:
      errno = plan.error;
      return true;
  }
}

// Opening counts if it makes a file, or if reading counts.
bool IsOpenFaulty(const std::string& path, bool is_write) {
  if (is_write) return IsFaulty(CallKind::kOpen, path);
  return CountsReads() && IsFaulty(CallKind::kRead, path);
}

int Open(int folder_fd, const char* path, int flags, mode_t mode) {
  const std::string name = Absolute(folder_fd, path);
  const bool is_write = (flags & O_ACCMODE) != O_RDONLY;
  if (IsOpenFaulty(name, is_write)) return -1;
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  const bool is_new = is_write && IsWatched(name) && !Exists(name);
  const int fd = Real<int(int, const char*, int, ...)>("openat64")(
      folder_fd, path, flags, mode);
  if (is_new && fd >= 0) {
    Record(false, FolderOf(name),
           [name] { Real<int(const char*)>("unlink")(name.c_str()); });
  }
  return fd;
}

FILE* OpenStream(const char* real, const char* path, const char* mode) {
  const std::string name = Absolute(AT_FDCWD, path);
  const bool is_write = mode[0] != 'r' || mode[1] == '+';
  if (IsOpenFaulty(name, is_write)) return nullptr;
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  const bool is_watched = is_write && IsWatched(name);
  const bool is_new = is_watched && !Exists(name);
  if (is_watched && !is_new && mode[0] == 'w') {
    const int fd =
        Real<int(const char*, int, ...)>("open")(path, O_RDWR | O_CLOEXEC);
    struct stat status;
    if (fstat(fd, &status) == 0) {
      RecordContent(fd, name, 0, static_cast<size_t>(status.st_size));
    }
    close(fd);
  }
  FILE* file = Real<FILE*(const char*, const char*)>(real)(path, mode);
  if (is_new && file != nullptr) {
    Record(false, FolderOf(name),
           [name] { Real<int(const char*)>("unlink")(name.c_str()); });
  }
  return file;
}

int Sync(const char* real, int fd) {
  const std::string path = PathOf(fd);
  if (IsFaulty(CallKind::kSync, path)) return -1;
  const int result = Real<int(int)>(real)(fd);
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  if (IsWatched(path) || path == TheState().plan.folder) ForgetSynced(path);
  return result;
}

int Truncate(const char* real, int fd, off_t size) {
  const std::string path = PathOf(fd);
  if (IsFaulty(CallKind::kWrite, path)) return -1;
  struct stat status;
  if (IsWatched(path) && fstat(fd, &status) == 0 && status.st_size > size) {
    RecordContent(fd, path, size, static_cast<size_t>(status.st_size - size));
  }
  return Real<int(int, off_t)>(real)(fd, size);
}

// `call` removes the name.
int RemoveName(const std::string& path, const std::function<int()>& call) {
  if (IsFaulty(CallKind::kName, path)) return -1;
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  if (!IsWatched(path)) return call();
  struct stat status;
  const bool is_folder =
      lstat(path.c_str(), &status) == 0 && S_ISDIR(status.st_mode);
  std::function<void()> undo = [path] { mkdir(path.c_str(), 0777); };
  if (!is_folder) undo = KeepFile(path);
  const int result = call();
  if (result == 0) Record(false, FolderOf(path), undo);
  return result;
}

int RenameName(const std::string& from, const std::string& to,
               const std::function<int()>& call) {
  if (IsFaulty(CallKind::kName, to)) return -1;
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  if (!IsWatched(to)) return call();
  const std::function<void()> restore = KeepFile(to);
  const int result = call();
  if (result == 0) {
    Record(false, FolderOf(to), [from, to, restore] {
      Real<int(const char*, const char*)>("rename")(to.c_str(), from.c_str());
      restore();
    });
  }
  return result;
}

// `call` makes the name, of a file that exists.
int AddName(const std::string& path, const std::function<int()>& call) {
  if (IsFaulty(CallKind::kName, path)) return -1;
  const int result = call();
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  if (result == 0 && IsWatched(path)) {
    Record(false, FolderOf(path),
           [path] { Real<int(const char*)>("unlink")(path.c_str()); });
  }
  return result;
}

int Exchange(const std::string& a, const std::string& b,
             const std::function<int()>& call) {
  if (IsFaulty(CallKind::kName, b)) return -1;
  const int result = call();
  const std::lock_guard<std::recursive_mutex> lock(TheMutex());
  if (result == 0 && IsWatched(b)) {
    Record(false, FolderOf(b), [a, b] {
      Real<int(int, const char*, int, const char*, unsigned)>("renameat2")(
          AT_FDCWD, a.c_str(), AT_FDCWD, b.c_str(), RENAME_EXCHANGE);
    });
  }
  return result;
}

ssize_t WriteAt(int fd, const void* data, size_t size, off_t offset,
                bool is_at_offset) {
  const std::string path = PathOf(fd);
  if (IsFaulty(CallKind::kWrite, path, &size)) return -1;
  if (IsWatched(path)) {
    RecordContent(fd, path, is_at_offset ? offset : lseek(fd, 0, SEEK_CUR),
                  size);
  }
  return is_at_offset
             ? Real<ssize_t(int, const void*, size_t, off_t)>("pwrite64")(
                   fd, data, size, offset)
             : Real<ssize_t(int, const void*, size_t)>("write")(fd, data, size);
}

// SQLite locks ranges of a file; unlocking never counts.
int Control(const char* real, int fd, int command, void* argument) {
  if (command == F_SETLK && argument != nullptr &&
      static_cast<const struct flock*>(argument)->l_type != F_UNLCK &&
      TheState().plan.counted == CountedCalls::kLocks &&
      IsFaulty(CallKind::kLock, PathOf(fd))) {
    return -1;
  }
  return Real<int(int, int, ...)>(real)(fd, command, argument);
}

}  // namespace

void StartFaults(const FaultPlan& plan) {
  State& state = TheState();
  state = State();
  state.plan = plan;
  SharedCounters() = Counters();
  state.is_active = true;
}

void StopFaults() { TheState().is_active = false; }

long NumCalls() { return SharedCounters().num_calls; }

CallKind KindOfFaultyCall() { return SharedCounters().kind_of_fault; }

}  // namespace mgsfm

// ------------------------------------------------- the calls of the system

namespace m = mgsfm;

extern "C" {

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = va_arg(arguments, mode_t);
  va_end(arguments);
  return m::Open(AT_FDCWD, path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = va_arg(arguments, mode_t);
  va_end(arguments);
  return m::Open(AT_FDCWD, path, flags, mode);
}
int openat(int folder_fd, const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = va_arg(arguments, mode_t);
  va_end(arguments);
  return m::Open(folder_fd, path, flags, mode);
}
FILE* fopen(const char* path, const char* mode) {
  return m::OpenStream("fopen", path, mode);
}
FILE* fopen64(const char* path, const char* mode) {
  return m::OpenStream("fopen64", path, mode);
}

ssize_t write(int fd, const void* data, size_t size) {
  return m::WriteAt(fd, data, size, 0, false);
}
ssize_t pwrite(int fd, const void* data, size_t size, off_t offset) {
  return m::WriteAt(fd, data, size, offset, true);
}
ssize_t pwrite64(int fd, const void* data, size_t size, off64_t offset) {
  return m::WriteAt(fd, data, size, offset, true);
}
ssize_t writev(int fd, const iovec* parts, int num_parts) {
  // Writes one part only: callers continue after a partial write.
  for (int i = 0; i < num_parts; ++i) {
    if (parts[i].iov_len == 0) continue;
    return m::WriteAt(fd, parts[i].iov_base, parts[i].iov_len, 0, false);
  }
  return 0;
}
ssize_t read(int fd, void* data, size_t size) {
  if (m::CountsReads() &&
      m::IsFaulty(m::CallKind::kRead, m::PathOf(fd), &size)) {
    return -1;
  }
  return m::Real<ssize_t(int, void*, size_t)>("read")(fd, data, size);
}
ssize_t pread64(int fd, void* data, size_t size, off64_t offset) {
  if (m::CountsReads() &&
      m::IsFaulty(m::CallKind::kRead, m::PathOf(fd), &size)) {
    return -1;
  }
  return m::Real<ssize_t(int, void*, size_t, off_t)>("pread64")(fd, data, size,
                                                                offset);
}

int fcntl(int fd, int command, ...) {
  va_list arguments;
  va_start(arguments, command);
  void* argument = va_arg(arguments, void*);
  va_end(arguments);
  return m::Control("fcntl", fd, command, argument);
}
int fcntl64(int fd, int command, ...) {
  va_list arguments;
  va_start(arguments, command);
  void* argument = va_arg(arguments, void*);
  va_end(arguments);
  return m::Control("fcntl64", fd, command, argument);
}

int fsync(int fd) { return m::Sync("fsync", fd); }
int fdatasync(int fd) { return m::Sync("fdatasync", fd); }
int ftruncate(int fd, off_t size) noexcept {
  return m::Truncate("ftruncate", fd, size);
}
int ftruncate64(int fd, off64_t size) noexcept {
  return m::Truncate("ftruncate64", fd, size);
}

int rename(const char* from, const char* to) noexcept {
  return m::RenameName(
      m::Absolute(AT_FDCWD, from), m::Absolute(AT_FDCWD, to), [=] {
        return m::Real<int(const char*, const char*)>("rename")(from, to);
      });
}
int renameat2(int folder_a, const char* a, int folder_b, const char* b,
              unsigned flags) noexcept {
  return m::Exchange(m::Absolute(folder_a, a), m::Absolute(folder_b, b), [=] {
    return m::Real<int(int, const char*, int, const char*, unsigned)>(
        "renameat2")(folder_a, a, folder_b, b, flags);
  });
}
int link(const char* from, const char* to) noexcept {
  return m::AddName(m::Absolute(AT_FDCWD, to), [=] {
    return m::Real<int(const char*, const char*)>("link")(from, to);
  });
}
int unlink(const char* path) noexcept {
  return m::RemoveName(m::Absolute(AT_FDCWD, path), [=] {
    return m::Real<int(const char*)>("unlink")(path);
  });
}
int unlinkat(int folder_fd, const char* path, int flags) noexcept {
  return m::RemoveName(m::Absolute(folder_fd, path), [=] {
    return m::Real<int(int, const char*, int)>("unlinkat")(folder_fd, path,
                                                           flags);
  });
}
int rmdir(const char* path) noexcept {
  return m::RemoveName(m::Absolute(AT_FDCWD, path), [=] {
    return m::Real<int(const char*)>("rmdir")(path);
  });
}
int remove(const char* path) noexcept {
  return m::RemoveName(m::Absolute(AT_FDCWD, path), [=] {
    return m::Real<int(const char*)>("remove")(path);
  });
}
int mkdir(const char* path, mode_t mode) noexcept {
  const std::string name = m::Absolute(AT_FDCWD, path);
  if (m::IsFaulty(m::CallKind::kName, name)) return -1;
  const int result = m::Real<int(const char*, mode_t)>("mkdir")(path, mode);
  const std::lock_guard<std::recursive_mutex> lock(m::TheMutex());
  if (result == 0 && m::IsWatched(name)) {
    m::Record(false, m::FolderOf(name),
              [name] { m::Real<int(const char*)>("rmdir")(name.c_str()); });
  }
  return result;
}

}  // extern "C"
