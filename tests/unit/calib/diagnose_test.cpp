// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/diagnose.h"

#include <gtest/gtest.h>

#include "depth_scene.h"

namespace servocal::calib {
namespace {

test::Scene scene(std::uint64_t seed, Mount mount, int views = 15) {
  test::SceneOptions options;
  options.views = views;
  options.mount = mount;
  options.noise = {0.1, 0.0003, 0.0005};
  return test::makeScene(seed, options);
}

std::string explain(const test::Scene& scene, const std::vector<RobotReading>& readings = {}) {
  return explainContradiction(scene.board, scene.camera, scene.observations, test::kCamera, Stream::kColor,
                              scene.mount, readings)
      .value_or("");
}

void expectHas(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << "'" << text << "' lacks '" << part << "'";
}

TEST(ExplainContradiction, IsSilentWhereThereIsNone) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) EXPECT_EQ(explain(scene(seed, mount)), "") << seed;
  }
}

TEST(ExplainContradiction, IsSilentWhereNothingFits) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Scene mixed = scene(seed, Mount::kFixed);
    std::mt19937_64 random(seed);
    for (Observation& observation : mixed.observations) {
      observation.robot->bMe = test::randomPose<Base, EndEffector>(random, 1.0, 0.5);
    }
    EXPECT_EQ(explain(mixed), "") << seed;
  }
}

TEST(ExplainContradiction, NamesInvertedPosesAndTheOtherMount) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
      test::Scene wrong = scene(seed, mount);
      for (Observation& observation : wrong.observations) {
        observation.robot->bMe = relabel<Base, EndEffector>(observation.robot->bMe.inverse());
      }
      const std::string text = explain(wrong);
      expectHas(text, "inverse");
      expectHas(text,
                mount == Mount::kFixed ? "eye_in_hand instead of eye_to_hand" : "eye_to_hand instead of");
    }
  }
}

TEST(ExplainContradiction, NamesTransposedRotations) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Scene wrong = scene(seed, Mount::kFlange);
    for (Observation& observation : wrong.observations) {
      const auto& bMe = observation.robot->bMe;
      observation.robot->bMe = Pose<Base, EndEffector>(bMe.rotation().transpose(), bMe.translation());
    }
    expectHas(explain(wrong), "transposed");
  }
}

/// The scene with the robot's lengths multiplied.
test::Scene stretched(test::Scene scene, double scale) {
  for (Observation& observation : scene.observations) {
    const auto& bMe = observation.robot->bMe;
    observation.robot->bMe = Pose<Base, EndEffector>(bMe.rotation(), scale * bMe.translation());
  }
  return scene;
}

TEST(ExplainContradiction, NamesUnitsOfLength) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      expectHas(explain(stretched(scene(seed, mount), 1000.0)), "millimetres, read as metres");
      expectHas(explain(stretched(scene(seed, mount), 0.001)), "metres, read as millimetres");
      expectHas(explain(stretched(scene(seed, mount), 100.0)), "centimetres");
    }
  }
}

TEST(ExplainContradiction, NamesTheSquareSize) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    for (const double scale : {1.5, 25.4 / 30.0, 0.5}) {
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        const std::string text = explain(stretched(scene(seed, mount), scale)),
                          words = "the squares measure ";
        ASSERT_EQ(text.find(words), 0u) << text;
        EXPECT_NEAR(std::stod(text.substr(words.size())), 30.0 * scale, 0.01 * 30.0 * scale) << text;
      }
    }
  }
}

TEST(ExplainContradiction, NamesTheReadingThatFits) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    test::Scene wrong = scene(seed, Mount::kFixed);
    RobotReading right{"the angles are in degrees", {}}, other{"something else is the matter", {}};
    std::mt19937_64 random(seed);
    for (Observation& observation : wrong.observations) {
      auto& bMe = observation.robot->bMe;
      right.bMe.emplace_back(bMe);
      other.bMe.emplace_back(test::randomPose<Base, EndEffector>(random, 1.0, 0.5));
      bMe = Pose<Base, EndEffector>::fromRotationVector(bMe.rotationVector() * M_PI / 180, bMe.translation());
    }
    EXPECT_EQ(explain(wrong, {other, right}), right.what);
    right.bMe.pop_back();
    EXPECT_THROW(explain(wrong, {right}), std::invalid_argument);
  }
}

TEST(BoardScaleByMotion, IsFoundWithinItsSigma) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    for (const double truth : {1.0, 0.98, 1.2, 0.5}) {
      double z_squares = 0;
      constexpr int kSeeds = 20;
      for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
        const test::Scene wrong = stretched(scene(seed, mount), truth);
        const auto found =
            boardScale(wrong.board, wrong.camera, wrong.observations, test::kCamera, Stream::kColor, mount);
        ASSERT_TRUE(found.has_value());
        EXPECT_LT(found->sigma, 0.01 * truth);
        z_squares += std::pow((found->scale - truth) / found->sigma, 2);
      }
      const double z = std::sqrt(z_squares / kSeeds);
      std::cout << "scale " << truth << ": rms z " << z << '\n';
      EXPECT_NEAR(z, 1.0, 0.5);  // 20 seeds scatter by 16 %; the rest is that equations count alike
    }
  }
}

TEST(BoardScaleByMotion, IsNothingWhereTheRobotDoesNotSay) {
  EXPECT_FALSE(boardScale({}, test::hdCamera(), {}, test::kCamera, Stream::kColor, Mount::kFixed));
  test::Scene few = scene(3, Mount::kFixed, 3);
  EXPECT_FALSE(
      boardScale(few.board, few.camera, few.observations, test::kCamera, Stream::kColor, Mount::kFixed));
}

test::DepthScene depthScene(std::uint64_t seed, const DepthModel& truth, int views = 15) {
  test::SceneOptions options;
  options.views = views;
  return test::makeDepthScene(seed, truth, options, {0.1, 0.001, 0.002});
}

BoardSpec resized(BoardSpec board, double ratio) {
  std::get<Checkerboard>(board.pattern).square_size_m *= ratio;
  return board;
}

TEST(BoardScaleByDepth, IsFoundWithinItsSigma) {
  DepthModel ideal = test::timeOfFlight();
  ideal.offset = 0.0;
  ideal.slope = 1.0;
  ideal.nodes.setZero();
  for (const double truth : {1.0, 0.98, 1.2, 0.5}) {
    double z_squares = 0;
    constexpr int kSeeds = 20;
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const test::DepthScene scene = depthScene(seed, ideal);
      const auto found = boardScaleByDepth(resized(scene.board, 1 / truth), scene.truth.camera, scene.observations,
                                           test::kCamera);
      ASSERT_TRUE(found.has_value());
      EXPECT_LT(found->sigma, 0.01 * truth);
      z_squares += std::pow((found->scale - truth) / found->sigma, 2);
    }
    EXPECT_NEAR(std::sqrt(z_squares / kSeeds), 1.0, 0.6) << truth;  // A scatter by 15 views is itself 25 % off.
  }
}

// What is refused as a wrong size (8 %) must be more than a sensor's own error.
TEST(BoardScaleByDepth, SensorsStayBelowWhatIsRefused) {
  for (const DepthModel& truth : {test::timeOfFlight(), test::structuredLight()}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const test::DepthScene scene = depthScene(seed, truth);
      const auto found = boardScaleByDepth(scene.board, truth.camera, scene.observations, test::kCamera);
      ASSERT_TRUE(found.has_value());
      EXPECT_NEAR(found->scale, 1.0, 0.06);
    }
  }
}

TEST(BoardScaleByDepth, IsNothingWithoutDepthInThreeViews) {
  test::DepthScene scene = depthScene(1, test::timeOfFlight(), 2);
  EXPECT_FALSE(boardScaleByDepth(scene.board, scene.truth.camera, scene.observations, test::kCamera));
  scene = depthScene(1, test::timeOfFlight());
  EXPECT_FALSE(boardScaleByDepth(scene.board, scene.truth.camera, scene.observations, "another"));
  for (Observation& observation : scene.observations) observation.views[0].depth.reset();
  EXPECT_FALSE(boardScaleByDepth(scene.board, scene.truth.camera, scene.observations, test::kCamera));
}

}  // namespace
}  // namespace servocal::calib
