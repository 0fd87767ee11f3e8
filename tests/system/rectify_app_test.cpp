// SPDX-License-Identifier: GPL-3.0-or-later
// servocal-rectify as a person runs it, against the library call it stands for.
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "errors.h"
#include "recorded_cell.h"
#include "run_program.h"
#include "servocal/sensor/rectify.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

class RectifyApp : public ::testing::Test {
 protected:
  RectifyApp() {
    session::saveResult(folder_ / "result.yaml", cell_.result);
    raw_ = cv::Mat(424, 512, CV_16UC1);
    for (int row = 0; row < raw_.rows; ++row) {
      for (int column = 0; column < raw_.cols; ++column) {
        raw_.at<std::uint16_t>(row, column) = static_cast<std::uint16_t>(600 + column / 4 + row / 3);
      }
    }
    cv::imwrite((folder_ / "a.png").string(), raw_);
  }
  test::ProgramRun rectify(const std::string& arguments) const {
    return test::runProgram(std::string(SERVOCAL_RECTIFY) + " " + path("result.yaml") + " --out " + path("out") + " " +
                            arguments);
  }
  std::string path(const std::string& name) const { return test::shellWord((folder_ / name).string()); }

  const test::TemporaryFolder folder_;
  const test::RecordedCell cell_{2, 3};
  cv::Mat raw_;
};

TEST_F(RectifyApp, WritesWhatTheLibraryComputes) {
  const test::ProgramRun run = rectify("--camera cam1 --corrected " + path("a.png"));
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const CameraResult& camera = cell_.result.cameras[0];
  const sensor::DepthRectifier rectifier(camera.depth->model, camera.intrinsics.camera,
                                         Pose<Color, Infrared>(camera.color_infrared->first_by_second));
  const cv::Mat color = cv::imread((folder_ / "out/a_color.png").string(), cv::IMREAD_UNCHANGED);
  const cv::Mat corrected = cv::imread((folder_ / "out/a_corrected.png").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(color.type(), CV_16UC1);
  EXPECT_EQ(color.size(), cv::Size(camera.intrinsics.camera.width_px, camera.intrinsics.camera.height_px));
  EXPECT_EQ(cv::norm(color, rectifier.registeredMm(raw_), cv::NORM_INF), 0.0);
  EXPECT_GT(cv::countNonZero(color), color.rows * color.cols / 4);
  ASSERT_EQ(corrected.size(), raw_.size());
  EXPECT_NEAR(corrected.at<std::uint16_t>(200, 250), 1000 * rectifier.corrected(raw_).at<float>(200, 250), 0.51);
}

TEST_F(RectifyApp, RefusesWhatDoesNotFit) {
  test::ProgramRun run = rectify(path("a.png"));
  EXPECT_EQ(run.exit_code, 2);
  test::expectPart(run.err, "say which camera");
  cv::imwrite((folder_ / "small.png").string(), raw_.rowRange(0, 100));
  run = rectify("--camera cam1 " + path("small.png"));
  EXPECT_EQ(run.exit_code, 8);
  test::expectPart(run.err, "has 512 x 100 px");
  cv::imwrite((folder_ / "gray.png").string(), cv::Mat::zeros(424, 512, CV_8UC1));
  EXPECT_EQ(rectify("--camera cam1 " + path("gray.png")).exit_code, 8);
  EXPECT_EQ(rectify("--camera cam1 " + path("none.png")).exit_code, 8);
  EXPECT_EQ(rectify("--camera nobody " + path("a.png")).exit_code, 2);
}

}  // namespace
}  // namespace servocal
