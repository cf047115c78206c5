// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace mgsfm {

// A two-dimensional HDF5 dataset; a vector is a matrix of one row.
template <class T>
struct Hdf5Matrix {
  size_t rows = 0;
  size_t cols = 0;
  std::vector<T> values;  // row by row
};

// An HDF5 file to read. Numbers of any size become float or int32. All
// functions throw Error, naming file and dataset, for damaged files.
class Hdf5File {
 public:
  Hdf5File() = default;
  virtual ~Hdf5File() = default;
  Hdf5File(const Hdf5File&) = delete;
  Hdf5File& operator=(const Hdf5File&) = delete;

  virtual const std::string& path() const = 0;
  // The paths of all groups, at any depth, that have a dataset of this name;
  // sorted.
  virtual std::vector<std::string> GroupsWith(
      const std::string& dataset) const = 0;
  virtual bool Has(const std::string& dataset) const = 0;
  virtual Hdf5Matrix<float> ReadFloats(const std::string& dataset) const = 0;
  virtual Hdf5Matrix<int32_t> ReadInts(const std::string& dataset) const = 0;
};

// Also throws Error if this build has no HDF5.
std::unique_ptr<Hdf5File> OpenHdf5(const std::string& path);

}  // namespace mgsfm
