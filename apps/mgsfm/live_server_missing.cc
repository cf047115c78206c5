// SPDX-License-Identifier: BSD-3-Clause
// Replaces live_server.cc in builds without libmicrohttpd.
#include "live_server.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

class LiveServer::Impl {};

LiveServer::LiveServer(const std::string&, int) {
  throw Error(
      "this mgsfm has no live view, because it was built without "
      "libmicrohttpd; install libmicrohttpd-dev and build it again, or omit "
      "--live_port");
}

LiveServer::~LiveServer() = default;

std::string LiveServer::Url() const { return ""; }

void LiveServer::Publish(const std::string&, const std::string&,
                         const std::string&) {}

void LiveServer::AwaitReader(const std::string&, double) {}

}  // namespace mgsfm
