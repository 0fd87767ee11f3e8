// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "controller_state.h"
#include "listener.h"

namespace servocal::sim {

/// The controller's side of RTDE, protocol version 2, faults included.
class RtdeServer {
 public:
  explicit RtdeServer(ControllerState& state) : state_(state) {}

  const Listener& listener() const { return listener_; }
  std::vector<int> descriptors() const;
  /// Takes connections and what they sent.
  void serve();
  /// To be called once per step of the controller: sends what is due.
  void publish();

 private:
  struct Client {
    std::unique_ptr<Connection> connection;
    std::vector<std::string> outputs;
    std::vector<std::string> inputs;
    double frequency_hz = 0.0;
    double next_due_s = 0.0;
    bool started = false;
    std::string merged;  ///< Held back to be sent in one piece,
    int merged_count = 0;
    std::string swapped;                              ///< or behind its successor,
    std::deque<std::pair<double, std::string>> late;  ///< or until an instant.
    std::deque<std::pair<double, std::string>> late_inputs;
  };

  void handle(Client& client, char type, const std::string& payload);
  void setupOutputs(Client& client, const std::string& payload);
  void setupInputs(Client& client, const std::string& payload);
  void takeInput(Client& client, const std::string& payload);
  void send(Client& client, const std::string& package);
  void sendData(Client& client);
  void spoil(Client& client, const std::string& package);
  double lateness();  ///< Of one package, s.
  bool owned(const std::string& name, const Client& asking) const;

  ControllerState& state_;
  Listener listener_;
  std::vector<std::unique_ptr<Client>> clients_;
  Random chance_{1, "network"};
};

}  // namespace servocal::sim
