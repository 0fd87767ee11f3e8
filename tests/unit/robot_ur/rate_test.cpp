// SPDX-License-Identifier: GPL-3.0-or-later
// No package is lost beside a running vision loop: a few seconds here, a minute in the nightly run.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <thread>

#include "ur_cell.h"

namespace servocal::robot::ur {
namespace {

using namespace test;

UrControllerOptions eSeries() {
  UrControllerOptions options;
  options.major = 5;
  options.minor = 11;
  return options;
}

/// Receives for a while beside a loop that works on images as a detector does.
void expectEveryPackage(const UrControllerOptions& options, double seconds) {
  UrCell cell(options);
  const auto arm = cell.armed();
  std::atomic<bool> quit{false};
  std::thread vision([&] {
    cv::Mat image(1080, 1920, CV_8U, cv::Scalar(90)), smooth;
    while (!quit) {
      cv::GaussianBlur(image, smooth, {5, 5}, 1.2);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const LinkReport before = arm->report();
  const double start_s = cell.controller.truth().time_s;
  EXPECT_FALSE(cell.drive(
      *arm, {}, [] { return false; }, seconds));
  const double passed_s = cell.controller.truth().time_s - start_s;
  quit = true;
  vision.join();
  const LinkReport after = arm->report();
  EXPECT_EQ(after.missed, 0u);
  EXPECT_EQ(after.repeated, 0u);
  EXPECT_NEAR(static_cast<double>(after.states - before.states), passed_s * arm->info().state_rate_hz,
              0.1 * arm->info().state_rate_hz);
  std::printf("%zu packages, %zu missed, longest gap %.1f ms, %zu late steps of the simulated controller\n",
              after.states, after.missed, 1e3 * toSeconds(after.longest_gap),
              cell.controller.truth().late_steps);
}

TEST(UrRate, NoPackageIsMissedAt125Hz) { expectEveryPackage({}, SERVOCAL_UR_RATE_S); }
TEST(UrRate, NoPackageIsMissedAt500Hz) { expectEveryPackage(eSeries(), SERVOCAL_UR_RATE_S); }

}  // namespace
}  // namespace servocal::robot::ur
