// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "rtde_fields.h"
#include "rtde_package.h"
#include "socket.h"

namespace servocal::robot::ur {

/// The RTDE conversation: handshake first, then packages in and out. One thread at a time.
class RtdeClient {
 public:
  /// Connects, agrees on protocol version 2 and reads the controller's version.
  /// @throws Error (kHardwareAbsent) if nobody answers, (kRefusedToMove) if the controller's software is
  /// older
  ///   than 3.12.3 or 5.6.0.
  RtdeClient(const std::string& host, int port, Duration reply_timeout);

  const ControllerVersion& version() const { return version_; }
  /// Agrees on what is exchanged and starts. `rate_hz` 0: the controller's own.
  /// @throws Error (kRefusedToMove) if a variable is missing or another program owns it.
  void start(double rate_hz);
  double rateHz() const { return rate_hz_; }

  int descriptor() const { return socket_.descriptor(); }
  /// What has arrived since; does not wait. Text messages are kept for takeMessages().
  /// @throws Error (kHardwareAbsent) if the link failed or the controller broke the protocol.
  std::vector<ControllerState> receive();
  void send(const ScriptInput& input);
  std::vector<TextMessage> takeMessages() { return std::exchange(messages_, {}); }

 private:
  Package reply(PackageType type);
  Package ask(PackageType type, const Bytes& payload);
  void keep(const Package& package);

  Socket socket_;
  Duration reply_timeout_;
  PackageReader reader_;
  ControllerVersion version_;
  double rate_hz_ = 0.0;
  int output_recipe_ = 0;  ///< 0: none agreed on yet.
  int input_recipe_ = 0;
  std::vector<ControllerState> early_;  ///< Data that overtook the reply to "start".
  std::vector<TextMessage> messages_;
};

}  // namespace servocal::robot::ur
