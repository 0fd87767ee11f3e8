// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/path_planner.h"

#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>

namespace servocal::robot {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;

constexpr double kPi = 3.14159265358979323846;

Eigen::VectorXd anglesOf(const ob::State* state, Eigen::Index size) {
  const double* values = state->as<ob::RealVectorStateSpace::StateType>()->values;
  return Eigen::Map<const Eigen::VectorXd>(values, size);
}

void set(const Eigen::VectorXd& q, ob::ScopedState<>& state) {
  for (Eigen::Index i = 0; i < q.size(); ++i) state[static_cast<unsigned>(i)] = q[i];
}

}  // namespace

std::optional<std::vector<Eigen::VectorXd>> planPath(const Kinematics& kinematics,
                                                     const std::function<bool(const Eigen::VectorXd&)>& free,
                                                     const Eigen::VectorXd& from, const Eigen::VectorXd& to,
                                                     const PathOptions& options) {
  const Eigen::Index size = kinematics.joints();
  if (from.size() != size || to.size() != size || !from.allFinite() || !to.allFinite())
    throw std::invalid_argument("planPath: both ends need " + std::to_string(size) + " finite joint angles");

  // OMPL draws its own seeds from one generator; set once, a program's plans repeat.
  static const bool quiet = [] {
    ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
    ompl::RNG::setSeed(1);
    return true;
  }();
  (void)quiet;

  auto space = std::make_shared<ob::RealVectorStateSpace>(static_cast<unsigned>(size));
  ob::RealVectorBounds bounds(static_cast<unsigned>(size));
  for (Eigen::Index i = 0; i < size; ++i) {
    // Not more than a turn from where it stands: nobody wants to see an arm wind itself up.
    const double low = std::max(kinematics.lower()[i] + options.joint_margin_rad, std::min(from[i], to[i]) - kPi);
    const double high = std::min(kinematics.upper()[i] - options.joint_margin_rad, std::max(from[i], to[i]) + kPi);
    if (std::min(from[i], to[i]) < low || std::max(from[i], to[i]) > high) return std::nullopt;
    bounds.setLow(static_cast<unsigned>(i), low);
    bounds.setHigh(static_cast<unsigned>(i), high);
  }
  space->setBounds(bounds);
  og::SimpleSetup setup(space);
  setup.setStateValidityChecker([&](const ob::State* state) { return free(anglesOf(state, size)); });
  // OMPL's distance is Euclidean, never less than the largest joint motion.
  setup.getSpaceInformation()->setStateValidityCheckingResolution(options.step_rad / space->getMaximumExtent());
  ob::ScopedState<> start(space), goal(space);
  set(from, start);
  set(to, goal);
  setup.setStartAndGoalStates(start, goal);
  setup.setPlanner(std::make_shared<og::RRTConnect>(setup.getSpaceInformation()));
  if (!free(from) || !free(to)) return std::nullopt;
  const double budget_s = toSeconds(options.budget);
  if (setup.solve(budget_s) != ob::PlannerStatus::EXACT_SOLUTION) return std::nullopt;

  og::PathGeometric& path = setup.getSolutionPath();
  og::PathSimplifier simplifier(setup.getSpaceInformation());
  simplifier.reduceVertices(path);
  simplifier.shortcutPath(path);
  std::vector<Eigen::VectorXd> corners;
  for (std::size_t i = 0; i < path.getStateCount(); ++i) corners.push_back(anglesOf(path.getState(i), size));
  return corners;
}

}  // namespace servocal::robot
