// SPDX-License-Identifier: BSD-3-Clause
#include "live_view.h"

#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "mgsfm/base/error.h"
#include "mgsfm/report_page/report_page.h"

namespace mgsfm {
namespace {

// The page asks every second, so it lags by at most a quarter of this.
constexpr double kStateInterval_s = 0.25;
// The last messages; the log has all of them.
constexpr size_t kMaxMessages = 12;
// Models are published at most at this interval, and so rarely that they cost
// at most 2 % of the time.
constexpr double kModelInterval_s = 1.0;
constexpr double kMinTimeBetweenModelsPerCost = 50.0;
// Enough for 50,000 points; each model is sent as a whole.
constexpr size_t kMaxModelBytes = 3'000'000;
// Time for three requests of the page, which asks every second.
constexpr double kMaxWaitForReader_s = 3.0;

}  // namespace

std::unique_ptr<LiveView> LiveView::Start(const LiveViewOptions& options,
                                          const std::string& title,
                                          const Context& context) {
  if (options.port < 0) return nullptr;
  std::unique_ptr<LiveView> view(
      new LiveView(options.address, options.port, title));
  context.Info("open " + view->server_.Url() + " in a browser to watch");
  return view;
}

LiveView::LiveView(const std::string& address, int port, std::string title)
    : server_(address, port),
      title_(std::move(title)),
      progress_(kStateInterval_s) {
  server_.Publish("/", "text/html; charset=utf-8", MakeLivePage(title_));
  server_.Publish("/model", "application/json", "{}");
  PublishState();
}

Context LiveView::Watch(const Context& context) {
  Context watched = context;
  watched.log = [this, log = context.log](LogLevel level,
                                          const std::string& message) {
    if (log) log(level, message);
    ShowMessage(level, message);
  };
  watched.progress = [this, show = context.progress](const Progress& progress) {
    if (show) show(progress);
    ShowProgress(progress);
  };
  return watched;
}

ModelObserver LiveView::Observe(const Scene& scene, const Context& context) {
  return [this, &scene, &context](const Reconstruction& model) {
    ShowModel(scene, model, context);
  };
}

void LiveView::Finish(const std::string& page) {
  if (page.empty()) return;
  server_.Publish("/", "text/html; charset=utf-8", page);
  is_finished_ = true;
  PublishState();
  server_.AwaitReader("/", kMaxWaitForReader_s);
}

void LiveView::ShowMessage(LogLevel level, const std::string& message) {
  if (level < LogLevel::kInfo) return;
  messages_.push_back(message);
  if (messages_.size() > kMaxMessages) messages_.erase(messages_.begin());
  PublishState();
}

void LiveView::ShowProgress(const Progress& progress) {
  const auto line = progress_.Update(progress, since_start_.Seconds());
  const bool is_new = progress.stage != stage_;
  // Progress does not cover the work after the last step of a stage.
  const bool has_ended =
      !line && progress.done >= progress.total && !progress_line_.empty();
  if (!is_new && !line && !has_ended) return;
  stage_ = progress.stage;
  progress_line_ = line.value_or("");
  share_ = line ? progress_.Share() : 0.0;
  PublishState();
}

void LiveView::ShowModel(const Scene& scene, const Reconstruction& model,
                         const Context& context) {
  if (since_start_.Seconds() < next_model_s_) return;
  const Timer timer;
  try {
    ReportPageOptions limits;
    limits.max_bytes = kMaxModelBytes;
    server_.Publish("/model", "application/json",
                    MakeLiveModel({title_, scene, model}, limits, context));
    ++model_version_;
  } catch (const Interrupted&) {
    throw;
  } catch (const std::exception&) {
    // The view keeps the previous model; the run matters more.
  }
  next_model_s_ = since_start_.Seconds() +
                  std::max(kModelInterval_s,
                           kMinTimeBetweenModelsPerCost * timer.Seconds());
  PublishState();
}

void LiveView::PublishState() {
  const double now_s = since_start_.Seconds();
  const nlohmann::ordered_json state = {
      {"stage", stage_},         {"progress", progress_line_},
      {"share", share_},         {"elapsed_s", now_s},
      {"messages", messages_},   {"model_version", model_version_},
      {"finished", is_finished_}};
  server_.Publish("/state", "application/json",
                  state.dump(-1, ' ', false,
                             nlohmann::ordered_json::error_handler_t::replace));
}

}  // namespace mgsfm
