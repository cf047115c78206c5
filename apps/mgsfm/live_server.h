// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>

namespace mgsfm {

// The parts of an HTTP request that identify its sender.
struct LiveRequest {
  std::string method;
  std::string path;
  std::optional<std::string> host;        // header Host
  std::optional<std::string> origin;      // header Origin
  std::optional<std::string> fetch_site;  // header Sec-Fetch-Site
};

// Why a request is refused.
struct LiveRefusal {
  int status = 0;
  const char* reason = "";
};

// Accepts only requests that the live page makes:
//
//   method  GET
//   Host    an address in numbers, or localhost. Any other name may be one
//           that another site has directed to this server (DNS rebinding). If
//           the server listens to this machine only, the address is a loopback
//           address.
//   Origin, Sec-Fetch-Site   the page itself, or none: the user typed the
//           address, or the program is no browser
//
// Ports do not matter: they differ behind a tunnel (ssh -L).
std::optional<LiveRefusal> RefusalOf(const LiveRequest& request,
                                     bool is_loopback_only);

// Whether a numeric IPv4 or IPv6 address is a loopback address.
bool IsLoopback(const std::string& address);

// Serves a few documents over HTTP to the live page (RefusalOf() has the
// rules), from a separate thread. Clients cannot change anything; their
// requests only cost processor time:
//
//   request      at most 32 KiB, without a body, complete within 5 s
//   answer       fetched within 60 s; then the connection is closed
//   connections  at most 64. If all are in use, those without a complete
//                request make room after a second.
//
// Without libmicrohttpd at build time, the constructor throws Error.
class LiveServer {
 public:
  // `address` in numbers; port 0 is replaced by a free one. Throws Error if the
  // address does not belong to this machine or the port is in use.
  LiveServer(const std::string& address, int port);
  ~LiveServer();
  LiveServer(const LiveServer&) = delete;
  LiveServer& operator=(const LiveServer&) = delete;

  // The address of the page for a browser.
  std::string Url() const;

  // Adds a document or replaces it. Any thread may call this.
  void Publish(const std::string& path, const std::string& content_type,
               const std::string& content);

  // If a client has requested something in the last three seconds, waits until
  // the current content of a path has been sent, but at most `seconds`.
  void AwaitReader(const std::string& path, double seconds);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mgsfm
