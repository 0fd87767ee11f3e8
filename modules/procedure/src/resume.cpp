// SPDX-License-Identifier: GPL-3.0-or-later
#include "resume.h"

#include <algorithm>
#include <cmath>

#include "servocal/calib/board_pose.h"
#include "servocal/core/error.h"
#include "servocal/procedure/check.h"

namespace servocal::procedure {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr int kViewsLookedAtAgain = 3;  // per camera
// Kinds of lines in the session's log that are read again.
constexpr const char *kOptions = "options", *kDevice = "device", *kTurnOver = "turn over",
                     *kTiltLimit = "tilt limit";

std::string optionsText(const CalibrateOptions& options) {
  std::string text = options.hand_eye_only ? "hand-eye only" : "everything";
  for (const std::string& camera : options.cameras) text += ", camera " + camera;
  for (const auto& [stream, model] : options.given_intrinsics) {
    text += ", intrinsics of " + stream.first + " " + toString(stream.second) + " given";
  }
  if (options.known) text += ", mount and tilt limits known";
  return text;
}

std::vector<std::string> deviceTexts(Run& run) {
  std::vector<std::string> texts = {"arm " + run.options().arm};
  for (Eye& eye : run.eyes()) {
    if (eye.stream() != Stream::kColor) continue;
    const sensor::CameraInfo& info = eye.device().info();
    texts.push_back("camera " + info.name + " " + info.model + " " + info.serial);
  }
  return texts;
}

void demandSame(Run& run, const std::vector<session::SessionEvent>& log) {
  std::set<std::string> devices;
  for (const session::SessionEvent& line : log) {
    if (line.kind == kDevice) devices.insert(line.message);
    if (line.kind == kOptions && line.message != optionsText(run.options())) {
      throw Error(ErrorKind::kRefusedToMove, "the session was begun with other options (" + line.message +
                                                 "); resume it with the same, or begin a new one");
    }
  }
  for (const std::string& device : deviceTexts(run)) {
    if (devices.empty() || devices.count(device) > 0) continue;
    std::string known;
    for (const std::string& other : devices) known += (known.empty() ? "" : ", ") + other;
    throw Error(ErrorKind::kRefusedToMove, "'" + device + "' is none of the session's devices (" + known +
                                               "); connect those, or begin a new session");
  }
}

std::vector<Eigen::Vector2d> pixelsOf(const BoardDetection& detection) {
  std::vector<Eigen::Vector2d> pixels;
  for (const Corner& corner : detection.corners) pixels.push_back(corner.pixel);
  return pixels;
}

template <class Use>
void forEachView(Run& run, const Use& use) {
  for (const Observation& observation : run.observations()) {
    for (const StreamObservation& view : observation.views) {
      Eye* const eye = run.find(view.camera, view.stream);
      if (eye != nullptr && observation.robot) use(observation, view, *eye);
    }
  }
}

void takeOverViews(Run& run) {
  forEachView(run, [](const Observation& observation, const StreamObservation& view, Eye& eye) {
    ++eye.views;
    eye.note(*observation.robot, view.detection);
    if (eye.hasDepth() && view.depth) eye.noteDepth("");
  });
  for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
    for (Eye& eye : run.eyes()) {
      if (eye.stream() == stream && eye.views > 0) run.updateBelief(eye);
    }
  }
  // An eye that stands behind the one that found the mount believes now.
  for (Eye& eye : run.eyes()) {
    if (eye.views > 0 && !eye.bMc() && run.eMo()) run.updateBelief(eye);
  }
  forEachView(run, [&](const Observation& observation, const StreamObservation& view, Eye& eye) {
    const auto expected = eye.predict(observation.robot->bMe, run.eMo());
    if (!expected) return;
    const auto seen = calib::refineBoardPose(run.cell().board, eye.model(), view.detection, *expected);
    eye.coverage.add(pixelsOf(view.detection), seen ? seen->cMo : *expected);
  });
}

/// "cam1 color roll+ 45 cap"; the camera's name may have spaces.
void takeOverTiltLimit(Run& run, const std::string& message) {
  std::vector<std::string> words;
  std::string rest = message;
  for (int i = 0; i < 4; ++i) {
    const std::size_t space = rest.rfind(' ');
    if (space == std::string::npos) return;
    words.push_back(rest.substr(space + 1));
    rest.resize(space);
  }
  const Stream stream = words[3] == toString(Stream::kInfrared) ? Stream::kInfrared : Stream::kColor;
  Eye* const eye = run.find(rest, stream);
  if (eye != nullptr) {
    eye->tilt_limits.push_back(
        {words[2], std::strtod(words[1].c_str(), nullptr) * kDegree, words[0], stream});
  }
}

/// Stored flange poses at which an eye saw the board: the one nearest to its image centre, then always the
/// one that turns the flange farthest from those chosen.
std::vector<Pose<Base, EndEffector>> posesToLookFrom(Run& run, const Eye& eye) {
  std::vector<Pose<Base, EndEffector>> all, chosen = {eye.sighting->robot.bMe};
  forEachView(run, [&](const Observation& observation, const StreamObservation&, Eye& other) {
    if (&other == &eye) all.push_back(observation.robot->bMe);
  });
  const auto isolation = [&](const Pose<Base, EndEffector>& pose) {
    double nearest = M_PI;
    for (const auto& other : chosen) nearest = std::min(nearest, angleRad(pose, other));
    return nearest;
  };
  while (chosen.size() < 3 * kViewsLookedAtAgain && chosen.size() < all.size()) {
    chosen.push_back(*std::max_element(
        all.begin(), all.end(), [&](const auto& a, const auto& b) { return isolation(a) < isolation(b); }));
  }
  return chosen;
}

void demandUnmoved(Run& run) {
  SolveOptions options;
  options.robot_sigma_m = run.cell().arm.accuracy_m;
  options.robot_sigma_rad = run.cell().arm.accuracy_rad;
  options.given_intrinsics = run.options().given_intrinsics;
  const CalibrationResult stored = solve(run.cell().board, run.observations(), options);
  const std::size_t before = run.observations().size();
  for (const CameraResult& camera : stored.cameras) {
    Eye* const eye = run.find(camera.camera, Stream::kColor);
    if (eye == nullptr || !eye->sighting || !camera.hand_eye) continue;
    int taken = 0;
    for (const Pose<Base, EndEffector>& bMe : posesToLookFrom(run, *eye)) {
      if (taken == kViewsLookedAtAgain) break;
      if (run.travelTo(bMe)) continue;
      if (run.observe("resume", *eye)) ++taken;
      run.report("resume", *eye, taken, kViewsLookedAtAgain);
    }
  }
  CheckOptions check_options;
  check_options.robot_sigma_m = options.robot_sigma_m;
  check_options.robot_sigma_rad = options.robot_sigma_rad;
  const std::vector<Observation> now(run.observations().begin() + static_cast<std::ptrdiff_t>(before),
                                     run.observations().end());
  const CheckVerdict verdict = judgeCalibration(stored, now, check_options);
  run.log("resume", verdict.sentence);
  if (verdict.status == CheckStatus::kOk || verdict.status == CheckStatus::kTooFewViews) return;
  run.guard().stopAndWait();
  throw Error(ErrorKind::kBadData,
              "the session cannot be resumed, something moved since it was interrupted. " + verdict.sentence +
                  " Begin a new session.");
}

}  // namespace

std::set<std::string> takeOver(Run& run, const session::Session& session) {
  const std::vector<session::SessionEvent> log = session.events();
  demandSame(run, log);
  std::vector<Observation> observations = session.observations();
  if (std::none_of(log.begin(), log.end(), [](const auto& line) { return line.kind == kOptions; })) {
    run.log(kOptions, optionsText(run.options()));
    for (const std::string& device : deviceTexts(run)) run.log(kDevice, device);
  }
  std::set<std::string> over;
  if (observations.empty()) return over;
  run.takeOver(std::move(observations));
  takeOverViews(run);
  for (const session::SessionEvent& line : log) {
    if (line.kind == kTurnOver) over.insert(line.message);
    if (line.kind == kTiltLimit) takeOverTiltLimit(run, line.message);
  }
  const bool anything_to_compare = std::any_of(run.eyes().begin(), run.eyes().end(),
                                               [](const Eye& eye) { return eye.handEye().has_value(); });
  if (anything_to_compare) demandUnmoved(run);
  return over;
}

void noteTurnOver(Run& run, const Eye& color) { run.log(kTurnOver, color.camera()); }

void noteTiltLimit(Run& run, const Eye& eye, const TiltLimit& limit) {
  run.log(kTiltLimit, eye.name() + " " + limit.direction + " " +
                          std::to_string(std::lround(limit.limit_rad / kDegree)) + " " + limit.ended_by);
}

bool hasTiltLimit(const Eye& eye, const std::string& direction) {
  return std::any_of(eye.tilt_limits.begin(), eye.tilt_limits.end(),
                     [&](const TiltLimit& limit) { return limit.direction == direction; });
}

int viewsTaken(const Run& run, const std::string& stage, const std::string& camera) {
  return static_cast<int>(std::count_if(run.observations().begin(), run.observations().end(),
                                        [&](const Observation& observation) {
                                          return observation.stage == stage && !observation.views.empty() &&
                                                 observation.views.front().camera == camera;
                                        }));
}

int viewsBesides(const Run& run, const std::string& stage, const Eye& eye) {
  int taken = 0;
  for (const Observation& observation : run.observations()) {
    if (observation.stage != stage || observation.views.empty()) continue;
    taken += static_cast<int>(std::count_if(observation.views.begin() + 1, observation.views.end(), [&](const StreamObservation& view) {
      return view.camera == eye.camera() && view.stream == eye.stream();
    }));
  }
  return taken;
}

int viewsTaken(const Run& run, const std::string& stage, const Eye& eye, coverage::Coverage& coverage) {
  int taken = 0;
  for (const Observation& observation : run.observations()) {
    if (observation.stage != stage || observation.views.empty() || !observation.robot) continue;
    const StreamObservation& view = observation.views.front();  // The one it was taken for.
    if (view.camera != eye.camera() || view.stream != eye.stream()) continue;
    ++taken;
    if (const auto cMo = eye.predict(observation.robot->bMe, run.eMo()))
      coverage.add(pixelsOf(view.detection), *cMo);
  }
  return taken;
}

}  // namespace servocal::procedure
