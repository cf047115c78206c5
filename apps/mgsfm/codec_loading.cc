// SPDX-License-Identifier: BSD-3-Clause
// OpenCV's image codecs, FFmpeg and HDF5 bring 200 libraries with them. To load
// these takes 0.09 s and 53 MiB, in a program that takes 0.03 s and 20 MiB
// without them, and most commands decode nothing. They are therefore in a
// library of their own, mgsfm_codecs.so, which is loaded when it is first
// needed. The functions here replace those that the modules define.
#include <dlfcn.h>

#include <string>

#include "base/memory.h"
#include "io/files/image_codecs.h"
#include "io/hloc/hdf5_file.h"
#include "mgsfm/base/error.h"
#include "video/video_decoder.h"

namespace mgsfm {
namespace {

[[noreturn]] void ThrowNotLoaded() {
  const char* const reason = dlerror();
  throw Error(
      "cannot load mgsfm_codecs.so, which reads images, videos and "
      "HDF5 files (" +
      std::string(reason == nullptr ? "" : reason) + "); install mgsfm again");
}

void* LoadLibrary() {
  // Addresses, 220 MiB of which the libraries take.
  RequireMemory(size_t{256} << 20);
  // The linker searches the folders that the program names (codecs.cmake).
  void* const library = dlopen("mgsfm_codecs.so", RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) ThrowNotLoaded();
  return library;
}

// The table that a function of the library returns. The library stays loaded.
template <class T>
const T* LoadTable(const char* function) {
  static void* const kLibrary = LoadLibrary();
  void* const address = dlsym(kLibrary, function);
  if (address == nullptr) ThrowNotLoaded();
  return reinterpret_cast<const T* (*)()>(address)();
}

}  // namespace

extern "C" const ImageCodecs* MgsfmImageCodecs() {
  static const auto* const kTable = LoadTable<ImageCodecs>(__func__);
  return kTable;
}

extern "C" const VideoCodecs* MgsfmVideoCodecs() {
  static const auto* const kTable = LoadTable<VideoCodecs>(__func__);
  return kTable;
}

extern "C" const Hdf5Library* MgsfmHdf5Library() {
  static const auto* const kTable = LoadTable<Hdf5Library>(__func__);
  return kTable;
}

}  // namespace mgsfm
