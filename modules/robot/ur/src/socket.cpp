// SPDX-License-Identifier: GPL-3.0-or-later
#include "socket.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

namespace servocal::robot::ur {

Socket::Socket(const std::string& host, int port, const std::string& peer, Duration timeout)
    : peer_(peer + " (" + host + ":" + std::to_string(port) + ")") {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int code = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); code != 0) {
    throw Error(ErrorKind::kHardwareAbsent, "The robot's address '" + host + "' is not known (" +
                                                ::gai_strerror(code) + "). Check 'host' in the cell file.");
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, ::freeaddrinfo);
  descriptor_ = ::socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (descriptor_ < 0) fail(errno);
  int error = 0;
  if (::connect(descriptor_, found->ai_addr, found->ai_addrlen) != 0) {
    error = errno;
    if (error == EINPROGRESS) {
      socklen_t size = sizeof error;
      error = ETIMEDOUT;
      if (waitFor(POLLOUT, timeout)) ::getsockopt(descriptor_, SOL_SOCKET, SO_ERROR, &error, &size);
    }
  }
  if (error != 0) {
    ::close(std::exchange(descriptor_, -1));
    fail(std::string("no connection, ") + std::strerror(error));
  }
  const int on = 1;  // A command must not wait for the acknowledgement of the one before.
  ::setsockopt(descriptor_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

Socket::Socket(Socket&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), peer_(std::move(other.peer_)) {}

Socket::~Socket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void Socket::fail(int error) const {
  if (error == ECONNRESET || error == EPIPE) fail("it closed the connection");
  fail(std::string(std::strerror(error)));
}

void Socket::fail(const std::string& what) const {
  throw Error(
      ErrorKind::kHardwareAbsent,
      "The link to the " + peer_ + " failed: " + what +
          ". The controller's watchdog stops the arm by itself. Check that the controller is on and the "
          "cable is in, then start again.");
}

bool Socket::waitFor(short events, Duration timeout) const {
  pollfd waited{descriptor_, events, 0};
  const auto nanoseconds = std::max<Duration::rep>(timeout.count(), 0);
  const timespec limit{static_cast<time_t>(nanoseconds / 1000000000),
                       static_cast<long>(nanoseconds % 1000000000)};
  return ::ppoll(&waited, 1, &limit, nullptr) > 0;
}

void Socket::send(const Bytes& bytes, Duration timeout) {
  std::size_t sent = 0;
  while (sent < bytes.size()) {
    const ssize_t count = ::send(descriptor_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
    if (count > 0) {
      sent += static_cast<std::size_t>(count);
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      if (!waitFor(POLLOUT, timeout)) fail("it takes no data");
    } else if (errno != EINTR) {
      fail(errno);
    }
  }
}

Bytes Socket::receive(Duration timeout) {
  Bytes bytes(16384);
  for (;;) {
    const ssize_t count = ::recv(descriptor_, bytes.data(), bytes.size(), 0);
    if (count > 0) {
      bytes.resize(static_cast<std::size_t>(count));
      return bytes;
    }
    if (count == 0) fail("it closed the connection");
    if (errno == EINTR) continue;
    if (errno != EAGAIN && errno != EWOULDBLOCK) fail(errno);
    if (timeout <= Duration::zero() || !waitFor(POLLIN, timeout)) return {};
    timeout = Duration::zero();
  }
}

}  // namespace servocal::robot::ur
