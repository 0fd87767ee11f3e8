// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "check_model.h"

namespace servocal::procedure {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180.0;
constexpr int kLeastViews = 3;  // of a camera

std::string text(const char* format, double a, double b = 0.0, double c = 0.0, double d = 0.0,
                 double e = 0.0) {
  char buffer[200];
  std::snprintf(buffer, sizeof buffer, format, a, b, c, d, e);
  return buffer;
}

std::string moveText(const Eigen::VectorXd& change, const char* axes) {
  const Vector3d shift_mm = 1e3 * change.head<3>();
  return text("by %.1f mm (x %+.1f, y %+.1f, z %+.1f) and %.2f degrees", shift_mm.norm(), shift_mm.x(),
              shift_mm.y(), shift_mm.z(), change.tail<3>().norm() / kDegree) +
         ", along the axes of the " + axes;
}

/// One way to explain the views: what is free already, and one part more.
struct Hypothesis {
  CheckPart part = CheckPart::kCamera;
  std::size_t camera = 0;
  int degrees = 6;
  FreeParts with(FreeParts free) const {
    if (part == CheckPart::kCamera) free.cameras.push_back(camera);
    if (part == CheckPart::kIntrinsics) free.intrinsics.push_back(camera);
    if (part == CheckPart::kMount) free.mount = true;
    return free;
  }
};

std::vector<Hypothesis> hypotheses(const CheckModel& model) {
  std::vector<Hypothesis> all = {{CheckPart::kMount, 0, 6}};
  for (std::size_t c = 0; c < model.cameras(); ++c) {
    if (model.views(c) == 0) continue;
    all.push_back({CheckPart::kCamera, c, 6});
    all.push_back({CheckPart::kIntrinsics, c, model.intrinsics(c)});
  }
  return all;
}

CheckFinding findingOf(const Hypothesis& what, const CheckFit& fit, const CheckModel& model) {
  CheckFinding finding;
  finding.part = what.part;
  if (what.part == CheckPart::kMount) {
    finding.change = fit.mount;
    finding.sigma = fit.mount_sigma;
    finding.sentence = "The board moved on its mount " + moveText(finding.change, "flange") +
                       ". Fix it, then repair the mount, or calibrate again.";
    return finding;
  }
  finding.camera = model.name(what.camera);
  if (what.part == CheckPart::kCamera) {
    finding.change = fit.cameras[what.camera];
    finding.sigma = fit.cameras_sigma[what.camera];
    finding.sentence = "Camera '" + finding.camera + "' moved " + moveText(finding.change, "robot's base") +
                       ". Fix it, then repair where it stands, or calibrate it again.";
  } else {
    finding.change = fit.intrinsics[what.camera];
    finding.sigma = fit.intrinsics_sigma[what.camera];
    finding.sentence = "The intrinsics of camera '" + finding.camera + "' changed" +
                       text(" (fx %+.1f, fy %+.1f, cx %+.1f, cy %+.1f px)", finding.change[0],
                            finding.change[1], finding.change[2], finding.change[3]) +
                       ". A few views cannot repair that: calibrate it again.";
  }
  return finding;
}

Eigen::Isometry3d displaced(const Eigen::Isometry3d& pose, const Eigen::VectorXd& change) {
  const auto turn = Pose<Base, Base>::fromRotationVector(change.tail<3>(), Vector3d::Zero());
  Eigen::Isometry3d result = pose;
  result.linear() = turn.rotation() * pose.linear();
  result.translation() += change.head<3>();
  return result;
}

void moveCamera(CalibrationResult& result, const CheckFinding& finding) {
  for (CameraResult& camera : result.cameras) {
    if (camera.camera != finding.camera || !camera.hand_eye) continue;
    const Eigen::Isometry3d before = camera.hand_eye->camera_pose, after = displaced(before, finding.change);
    const Eigen::Isometry3d motion = after * before.inverse();  // of the whole camera, in the base
    camera.hand_eye->camera_pose = after;
    camera.hand_eye->camera_sigma = finding.sigma;
    if (camera.infrared_hand_eye)
      camera.infrared_hand_eye->camera_pose = motion * camera.infrared_hand_eye->camera_pose;
    camera.held_out.reset();
    for (CameraPair& pair : result.camera_pairs) {
      if (pair.first == camera.camera) pair.first_by_second = after.inverse() * before * pair.first_by_second;
      if (pair.second == camera.camera) {
        pair.first_by_second = pair.first_by_second * before.inverse() * after;
      }
    }
    if (!result.joint) continue;
    for (JointCameraResult& joint : result.joint->cameras) {
      if (joint.camera != camera.camera) continue;
      joint.pose = motion * joint.pose;
      joint.pose_covariance = finding.sigma.cwiseAbs2().asDiagonal();
    }
    std::vector<JointPair>& pairs = result.joint->pairs;  // How well it stands beside the others is no longer known.
    pairs.erase(std::remove_if(pairs.begin(), pairs.end(), [&](const JointPair& pair) {
      return (pair.first == camera.camera) != (pair.second == camera.camera);
    }), pairs.end());
  }
}

void moveMount(CalibrationResult& result, const CheckFinding& finding) {
  for (CameraResult& camera : result.cameras) {
    for (auto* hand_eye : {&camera.hand_eye, &camera.infrared_hand_eye}) {
      if (!*hand_eye || (*hand_eye)->mount != Mount::kFixed) continue;
      (*hand_eye)->board_pose = displaced((*hand_eye)->board_pose, finding.change);
      (*hand_eye)->board_sigma = finding.sigma;
    }
    camera.held_out.reset();
  }
  if (!result.joint) return;
  result.joint->board_pose = displaced(result.joint->board_pose, finding.change);
  result.joint->board_sigma = finding.sigma;
}

}  // namespace

const char* toString(CheckPart part) {
  switch (part) {
    case CheckPart::kCamera: return "camera";
    case CheckPart::kIntrinsics: return "intrinsics";
    case CheckPart::kMount: return "mount";
  }
  return "unknown";
}

const char* toString(CheckStatus status) {
  switch (status) {
    case CheckStatus::kOk: return "ok";
    case CheckStatus::kChanged: return "changed";
    case CheckStatus::kNotSeen: return "not_seen";
    case CheckStatus::kTooFewViews: return "too_few_views";
  }
  return "unknown";
}

CheckVerdict judgeCalibration(const CalibrationResult& stored, const std::vector<Observation>& views,
                              const CheckOptions& options) {
  const CheckModel model(stored, views, options);
  CheckVerdict verdict;
  std::string unseen, few;
  for (std::size_t c = 0; c < model.cameras(); ++c) {
    verdict.cameras.push_back({model.name(c), model.views(c), model.rmsPx(c)});
    if (model.views(c) < kLeastViews) (model.views(c) == 0 ? unseen : few) += " '" + model.name(c) + "'";
  }
  const bool none = std::all_of(verdict.cameras.begin(), verdict.cameras.end(),
                                [](const CameraCheck& camera) { return camera.views < kLeastViews; });
  if (none) {
    verdict.status = unseen.empty() ? CheckStatus::kTooFewViews : CheckStatus::kNotSeen;
    verdict.sentence = unseen.empty()
                           ? "Too few views to say anything: at least 3 of a camera are needed."
                           : "The board was not seen where it should be, by camera" + unseen +
                                 ". Is something in the way, or was the camera or the board moved far?";
    return verdict;
  }
  const std::vector<Hypothesis> parts = hypotheses(model);
  FreeParts free;
  CheckFit explained = model.fit(free);
  std::vector<std::pair<Hypothesis, std::size_t>> found;
  for (;;) {
    const Hypothesis* best = nullptr;
    double best_gain = 0.0, best_tail = 1.0;
    CheckFit best_fit;
    for (const Hypothesis& part : parts) {
      const bool free_already = std::any_of(found.begin(), found.end(), [&](const auto& one) {
        return one.first.part == part.part && one.first.camera == part.camera;
      });
      if (free_already) continue;
      CheckFit fit = model.fit(part.with(free));
      const double gain = explained.cost - fit.cost;
      // Of those that explain more than chance, the one that does best for its number of parameters (AIC).
      if (best != nullptr && gain - 2.0 * part.degrees <= best_gain - 2.0 * best->degrees) continue;
      best = &part;
      best_gain = gain;
      best_tail = chiSquareTail(gain, part.degrees);
      best_fit = std::move(fit);
    }
    if (best == nullptr || best_tail >= options.false_alarm / static_cast<double>(parts.size())) break;
    found.push_back({*best, verdict.findings.size()});
    free = best->with(free);
    explained = std::move(best_fit);
    verdict.findings.push_back(findingOf(*best, explained, model));
    verdict.findings.back().log_likelihood_ratio = 0.5 * best_gain;
  }
  // What was found later changes what was found first.
  for (const auto& [what, at] : found) {
    const double ratio = verdict.findings[at].log_likelihood_ratio;
    verdict.findings[at] = findingOf(what, explained, model);
    verdict.findings[at].log_likelihood_ratio = ratio;
  }
  for (const CheckFinding& finding : verdict.findings) {
    verdict.sentence += (verdict.sentence.empty() ? "" : " ") + finding.sentence;
  }
  if (!unseen.empty()) {
    verdict.status = CheckStatus::kNotSeen;
    verdict.sentence += (verdict.sentence.empty() ? "" : " ") +
                        ("The board was not seen where it should be, by camera" + unseen +
                         ", but by others: is something in the way, or was it moved far?");
  } else {
    verdict.status = verdict.findings.empty() ? CheckStatus::kOk : CheckStatus::kChanged;
    if (verdict.findings.empty()) verdict.sentence = "OK: nothing that these views could tell has changed.";
  }
  if (!few.empty())
    verdict.sentence += " Of camera" + few + " there are fewer than 3 views; they say little.";
  return verdict;
}

Repaired repaired(const CalibrationResult& stored, const CheckVerdict& verdict) {
  Repaired repaired{stored, verdict.status == CheckStatus::kOk || verdict.status == CheckStatus::kChanged};
  CalibrationResult& result = repaired.result;
  for (const CheckFinding& finding : verdict.findings) {
    if (finding.part == CheckPart::kIntrinsics) {
      repaired.whole = false;
      continue;
    }
    if (finding.part == CheckPart::kCamera) moveCamera(result, finding);
    if (finding.part == CheckPart::kMount) moveMount(result, finding);
    for (CameraResult& camera : result.cameras) {
      if (finding.part == CheckPart::kCamera && camera.camera != finding.camera) continue;
      camera.notes.push_back("put right from a few views: " + finding.sentence);
    }
  }
  return repaired;
}

std::vector<Pose<Color, Board>> checkViews(const CameraModel& camera, double near_distance_m) {
  struct View {
    double x, y;      // of the half image
    double distance;  // of the near one
    double roll_deg, pitch_deg, yaw_deg;
  };
  constexpr std::array<View, 12> kViews = {{{0.0, 0.0, 1.1, 0, 0, 0},
                                            {-0.45, -0.3, 1.5, 35, 20, 0},
                                            {0.45, 0.3, 1.5, -35, -20, 0},
                                            {0.3, -0.3, 1.15, -30, 0, 22},
                                            {-0.3, 0.3, 1.15, 30, 0, -22},
                                            {0.0, 0.0, 1.7, 0, 15, 15},
                                            {-0.4, 0.2, 1.4, -40, 15, 0},
                                            {0.4, -0.2, 1.4, 40, -15, 0},
                                            {0.0, 0.3, 1.3, 20, 25, 0},
                                            {0.0, -0.3, 1.3, -20, 0, 25},
                                            {0.3, 0.0, 1.2, 25, -20, 10},
                                            {-0.3, 0.0, 1.2, -25, 20, -10}}};
  std::vector<Pose<Color, Board>> views;
  for (const View& view : kViews) {
    const double z_m = view.distance * near_distance_m;
    const Vector3d centre(view.x * 0.5 * camera.width_px / camera.fx() * z_m,
                          view.y * 0.5 * camera.height_px / camera.fy() * z_m, z_m);
    const Eigen::Matrix3d rotation = (Eigen::AngleAxisd(view.pitch_deg * kDegree, Vector3d::UnitX()) *
                                      Eigen::AngleAxisd(view.yaw_deg * kDegree, Vector3d::UnitY()) *
                                      Eigen::AngleAxisd(view.roll_deg * kDegree, Vector3d::UnitZ()))
                                         .toRotationMatrix();
    views.emplace_back(rotation, centre);
  }
  return views;
}

int checkViewsOfEach(std::size_t cameras) { return cameras <= 1 ? 8 : cameras == 2 ? 6 : 3; }

}  // namespace servocal::procedure
