// SPDX-License-Identifier: GPL-3.0-or-later
#include "listener.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace servocal::sim {

Connection::~Connection() { ::close(descriptor_); }

void Connection::read() {
  char bytes[8192];
  for (;;) {
    const ssize_t count = ::recv(descriptor_, bytes, sizeof bytes, 0);
    if (count > 0) {
      received_.append(bytes, static_cast<std::size_t>(count));
      continue;
    }
    if (count == 0 || (errno != EAGAIN && errno != EINTR)) open_ = false;
    return;
  }
}

void Connection::write(const std::string& bytes) {
  if (!open_) return;
  const ssize_t count = ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  if (count != static_cast<ssize_t>(bytes.size())) open_ = false;
}

Listener::Listener() : descriptor_(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  if (descriptor_ < 0 || ::bind(descriptor_, generic, size) != 0 || ::listen(descriptor_, 8) != 0 ||
      ::getsockname(descriptor_, generic, &size) != 0) {
    throw std::runtime_error(std::string("simulated controller: no port to listen on, ") +
                             std::strerror(errno));
  }
  port_ = ntohs(address.sin_port);
}

Listener::~Listener() { ::close(descriptor_); }

std::unique_ptr<Connection> Listener::accept() {
  const int descriptor = ::accept4(descriptor_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (descriptor < 0) return nullptr;
  const int on = 1;
  ::setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  return std::make_unique<Connection>(descriptor);
}

std::string bigEndian(std::uint64_t value, int bytes) {
  std::string result;
  for (int shift = 8 * (bytes - 1); shift >= 0; shift -= 8)
    result += static_cast<char>(value >> shift & 0xff);
  return result;
}

std::string bigEndian(double value) {
  std::uint64_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bigEndian(bits, 8);
}

std::uint64_t fromBigEndian(const std::string& bytes, std::size_t at, int count) {
  std::uint64_t value = 0;
  for (int i = 0; i < count; ++i) value = value << 8 | static_cast<unsigned char>(bytes.at(at + i));
  return value;
}

double doubleFromBigEndian(const std::string& bytes, std::size_t at) {
  const std::uint64_t bits = fromBigEndian(bytes, at, 8);
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

}  // namespace servocal::sim
