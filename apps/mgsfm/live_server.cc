// SPDX-License-Identifier: BSD-3-Clause
#include "live_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <exception>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

bool IsPort(const std::string& text) {
  return !text.empty() && text.size() <= 5 &&
         AllOf(text, [](unsigned char c) { return std::isdigit(c) != 0; });
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
  const bool is_of_other_origin =
      request.origin && *request.origin != "http://" + *request.host;
  const bool is_of_other_site = request.fetch_site &&
                                *request.fetch_site != "same-origin" &&
                                *request.fetch_site != "none";
  if (is_of_other_origin || is_of_other_site) {
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

namespace {

// A browser opens at most six connections to one address: enough for ten
// readers.
constexpr unsigned kMaxConnections = 64;
// Browsers send the cookies of all programs that have served this address.
constexpr size_t kMaxRequestBytes = 32768;
// A request is smaller than two dozen packets, so it arrives in one go.
constexpr double kMaxRequest_s = 5.0;
// A report of 10 MB takes 8 s at 10 Mbit/s; slower connections need more.
constexpr double kMaxConnection_s = 60.0;
// The time that an incomplete request may take if others wait.
constexpr double kMinRequest_s = 1.0;
// The longest time for which the end of the program waits for the loop.
constexpr int kPollMilliseconds = 50;
// The pause between rounds of the loop: a flood of requests cannot occupy a
// core.
constexpr std::chrono::milliseconds kPause(2);
// The page asks every second.
constexpr double kReaderMemory_s = 3.0;

// A socket address of either family.
struct Endpoint {
  sockaddr_storage storage = {};
  socklen_t size = 0;

  const sockaddr* get() const {
    return reinterpret_cast<const sockaddr*>(&storage);
  }
};

Endpoint MakeEndpoint(const std::string& address, int port) {
  Endpoint endpoint;
  auto* v4 = reinterpret_cast<sockaddr_in*>(&endpoint.storage);
  auto* v6 = reinterpret_cast<sockaddr_in6*>(&endpoint.storage);
  if (inet_pton(AF_INET, address.c_str(), &v4->sin_addr) == 1) {
    endpoint.storage.ss_family = AF_INET;
    endpoint.size = sizeof(*v4);
  } else if (inet_pton(AF_INET6, address.c_str(), &v6->sin6_addr) == 1) {
    endpoint.storage.ss_family = AF_INET6;
    endpoint.size = sizeof(*v6);
  } else {
    throw Error("--live_address '" + address +
                "' is not a numeric address such as 127.0.0.1 or 0.0.0.0");
  }
  // The port is at the same place in both families.
  const uint16_t port_in_network_order = htons(static_cast<uint16_t>(port));
  std::memcpy(&v6->sin6_port, &port_in_network_order, sizeof(v6->sin6_port));
  return endpoint;
}

// Opens the socket on which the server listens.
int Listen(const std::string& address, int port) {
  const Endpoint endpoint = MakeEndpoint(address, port);
  const int server = socket(endpoint.storage.ss_family,
                            SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const auto fail = [&] {
    const int error = errno;
    if (server >= 0) close(server);
    const std::string remedy =
        error == EADDRINUSE || error == EACCES
            ? "; choose another --live_port, or 0 for any that is free"
            : "; check --live_address";
    throw Error("the live view cannot listen on " + address + " port " +
                std::to_string(port) + ": " + std::strerror(error) + remedy);
  };
  if (server < 0) fail();
  // Lets a new run use the port while connections of the previous run time out.
  const int on = 1;
  setsockopt(server, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  if (bind(server, endpoint.get(), endpoint.size) != 0) fail();
  if (listen(server, SOMAXCONN) != 0) fail();
  return server;
}

int PortOf(int fd) {
  sockaddr_storage storage{};
  socklen_t size = sizeof(storage);
  getsockname(fd, reinterpret_cast<sockaddr*>(&storage), &size);
  const auto* v6 = reinterpret_cast<const sockaddr_in6*>(&storage);
  // The port is at the same place in both families.
  return ntohs(v6->sin6_port);
}

// An answer of libmicrohttpd, which counts those who use it.
using Response = std::shared_ptr<MHD_Response>;

Response MakeResponse(const std::string& content_type,
                      const std::string& content) {
  // The library copies the content, although it takes a pointer to non-const.
  Response response(MHD_create_response_from_buffer(
                        content.size(), const_cast<char*>(content.data()),
                        MHD_RESPMEM_MUST_COPY),
                    MHD_destroy_response);
  if (!response) throw std::bad_alloc();
  const std::pair<const char*, const char*> headers[] = {
      {"Content-Type", content_type.c_str()},
      {"Cache-Control", "no-store"},
      {"Connection", "close"},
      {"X-Content-Type-Options", "nosniff"},
      {"X-Frame-Options", "DENY"},
      {"Cross-Origin-Resource-Policy", "same-origin"},
      {"Cross-Origin-Opener-Policy", "same-origin"},
      {"Referrer-Policy", "no-referrer"}};
  for (const auto& [name, value] : headers) {
    MHD_add_response_header(response.get(), name, value);
  }
  return response;
}

std::optional<std::string> Header(MHD_Connection* connection,
                                  const char* name) {
  const char* value =
      MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  if (value == nullptr) return std::nullopt;
  return value;
}

}  // namespace

class LiveServer::Impl {
 public:
  Impl(const std::string& address, int port)
      : address_(address), is_loopback_only_(IsLoopback(address)) {
    const int socket = Listen(address, port);  // the library will close it
    port_ = PortOf(socket);
    daemon_ = MHD_start_daemon(
        MHD_USE_AUTO, 0, nullptr, nullptr, &Impl::OnRequest, this,
        MHD_OPTION_LISTEN_SOCKET, socket, MHD_OPTION_CONNECTION_LIMIT,
        kMaxConnections, MHD_OPTION_CONNECTION_MEMORY_LIMIT, kMaxRequestBytes,
        MHD_OPTION_CONNECTION_TIMEOUT, static_cast<unsigned>(kMaxConnection_s),
        MHD_OPTION_NOTIFY_CONNECTION, &Impl::OnConnection, this,
        MHD_OPTION_END);
    if (daemon_ == nullptr) throw Error("the live view cannot be started");
    thread_ = std::thread([this] { Run(); });
  }

  ~Impl() {
    is_stopped_ = true;
    thread_.join();
    MHD_stop_daemon(daemon_);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  std::string Url() const {
    const bool is_v6 = address_.find(':') != std::string::npos;
    return "http://" + (is_v6 ? "[" + address_ + "]" : address_) + ":" +
           std::to_string(port_) + "/";
  }

  void Publish(const std::string& path, const std::string& content_type,
               const std::string& content) {
    Response response = MakeResponse(content_type, content);
    const std::lock_guard<std::mutex> lock(mutex_);
    documents_[path] = {std::move(response), false};
  }

  void AwaitReader(const std::string& path, double seconds) {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!last_request_ || last_request_->Seconds() > kReaderMemory_s) return;
    was_sent_.wait_for(lock, std::chrono::duration<double>(seconds), [&] {
      return documents_[path].is_sent && connections_.empty();
    });
  }

 private:
  struct Document {
    Response response;
    bool is_sent = false;
  };
  struct Connection {
    int fd = -1;
    Timer age;
    bool has_request = false;
  };

  // Everything below runs on the thread of the server.

  void Run() {
    while (!is_stopped_) {
      MHD_run_wait(daemon_, kPollMilliseconds);
      EndSlowConnections();
      std::this_thread::sleep_for(kPause);
    }
  }

  // The library notices the end of a connection in its next round.
  void EndSlowConnections() {
    const std::lock_guard<std::mutex> lock(mutex_);
    const double max_request_s =
        connections_.size() >= kMaxConnections ? kMinRequest_s : kMaxRequest_s;
    for (const auto& [handle, connection] : connections_) {
      const double max_s =
          connection.has_request ? kMaxConnection_s : max_request_s;
      if (connection.age.Seconds() > max_s) shutdown(connection.fd, SHUT_RDWR);
    }
  }

  static void OnConnection(void* self, MHD_Connection* handle, void**,
                           MHD_ConnectionNotificationCode code) {
    auto* impl = static_cast<Impl*>(self);
    try {
      const std::lock_guard<std::mutex> lock(impl->mutex_);
      if (code == MHD_CONNECTION_NOTIFY_CLOSED) {
        impl->connections_.erase(handle);
        impl->was_sent_.notify_all();
        return;
      }
      const MHD_ConnectionInfo* info =
          MHD_get_connection_info(handle, MHD_CONNECTION_INFO_CONNECTION_FD);
      if (info != nullptr) impl->connections_[handle].fd = info->connect_fd;
    } catch (const std::exception&) {
      // If the entry cannot be allocated, the connection only ends by itself.
    }
  }

  static MHD_Result OnRequest(void* self, MHD_Connection* handle,
                              const char* path, const char* method, const char*,
                              const char*, size_t*, void**) {
    try {
      return static_cast<Impl*>(self)->Answer(handle, path, method);
    } catch (const std::exception&) {
      return MHD_NO;  // closes the connection
    }
  }

  MHD_Result Answer(MHD_Connection* handle, const char* path,
                    const char* method) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto connection = connections_.find(handle);
    if (connection != connections_.end()) connection->second.has_request = true;
    const LiveRequest request{method, path, Header(handle, "Host"),
                              Header(handle, "Origin"),
                              Header(handle, "Sec-Fetch-Site")};
    if (const auto refusal = RefusalOf(request, is_loopback_only_)) {
      return Refuse(handle, *refusal);
    }
    const auto document = documents_.find(request.path);
    if (document == documents_.end()) {
      return Refuse(handle, {404, "there is no such page"});
    }
    last_request_.emplace();
    document->second.is_sent = true;
    return MHD_queue_response(handle, MHD_HTTP_OK,
                              document->second.response.get());
  }

  static MHD_Result Refuse(MHD_Connection* handle, const LiveRefusal& refusal) {
    const Response response =
        MakeResponse("text/plain", std::string(refusal.reason) + "\n");
    return MHD_queue_response(handle, static_cast<unsigned>(refusal.status),
                              response.get());
  }

  std::string address_;
  bool is_loopback_only_;
  int port_ = 0;
  MHD_Daemon* daemon_ = nullptr;
  std::atomic<bool> is_stopped_{false};
  std::mutex mutex_;  // guards all below
  std::map<std::string, Document> documents_;
  std::map<MHD_Connection*, Connection> connections_;
  std::optional<Timer> last_request_;
  std::condition_variable was_sent_;
  std::thread thread_;
};

LiveServer::LiveServer(const std::string& address, int port)
    : impl_(std::make_unique<Impl>(address, port)) {}

LiveServer::~LiveServer() = default;

std::string LiveServer::Url() const { return impl_->Url(); }

void LiveServer::Publish(const std::string& path,
                         const std::string& content_type,
                         const std::string& content) {
  impl_->Publish(path, content_type, content);
}

void LiveServer::AwaitReader(const std::string& path, double seconds) {
  impl_->AwaitReader(path, seconds);
}

}  // namespace mgsfm
