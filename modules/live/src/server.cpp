// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/live/server.h"

#include <httplib.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <string_view>
#include <thread>

#include "door.h"
#include "mailbox.h"
#include "page.h"
#include "page_json.h"
#include "servocal/core/error.h"

namespace servocal::live {
namespace {

using Steady = std::chrono::steady_clock;

// A connection serves one request, and a client that stops reading holds a thread for as long as this.
constexpr int kThreads = 24;
constexpr int kPatienceS = 2;
constexpr std::chrono::seconds kFinishWithin{2};
constexpr const char* kTokenHeader = "X-Servocal-Token";

std::optional<Stream> streamOf(const std::string& name) {
  for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth}) {
    if (name == toString(stream)) return stream;
  }
  return std::nullopt;
}

void refuse(httplib::Response& response, int status, const std::string& sentence) {
  response.status = status;
  response.set_content(sentence + "\n", "text/plain; charset=utf-8");
}

}  // namespace

struct Server::Impl {
  CellConfig cell;
  std::function<void()> stop;
  std::string token = newToken();
  std::string own_name;
  std::string url;
  Mailbox mailbox;
  httplib::Server http;
  std::thread listener;
  std::atomic<bool> listened{false};  ///< The listener has come to its end.

  // The last look of each eye as JSON, made once for all who ask.
  std::mutex made_mutex;
  std::map<EyeName, std::pair<std::uint64_t, std::shared_ptr<const std::string>>> made;

  // When somebody last asked for the state, and whether anybody has got the ending.
  std::mutex seen_mutex;
  std::condition_variable seen;
  std::optional<Steady::time_point> last_asked;
  bool ending_told = false;

  Impl(const CellConfig& watched, std::function<void()> stop_arm)
      : cell(watched), stop(std::move(stop_arm)) {}

  void route() {
    http.set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
      response.set_header("Cache-Control", "no-store");
      response.set_header("Referrer-Policy", "no-referrer");
      response.set_header("X-Content-Type-Options", "nosniff");
      if (!isOwnHost(request.get_header_value("Host"), own_name)) {
        refuse(response, 421, "This server does not go by that name.");
        return httplib::Server::HandlerResponse::Handled;
      }
      const std::string given =
          request.path == "/" ? request.get_param_value("token") : request.get_header_value(kTokenHeader);
      if (!sameToken(given, token)) {
        refuse(response, 403, "Open the address that servocal-calibrate printed, token included.");
        return httplib::Server::HandlerResponse::Handled;
      }
      return httplib::Server::HandlerResponse::Unhandled;
    });
    http.Get("/", [](const httplib::Request&, httplib::Response& response) {
      const std::string nonce = newToken();
      response.set_header("Content-Security-Policy",
                          "default-src 'none'; connect-src 'self'; img-src data:; script-src 'nonce-" +
                              nonce + "'; style-src 'nonce-" + nonce +
                              "'; frame-ancestors 'none'; base-uri 'none'");
      response.set_content(pageWith(nonce), "text/html; charset=utf-8");
    });
    http.Get("/state", [this](const httplib::Request&, httplib::Response& response) {
      const Snapshot snapshot = mailbox.snapshot();
      response.set_content(stateJson(snapshot, cell), "application/json");
      const std::lock_guard lock(seen_mutex);
      last_asked = Steady::now();
      ending_told = ending_told || snapshot.ending.has_value();
      seen.notify_all();
    });
    http.Get("/look", [this](const httplib::Request& request, httplib::Response& response) {
      const auto stream = streamOf(request.get_param_value("stream"));
      const auto text = stream ? lookOf({request.get_param_value("camera"), *stream}) : nullptr;
      if (!text) return refuse(response, 404, "Nothing was seen by that camera yet.");
      response.set_content(*text, "application/json");
    });
    http.Post("/stop", [this](const httplib::Request&, httplib::Response& response) {
      stop();
      response.set_content("{\"stopping\": true}", "application/json");
    });
  }

  std::shared_ptr<const std::string> lookOf(const EyeName& eye) {
    const auto look = mailbox.look(eye);
    if (!look) return nullptr;
    const std::lock_guard lock(made_mutex);
    auto& [number, text] = made[eye];
    if (!text || number != look->number) {
      text = std::make_shared<const std::string>(lookJson(*look));
      number = look->number;
    }
    return text;
  }
};

Server::Server(const CellConfig& cell, std::function<void()> stop, const ServerOptions& options)
    : impl_(std::make_unique<Impl>(cell, std::move(stop))) {
  httplib::Server& http = impl_->http;
  impl_->own_name = options.host;
  http.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  http.set_keep_alive_max_count(1);
  http.set_socket_options([](socket_t socket) {
    const int yes = 1;  // and not SO_REUSEPORT, with which two servers would share a port
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  http.set_read_timeout(kPatienceS);
  http.set_write_timeout(kPatienceS);
  http.set_payload_max_length(1024);
  impl_->route();
  const int port = options.port == 0                               ? http.bind_to_any_port(options.host)
                   : http.bind_to_port(options.host, options.port) ? options.port
                                                                   : -1;
  if (port <= 0) {
    throw Error(ErrorKind::kNothingToDo, "cannot listen at " + options.host + ":" +
                                             std::to_string(options.port) +
                                             "; is the port taken, or the address not this machine's?");
  }
  const bool everywhere = options.host == "0.0.0.0" || options.host == "::";
  const bool six = options.host.find(':') != std::string::npos;
  const std::string shown = everywhere ? "localhost" : six ? "[" + options.host + "]" : options.host;
  impl_->url = "http://" + shown + ":" + std::to_string(port) + "/?token=" + impl_->token;
  impl_->listener = std::thread([this] {
    impl_->http.listen_after_bind();
    impl_->listened = true;
  });
}

Server::~Server() {
  // stop() is heard only by a server that has begun to listen.
  while (!impl_->http.is_running() && !impl_->listened) std::this_thread::yield();
  impl_->http.stop();
  impl_->listener.join();
}

const std::string& Server::url() const { return impl_->url; }

void Server::show(const procedure::Event& event) { impl_->mailbox.put(event); }
void Server::show(const procedure::Look& look) { impl_->mailbox.put(look); }

void Server::finish(bool goal_met, const std::string& verdict) {
  impl_->mailbox.put(Ending{goal_met, verdict});
  std::unique_lock lock(impl_->seen_mutex);
  if (!impl_->last_asked || Steady::now() - *impl_->last_asked > kFinishWithin) return;
  impl_->seen.wait_for(lock, kFinishWithin, [&] { return impl_->ending_told; });
}

}  // namespace servocal::live
