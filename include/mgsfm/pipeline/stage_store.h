// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace mgsfm {

struct MapperInput;

// Keeps what the stages of a run computed, so that a later run with the same
// input and options continues after them and ends with the same result.
class StageStore {
 public:
  virtual ~StageStore() = default;
  // The content saved under this name; nullopt if there is none.
  virtual std::optional<std::string> Load(const std::string& name) = 0;
  // Replaces an earlier content of this name.
  virtual void Save(const std::string& name, const std::string& content) = 0;
};

// A hash of everything in the input that stages read. Cost: linear in its size.
[[nodiscard]] uint64_t HashInput(const MapperInput& input);
[[nodiscard]] uint64_t HashText(const std::string& text);

}  // namespace mgsfm
