// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "live_server.h"

namespace mgsfm {
namespace {

LiveRequest RequestOf(const std::string& host) {
  LiveRequest request;
  request.method = "GET";
  request.path = "/";
  request.host = host;
  return request;
}

bool IsAccepted(const LiveRequest& request, bool is_loopback_only = true) {
  return !RefusalOf(request, is_loopback_only).has_value();
}

TEST(LiveRequest, AcceptsThePageOnThisMachine) {
  for (const char* host : {"127.0.0.1", "127.0.0.1:8080", "127.8.9.1:1",
                           "localhost:9000", "[::1]:8080", "[::1]"}) {
    EXPECT_TRUE(IsAccepted(RequestOf(host))) << host;
    EXPECT_TRUE(IsAccepted(RequestOf(host), false)) << host;
  }
}

TEST(LiveRequest, RefusesNamesThatAnotherSiteMayHaveDirectedHere) {
  for (const char* host :
       {"example.com", "example.com:8080", "127.0.0.1.example.com",
        "localhost.example.com", "localhost@example.com", "", ":8080", "[",
        "[::1", "[::1]x", "127.0.0.1:", "127.0.0.1:80x", "127.0.0.1:999999",
        "127.1", "0x7f.0.0.1", "::1", "127.0.0.1/", " 127.0.0.1"}) {
    EXPECT_FALSE(IsAccepted(RequestOf(host))) << host;
    EXPECT_FALSE(IsAccepted(RequestOf(host), false)) << host;
  }
  LiveRequest request = RequestOf("");
  request.host.reset();
  EXPECT_FALSE(IsAccepted(request));
}

TEST(LiveRequest, OtherAddressesOnlyIfItListensToTheNetwork) {
  for (const char* host : {"192.168.1.5:8080", "[fe80::1]:8080"}) {
    EXPECT_FALSE(IsAccepted(RequestOf(host))) << host;
    EXPECT_TRUE(IsAccepted(RequestOf(host), false)) << host;
  }
}

TEST(LiveRequest, RefusesOtherSites) {
  LiveRequest request = RequestOf("127.0.0.1:8080");
  request.origin = "http://127.0.0.1:8080";
  request.fetch_site = "same-origin";
  EXPECT_TRUE(IsAccepted(request));
  for (const char* origin : {"http://127.0.0.1:8081", "https://127.0.0.1:8080",
                             "http://example.com", "null", ""}) {
    request.origin = origin;
    EXPECT_FALSE(IsAccepted(request)) << origin;
  }
  request.origin.reset();
  for (const char* site : {"cross-site", "same-site", ""}) {
    request.fetch_site = site;
    EXPECT_FALSE(IsAccepted(request)) << site;
  }
}

TEST(LiveRequest, RefusesAllMethodsButGet) {
  LiveRequest request = RequestOf("127.0.0.1");
  for (const char* method : {"POST", "HEAD", "PUT", "OPTIONS", "get", ""}) {
    request.method = method;
    EXPECT_EQ(RefusalOf(request, true)->status, 405) << method;
  }
}

TEST(LiveRequest, KnowsLoopbackAddresses) {
  for (const char* address : {"127.0.0.1", "127.255.0.9", "::1"}) {
    EXPECT_TRUE(IsLoopback(address)) << address;
  }
  for (const char* address : {"0.0.0.0", "10.0.0.1", "::", "localhost", "",
                              "128.0.0.1", "::ffff:127.0.0.1"}) {
    EXPECT_FALSE(IsLoopback(address)) << address;
  }
}

}  // namespace
}  // namespace mgsfm
