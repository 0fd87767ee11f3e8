// SPDX-License-Identifier: GPL-3.0-or-later
#include "text_servers.h"

#include <algorithm>

namespace servocal::sim {
namespace {

template <class Connections>
void forgetClosed(Connections& connections) {
  connections.erase(std::remove_if(connections.begin(), connections.end(),
                                   [](const auto& connection) { return !connection->open(); }),
                    connections.end());
}

std::vector<int> all(const Listener& listener, const std::vector<std::unique_ptr<Connection>>& connections) {
  std::vector<int> descriptors = {listener.descriptor()};
  for (const auto& connection : connections) descriptors.push_back(connection->descriptor());
  return descriptors;
}

std::string primaryPackage(int type, const std::string& payload) {
  return bigEndian(payload.size() + 5, 4) + static_cast<char>(type) + payload;
}

std::string message(int kind, const std::string& payload) {
  return primaryPackage(
      20, bigEndian(std::uint64_t{0}, 8) + static_cast<char>(-2) + static_cast<char>(kind) + payload);
}

}  // namespace

std::string keyMessage(const std::string& title, const std::string& text) {
  return message(7, bigEndian(std::uint64_t{0}, 4) + bigEndian(std::uint64_t{0}, 4) +
                        static_cast<char>(title.size()) + title + text);
}

std::string runtimeException(const ScriptFault& fault) {
  return message(10, bigEndian(static_cast<std::uint32_t>(fault.line), 4) +
                         bigEndian(static_cast<std::uint32_t>(fault.column), 4) + fault.what());
}

std::vector<int> DashboardServer::descriptors() const { return all(listener_, connections_); }

void DashboardServer::serve() {
  while (auto connection = listener_.accept()) {
    connection->write("Connected: Universal Robots Dashboard Server\n");
    connections_.push_back(std::move(connection));
  }
  for (const auto& connection : connections_) {
    connection->read();
    std::string& bytes = connection->received();
    for (std::size_t end; (end = bytes.find('\n')) != std::string::npos; bytes.erase(0, end + 1)) {
      connection->write(answer(bytes.substr(0, end)) + "\n");
    }
  }
  forgetClosed(connections_);
}

std::string DashboardServer::answer(const std::string& question) const {
  if (question == "get robot model") return state_.options.model;
  if (question == "get serial number" && state_.options.tells_serial) return state_.options.serial;
  if (question == "is in remote control" && state_.eSeries()) {
    return state_.options.remote_control ? "true" : "false";
  }
  return "could not understand: '" + question + "'";
}

std::vector<int> PrimaryServer::descriptors() const { return all(listener_, connections_); }

std::string PrimaryServer::serve() {
  while (auto connection = listener_.accept()) {
    connections_.push_back(std::move(connection));
  }
  std::string program;
  for (const auto& connection : connections_) {
    connection->read();
    std::string& bytes = connection->received();
    const std::size_t end = bytes.find("\nend\n");
    if (end == std::string::npos) continue;
    program = bytes.substr(0, end + 5);
    bytes.erase(0, end + 5);
  }
  forgetClosed(connections_);
  return program;
}

void PrimaryServer::publish() {
  if (state_.time_s >= next_state_s_) {
    next_state_s_ = state_.time_s + 0.1;
    state_.messages.push_back(primaryPackage(16, std::string(200, 0)));  // Its content nobody here reads.
  }
  for (const std::string& bytes : state_.messages) {
    for (const auto& connection : connections_) connection->write(bytes);
  }
  state_.messages.clear();
}

}  // namespace servocal::sim
