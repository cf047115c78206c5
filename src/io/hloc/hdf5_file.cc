// SPDX-License-Identifier: BSD-3-Clause
#include "hloc/hdf5_file.h"

#include <hdf5.h>

#include <algorithm>
#include <filesystem>
#include <type_traits>
#include <utility>

#include "base/text.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// One dataset may have a million keypoints with 256 floats.
constexpr hsize_t kMaxNumValues = hsize_t{1} << 28;

// An identifier of the library, released at the end.
class Handle {
 public:
  Handle(hid_t id, herr_t (*close)(hid_t)) : id_(id), close_(close) {}
  ~Handle() {
    if (IsValid()) close_(id_);
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;

  hid_t id() const { return id_; }
  bool IsValid() const { return id_ >= 0; }

 private:
  hid_t id_;
  herr_t (*close_)(hid_t);
};

// Collects the groups with a dataset of this name.
struct Search {
  std::string dataset;
  std::vector<std::string> groups;
};

herr_t Visit(hid_t /*root*/, const char* name, const H5L_info_t* /*info*/,
             void* data) noexcept {
  auto* search = static_cast<Search*>(data);
  const std::string path = name;
  const std::string ending = "/" + search->dataset;
  if (path.size() > ending.size() &&
      path.compare(path.size() - ending.size(), ending.size(), ending) == 0) {
    search->groups.push_back(path.substr(0, path.size() - ending.size()));
  }
  return 0;
}

template <class T>
hid_t NativeType() {
  return std::is_same_v<T, float> ? H5T_NATIVE_FLOAT : H5T_NATIVE_INT32;
}

class LinkedHdf5File : public Hdf5File {
 public:
  explicit LinkedHdf5File(const std::string& path)
      : path_(path), file_(Open(path), H5Fclose) {
    if (!file_.IsValid()) {
      throw Error("'" + path +
                  "' is not an HDF5 file, or is damaged; write it again");
    }
  }

  const std::string& path() const override { return path_; }

  std::vector<std::string> GroupsWith(
      const std::string& dataset) const override {
    Search search{dataset, {}};
    if (H5Lvisit(file_.id(), H5_INDEX_NAME, H5_ITER_INC, Visit, &search) < 0) {
      Throw(dataset, "cannot be searched; the file is damaged");
    }
    std::sort(search.groups.begin(), search.groups.end());
    return std::move(search.groups);
  }

  bool Has(const std::string& dataset) const override {
    // Each group of the path must exist before the next is asked for.
    for (size_t end = dataset.find('/'); end != std::string::npos;
         end = dataset.find('/', end + 1)) {
      if (!Exists(dataset.substr(0, end))) return false;
    }
    return Exists(dataset);
  }

  Hdf5Matrix<float> ReadFloats(const std::string& dataset) const override {
    return Read<float>(dataset);
  }

  Hdf5Matrix<int32_t> ReadInts(const std::string& dataset) const override {
    return Read<int32_t>(dataset);
  }

 private:
  template <class T>
  Hdf5Matrix<T> Read(const std::string& name) const {
    const Handle dataset(H5Dopen2(file_.id(), name.c_str(), H5P_DEFAULT),
                         H5Dclose);
    if (!dataset.IsValid()) Throw(name, "is missing; write the file again");
    const Handle space(H5Dget_space(dataset.id()), H5Sclose);
    hsize_t sizes[2] = {1, 1};
    const int num_dims =
        space.IsValid() ? H5Sget_simple_extent_ndims(space.id()) : -1;
    if (num_dims < 1 || num_dims > 2) {
      Throw(name, "is not a vector or matrix; write the file again");
    }
    H5Sget_simple_extent_dims(space.id(), sizes + (2 - num_dims), nullptr);
    if (sizes[0] > kMaxNumValues || sizes[1] > kMaxNumValues ||
        sizes[0] * sizes[1] > kMaxNumValues) {
      Throw(name, "has more than " + std::to_string(kMaxNumValues) +
                      " values; write the file again");
    }
    Hdf5Matrix<T> matrix{sizes[0], sizes[1], {}};
    matrix.values.resize(matrix.rows * matrix.cols);
    if (!matrix.values.empty() &&
        H5Dread(dataset.id(), NativeType<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT,
                matrix.values.data()) < 0) {
      Throw(name, "cannot be read as numbers; write the file again");
    }
    return matrix;
  }

  static hid_t Open(const std::string& path) {
    if (!std::filesystem::is_regular_file(path)) {
      throw Error("there is no file '" + path + "'; check the path");
    }
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // errors become exceptions
    return H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  }
  bool Exists(const std::string& path) const {
    return H5Lexists(file_.id(), path.c_str(), H5P_DEFAULT) > 0;
  }
  [[noreturn]] void Throw(const std::string& dataset,
                          const std::string& problem) const {
    throw Error("'" + path_ + "': dataset '" + Printable(dataset) + "' " +
                problem);
  }

  const std::string path_;
  const Handle file_;
};

}  // namespace

std::unique_ptr<Hdf5File> OpenHdf5(const std::string& path) {
  return std::make_unique<LinkedHdf5File>(path);
}

}  // namespace mgsfm
