// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/slip.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <stdexcept>

#include "calib_scene.h"

namespace servocal::calib {
namespace {

constexpr int kStops = 40;

struct Course {
  std::vector<SlipView> views;
  std::map<std::string, Pose<Base, Color>> bMc;
  Pose<EndEffector, Board> eMo;
};

struct Mishap {
  int stop = 20;                                       ///< From this stop (of kStops, from 0) on
  Eigen::Vector3d mount_m = Eigen::Vector3d::Zero();   ///< the board is displaced along the flange's axes,
  Eigen::Vector3d camera_m = Eigen::Vector3d::Zero();  ///< camera "left" along the base's.
};

/// Stops of a turning flange before cameras; robot noise 0.3 mm and 0.5 mrad per axis, board poses as one
/// image of an HD camera gives them.
Course makeCourse(std::uint64_t seed, const std::vector<std::string>& cameras, const Mishap& mishap = {}) {
  std::mt19937_64 random(seed);
  Course run;
  run.eMo = test::randomPose<EndEffector, Board>(random, 0.5, 0.05);
  for (const std::string& camera : cameras) run.bMc[camera] = test::randomPose<Base, Color>(random, 1.0, 1.0);
  for (int stop = 0; stop < kStops; ++stop) {
    const auto bMe = test::randomPose<Base, EndEffector>(random, 0.7, 0.3);
    const auto told = test::disturbed(bMe, random, 0.0003, 0.0005);
    for (const std::string& camera : cameras) {
      Pose<EndEffector, Board> eMo = run.eMo;
      Pose<Base, Color> bMc = run.bMc[camera];
      if (stop >= mishap.stop) {
        eMo = Pose<EndEffector, Board>(eMo.rotation(), eMo.translation() + mishap.mount_m);
        if (camera == "left") bMc = Pose<Base, Color>(bMc.rotation(), bMc.translation() + mishap.camera_m);
      }
      run.views.push_back(
          {stop + 1, camera, told, test::disturbed(bMc.inverse() * bMe * eMo, random, 0.0004, 0.001)});
    }
  }
  return run;
}

/// A robot's kinematic error: a smooth random function of where the flange is, alike at neighboring stops.
class ErrorField {
 public:
  /// RMS per axis.
  ErrorField(std::mt19937_64& random, double error_m, double error_rad) {
    constexpr double kLengthM = 0.25;
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> phase(0.0, 2.0 * M_PI);
    for (Wave& wave : waves_) {
      wave.phase = phase(random);
      for (double& value : wave.frequency) value = normal(random) / kLengthM;
      for (int axis = 0; axis < 6; ++axis) {
        const double rms = axis < 3 ? error_m : error_rad;
        wave.amplitude[axis] = rms * normal(random) * std::sqrt(2.0 / kWaves);
      }
    }
  }
  Pose<Base, EndEffector> told(const Pose<Base, EndEffector>& bMe) const {
    Eigen::Matrix<double, 6, 1> error = Eigen::Matrix<double, 6, 1>::Zero();
    for (const Wave& wave : waves_) {
      error += wave.amplitude * std::cos(wave.frequency.dot(bMe.translation()) + wave.phase);
    }
    return bMe * Pose<EndEffector, EndEffector>::fromRotationVector(error.tail<3>(), error.head<3>());
  }

 private:
  static constexpr int kWaves = 40;
  struct Wave {
    Eigen::Vector3d frequency;
    double phase = 0.0;
    Eigen::Matrix<double, 6, 1> amplitude;
  };
  std::array<Wave, kWaves> waves_;
};

/// Cameras take turns as in a run: each has its region of the workspace, and passes it from near to far.
Course makeTurns(std::uint64_t seed, const std::vector<std::string>& cameras, double error_m,
                 double error_rad, const Eigen::Vector3d& mount_m = Eigen::Vector3d::Zero()) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const ErrorField field(random, error_m, error_rad);
  Course run;
  run.eMo = test::randomPose<EndEffector, Board>(random, 0.5, 0.05);
  int id = 0;
  for (const std::string& camera : cameras) {
    const auto bMc = run.bMc[camera] = test::randomPose<Base, Color>(random, 1.0, 1.0);
    const Eigen::Vector3d from(0.2 * normal(random), 0.2 * normal(random), 0.2 * normal(random));
    const Eigen::Vector3d way =
        0.4 * Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
    for (int stop = 0; stop < 20; ++stop) {
      const Eigen::Vector3d wander(0.05 * normal(random), 0.05 * normal(random), 0.05 * normal(random));
      const Pose<Base, EndEffector> bMe(test::randomPose<Base, EndEffector>(random, 0.4, 0.0).rotation(),
                                        Eigen::Vector3d(from + way * (stop / 20.0) + wander));
      const auto eMo =
          id++ < 10 ? run.eMo : Pose<EndEffector, Board>(run.eMo.rotation(), run.eMo.translation() + mount_m);
      run.views.push_back({id, camera, test::disturbed(field.told(bMe), random, 0.00003, 0.00003),
                           test::disturbed(bMc.inverse() * bMe * eMo, random, 0.0004, 0.0007)});
    }
  }
  return run;
}

std::optional<Slip> find(const Course& run) { return findSlip(run.views, run.bMc, run.eMo); }

TEST(FindSlip, NamesAMountThatSlipped) {
  int right_part = 0, found = 0;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    Mishap mishap;
    mishap.stop = 8 + static_cast<int>(seed % 25);
    mishap.mount_m = Eigen::Vector3d(0.002, -0.002, 0.001);  // 3 mm
    const auto slip = find(makeCourse(seed, {"left", "right"}, mishap));
    if (!slip) continue;
    ++found;
    right_part += slip->part == SlipPart::kMount ? 1 : 0;
    EXPECT_NEAR(static_cast<double>(slip->observation_id), mishap.stop + 1, 1.0) << seed;
    EXPECT_LT((slip->step_m - mishap.mount_m).norm(), 0.001) << seed;
  }
  EXPECT_EQ(found, 50);
  EXPECT_EQ(right_part, 50);
}

TEST(FindSlip, NamesACameraThatWasBumped) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Mishap mishap;
    mishap.camera_m = Eigen::Vector3d(0.0, 0.003, 0.0);
    const auto slip = find(makeCourse(seed, {"left", "right"}, mishap));
    ASSERT_TRUE(slip) << seed;
    EXPECT_EQ(slip->part, SlipPart::kCamera) << seed;
    EXPECT_EQ(slip->camera, "left") << seed;
    EXPECT_LT((slip->step_m - mishap.camera_m).norm(), 0.002) << seed;
  }
}

TEST(FindSlip, OneCameraTellsMountFromCamera) {
  int right_part = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Mishap mishap;
    mishap.mount_m = Eigen::Vector3d(0.003, 0.0, 0.0);
    const auto slip = find(makeCourse(seed, {"left"}, mishap));
    ASSERT_TRUE(slip) << seed;
    right_part += slip->part == SlipPart::kMount ? 1 : 0;
  }
  EXPECT_GE(right_part, 27);
}

TEST(FindSlip, IsQuietWhenNothingMoved) {
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    alarms += find(makeCourse(1000 + seed, {"left", "right"})) ? 1 : 0;
  }
  EXPECT_LE(alarms, 1);
}

TEST(FindSlip, IsQuietWhenTheRobotsErrorIsAlikeAtNeighboringStops) {
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    alarms += find(makeTurns(3000 + seed, {"left", "right", "top"}, 0.0003, 0.0003)) ? 1 : 0;
  }
  EXPECT_LE(alarms, 2);
}

TEST(FindSlip, NamesAMountThatSlippedWithinACamerasTurn) {
  int named = 0;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    const Eigen::Vector3d mount_m(0.002, -0.002, 0.001);  // 3 mm
    const auto slip = find(makeTurns(4000 + seed, {"left", "right", "top"}, 0.0003, 0.0003, mount_m));
    named += slip && slip->part == SlipPart::kMount && std::abs(slip->observation_id - 11) <= 1 ? 1 : 0;
  }
  EXPECT_GE(named, 40);
}

TEST(FindSlip, OneWrongViewIsNoStep) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Course run = makeCourse(2000 + seed, {"left"});
    for (const std::size_t wrong : {5u, 34u}) {
      run.views[wrong].cMo =
          run.views[wrong].cMo * Pose<Board, Board>::fromRotationVector({0.3, 0, 0}, {0.03, 0, 0});
    }
    EXPECT_FALSE(find(run)) << seed;
  }
}

TEST(FindSlip, FewViewsSayNothing) {
  Course run = makeCourse(1, {"left"});
  run.views.resize(6);
  EXPECT_FALSE(find(run));
  run.views[0].camera = "another";
  EXPECT_THROW((void)find(run), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::calib
