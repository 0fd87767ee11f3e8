// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "controller_state.h"
#include "listener.h"

namespace servocal::sim {

/// Questions in lines, answers in lines.
class DashboardServer {
 public:
  explicit DashboardServer(const ControllerState& state) : state_(state) {}
  const Listener& listener() const { return listener_; }
  std::vector<int> descriptors() const;
  void serve();

 private:
  std::string answer(const std::string& question) const;

  const ControllerState& state_;
  Listener listener_;
  std::vector<std::unique_ptr<Connection>> connections_;
};

/// Programs in, states at 10 Hz and messages out.
class PrimaryServer {
 public:
  explicit PrimaryServer(ControllerState& state) : state_(state) {}
  const Listener& listener() const { return listener_; }
  std::vector<int> descriptors() const;
  /// Takes what was sent; returns a program that is complete, or an empty text.
  std::string serve();
  /// Once per step of the controller.
  void publish();

 private:
  ControllerState& state_;
  Listener listener_;
  std::vector<std::unique_ptr<Connection>> connections_;
  double next_state_s_ = 0.0;
};

/// Messages of the primary interface, packed.
std::string keyMessage(const std::string& title, const std::string& text);
std::string runtimeException(const ScriptFault& fault);

}  // namespace servocal::sim
