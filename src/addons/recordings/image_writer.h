// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "recordings/recording.h"
#include "recordings/recording_import.h"

namespace mgsfm {

// A message that becomes a file.
struct ImageMessageTask {
  int topic_idx = 0;
  std::filesystem::path path;  // without extension
  std::string message;
  // Results: whether the file exists, and what is wrong with the message.
  bool was_present = false;
  std::string problem;
};

// Writes the file of an image unless it exists. Throws Error, continuing the
// name of the topic, for an unknown encoding; thread-safe.
void WriteImageMessage(const RecordingTopic& topic,
                       const RecordingImportOptions& options,
                       ImageMessageTask* task);

}  // namespace mgsfm
