// SPDX-License-Identifier: GPL-3.0-or-later
#include "view_reasons.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "median.h"

namespace servocal::calib {
namespace {

constexpr double kDegPerRad = 180.0 / M_PI;

std::string number(const char* pattern, double value) {
  char text[32];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

void name(ViewResidual& report, ViewCause cause, std::string reason) {
  report.used = false;
  report.cause = cause;
  report.reason = std::move(reason);
}

using ArmPose = Pose<Base, EndEffector>;

ArmPose armPose(Mount mount, const Eigen::Isometry3d& lMr) {
  return ArmPose(mount == Mount::kFixed ? lMr : lMr.inverse());
}

/// The other pose of a plane seen from afar: tilted the other way about the line of sight.
Pose<Color, Board> mirrored(const Pose<Color, Board>& cMo) {
  const Eigen::Vector3d sight = cMo.translation().normalized();
  const Eigen::Matrix3d reflection = Eigen::Matrix3d::Identity() - 2.0 * sight * sight.transpose();
  return Pose<Color, Board>(reflection * cMo.rotation() * Eigen::Vector3d(1, 1, -1).asDiagonal(),
                            cMo.translation());
}

/// Rotation counts as much as what it moves at arm's length from the flange, 0.1 m.
double difference(const ArmPose& first, const ArmPose& second) {
  return distanceM(first, second) + 0.1 * angleRad(first, second);
}

std::string distanceText(const ArmPose& first, const ArmPose& second) {
  return number("%.1f mm", 1e3 * distanceM(first, second)) + " and " +
         number("%.2f deg", kDegPerRad * angleRad(first, second));
}

}  // namespace

double claimedSigmaPx(const BoardDetection& detection) {
  std::vector<double> sigmas;
  for (const Corner& corner : detection.corners) {
    const double variance = 0.5 * corner.covariance_px2.trace();
    sigmas.push_back(std::isfinite(variance) && variance > 0 ? std::sqrt(variance) : 0.0);
  }
  return sigmas.empty() ? 0.0 : median(sigmas);
}

void explainImage(const BoardDetection& detection, double sharpness_px, double usual_rms_px, double rms_px,
                  ViewResidual& report) {
  const double sigma_px = claimedSigmaPx(detection);
  const std::string residual = number("%.2f px", rms_px) + ", the others " + number("%.2f px", usual_rms_px);
  if (sharpness_px > 0 && sigma_px > kBlurRatio * sharpness_px) {
    name(report, ViewCause::kBlurred,
         "blurred: its corners are " + number("%.1f", sigma_px / sharpness_px) +
             " times less sharp than the others' and fit worse (" + residual + ")");
  } else {
    name(report, ViewCause::kCorners,
         "another board, another camera, or wrong corners: no pose of the board explains its image (" +
             residual + ")");
  }
}

void explainLeftOut(const BoardSpec& board, Mount mount, const Eigen::Isometry3d& lMc,
                    const Eigen::Isometry3d& rMo, double tolerance_m, const std::vector<Stop>& stops,
                    std::vector<ViewResidual>& reports) {
  std::vector<double> sharpness_px, image_rms_px;
  for (std::size_t i = 0; i < stops.size(); ++i) {
    if (!reports[i].used || stops[i].candidates.empty()) continue;
    sharpness_px.push_back(claimedSigmaPx(*stops[i].detection));
    image_rms_px.push_back(stops[i].candidates.front().rms_px);
  }
  // Nothing to compare with if no view is left.
  const double usual_sigma_px = sharpness_px.empty() ? 0.0 : median(sharpness_px);
  const double usual_rms_px = image_rms_px.empty() ? 0.0 : median(image_rms_px);

  for (std::size_t i = 0; i < stops.size(); ++i) {
    if (reports[i].used) continue;
    const Stop& stop = stops[i];
    if (stop.candidates.empty()) {
      name(reports[i], ViewCause::kNoBoard, "no board pose: too few corners, or all on one line");
      continue;
    }
    const double rms_px = stop.candidates.front().rms_px;
    if (rms_px > std::max(0.3, 5.0 * usual_rms_px)) {
      explainImage(*stop.detection, usual_sigma_px, usual_rms_px, rms_px, reports[i]);
      continue;
    }
    // Of the better and of the worse fitting solutions, those nearest to what the robot says.
    const Pose<Color, Board> predicted(lMc.inverse() * stop.lMr * rMo);
    const BoardPoseCandidate* better = nullptr;
    double better_m = INFINITY, worse_m = INFINITY;
    for (const BoardPoseCandidate& candidate : stop.candidates) {
      const double distance_m = cornerDistance(board, predicted, candidate.cMo);
      double& least_m = candidate.better_fitting ? better_m : worse_m;
      if (distance_m >= least_m) continue;
      least_m = distance_m;
      if (candidate.better_fitting) better = &candidate;
    }
    const double sigma_px = claimedSigmaPx(*stop.detection);
    if (worse_m > 0.3 * better_m) worse_m = cornerDistance(board, predicted, mirrored(better->cMo));
    if (worse_m < 0.3 * better_m && worse_m < 0.02 * predicted.translation().norm()) {
      name(reports[i], ViewCause::kPoseFlip,
           "pose flip: its robot pose goes with the mirrored one of the two poses of a plane, tilted the "
           "other way; "
           "its image does not");
      continue;
    }
    const ArmPose given = armPose(mount, stop.lMr);
    const ArmPose implied = armPose(mount, lMc * better->cMo.isometry() * rMo.inverse());
    if (usual_sigma_px > 0 && sigma_px > kBlurRatio * usual_sigma_px && difference(given, implied) < 0.03) {
      name(reports[i], ViewCause::kBlurred,
           "blurred: its corners are " + number("%.1f", sigma_px / usual_sigma_px) +
               " times less sharp than the others', and it is " + distanceText(given, implied) + " off");
      continue;
    }
    std::string reason =
        "wrong robot pose: it is " + distanceText(given, implied) + " from where the image puts the arm";
    // The pose of another view, or its own inverse, must explain it far better to be named.
    const double limit = std::min(0.25 * difference(given, implied), 10.0 * tolerance_m);
    double least = limit;
    std::optional<std::size_t> neighbor;
    for (std::size_t k = 0; k < stops.size(); ++k) {
      if (k == i) continue;
      const double apart = difference(armPose(mount, stops[k].lMr), implied);
      if (apart >= least) continue;
      least = apart;
      neighbor = k;
    }
    const ArmPose inverse = relabel<Base, EndEffector>(given.inverse());
    if (difference(inverse, implied) < least) {
      reason += "; its inverse fits (eMb given for bMe)";
    } else if (neighbor) {
      reason += "; the image goes with the pose of '" + reports[*neighbor].name + "' (rows swapped?)";
    }
    name(reports[i], ViewCause::kRobotPose, reason);
  }
}

}  // namespace servocal::calib
