// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "io/files/file_operations.h"

namespace mgsfm {

// Puts finished entries in their places, all of them or, after a failure, none.
//
// The swap works in a hidden folder `work` in the folder `base` that holds the
// places:
//   work/new/NAME   a new entry for base/NAME
//   work/old/NAME   an entry that was taken from base/NAME
//   work/journal    the steps; while it exists, they must be finished or undone
//
// The journal is published, by a rename, when everything in work/new is on the
// disk. From then on each step can be repeated and undone at any time, as the
// state of a step follows from the entries that exist. A process that
// finds a journal, after a kill or a loss of power, finishes the swap.
struct SwapStep {
  enum class Kind {
    kAdd,      // work/new/name becomes base/name, where there is nothing
    kReplace,  // work/new/name and base/name are exchanged
    kRemove,   // base/name goes to work/old
  };
  Kind kind = Kind::kAdd;
  std::string name;
  // Inode of the new entry. After an exchange, work/new/name is the old one.
  uint64_t inode = 0;
};

struct SwapPlaces {
  std::filesystem::path base;
  std::filesystem::path work;
};

class OutputSwap {
 public:
  OutputSwap(std::filesystem::path base, std::filesystem::path work,
             FileOperations* operations);

  static std::filesystem::path NewDir(const std::filesystem::path& work);
  std::filesystem::path NewDir() const { return NewDir(places_.work); }

  // Append a step; steps run in this order. Folders that are replaced or
  // removed must be models: their entries that are not files of a model
  // (model_files.h) are moved back to where they were.
  void Add(const std::string& name);
  void Replace(const std::string& name);
  void Remove(const std::string& name);

  // Publishes the journal and does all steps; work/new must be synced. If one
  // fails, undoes those before and throws Error. If even that fails the journal
  // stays, and the next run calls FinishPending.
  void Run();

  // Returns whether `work` has a journal and must not be removed.
  static bool IsPending(const std::filesystem::path& work);

  // Finishes the steps of a journal or, if that fails, undoes them. Throws
  // Error if both fail.
  static void FinishPending(const std::filesystem::path& base,
                            const std::filesystem::path& work,
                            FileOperations* operations);

 private:
  void AddStep(SwapStep::Kind kind, const std::string& name);

  const SwapPlaces places_;
  FileOperations* const operations_;
  std::vector<SwapStep> steps_;
};

}  // namespace mgsfm
