// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/diagnose.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "depth_views.h"
#include "hand_eye_start.h"
#include "median.h"
#include "servocal/core/mount.h"

namespace servocal::calib {
namespace {

/// The views of one camera: what their images say, and the arm's poses as given.
struct Views {
  std::vector<CandidateView> candidates;
  std::vector<std::size_t> observation;  // by view, index into the observations
};

Views viewsOf(const BoardSpec& board, const CameraModel& camera, const std::vector<Observation>& observations,
              const std::string& camera_name, Stream stream, Mount mount) {
  const BoardTurns turns(board);
  Views views;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!observations[i].robot) continue;
    for (const StreamObservation& seen : observations[i].views) {
      if (seen.camera != camera_name || seen.stream != stream) continue;
      const Pose<Base, EndEffector>& bMe = observations[i].robot->bMe;
      if (!bMe.isFinite()) {
        throw std::invalid_argument("the robot pose of observation " + std::to_string(observations[i].id) +
                                    " is not finite");
      }
      views.candidates.push_back(candidateView(board, turns, camera, seen.detection, forMount(mount, bMe)));
      views.observation.push_back(i);
    }
  }
  return views;
}

/// How well one reading of the robot's poses agrees with the images.
struct Agreement {
  bool consistent = false;
  double scatter = INFINITY;  // rad + share of the distance
  double scale = 1.0;
  std::vector<HandEyeView> chosen;
  HandEyeResult closed_form;
};

Agreement agreement(const BoardSpec& board, const std::vector<CandidateView>& views, bool free_scale) {
  constexpr double kLeastShare = 0.8, kMostRotation_rad = 0.035, kMostTranslation = 0.015;
  HandEyeOptions options;
  options.free_scale = free_scale;
  Agreement out;
  const HandEyeStart start = startHandEye(board, views, options);
  if (start.status != HandEyeStatus::kSolved) return out;
  double distance_m = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (start.choice[i] < 0) continue;
    out.chosen.push_back({views[i].bMe, views[i].candidates[static_cast<std::size_t>(start.choice[i])].cMo});
    distance_m += start.scale * out.chosen.back().cMo.translation().norm();
  }
  out.closed_form = solveHandEye(out.chosen, options);
  if (out.closed_form.status != HandEyeStatus::kSolved || !(out.closed_form.scale > 0)) return out;
  distance_m /= static_cast<double>(out.chosen.size());
  const double translation = out.closed_form.rms_translation_m / distance_m;
  out.scale = out.closed_form.scale;
  out.scatter = translation + out.closed_form.rms_rotation_rad;
  out.consistent =
      static_cast<double>(out.chosen.size()) >= kLeastShare * static_cast<double>(views.size()) &&
      out.closed_form.rms_rotation_rad < kMostRotation_rad && translation < kMostTranslation;
  return out;
}

std::string number(const char* pattern, double value) {
  char text[32];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

/// What a scale between robot and board looks like; empty if it is none to speak of.
std::string scaleClause(const BoardSpec& board, double scale) {
  const auto near = [&](double value) { return std::abs(scale / value - 1.0) < 0.1; };
  if (near(1000)) return "the robot poses are in millimetres, read as metres (length_unit: mm)";
  if (near(0.001)) return "the robot poses are in metres, read as millimetres (length_unit: m)";
  if (near(100)) return "the robot poses are in centimetres, read as metres";
  if (near(39.37)) return "the robot poses are in inches, read as metres";
  if (std::abs(scale - 1.0) < 0.03) return "";
  return sizeText(board, scale);
}

}  // namespace

std::string sizeText(const BoardSpec& board, double scale, const std::string& by) {
  std::string what = "squares measure";
  double stated_m = 0;
  if (const auto* checkerboard = board.as<Checkerboard>()) stated_m = checkerboard->square_size_m;
  if (const auto* charuco = board.as<Charuco>()) stated_m = charuco->square_size_m;
  if (const auto* tags = board.as<TagGrid>()) {
    what = "tags measure";
    stated_m = tags->tag_size_m;
  }
  if (const auto* circles = board.as<CircleGrid>()) {
    what = "circles are spaced";
    stated_m = circles->spacing_m;
  }
  return "the " + what + " " + number("%.2f", 1e3 * stated_m * scale) + " mm by " + by + ", not " +
         number("%g", 1e3 * stated_m) + " mm";
}

std::optional<BoardScale> boardScaleByDepth(const BoardSpec& board, const CameraModel& infrared,
                                            const std::vector<Observation>& observations,
                                            const std::string& camera_name) {
  constexpr std::size_t kLeastViews = 3;
  std::vector<double> ratios;
  for (const Observation& observation : observations) {
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera != camera_name || seen.stream != Stream::kInfrared || !seen.depth) continue;
      const auto view = depthView(board, infrared, observation, seen, {});
      if (view) ratios.push_back(view->raw_m.cwiseQuotient(view->plane_m).mean());
    }
  }
  if (ratios.size() < kLeastViews) return std::nullopt;
  const double scale = median(ratios);
  std::vector<double> off;
  for (const double ratio : ratios) off.push_back(std::abs(ratio - scale));
  // Of normal errors, the median's standard deviation is 1.25 times the mean's.
  return BoardScale{scale, 1.25 * 1.4826 * median(off) / std::sqrt(static_cast<double>(ratios.size()))};
}

std::optional<BoardScale> boardScale(const BoardSpec& board, const CameraModel& camera,
                                     const std::vector<Observation>& observations,
                                     const std::string& camera_name, Stream stream, Mount mount) {
  const Views views = viewsOf(board, camera, observations, camera_name, stream, mount);
  const Agreement found = agreement(board, views.candidates, true);
  if (!found.consistent || found.chosen.size() < 4) return std::nullopt;
  // The translations' equations of solveHandEye, their residuals and the inverse normal matrix.
  const Eigen::Matrix3d bRc = found.closed_form.bMc->rotation();
  Eigen::Matrix<double, 7, 7> matrix = Eigen::Matrix<double, 7, 7>::Zero();
  Eigen::Matrix<double, 7, 1> solution;
  solution << found.closed_form.eMo->translation(), found.closed_form.bMc->translation(), found.scale;
  double squares_m2 = 0;
  for (const HandEyeView& view : found.chosen) {
    Eigen::Matrix<double, 3, 7> row;
    row << view.bMe.rotation(), -Eigen::Matrix3d::Identity(), -(bRc * view.cMo.translation());
    matrix += row.transpose() * row;
    squares_m2 += (row * solution + view.bMe.translation()).squaredNorm();
  }
  const double degrees = 3.0 * static_cast<double>(found.chosen.size()) - 7.0;
  const Eigen::Matrix<double, 7, 7> covariance = matrix.inverse() * (squares_m2 / degrees);
  if (!(covariance(6, 6) >= 0)) return std::nullopt;
  return BoardScale{found.scale, std::sqrt(covariance(6, 6))};
}

std::optional<std::string> explainContradiction(const BoardSpec& board, const CameraModel& camera,
                                                const std::vector<Observation>& observations,
                                                const std::string& camera_name, Stream stream, Mount mount,
                                                const std::vector<RobotReading>& readings) {
  for (const RobotReading& reading : readings) {
    if (reading.bMe.size() != observations.size()) {
      throw std::invalid_argument("a reading of the robot poses has " + std::to_string(reading.bMe.size()) +
                                  " poses for " + std::to_string(observations.size()) + " observations");
    }
  }
  const Views views = viewsOf(board, camera, observations, camera_name, stream, mount);
  const Agreement given = agreement(board, views.candidates, false);

  struct Way {
    std::string what;
    std::vector<CandidateView> views;
  };
  std::vector<Way> ways = {
      {"", views.candidates},
      {std::string("the poses are the inverse of what the manifest says (pose: eMb for bMe or the other way "
                   "round), or the camera is on the other mount (") +
           (mount == Mount::kFixed ? "eye_in_hand instead of eye_to_hand"
                                   : "eye_to_hand instead of eye_in_hand") +
           "), which is the same geometry",
       views.candidates},
      {"the rotations are transposed (rows of the matrix for columns, or the quaternion conjugated)",
       views.candidates}};
  for (CandidateView& view : ways[1].views) view.bMe = relabel<Base, EndEffector>(view.bMe.inverse());
  for (std::size_t i = 0; i < views.candidates.size(); ++i) {
    const Pose<Base, EndEffector>& bMe = observations[views.observation[i]].robot->bMe;
    ways[2].views[i].bMe =
        forMount(mount, Pose<Base, EndEffector>(bMe.rotation().transpose(), bMe.translation()));
  }
  for (const RobotReading& reading : readings) {
    Way way{reading.what, views.candidates};
    bool whole = true;
    for (std::size_t i = 0; i < way.views.size() && whole; ++i) {
      const auto& bMe = reading.bMe[views.observation[i]];
      whole = bMe.has_value() && bMe->isFinite();
      if (whole) way.views[i].bMe = forMount(mount, *bMe);
    }
    if (whole) ways.push_back(std::move(way));
  }

  std::string best;
  double least = (given.consistent ? given.scatter : INFINITY) / 3.0;
  for (const bool free_scale : {false, true}) {
    for (const Way& way : ways) {
      if (way.what.empty() && !free_scale) continue;
      const Agreement found = agreement(board, way.views, free_scale);
      // A later way must be clearly better: the first of several alike is the simplest.
      if (!found.consistent || !(found.scatter < (best.empty() ? least : 0.5 * least))) continue;
      const std::string scale = free_scale ? scaleClause(board, found.scale) : "";
      if (free_scale && scale.empty()) continue;
      least = found.scatter;
      best = way.what.empty() ? scale : scale.empty() ? way.what : way.what + ", and " + scale;
    }
  }
  if (best.empty()) return std::nullopt;
  return best;
}

}  // namespace servocal::calib
