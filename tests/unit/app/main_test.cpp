// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app/main.h"

#include <gtest/gtest.h>

#include <functional>
#include <new>
#include <stdexcept>

#include "errors.h"

namespace servocal::app {
namespace {

/// Exit code and what is on stderr if an app's work ends so.
std::pair<int, std::string> end(const std::function<int()>& body) {
  CLI::App cli("An app.", "servocal-test");
  const char* words[] = {"servocal-test"};
  testing::internal::CaptureStderr();
  const int code = guardedMain(cli, 1, const_cast<char**>(words), body);
  return {code, testing::internal::GetCapturedStderr()};
}

TEST(GuardedMain, OutOfMemoryIsNamed) {
  const auto [code, text] = end([]() -> int { throw std::bad_alloc(); });
  EXPECT_EQ(code, kInternalError);
  test::expectPart(text, "servocal-test: out of memory; what was stored before is safe");
  // As OpenCV says it.
  const auto [cv_code, cv_text] = end([]() -> int {
    throw std::runtime_error(
        "OpenCV(4.6.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 9 bytes");
  });
  EXPECT_EQ(cv_code, kInternalError);
  test::expectPart(cv_text, "out of memory");
}

TEST(GuardedMain, ErrorsHaveTheirExitCodes) {
  EXPECT_EQ(end([] { return 0; }).first, kOk);
  const auto [code, text] = end([]() -> int { throw Error(ErrorKind::kBadData, "The disk is full."); });
  EXPECT_EQ(code, kBadData);
  EXPECT_EQ(text, "servocal-test: The disk is full.\n");
  const auto [other_code, other_text] = end([]() -> int { throw std::logic_error("x"); });
  EXPECT_EQ(other_code, kInternalError);
  test::expectPart(other_text, "internal error: x");
}

}  // namespace
}  // namespace servocal::app
