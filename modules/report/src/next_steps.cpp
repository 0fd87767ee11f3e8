// SPDX-License-Identifier: GPL-3.0-or-later
#include "next_steps.h"

#include <cmath>
#include <map>

#include "number_text.h"

namespace servocal::report {
namespace {

/// Advice for a cause that left out several views of a camera; one alone may happen.
void adviseOnRejected(std::vector<std::string>& steps, const std::string& camera,
                      const std::vector<ViewResidual>& views) {
  static const std::map<ViewCause, std::string> advice = {
      {ViewCause::kCorners,
       "Check that no second board is in view and that board and camera are those of the cell file"},
      {ViewCause::kBlurred, "Give more light, a shorter exposure, or a longer time to settle"},
      {ViewCause::kRobotPose,
       "Check the arm's clock, its payload and tool settings, and that the board is fixed tightly"},
      {ViewCause::kPoseFlip, "Tilt the board more, or bring it nearer"}};
  std::map<ViewCause, int> counts;
  for (const ViewResidual& view : views) counts[view.cause] += view.used ? 0 : 1;
  for (const auto& [cause, sentence] : advice) {
    const int count = counts[cause];
    if (count < 2 || count * 20 < static_cast<int>(views.size())) continue;
    steps.push_back(sentence + ": " + std::to_string(count) + " of " + std::to_string(views.size()) +
                    " views of " + camera + " were left out (" + toString(cause) + ").");
  }
}

void adviseOnCamera(std::vector<std::string>& steps, const CameraResult& camera) {
  adviseOnRejected(steps, camera.camera, camera.intrinsics.views);
  if (camera.hand_eye) adviseOnRejected(steps, camera.camera, camera.hand_eye->views);
  if (const auto& scale = camera.board_scale) {
    const double off = scale->scale - 1.0;
    if (std::abs(off) > 5.0 * scale->sigma && std::abs(off) > 0.002) {
      steps.push_back("Measure the board: by the robot's motion, seen from " + camera.camera + ", it is " +
                      shortNumber(100.0 * std::abs(off)) + " % " + (off > 0 ? "larger" : "smaller") +
                      " than the cell file says.");
    }
  }
  if (camera.hand_eye) {
    const double sigma_mm = camera.hand_eye->camera_sigma.head<3>().norm() * 1e3;
    const double scatter_mm = camera.hand_eye->scatter_m * 1e3;
    if (sigma_mm > 1.0) {
      steps.push_back("Take more views of " + camera.camera +
                      ", tilted and turned about several axes: its place is known to " +
                      shortNumber(sigma_mm) + " mm.");
    }
    if (scatter_mm > 2.0) {
      steps.push_back("Check the arm's accuracy and the board's mount: seen from " + camera.camera +
                      ", the board moves on the flange by " + shortNumber(scatter_mm) +
                      " mm RMS if the robot is believed.");
    }
  }
  if (camera.time_offset_s &&
      std::abs(*camera.time_offset_s) > std::max(0.005, 3.0 * camera.time_offset_sigma_s)) {
    steps.push_back("Correct latency_s of " + camera.camera + " in the cell file: its images are stamped " +
                    shortNumber(std::abs(*camera.time_offset_s) * 1e3) + " ms too " +
                    (*camera.time_offset_s > 0 ? "late." : "early."));
  }
}

}  // namespace

std::vector<std::string> nextSteps(const CalibrationResult& result) {
  std::vector<std::string> steps;
  for (const std::string& missing : result.missing) steps.push_back("Still missing: " + missing + ".");
  for (const CameraResult& camera : result.cameras) adviseOnCamera(steps, camera);
  if (result.goal_met) {
    steps.emplace_back(
        "Load the result: servocal-export writes it for ROS, OpenCV, ViSP, Kalibr, mrcal and others.");
    steps.emplace_back(
        "Calibrate again after anything was bumped, refocused or remounted; the same command does it.");
  } else {
    steps.emplace_back("Do not use this result before the goal is met, or accept what is missing knowingly.");
  }
  return steps;
}

}  // namespace servocal::report
