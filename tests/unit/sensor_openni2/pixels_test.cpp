// SPDX-License-Identifier: GPL-3.0-or-later
#include "pixels.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "servocal/sensor/infrared.h"

namespace servocal::openni2 {
namespace {

TEST(Pixels, ColorComesAsBlueGreenRed) {
  const std::vector<std::uint8_t> rgb{10, 20, 30, 40, 50, 60};
  const cv::Mat image = imageOf(openni::PIXEL_FORMAT_RGB888, 2, 1, 6, rgb.data());
  EXPECT_EQ(image.type(), CV_8UC3);
  EXPECT_EQ(image.at<cv::Vec3b>(0, 1), cv::Vec3b(60, 50, 40));
}

// Both hold the luminances 50 and 200 with no color; in one they come second.
TEST(Pixels, TheTwoOrdersOfYuvAreToldApart) {
  const std::vector<std::uint8_t> yuyv{50, 128, 200, 128}, uyvy{128, 50, 128, 200};
  for (const cv::Mat& image : {imageOf(openni::PIXEL_FORMAT_YUYV, 2, 1, 4, yuyv.data()),
                               imageOf(openni::PIXEL_FORMAT_YUV422, 2, 1, 4, uyvy.data())}) {
    ASSERT_EQ(image.type(), CV_8UC3);
    EXPECT_NEAR(image.at<cv::Vec3b>(0, 0)[1], 40, 3);  // Video range: 16 is black.
    EXPECT_NEAR(image.at<cv::Vec3b>(0, 1)[1], 214, 3);
  }
}

TEST(Pixels, DepthIsInMillimetresWhateverTheDeviceCounts) {
  const std::vector<std::uint16_t> depth{0, 7004, 7006, 65535};
  const cv::Mat fine = imageOf(openni::PIXEL_FORMAT_DEPTH_100_UM, 4, 1, 8, depth.data());
  EXPECT_EQ(fine.type(), CV_16UC1);
  EXPECT_EQ(fine.at<std::uint16_t>(0, 0), 0);
  EXPECT_EQ(fine.at<std::uint16_t>(0, 1), 700);
  EXPECT_EQ(fine.at<std::uint16_t>(0, 2), 701);
  const cv::Mat mm = imageOf(openni::PIXEL_FORMAT_DEPTH_1_MM, 4, 1, 8, depth.data());
  EXPECT_EQ(mm.at<std::uint16_t>(0, 1), 7004);
}

TEST(Pixels, RowsMayBeFartherApartThanTheyAreLong) {
  const std::vector<std::uint16_t> depth{1, 2, 99, 3, 4, 99};
  const cv::Mat image = imageOf(openni::PIXEL_FORMAT_DEPTH_1_MM, 2, 2, 6, depth.data());
  EXPECT_EQ(image.at<std::uint16_t>(1, 0), 3);
  EXPECT_TRUE(image.isContinuous());
}

TEST(Pixels, FormatsThatNobodyReadsAreRefused) {
  EXPECT_THROW((void)imageOf(openni::PIXEL_FORMAT_JPEG, 1, 1, 3, "abc"), std::invalid_argument);
}

// Ten bits of a Kinect v1, sixteen of a v2: white is white, and a little more light changes nothing.
TEST(Infrared, TheGainSuitsTheSensorAndStays) {
  for (const int white : {900, 20000, 60}) {
    cv::Mat counts(60, 80, CV_16UC1, cv::Scalar(white));
    counts.colRange(0, 40).setTo(white / 5);
    const cv::Mat gray = sensor::infraredToEightBits(counts);
    ASSERT_EQ(gray.type(), CV_8UC1);
    const int seen = gray.at<std::uint8_t>(30, 60);
    EXPECT_LE(seen, 230) << white;
    EXPECT_GE(seen, 190) << white;
    EXPECT_NEAR(gray.at<std::uint8_t>(30, 10), seen / 5.0, 1.0) << white;
  }
  cv::Mat counts(60, 80, CV_16UC1, cv::Scalar(1000));
  const int before = sensor::infraredToEightBits(counts).at<std::uint8_t>(0, 0);
  counts.setTo(1010);
  EXPECT_NEAR(sensor::infraredToEightBits(counts).at<std::uint8_t>(0, 0), before * 1.01, 1.0);
  EXPECT_THROW((void)sensor::infraredToEightBits(cv::Mat(2, 2, CV_8UC1)), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::openni2
