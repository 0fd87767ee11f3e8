// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <stdexcept>

#include "errors.h"
#include "servocal/sensor/exposure.h"

namespace servocal::sensor {
namespace {

/// A noisy picture, white in its upper `white_share`.
cv::Mat picture(double gray, double white_share, int type = CV_8UC1) {
  cv::Mat image(424, 512, type);
  cv::RNG random(7);
  random.fill(image, cv::RNG::NORMAL, gray, 4.0);
  image.rowRange(0, static_cast<int>(white_share * image.rows)).setTo(cv::Scalar::all(255));
  return image;
}

TEST(ExposureTrouble, NamesDarknessAndSaturation) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    EXPECT_FALSE(exposureTrouble(picture(100, 0.0, type)));
    EXPECT_FALSE(exposureTrouble(picture(40, 0.45, type)));  // A bright board before a dark wall.
    test::expectPart(exposureTrouble(picture(6, 0.0, type)).value_or(""), "almost black");
    test::expectPart(exposureTrouble(picture(6, 0.005, type)).value_or(""), "almost black");  // A lamp in it.
    test::expectPart(exposureTrouble(picture(100, 0.7, type)).value_or(""), "70 % of its image is saturated");
  }
}

TEST(ExposureTrouble, SaysNothingOfCountsWhoseWhiteIsUnknown) {
  EXPECT_FALSE(exposureTrouble(cv::Mat::zeros(48, 64, CV_16UC1)));
  EXPECT_THROW((void)exposureTrouble(cv::Mat()), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sensor
