// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mgsfm {

// A dataset of HDF5 with two dimensions; a vector is a matrix of one row.
template <class T>
struct Hdf5Matrix {
  size_t rows = 0;
  size_t cols = 0;
  std::vector<T> values;  // row by row
};

// A file of HDF5 that is read. Numbers of any size become float or int32. All
// functions throw Error, naming file and dataset, for damaged files, and the
// constructor also if this build has no HDF5.
class Hdf5File {
 public:
  explicit Hdf5File(const std::string& path);
  ~Hdf5File();
  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;

  const std::string& path() const;
  // The paths of all groups, at any depth, that have a dataset of this name;
  // sorted.
  std::vector<std::string> GroupsWith(const std::string& dataset) const;
  bool Has(const std::string& dataset) const;
  Hdf5Matrix<float> ReadFloats(const std::string& dataset) const;
  Hdf5Matrix<int32_t> ReadInts(const std::string& dataset) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mgsfm
