// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "bytes.h"
#include "servocal/core/clock.h"

namespace servocal::robot::ur {

/// A TCP connection that never blocks for longer than it is told. Failures are Errors (kHardwareAbsent) that
/// name the peer and say what to look at.
class Socket {
 public:
  /// `peer` is how messages call the other side, e.g. "RTDE of the robot".
  Socket(const std::string& host, int port, const std::string& peer, Duration timeout);
  ~Socket();
  Socket(Socket&& other) noexcept;
  Socket& operator=(Socket&&) = delete;

  int descriptor() const { return descriptor_; }
  /// Sends everything, or throws if the peer does not take it within `timeout`.
  void send(const Bytes& bytes, Duration timeout);
  /// What has arrived; empty if nothing came within `timeout` (zero: do not wait).
  /// @throws Error if the peer closed the connection.
  Bytes receive(Duration timeout);

 private:
  bool waitFor(short events, Duration timeout) const;
  [[noreturn]] void fail(const std::string& what) const;
  [[noreturn]] void fail(int error) const;

  int descriptor_ = -1;
  std::string peer_;
};

}  // namespace servocal::robot::ur
