// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "io/files/file_operations.h"

namespace mgsfm {

class FolderLock;
class OutputSwap;

enum class OutputKind {
  kRun,    // holds models in folders "0", "1", ...
  kModel,  // is a model
};

// Output that appears as a whole or not at all. Files are written into a hidden
// temporary folder; Commit() moves them to the target.
//
// Commit() replaces entries of the same name and removes the other files of an
// earlier output: those of a model (model_files.h), of all models of a run, and
// folders of models that are then empty. Everything else in the target stays.
//
// A process that is killed leaves either the old output, or a journal with
// which the next one with the same target finishes the swap (OutputSwap). A
// folder that holds a model and nothing else is replaced by one exchange, where
// the file system can, so that every model is complete at every instant. In
// other folders the file of images is taken away first and put in place last:
// in between there is no model, rather than one of old and new files.
class StagedOutput {
 public:
  // First finishes what a killed process began. Throws Error
  // - if the target is a file, or nothing can be written there,
  // - if the output would replace something that is not a model,
  // - if an earlier swap can neither be finished nor undone.
  explicit StagedOutput(const std::filesystem::path& target,
                        OutputKind kind = OutputKind::kRun);
  // `operations` must outlive the object.
  StagedOutput(const std::filesystem::path& target, OutputKind kind,
               FileOperations* operations);
  // Removes the temporary folder.
  ~StagedOutput();
  StagedOutput(const StagedOutput&) = delete;
  StagedOutput& operator=(const StagedOutput&) = delete;

  std::filesystem::path StagingDir() const;

  // May be called once. Throws Error if a call fails, after restoring the
  // target.
  void Commit();

 private:
  void RemoveStale(const std::filesystem::path& folder) const;
  void MakeStagingDir();
  void RemoveNewParents();
  std::filesystem::path ChooseBase() const;
  void PlanEntry(const std::string& name, OutputSwap* swap) const;
  void PlanModel(const std::string& name, OutputSwap* swap) const;
  void PlanRemoval(const std::string& name, OutputSwap* swap) const;
  void PlanObsoleteModels(OutputSwap* swap) const;
  bool CanMove(const std::filesystem::path& folder) const;
  std::string InBase(const std::string& name) const;

  FileOperations default_operations_;
  FileOperations* const operations_;
  std::filesystem::path target_;
  const OutputKind kind_;
  // The temporary folder lies in `base_`: the target, or its parent folder.
  std::filesystem::path base_;
  std::filesystem::path staging_;
  std::unique_ptr<FolderLock> lock_;  // on staging_, while this object lives
  // Folders made above a new target, the lowest first.
  std::vector<std::filesystem::path> new_parents_;
};

// Returns whether an output may replace or remove this file.
bool IsReplacedByOutput(const std::filesystem::path& target, OutputKind kind,
                        const std::filesystem::path& file);

}  // namespace mgsfm
