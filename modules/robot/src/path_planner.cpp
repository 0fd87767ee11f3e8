// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/path_planner.h"

#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/terminationconditions/IterationTerminationCondition.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/SimpleSetup.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <random>
#include <stdexcept>

namespace servocal::robot {
namespace {

namespace ob = ompl::base;
namespace og = ompl::geometric;

constexpr double kPi = 3.14159265358979323846;
constexpr int kStarts = 32;           // Of the search for postures.
constexpr double kSamePostureRad = 0.1;

double largest(const Eigen::VectorXd& v) { return v.cwiseAbs().maxCoeff(); }

double lengthOf(const std::vector<Eigen::VectorXd>& path) {
  double sum = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) sum += largest(path[i] - path[i - 1]);
  return sum;
}

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

  // OMPL draws the seeds of its generators from one for the whole process. Set anew for each question, with no
  // other in between, the answer repeats; OMPL would log that as a mistake.
  static std::mutex one_at_a_time;
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  ompl::RNG::setSeed(1);

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
  ob::IterationTerminationCondition search(static_cast<unsigned>(std::max(1, options.max_iterations)));
  if (setup.solve(search) != ob::PlannerStatus::EXACT_SOLUTION) return std::nullopt;

  og::PathGeometric& path = setup.getSolutionPath();
  og::PathSimplifier simplifier(setup.getSpaceInformation());
  simplifier.reduceVertices(path);
  simplifier.shortcutPath(path);
  std::vector<Eigen::VectorXd> corners;
  for (std::size_t i = 0; i < path.getStateCount(); ++i) corners.push_back(anglesOf(path.getState(i), size));
  return corners;
}

std::vector<Eigen::VectorXd> postures(const Kinematics& kinematics, const Pose<Base, EndEffector>& bMe,
                                      const Eigen::VectorXd& from, double margin_rad) {
  std::mt19937_64 random(1);  // The same every time.
  std::uniform_real_distribution<double> turn(-kPi, kPi);
  std::vector<Eigen::VectorXd> found;
  for (int start = 0; start < kStarts; ++start) {
    Eigen::VectorXd seed = from;
    if (start > 0)
      for (double& angle : seed) angle += turn(random);
    std::optional<Eigen::VectorXd> q = kinematics.inverse(bMe, seed, margin_rad);
    if (!q) {
      if (start > 2 && found.empty()) break;  // Each start has searched all around itself: out of reach.
      continue;
    }
    for (Eigen::Index joint = 0; joint < q->size(); ++joint) {
      const double nearer = (*q)[joint] + 2.0 * kPi * std::round((from[joint] - (*q)[joint]) / (2.0 * kPi));
      if (nearer >= kinematics.lower()[joint] + margin_rad && nearer <= kinematics.upper()[joint] - margin_rad)
        (*q)[joint] = nearer;
    }
    const bool known = std::any_of(found.begin(), found.end(), [&](const Eigen::VectorXd& other) {
      return largest(other - *q) < kSamePostureRad;
    });
    if (!known) found.push_back(std::move(*q));
  }
  std::sort(found.begin(), found.end(), [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
    return largest(a - from) < largest(b - from);
  });
  return found;
}

Plan planTo(const Guard& guard, const Eigen::VectorXd& from, const Pose<Base, EndEffector>& bMe,
            const PlanOptions& options) {
  const Kinematics& kinematics = guard.kinematics();
  if (from.size() != kinematics.joints() || !from.allFinite() || !bMe.isFinite())
    throw std::invalid_argument("planTo: expected " + std::to_string(kinematics.joints()) +
                                " finite joint angles and a finite pose");
  if (const auto reason = guard.objection(from)) return {{}, "The arm cannot leave where it stands. " + *reason};
  const double room_m = guard.objection(from, options.room_m) ? 0.0 : options.room_m;
  const auto free = [&](const Eigen::VectorXd& q) { return !guard.objection(q, room_m); };
  const double margin_rad = std::max(options.search.joint_margin_rad, guard.limits().joint_margin_rad);

  const std::vector<Eigen::VectorXd> goals = postures(kinematics, bMe, from, margin_rad);
  if (goals.empty()) return {{}, "No joint angles of the arm reach the goal."};
  Plan best;
  double least = std::numeric_limits<double>::infinity();
  int searched = 0;
  for (const Eigen::VectorXd& goal : goals) {
    if (largest(goal - from) >= least) break;  // No way there is shorter.
    if (const auto reason = guard.objection(goal, room_m)) {
      if (best.reason.empty()) best.reason = *reason;
      continue;
    }
    ++searched;
    const auto path = planPath(kinematics, free, from, goal, options.search);
    if (!path || lengthOf(*path) >= least) continue;
    least = lengthOf(*path);
    best.path = *path;
  }
  if (!best.path.empty()) best.reason.clear();
  else if (searched > 0)
    best.reason = "No free way to the goal was found, in any of " + std::to_string(searched) + " postures of the arm.";
  return best;
}

}  // namespace servocal::robot
