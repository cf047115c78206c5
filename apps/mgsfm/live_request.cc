// SPDX-License-Identifier: BSD-3-Clause
#include "live_request.h"

#include <arpa/inet.h>

#include <algorithm>
#include <cctype>

namespace mgsfm {
namespace {

bool IsPort(const std::string& text) {
  return !text.empty() && text.size() <= 5 &&
         std::all_of(text.begin(), text.end(),
                     [](unsigned char c) { return std::isdigit(c) != 0; });
}

// The name in "name", "name:port", "[address]" or "[address]:port".
std::optional<std::string> HostName(const std::string& host) {
  const bool is_bracketed = !host.empty() && host.front() == '[';
  const size_t begin = is_bracketed ? 1 : 0;
  const size_t end = is_bracketed ? host.find(']') : host.find(':');
  if (is_bracketed && end == std::string::npos) return std::nullopt;
  const size_t rest = is_bracketed ? end + 1 : end;
  if (rest < host.size() &&
      (host[rest] != ':' || !IsPort(host.substr(rest + 1)))) {
    return std::nullopt;
  }
  return host.substr(begin, end - begin);
}

bool IsAddress(const std::string& name) {
  in6_addr address{};
  return inet_pton(AF_INET, name.c_str(), &address) == 1 ||
         inet_pton(AF_INET6, name.c_str(), &address) == 1;
}

bool IsOwnHost(const std::string& host, bool is_loopback_only) {
  const std::optional<std::string> name = HostName(host);
  if (!name) return false;
  if (*name == "localhost") return true;
  return is_loopback_only ? IsLoopback(*name) : IsAddress(*name);
}

}  // namespace

std::optional<LiveRefusal> RefusalOf(const LiveRequest& request,
                                     bool is_loopback_only) {
  if (request.method != "GET") {
    return LiveRefusal{405, "only GET is allowed"};
  }
  if (!request.host || !IsOwnHost(*request.host, is_loopback_only)) {
    return LiveRefusal{
        403, "open the page by its address in numbers, or as localhost"};
  }
  if (request.origin && *request.origin != "http://" + *request.host) {
    return LiveRefusal{403, "another site must not use this page"};
  }
  if (request.fetch_site && *request.fetch_site != "same-origin" &&
      *request.fetch_site != "none") {
    return LiveRefusal{403, "another site must not use this page"};
  }
  return std::nullopt;
}

bool IsLoopback(const std::string& address) {
  in_addr v4{};
  if (inet_pton(AF_INET, address.c_str(), &v4) == 1) {
    constexpr uint32_t kLoopbackNet = 127;  // 127.0.0.0/8 (RFC 1122)
    return ntohl(v4.s_addr) >> 24 == kLoopbackNet;
  }
  in6_addr v6{};
  return inet_pton(AF_INET6, address.c_str(), &v6) == 1 &&
         IN6_IS_ADDR_LOOPBACK(&v6);
}

}  // namespace mgsfm
