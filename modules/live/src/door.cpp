// SPDX-License-Identifier: GPL-3.0-or-later
#include "door.h"

#include <arpa/inet.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <random>

namespace servocal::live {

std::string newToken() {
  std::random_device random;  // the kernel's, not a generator of ours
  std::string token;
  for (int word = 0; word < 4; ++word) {
    char digits[9];
    std::snprintf(digits, sizeof digits, "%08x", static_cast<unsigned>(random()));
    token += digits;
  }
  return token;
}

bool sameToken(const std::string& one, const std::string& other) {
  if (one.size() != other.size()) return false;
  unsigned char difference = 0;
  for (std::size_t i = 0; i < one.size(); ++i) difference |= static_cast<unsigned char>(one[i] ^ other[i]);
  return difference == 0;
}

bool isOwnHost(const std::string& host_header, const std::string& own_name) {
  std::string host = host_header;
  if (!host.empty() && host.front() == '[') {
    const std::size_t end = host.find(']');
    if (end == std::string::npos) return false;
    in6_addr address{};
    return inet_pton(AF_INET6, host.substr(1, end - 1).c_str(), &address) == 1;
  }
  host = host.substr(0, host.find(':'));
  std::transform(host.begin(), host.end(), host.begin(), [](unsigned char c) { return std::tolower(c); });
  if (host.empty()) return false;
  if (host == "localhost" || host == own_name) return true;
  in_addr address{};
  return inet_pton(AF_INET, host.c_str(), &address) == 1;
}

}  // namespace servocal::live
