// SPDX-License-Identifier: GPL-3.0-or-later
#include "dashboard.h"

#include <chrono>

namespace servocal::robot::ur {
namespace {

constexpr std::size_t kLongestLine = 1024;

}  // namespace

Dashboard::Dashboard(const std::string& host, int port, Duration reply_timeout)
    : socket_(host, port, "robot's dashboard server", reply_timeout), reply_timeout_(reply_timeout) {
  const std::string greeting = line();
  if (greeting.rfind("Connected: Universal Robots Dashboard Server", 0) != 0) {
    failProtocol("the dashboard server says '" + greeting + "'");
  }
}

std::string Dashboard::line() {
  const auto give_up = std::chrono::steady_clock::now() + reply_timeout_;
  for (;;) {
    const std::size_t end = received_.find('\n');
    if (end != std::string::npos) {
      std::string line = received_.substr(0, end);
      received_.erase(0, end + 1);
      if (!line.empty() && line.back() == '\r') line.pop_back();
      return line;
    }
    if (received_.size() > kLongestLine) failProtocol("a line of the dashboard server does not end");
    const Duration left = give_up - std::chrono::steady_clock::now();
    if (left <= Duration::zero()) failProtocol("the dashboard server does not answer");
    const Bytes bytes = socket_.receive(left);
    received_.append(bytes.begin(), bytes.end());
  }
}

std::string Dashboard::ask(const std::string& question) {
  socket_.send(ByteWriter().text(question + "\n").bytes(), reply_timeout_);
  const std::string answer = line();
  if (answer.rfind("could not understand", 0) == 0 || answer.empty()) {
    throw Error(ErrorKind::kRefusedToMove,
                "The controller's dashboard server does not understand '" + question +
                    "'. Update PolyScope to 3.12.3 (CB3) or 5.6 (e-Series), or later.");
  }
  return answer;
}

std::string Dashboard::serialNumber() { return ask("get serial number"); }
std::string Dashboard::model() { return ask("get robot model"); }
bool Dashboard::inRemoteControl() { return ask("is in remote control") == "true"; }

}  // namespace servocal::robot::ur
