// SPDX-License-Identifier: GPL-3.0-or-later
#include "door.h"

#include <gtest/gtest.h>

namespace servocal::live {
namespace {

TEST(Door, HostsThatANameServerCannotForge) {
  for (const char* host : {"127.0.0.1:8080", "127.0.0.1", "localhost:1", "LocalHost", "[::1]:8080",
                           "192.168.1.7:80", "cell.lab:8080"}) {
    EXPECT_TRUE(isOwnHost(host, "cell.lab")) << host;
  }
  for (const char* host : {"", "evil.example", "evil.example:8080", "127.0.0.1.evil.example:80",
                           "localhost.evil", "[::1", "[evil]:80", ":80", "0x7f000001"}) {
    EXPECT_FALSE(isOwnHost(host, "cell.lab")) << host;
  }
}

TEST(Door, TokensAreLongAndNew) {
  const std::string token = newToken();
  EXPECT_EQ(token.size(), 32u);
  EXPECT_NE(token, newToken());
  EXPECT_TRUE(sameToken(token, token));
  for (std::size_t i = 0; i < token.size(); ++i) {
    std::string other = token;
    other[i] = other[i] == '0' ? '1' : '0';
    EXPECT_FALSE(sameToken(token, other)) << i;
  }
  EXPECT_FALSE(sameToken(token, token.substr(1)));
  EXPECT_FALSE(sameToken("", token));
}

}  // namespace
}  // namespace servocal::live
