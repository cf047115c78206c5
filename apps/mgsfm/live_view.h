// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "live_server.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/mapper/mapper.h"
#include "terminal.h"

namespace mgsfm {

struct LiveViewOptions {
  Option<int> port{"live_port", -1, Between(-1, 65535),
                   "Show the run in a browser at http://127.0.0.1:PORT/: the "
                   "growing model, the stage and the remaining time. 0 takes "
                   "any free port, -1 shows nothing."};
  Option<std::string> address{
      "live_address", "127.0.0.1",
      "Listen on this numeric address of the machine. Any address but "
      "127.0.0.1 and ::1 lets everybody on the network watch."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(port, address);
  }
};

// Shows a run in a browser: the report page of the model that is being
// reconstructed, the stage, the remaining time and the last messages.
//
// After each page, at least 50 times as long as making it passes before the
// next, so that the run becomes at most 2 % longer.
class LiveView {
 public:
  // Null unless the options name a port. Throws Error if it cannot be used.
  static std::unique_ptr<LiveView> Start(const LiveViewOptions& options,
                                         const std::string& title,
                                         const Context& context);

  // The context whose progress and messages the view also shows. The view must
  // outlive it.
  Context Watch(const Context& context);

  // Shows models of this scene. View, scene and context must outlive the
  // observer.
  ModelObserver Observe(const Scene& scene, const Context& context);

  // Replaces the view by the page of the finished model, unless the page is "".
  // Waits briefly for a browser to fetch it.
  void Finish(const std::string& page);

 private:
  LiveView(const std::string& address, int port, std::string title);

  void ShowMessage(LogLevel level, const std::string& message);
  void ShowProgress(const Progress& progress);
  void ShowModel(const Scene& scene, const Reconstruction& model,
                 const Context& context);
  void PublishState();

  LiveServer server_;
  std::string title_;
  Timer since_start_;
  ProgressText progress_;
  // The state that the page shows.
  std::string stage_;
  std::string progress_line_;
  double share_ = 0.0;
  std::vector<std::string> messages_;
  int model_version_ = 0;
  bool is_finished_ = false;
  double next_model_s_ = 0.0;
};

}  // namespace mgsfm
