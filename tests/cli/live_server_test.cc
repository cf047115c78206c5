// SPDX-License-Identifier: BSD-3-Clause
// The server of the live view and clients that misbehave, all on 127.0.0.1.
#include "live_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;
using testing::StartsWith;

int PortOf(const LiveServer& server) {
  const std::string url = server.Url();
  return std::stoi(url.substr(url.rfind(':') + 1));
}

// One connection to the server.
class Client {
 public:
  explicit Client(const LiveServer& server)
      : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<uint16_t>(PortOf(server)));
    const timeval limit{20, 0};
    setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
    setsockopt(fd_, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit));
    is_connected_ = connect(fd_, reinterpret_cast<sockaddr*>(&address),
                            sizeof(address)) == 0;
  }
  ~Client() { close(fd_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  bool IsConnected() const { return is_connected_; }
  // False once the server has closed the connection.
  bool Send(const std::string& text) const {
    return send(fd_, text.data(), text.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(text.size());
  }
  void EndSending() const { shutdown(fd_, SHUT_WR); }
  // Closing then resets the connection.
  void DropOnClose() const {
    const linger now{1, 0};
    setsockopt(fd_, SOL_SOCKET, SO_LINGER, &now, sizeof(now));
  }
  // All that comes until the server closes the connection.
  std::string Receive() const {
    std::string text;
    char buffer[65536];
    ssize_t size = 0;
    while ((size = recv(fd_, buffer, sizeof(buffer), 0)) > 0) {
      text.append(buffer, static_cast<size_t>(size));
    }
    return text;
  }

 private:
  int fd_;
  bool is_connected_;
};

std::string Ask(const LiveServer& server, const std::string& request) {
  const Client client(server);
  client.Send(request);
  return client.Receive();
}

const std::string kGoodRequest =
    "GET /state HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";

class LiveServerTest : public testing::Test {
 protected:
  LiveServerTest() : server_("127.0.0.1", 0) {
    server_.Publish("/state", "application/json", "{\"stage\":\"x\"}");
  }

  void ExpectGoodService() {
    EXPECT_THAT(Ask(server_, kGoodRequest),
                AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("{\"stage\"")));
  }

  LiveServer server_;
};

TEST_F(LiveServerTest, ServesWhatIsPublished) {
  const std::string answer = Ask(server_, kGoodRequest);
  EXPECT_THAT(answer, AllOf(StartsWith("HTTP/1.1 200"),
                            HasSubstr("Content-Type: application/json\r\n"),
                            HasSubstr("Connection: close\r\n"),
                            HasSubstr("\r\n\r\n{\"stage\":\"x\"}")));
  server_.Publish("/state", "application/json", "new");
  EXPECT_THAT(Ask(server_, kGoodRequest), HasSubstr("\r\n\r\nnew"));
}

TEST_F(LiveServerTest, RefusesOtherRequests) {
  const auto status = [&](const std::string& request) {
    return Ask(server_, request).substr(0, 12);
  };
  const std::string host = "Host: 127.0.0.1\r\n\r\n";
  EXPECT_EQ(status("GET /other HTTP/1.1\r\n" + host), "HTTP/1.1 404");
  EXPECT_EQ(status("GET /../etc/passwd HTTP/1.1\r\n" + host), "HTTP/1.1 404");
  EXPECT_EQ(
      status("POST /state HTTP/1.1\r\nContent-Length: 4\r\n" + host + "abcd"),
      "HTTP/1.1 405");
  EXPECT_EQ(status("POST /state HTTP/1.1\r\nContent-Length: 99999999999\r\n" +
                   host + std::string(100'000, 'x')),
            "HTTP/1.1 405");
  EXPECT_EQ(status("DELETE /state HTTP/1.1\r\n" + host), "HTTP/1.1 405");
  EXPECT_EQ(status("GET /state HTTP/1.1\r\nHost: example.com\r\n\r\n"),
            "HTTP/1.1 403");
  EXPECT_EQ(status("GET /state HTTP/1.1\r\nOrigin: http://a.com\r\n" + host),
            "HTTP/1.1 403");
  EXPECT_THAT(status("GET /state HTTP/1.1\r\n\r\n"),
              AnyOf("HTTP/1.1 400", "HTTP/1.1 403"));
  ExpectGoodService();
}

TEST_F(LiveServerTest, SurvivesGarbage) {
  std::mt19937 random(0);
  for (int i = 0; i < 60; ++i) {
    std::string bytes(random() % 4000, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    const Client client(server_);
    if (i % 2 == 0) client.Send("GET ");
    client.Send(bytes);
    if (i % 3 == 0) client.DropOnClose();
    if (i % 3 == 1) client.EndSending();
  }
  // A header, a line and a number of headers without end.
  for (const char* part : {"x", "GET /", "a: b\r\n"}) {
    const Client client(server_);
    client.Send("GET /state HTTP/1.1\r\n");
    std::string many;
    while (many.size() < 100'000) many += part;
    client.Send(many);
    client.EndSending();
    EXPECT_THAT(client.Receive(), testing::Not(StartsWith("HTTP/1.1 200")));
  }
  ExpectGoodService();
}

TEST_F(LiveServerTest, AnswersHalfClosedConnections) {
  const Client client(server_);
  client.Send(kGoodRequest);
  client.EndSending();
  EXPECT_THAT(client.Receive(), StartsWith("HTTP/1.1 200"));
  const Client incomplete(server_);
  incomplete.Send("GET /state HT");
  incomplete.EndSending();
  ExpectGoodService();
}

TEST_F(LiveServerTest, SlowRequestsMakeRoomForOthers) {
  constexpr int kNumClients = 80;  // more than may be connected
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < kNumClients; ++i) {
    clients.push_back(std::make_unique<Client>(server_));
    clients.back()->Send("GET /state HTTP/1.1\r\nX-");
  }
  std::atomic<bool> is_done{false};
  std::thread drip([&] {
    while (!is_done) {
      for (const auto& client : clients) client->Send("a");
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  });
  const Timer timer;
  ExpectGoodService();
  EXPECT_LT(timer.Seconds(), 15.0);
  is_done = true;
  drip.join();
}

TEST_F(LiveServerTest, SurvivesAFlood) {
  for (int i = 0; i < 1000; ++i) {
    const Client client(server_);
    if (i % 2 == 0) client.Send(kGoodRequest);
    client.DropOnClose();
  }
  std::string many;
  for (int i = 0; i < 1000; ++i) many += kGoodRequest;
  Ask(server_, many);
  ExpectGoodService();
}

TEST_F(LiveServerTest, SlowReadersDelayNobody) {
  server_.Publish("/model", "application/json", std::string(30'000'000, 'x'));
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 20; ++i) {
    clients.push_back(std::make_unique<Client>(server_));
    clients.back()->Send("GET /model HTTP/1.1\r\nHost: localhost\r\n\r\n");
  }
  ExpectGoodService();
  // New content does not disturb clients that still read the old one.
  server_.Publish("/model", "application/json", "y");
  const std::string old = clients.front()->Receive();
  EXPECT_EQ(old.size() - old.find("\r\n\r\n") - 4, 30'000'000u);
  EXPECT_EQ(old.find('y', old.find("\r\n\r\n")), std::string::npos);
}

TEST(LiveServer, EndsAtOnceWhateverClientsDo) {
  auto server = std::make_unique<LiveServer>("127.0.0.1", 0);
  server->Publish("/state", "text/plain", std::string(10'000'000, 'x'));
  const Client silent(*server), incomplete(*server), reader(*server);
  incomplete.Send("GET /st");
  reader.Send(kGoodRequest);
  const Timer timer;
  server.reset();
  EXPECT_LT(timer.Seconds(), 5.0);
}

TEST(LiveServer, ExplainsWhyItCannotListen) {
  const LiveServer server("127.0.0.1", 0);
  const auto message = [](const std::string& address, int port) {
    try {
      const LiveServer other(address, port);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(message("127.0.0.1", PortOf(server)),
              AllOf(HasSubstr(std::to_string(PortOf(server))),
                    HasSubstr("--live_port")));
  EXPECT_THAT(message("192.0.2.1", 0), HasSubstr("--live_address"));
  EXPECT_THAT(message("example.com", 0), HasSubstr("numeric address"));
  EXPECT_THAT(message("", 0), HasSubstr("numeric address"));
}

TEST(LiveServer, ListensToIpVersion6) {
  const auto make = [] {
    try {
      return std::make_unique<LiveServer>("::1", 0);
    } catch (const Error&) {
      return std::unique_ptr<LiveServer>();
    }
  };
  const auto server = make();
  if (!server) GTEST_SKIP() << "this machine has no IPv6";
  EXPECT_THAT(server->Url(), StartsWith("http://[::1]:"));
}

TEST_F(LiveServerTest, AwaitsAReaderOnlyIfThereWasOne) {
  const Timer timer;
  server_.AwaitReader("/state", 10.0);
  EXPECT_LT(timer.Seconds(), 5.0);
  ExpectGoodService();
  server_.Publish("/state", "text/plain", "last");
  std::thread reader([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    EXPECT_THAT(Ask(server_, kGoodRequest), HasSubstr("last"));
  });
  server_.AwaitReader("/state", 10.0);
  EXPECT_LT(timer.Seconds(), 9.0);
  reader.join();
}

}  // namespace
}  // namespace mgsfm
