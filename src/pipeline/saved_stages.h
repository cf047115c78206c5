// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/bundle/bundle_adjustment.h"
#include "mgsfm/pipeline/stage_store.h"
#include "pipeline/stage_archive.h"
#include "pipeline/timed.h"

namespace mgsfm {

// Stages that are saved. The names of what they save start with the prefix.
struct StageFolder {
  StageStore* store = nullptr;  // null: nothing is saved
  std::string prefix = {};
};

template <class T>
std::optional<T> LoadStage(const StageFolder& stages, const std::string& name) {
  if (stages.store == nullptr) return std::nullopt;
  const std::optional<std::string> content =
      stages.store->Load(stages.prefix + name);
  if (!content) return std::nullopt;
  StringSource source(*content);
  return ReadFrom<StringSource, T>(&source);
}

template <class T>
void SaveStage(const StageFolder& stages, const std::string& name,
               const T& value) {
  if (stages.store == nullptr) return;
  StringSink sink;
  WriteTo(&sink, value);
  stages.store->Save(stages.prefix + name, sink.content);
}

// Timed() for a stage whose result is saved, or loaded if it was. Its time is
// that of the run that computed it.
template <class Function>
auto Saved(const StageFolder& stages, const char* stage, const Context& context,
           std::vector<StageTime>* times, const Function& function) {
  using Result = decltype(function());
  if (auto earlier = LoadStage<Result>(stages, stage)) {
    times->push_back(LoadStage<StageTime>(stages, std::string(stage) + ", time")
                         .value_or(StageTime{stage}));
    context.Info(std::string(stage) + ": from the checkpoint");
    return std::move(*earlier);
  }
  Result result = Timed(stage, context, times, function);
  SaveStage(stages, std::string(stage) + ", time", times->back());
  SaveStage(stages, stage, result);
  return result;
}

// The store of bundle adjustment; without a stage store, an empty one.
inline RefinementStore MakeRefinementStore(const StageFolder& stages) {
  if (stages.store == nullptr) return {};
  constexpr const char* kName = "bundle adjustment";
  return {[stages] { return LoadStage<RefinementState>(stages, kName); },
          [stages](const RefinementState& state) {
            SaveStage(stages, kName, state);
          }};
}

}  // namespace mgsfm
