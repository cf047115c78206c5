// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

namespace mgsfm {

// The parts of an HTTP request that tell who sent it.
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

// Accepts a request only if it is one that the live page makes:
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

}  // namespace mgsfm
