// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_observer.h"

#include <gtest/gtest.h>

#include "tag_pictures.h"

namespace servocal::procedure {
namespace {

/// Shows one picture again and again.
class StillCamera final : public sensor::RgbdCamera {
 public:
  const sensor::CameraInfo& info() const override { return info_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override {
    sensor::Frame frame;
    frame.stream = stream;
    frame.image = image;
    frame.stamp = frame.received = deadline;
    return frame;
  }
  cv::Mat image;

 private:
  sensor::CameraInfo info_;
};

class Observing : public ::testing::Test {
 protected:
  /// The board with everything left of `covered` tags hidden.
  test::Picture show(double covered) {
    options.square_px = 50;
    options.tilt_rad = 0.3;
    options.clutter = false;
    options.covers = {{-1, -1, covered, 10, 120}};
    test::Picture picture = test::renderTags(board, options);
    camera.image = picture.gray;
    return picture;
  }
  /// The renderer's camera: centre in the middle, no distortion.
  static CameraModel pinhole() {
    CameraModel model = CameraModel::fromFieldOfView(640, 480, 1.0);
    model.parameters << 600, 600, 319.5, 239.5, 0, 0, 0, 0, 0;
    return model;
  }
  const BoardSpec board{TagGrid{"apriltag_36h11", 4, 3, 0.04, 0.012}, 0.012};
  test::TagPictureOptions options;
  StillCamera camera;
  BoardObserver observer{board, camera, Stream::kColor, pinhole()};
};

TEST_F(Observing, CornersThatAreHiddenAreWhereThePoseSaysTheyAre) {
  const test::Picture picture = show(1.1);  // One column of four.
  const auto seen = observer.see(Instant{});
  ASSERT_TRUE(seen && seen->detection);
  ASSERT_EQ(seen->detection->corners.size(), 36u);
  const servo::Look look = observer.look(Instant{});
  ASSERT_TRUE(look.sight);
  ASSERT_EQ(look.sight->pixels.size(), 48u);
  for (int id = 0; id < 48; ++id) EXPECT_LT((look.sight->pixels[id] - picture.corners[id]).norm(), 0.5) << id;
}

TEST_F(Observing, LessThanHalfABoardIsNoSight) {
  show(3.6);  // Three columns of four.
  const auto seen = observer.see(Instant{});
  ASSERT_TRUE(seen && seen->detection);
  EXPECT_EQ(seen->detection->corners.size(), 12u);
  EXPECT_FALSE(observer.isUsable(*seen->detection));
  EXPECT_FALSE(observer.look(Instant{}).sight);
}

// A board seen from afar has two poses that fit alike; the robot knows which.
TEST_F(Observing, OfTwoPosesThatFitAlikeTheRobotsIsTaken) {
  const auto truth = Pose<Color, Board>::fromRotationVector({0.25, 0.1, 0}, {0, 0, 4.0});
  BoardDetection detection;
  detection.orientation_known = true;
  for (int id = 0; id < board.cornerCount(); ++id) {
    const Eigen::Vector2d nudge = 0.3 * Eigen::Vector2d(std::sin(7.0 * id), std::cos(5.0 * id));
    detection.corners.push_back({id, *pinhole().project(truth * board.corner(id)) + nudge,
                                 0.04 * Eigen::Matrix2d::Identity()});
  }
  const auto flipped = Pose<Color, Board>::fromRotationVector({-0.25, -0.1, 0}, {0, 0, 4.0});
  for (const auto& predicted : {truth, flipped}) {
    observer.setPrediction([&](Instant) { return std::optional(predicted); });
    const auto cMo = observer.poseOf(detection, Instant{});
    ASSERT_TRUE(cMo);
    EXPECT_LT(angleRad(*cMo, predicted), 0.2);
  }
}

}  // namespace
}  // namespace servocal::procedure
