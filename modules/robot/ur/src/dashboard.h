// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "socket.h"

namespace servocal::robot::ur {

/// The dashboard server, asked questions only: nothing here powers the arm, releases a brake or a protective
/// stop, because the vendor forbids doing so automatically.
class Dashboard {
 public:
  Dashboard(const std::string& host, int port, Duration reply_timeout);

  std::string serialNumber();
  std::string model();
  /// e-Series only; a CB3 has no such mode.
  bool inRemoteControl();

 private:
  std::string ask(const std::string& question);
  std::string line();

  Socket socket_;
  Duration reply_timeout_;
  std::string received_;
};

}  // namespace servocal::robot::ur
