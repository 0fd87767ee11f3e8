// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/summary.h"

#include <algorithm>
#include <cmath>

#include "format.h"
#include "servocal/core/pose.h"

namespace servocal::procedure {
namespace {

constexpr double kRadToDeg = 180.0 / M_PI;

/// "5 of 6"
std::string usedOfFound(const std::vector<ViewResidual>& views) {
  const auto used = std::count_if(views.begin(), views.end(), [](const ViewResidual& view) { return view.used; });
  return std::to_string(used) + " of " + std::to_string(views.size());
}

std::string intrinsicsText(const char* what, const IntrinsicsResult& intrinsics) {
  const CameraModel& camera = intrinsics.camera;
  const bool solved = intrinsics.sigma.size() == camera.parameters.size();
  std::string text = format("  %s, %d x %d px, %s, ", what, camera.width_px, camera.height_px, toString(camera.lens));
  text += solved ? format("from %s views (%d corners), residual %.3f px RMS\n",
                          usedOfFound(intrinsics.views).c_str(), intrinsics.corners, intrinsics.rms_px)
                 : std::string("given\n");
  const auto& names = parameterNames(camera.lens);
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += format(i < 4 ? "    %-3s %11.3f" : "    %-3s %11.5f", names[i].c_str(), camera.parameters[i]);
    if (solved) text += format(i < 4 ? " +- %.3f" : " +- %.5f", intrinsics.sigma[i]);
    if (i < 4) text += " px";
    if (i % 2 == 1 || i + 1 == names.size()) text += '\n';
  }
  return text;
}

std::string poseText(const char* what, const Eigen::Isometry3d& pose, const Eigen::Matrix<double, 6, 1>& sigma) {
  const Eigen::Vector3d t_mm = pose.translation() * 1e3;
  const Eigen::AngleAxisd turn(pose.linear());
  const Eigen::Vector3d r_deg = turn.angle() * kRadToDeg * turn.axis();
  const Eigen::Vector3d sigma_mm = sigma.head<3>() * 1e3, sigma_deg = sigma.tail<3>() * kRadToDeg;
  return format("    %-28s t = (%9.2f, %9.2f, %9.2f) +- (%.2f, %.2f, %.2f) mm\n", what, t_mm.x(), t_mm.y(), t_mm.z(),
                sigma_mm.x(), sigma_mm.y(), sigma_mm.z()) +
         format("    %-28s r = (%9.3f, %9.3f, %9.3f) +- (%.3f, %.3f, %.3f) deg (rotation vector)\n", "", r_deg.x(),
                r_deg.y(), r_deg.z(), sigma_deg.x(), sigma_deg.y(), sigma_deg.z());
}

std::string handEyeText(const HandEyeSolution& hand_eye) {
  const bool fixed = hand_eye.mount == Mount::kFixed;
  return poseText(fixed ? "camera in base (bMc)" : "camera on flange (eMc)", hand_eye.camera_pose,
                  hand_eye.camera_sigma) +
         poseText(fixed ? "board on flange (eMo)" : "board in base (bMo)", hand_eye.board_pose, hand_eye.board_sigma) +
         format("    %s views, residual %.3f px RMS, robot corrected by %.2f mm and %.3f deg RMS; scatter if the robot is\n"
                "    believed: %.2f mm, %.3f deg. A residual is fit, not accuracy.\n",
                usedOfFound(hand_eye.views).c_str(), hand_eye.rms_px, hand_eye.robot_rms_m * 1e3, hand_eye.robot_rms_rad * kRadToDeg,
                hand_eye.scatter_m * 1e3, hand_eye.scatter_rad * kRadToDeg);
}

/// "12.345 +- 0.012", right-aligned.
std::string valueText(double value, double sigma, int digits) {
  return format("%24s", format("%.*f +- %.*f", digits, value, digits, sigma).c_str());
}

std::string comparisonHead() {
  return format("    %-16s%24s%24s   %s\n", "the outliers", "left out", "kept", "apart by");
}

/// What the views that were left out would have done to the intrinsics.
std::string comparisonText(const IntrinsicsResult& without, const IntrinsicsResult& with) {
  std::string text = comparisonHead();
  text += format("    %-16s%24.3f%24.3f\n", "residual, px", without.rms_px, with.rms_px);
  for (int i = 0; i < 4; ++i) {
    const double value = without.camera.parameters[i], other = with.camera.parameters[i];
    const std::string& name = parameterNames(without.camera.lens)[static_cast<std::size_t>(i)];
    text += format("    %-16s", (name + ", px").c_str()) + valueText(value, without.sigma[i], 2) +
            valueText(other, with.sigma[i], 2) +
            format("   %.1f sigma\n", std::abs(other - value) / without.sigma[i]);
  }
  return text;
}

std::string comparisonText(const HandEyeSolution& without, const HandEyeSolution& with) {
  std::string text = comparisonHead();
  text += format("    %-16s%24.3f%24.3f\n", "residual, px", without.rms_px, with.rms_px);
  text += format("    %-16s%24.2f%24.2f\n", "scatter, mm", without.scatter_m * 1e3, with.scatter_m * 1e3);
  for (int i = 0; i < 3; ++i) {
    const double value = without.camera_pose.translation()[i], other = with.camera_pose.translation()[i];
    text += format("    camera %c, mm    ", "xyz"[i]) +
            valueText(value * 1e3, without.camera_sigma[i] * 1e3, 2) +
            valueText(other * 1e3, with.camera_sigma[i] * 1e3, 2) +
            format("   %.1f sigma\n", std::abs(other - value) / without.camera_sigma[i]);
  }
  const Pose<Base, Color> first(without.camera_pose), second(with.camera_pose);
  return text + format("    camera turned by %.3f deg\n", angleRad(first, second) * kRadToDeg);
}

std::string coverageText(const char* what, const CoverageSummary& coverage) {
  int filled = 0, given_up = 0;
  std::string grid;
  for (int row = 0; row < coverage.cells_y; ++row) {
    grid += "    ";
    for (int column = 0; column < coverage.cells_x; ++column) {
      const std::size_t cell = row * coverage.cells_x + column;
      const bool full = coverage.corners_per_cell[cell] >= coverage.corners_to_fill;
      filled += full;
      given_up += !full && coverage.unreachable[cell];
      grid += full ? format("%4d", coverage.corners_per_cell[cell]) : coverage.unreachable[cell] ? "   -" : "   .";
    }
    grid += '\n';
  }
  std::string text = format("  %s: %d of %d image cells hold %d corners or more, %d out of reach (-)\n", what, filled,
                            coverage.cells_x * coverage.cells_y, coverage.corners_to_fill, given_up) + grid;
  text += format("    views: %d near, %d far;", coverage.near_views, coverage.far_views);
  for (const auto& [bin, views] : coverage.tilt_bins) text += format(" %s %d", bin.c_str(), views);
  return text + '\n';
}

std::string rejectedText(const std::vector<ViewResidual>& views) {
  std::string text;
  for (const ViewResidual& view : views) {
    if (!view.used) text += "    left out: " + view.name + " (" + view.reason + ")\n";
  }
  return text;
}

std::string depthText(const DepthResult& depth) {
  const DepthModel& model = depth.model;
  const char* unit = model.sensor == DepthSensor::kStructuredLight ? "1/m" : "m";
  std::string text =
      format("  Depth, %s: offset %.5f %s, slope %.5f, lattice %d x %d; from %d views (%d patches)\n",
             toString(model.sensor), model.offset, unit, model.slope, model.nodes_x, model.nodes_y, depth.views,
             depth.patches) +
      format("    against the board: %.2f mm RMS as measured, %.2f mm corrected. Fit, not accuracy.\n    sigma in the"
             " middle of the image:",
             depth.rms_before_m * 1e3, depth.rms_after_m * 1e3);
  for (Eigen::Index i = 0; i < depth.sigma_m.size(); ++i) {
    text += format(" %.2f mm at %.2f m%s", depth.sigma_m[i] * 1e3, depth.sigma_at_m[i],
                   i + 1 < depth.sigma_m.size() ? "," : "");
  }
  text += format("; solved from %.2f to %.2f m\n", model.near_m, model.far_m);
  for (const std::string& note : depth.notes) text += "    note: " + note + "\n";
  return text;
}

std::string tiltText(const std::vector<TiltLimit>& limits, Stream stream) {
  std::string text;
  for (const TiltLimit& limit : limits) {
    if (limit.stream != stream) continue;
    text += format(" %s %.0f deg (%s)", limit.direction.c_str(), limit.limit_rad * kRadToDeg, limit.ended_by.c_str());
  }
  return text.empty() ? text : format("  Tilt limits, %s:", toString(stream)) + text + '\n';
}

std::string infraredText(const CameraResult& camera) {
  std::string text = intrinsicsText("Infrared", *camera.infrared) + rejectedText(camera.infrared->views);
  if (camera.color_infrared) {
    const CameraPair& pair = *camera.color_infrared;
    text += poseText("infrared in color (cMi)", pair.first_by_second, pair.covariance.diagonal().cwiseSqrt()) +
            format("    %d views in which both saw the board, residual %.3f px RMS\n", camera.combined_views, pair.rms_px);
  }
  if (camera.depth) text += depthText(*camera.depth);
  return text;
}

std::string jointCameraText(const JointCameraResult& camera, Mount mount) {
  const bool fixed = mount == Mount::kFixed;
  std::string text = format("  %s %s, %d views, corner noise %.2f times what the detector claims\n",
                            camera.camera.c_str(), toString(camera.stream), camera.views, camera.corner_scale);
  const auto& names = parameterNames(camera.model.lens);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    const char* pattern = i < 4 ? "    %-3s %11.3f +- %.3f px" : "    %-3s %11.5f +- %.5f";
    const char* held = i < 4 ? "    %-3s %11.3f px, held" : "    %-3s %11.5f held";
    text += camera.sigma[at] == 0 ? format(held, names[i].c_str(), camera.model.parameters[at])
                                  : format(pattern, names[i].c_str(), camera.model.parameters[at], camera.sigma[at]);
    if (i % 2 == 1 || i + 1 == names.size()) text += '\n';
  }
  text += poseText(fixed ? (camera.stream == Stream::kColor ? "camera in base (bMc)" : "infrared in base (bMi)")
                         : (camera.stream == Stream::kColor ? "camera on flange (eMc)" : "infrared on flange (eMi)"),
                   camera.pose, camera.pose_covariance.diagonal().cwiseSqrt());
  text += format("    projection good to %.2f px at %.2f m and %.2f px at infinity, one sigma, worst place of the "
                 "image\n    a point of the workspace good to %.2f mm in the mean, %.2f mm at worst "
                 "(%d of %zu places are seen)\n",
                 camera.at_range.worst_px, camera.range_m, camera.at_infinity.worst_px, camera.workspace.rms_m * 1e3,
                 camera.workspace.worst_m * 1e3, camera.workspace.seen, camera.workspace.sigma_m.size());
  if (const auto& halves = camera.halves) {
    text += format("    every other stop and the rest differ by %.2f px, %.2f px are claimed\n", halves->rms_px,
                   halves->claimed_px);
  }
  return text;
}

std::string jointPairText(const JointPair& pair) {
  const bool one_camera = pair.first == pair.second;
  const std::string what = one_camera ? pair.first + ": " + toString(pair.second_stream) + " in " + toString(pair.first_stream)
                                      : pair.second + " in " + pair.first;
  const std::string text = poseText(what.c_str(), pair.first_by_second, pair.covariance.diagonal().cwiseSqrt());
  if (pair.seen == 0) return text;
  return text + format("    a point of the workspace is the same in both to %.2f mm in the mean, %.2f mm at worst\n",
                       pair.rms_m * 1e3, pair.worst_m * 1e3);
}

std::string jointText(const JointResult& joint) {
  std::string text = "Joint estimate: all cameras, board and robot at once\n";
  for (const JointCameraResult& camera : joint.cameras) text += jointCameraText(camera, joint.mount);
  if (!joint.pairs.empty()) text += "  Beside each other\n";
  for (const JointPair& pair : joint.pairs) text += jointPairText(pair);
  text += poseText(joint.mount == Mount::kFixed ? "board on flange (eMo)" : "board in base (bMo)", joint.board_pose,
                   joint.board_sigma);
  text += format("  Board: print %.3f %% (x) and %.3f %% (y) of its stated size, bowed by %.2f mm and %.2f mm\n",
                 joint.board_scale_x * 100, joint.board_scale_y * 100, joint.board_bow_x_m * 1e3,
                 joint.board_bow_y_m * 1e3);
  text += format("  Robot noise per axis and stop: found %.3f mm and %.4f deg, declared %.3f mm and %.4f deg\n",
                 joint.robot_sigma_m * 1e3, joint.robot_sigma_rad * kRadToDeg, joint.declared_sigma_m * 1e3,
                 joint.declared_sigma_rad * kRadToDeg);
  for (const auto& [name, value] : joint.robot_terms) text += format("    %-28s %10.6f\n", name.c_str(), value);
  if (joint.held_out) {
    text += format("  Views that the solve did not see: %d, off by %.3f px and %.2f mm RMS, the robot's error included; "
                   "%.2f times what is\n    claimed (1: the claims hold)\n",
                   joint.held_out->views, joint.held_out->rms_px, joint.held_out->rms_m * 1e3, joint.held_out->z);
  }
  if (!joint.model.empty()) text += "  " + joint.model + "\n";
  for (const std::string& fault : joint.faults) text += "  Fault: " + fault + "\n";
  for (const std::string& open : joint.open) text += "  Open: " + open + "\n";
  for (const std::string& note : joint.notes) text += "  Note: " + note + "\n";
  return text;
}

}  // namespace

std::string line(const Event& event) {
  std::string text = format("%6.1f s  %-14s %-9s %3d/%-3d", toSeconds(event.stamp), event.camera.c_str(),
                            event.stage.c_str(), event.done, event.planned);
  text += event.eta_s ? format("  ETA %4.0f s", *event.eta_s) : std::string("             ");
  if (event.rms_px) text += format("  reprojection %.3f px", *event.rms_px);
  if (event.scatter_m) text += format("  hand-eye scatter %.2f mm", *event.scatter_m * 1e3);
  if (!event.message.empty()) text += "  " + event.message;
  return text;
}

std::string verdict(const CalibrationResult& result) {
  std::string text = result.goal_met ? "Goal met." : "Goal not met.";
  for (const std::string& missing : result.missing) text += " " + missing + ".";
  return text;
}

std::string summary(const CalibrationResult& result) {
  std::string text = result.goal_met ? "Goal met.\n" : "Goal not met:\n";
  for (const std::string& missing : result.missing) text += "  - " + missing + "\n";
  for (const CameraResult& camera : result.cameras) {
    text += "Camera " + camera.camera + "\n" + intrinsicsText("Intrinsics", camera.intrinsics) +
            rejectedText(camera.intrinsics.views);
    if (camera.intrinsics_with_outliers) {
      text += comparisonText(camera.intrinsics, *camera.intrinsics_with_outliers);
    }
    if (camera.hand_eye) {
      text += "  Hand-eye\n" + handEyeText(*camera.hand_eye) + rejectedText(camera.hand_eye->views);
      if (camera.hand_eye_with_outliers)
        text += comparisonText(*camera.hand_eye, *camera.hand_eye_with_outliers);
    }
    for (const std::string& note : camera.notes) text += "  Note: " + note + ".\n";
    if (camera.held_out) {
      text += format("  Held out: %d views that no solver saw, off by %.3f px and %.2f mm RMS, the robot's error included\n",
                     camera.held_out->views, camera.held_out->rms_px, camera.held_out->rms_m * 1e3);
    }
    if (camera.infrared) text += infraredText(camera);
    if (camera.coverage) text += coverageText("Coverage", *camera.coverage);
    if (camera.infrared_coverage) text += coverageText("Infrared coverage", *camera.infrared_coverage);
    text += tiltText(camera.tilt_limits, Stream::kColor) + tiltText(camera.tilt_limits, Stream::kInfrared);
  }
  for (const CameraPair& pair : result.camera_pairs) {
    text += "Cameras " + pair.first + " and " + pair.second + "\n" +
            poseText((pair.second + " in " + pair.first).c_str(), pair.first_by_second,
                     pair.covariance.diagonal().cwiseSqrt()) +
            format("    %s views, residual %.3f px RMS\n", usedOfFound(pair.views).c_str(), pair.rms_px) +
            rejectedText(pair.views);
  }
  if (result.joint) text += jointText(*result.joint);
  if (!result.joint_problem.empty()) text += "Joint estimate: none. " + result.joint_problem + "\n";
  text += format("%d observations", result.observations);
  if (result.motion_time_s > 0) {
    text += format("; first to last motion %.1f s, of which tilt search %.1f s", result.motion_time_s,
                   result.tilt_time_s);
  }
  return text + "\n";
}

}  // namespace servocal::procedure
