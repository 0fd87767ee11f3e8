// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace servocal::sim {

/// One accepted connection; never blocks.
class Connection {
 public:
  explicit Connection(int descriptor) : descriptor_(descriptor) {}
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int descriptor() const { return descriptor_; }
  bool open() const { return open_; }
  void close() { open_ = false; }
  /// Appends to received() what has arrived.
  void read();
  std::string& received() { return received_; }
  /// A peer that does not read is closed, as the controller does.
  void write(const std::string& bytes);

 private:
  int descriptor_;
  bool open_ = true;
  std::string received_;
};

/// A listening TCP socket on the loopback, on a free port.
class Listener {
 public:
  Listener();
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  int port() const { return port_; }
  int descriptor() const { return descriptor_; }
  /// The next waiting connection; nothing if there is none.
  std::unique_ptr<Connection> accept();

 private:
  int descriptor_ = -1;
  int port_ = 0;
};

/// Big-endian numbers of the vendor's protocols, written once more, apart from the client's.
std::string bigEndian(std::uint64_t value, int bytes);
std::string bigEndian(double value);
std::uint64_t fromBigEndian(const std::string& bytes, std::size_t at, int count);
double doubleFromBigEndian(const std::string& bytes, std::size_t at);

}  // namespace servocal::sim
