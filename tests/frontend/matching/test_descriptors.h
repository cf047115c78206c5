// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "base/random.h"
#include "matching/descriptor_matching.h"

namespace mgsfm {

// Rows of 128 bytes with about the norm of SIFT descriptors.
struct TestDescriptors {
  std::vector<uint8_t> values;

  size_t size() const { return values.size() / DescriptorView::kDim; }
  DescriptorView View() const { return {values.data(), size()}; }

  // Like SIFT: few large values and many small ones.
  void AddRandom(Random* random) {
    std::vector<double> row(DescriptorView::kDim);
    double squared_norm = 0.0;
    for (double& value : row) {
      value = std::pow(random->Uniform(), 3.0);
      squared_norm += value * value;
    }
    AddScaled(row, 512.0 / std::sqrt(squared_norm));
  }

  void AddNoisyCopy(const uint8_t* row, double noise, Random* random) {
    std::vector<double> noisy(DescriptorView::kDim);
    for (size_t k = 0; k < noisy.size(); ++k) {
      noisy[k] = row[k] + noise * random->Normal();
    }
    AddScaled(noisy, 1.0);
  }

 private:
  void AddScaled(const std::vector<double>& row, double scale) {
    for (const double value : row) {
      values.push_back(static_cast<uint8_t>(
          std::lround(std::fmin(std::fmax(scale * value, 0.0), 255.0))));
    }
  }
};

inline TestDescriptors RandomDescriptors(size_t size, Random* random) {
  TestDescriptors descriptors;
  for (size_t i = 0; i < size; ++i) descriptors.AddRandom(random);
  return descriptors;
}

// Noisy copies of some of the rows among random ones, in reverse order.
inline TestDescriptors PartlyMatching(const TestDescriptors& other, size_t size,
                                      double noise, Random* random) {
  TestDescriptors descriptors;
  for (size_t i = 0; i < size; ++i) {
    if (i < other.size() && random->Uniform() < 0.5) {
      descriptors.AddNoisyCopy(other.View().Row(other.size() - 1 - i), noise,
                               random);
    } else {
      descriptors.AddRandom(random);
    }
  }
  return descriptors;
}

}  // namespace mgsfm
