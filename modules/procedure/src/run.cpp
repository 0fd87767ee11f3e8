// SPDX-License-Identifier: GPL-3.0-or-later
#include "run.h"

#include <cmath>
#include <map>

#include "servocal/calib/intrinsics.h"
#include "servocal/core/error.h"

namespace servocal::procedure {
namespace {

constexpr int kFramesPerStop = 3;
constexpr int kMinFramesPerStop = 2;
constexpr int kFramesTried = 6;
constexpr double kStillM = 0.0005;      // the arm may drift this much while a stop's frames are taken
constexpr double kStillRad = 0.001;
constexpr std::size_t kMinViewsForIntrinsics = 5;
constexpr double kDriveMarginPx = 8.0;  // between the squares and the image border on the way

/// Mean of several detections of the same board, of the corners that most of them hold; the noise of a
/// corner is only partly independent from frame to frame (the pattern sits on the same pixels), so its
/// covariance is not divided by the count.
BoardDetection average(const std::vector<BoardDetection>& detections) {
  std::map<int, std::vector<const Corner*>> by_id;
  for (const BoardDetection& detection : detections) {
    for (const Corner& corner : detection.corners) by_id[corner.id].push_back(&corner);
  }
  BoardDetection mean;
  mean.orientation_known = true;
  for (const auto& [id, seen] : by_id) {
    if (2 * seen.size() <= detections.size()) continue;
    Corner corner{id, Eigen::Vector2d::Zero(), Eigen::Matrix2d::Zero()};
    for (const Corner* one : seen) {
      corner.pixel += one->pixel;
      corner.covariance_px2 += one->covariance_px2;
    }
    const auto count = static_cast<double>(seen.size());
    corner.pixel /= count;
    corner.covariance_px2 /= count * std::sqrt(count);
    mean.corners.push_back(corner);
  }
  return mean;
}

}  // namespace

Run::Run(const CellConfig& cell, const Devices& devices, session::Session& session, const EventSink& on_event)
    : cell_(cell), devices_(devices), session_(session), on_event_(on_event),
      observer_(cell.board, *devices.cameras.front(), nominalModel(cell.cameras.front(), Stream::kColor)) {
  observer_.setPrediction([this](Instant stamp) -> std::optional<Pose<Color, Board>> {
    if (!hand_eye_) return std::nullopt;
    return bMc().inverse() * guard().stateAt(stamp).bMe * eMo();
  });
}

std::optional<Observation> Run::observe(const std::string& stage) {
  throwIfStopped();
  guard().stopAndWait();
  const double rate_hz = devices_.cameras.front()->info().streams.front().rate_hz;
  // An exposure lasts a frame period at most, so these frames began after the arm came to rest.
  const Instant first_stamp = clock().now() + fromSeconds(0.5 / rate_hz);

  std::vector<BoardDetection> detections;
  std::optional<sensor::Frame> first_frame;
  Instant last_stamp{};
  for (int tried = 0; tried < kFramesTried && detections.size() < kFramesPerStop;) {
    auto seen = observer_.see(clock().now() + std::chrono::milliseconds(300));
    if (!seen) break;
    if (seen->frame.stamp < first_stamp) continue;
    ++tried;
    const bool usable = seen->detection && observer_.isUsable(*seen->detection);
    if (!usable && tried - static_cast<int>(detections.size()) > kFramesTried - kMinFramesPerStop) break;
    if (!usable) continue;
    detections.push_back(*seen->detection);
    last_stamp = seen->frame.stamp;
    if (!first_frame) first_frame = std::move(seen->frame);
  }
  if (static_cast<int>(detections.size()) < kMinFramesPerStop) return std::nullopt;

  const RobotState state = guard().stateAt(first_frame->stamp);
  const RobotState after = guard().stateAt(last_stamp);
  if (distanceM(state.bMe, after.bMe) > kStillM || angleRad(state.bMe, after.bMe) > kStillRad) {
    return std::nullopt;
  }

  Observation observation;
  observation.stage = stage;
  observation.robot = state;
  StreamObservation view;
  view.camera = camera();
  view.stream = Stream::kColor;
  view.stamp = first_frame->stamp;
  view.device_stamp_s = first_frame->device_stamp_s;
  view.width_px = first_frame->image.cols;
  view.height_px = first_frame->image.rows;
  view.detection = average(detections);
  observation.views.push_back(std::move(view));
  observation = session_.add(std::move(observation), {first_frame->image});
  observations_.push_back(observation);
  return observation;
}

Run::Visit Run::visit(const std::string& stage, const Pose<Color, Board>& cdMo, servo::DriveOptions options) {
  throwIfStopped();
  options.keep_visible_o = cell_.board.patternOutline();
  options.image_margin_px = kDriveMarginPx;
  servo::CellEstimate estimate;
  estimate.camera = observer_.model();
  estimate.eMo = eMo();
  estimate.bMc = bMc();
  Attempt attempt;
  attempt.stage = stage;
  attempt.camera = camera();
  attempt.cdMo = cdMo;
  attempt.start = clock().now();
  Visit visit;
  visit.drive = servo::drive(guard(), clock(), observer_, cell_.board.corners(), cdMo, estimate, options);
  const bool arrived = visit.drive.status == DriveStatus::kReached || visit.drive.status == DriveStatus::kPlateau;
  if (arrived) visit.observation = observe(stage);
  attempt.end = clock().now();
  attempt.status = visit.drive.status;
  attempt.reason = visit.drive.reason;
  if (visit.observation) attempt.observation_id = visit.observation->id;
  session_.add(attempt);
  throwIfStopped();
  return visit;
}

void Run::moveTo(const Pose<Base, EndEffector>& bMe) {
  throwIfStopped();
  const servo::DriveOutcome outcome = servo::moveTo(guard(), clock(), bMe);
  throwIfStopped();
  if (outcome.status != DriveStatus::kReached) throw Error(ErrorKind::kSafetyStop, outcome.reason);
}

void Run::report(const std::string& stage, int done, int planned, const std::string& message) {
  Event event;
  event.stamp = clock().now();
  event.stage = stage;
  event.done = done;
  event.planned = planned;
  event.eta_s = eta_s_;
  if (hand_eye_) {
    event.rms_px = hand_eye_->rms_px;
    event.scatter_m = hand_eye_->scatter_m;
  }
  event.message = message;
  if (!message.empty()) session_.event(event.stamp, stage, message);
  if (on_event_) on_event_(event);
}

bool Run::updateBelief() {
  if (observations_.size() >= kMinViewsForIntrinsics) {
    calib::IntrinsicsOptions options;
    options.prior = calib::nominalPrior(nominalModel(cell_.cameras.front(), Stream::kColor));
    const auto intrinsics =
        calib::solveIntrinsics(cell_.board, observations_, camera(), Stream::kColor, options);
    if (intrinsics.result) observer_.setModel(intrinsics.result->camera);
  }
  calib::ReprojectionOptions options;
  options.robot_sigma_m = cell_.arm.accuracy_m;
  options.robot_sigma_rad = cell_.arm.accuracy_rad;
  options.start = hand_eye_;
  auto outcome = calib::solveHandEyeReprojection(cell_.board, observer_.model(), observations_, camera(),
                                                 Stream::kColor, options);
  if (!outcome.solution) {
    why_ = calib::toString(outcome.status);
    return false;
  }
  hand_eye_ = std::move(outcome.solution);
  guard().setBoard(eMo());
  return true;
}

void Run::throwIfStopped() const {
  if (devices_.guard.operatorStopped()) {
    throw Error(ErrorKind::kInterrupted, "Stopped by the operator. The arm stands still; what was observed is in " +
                                             session_.folder().string() + ".");
  }
}

}  // namespace servocal::procedure
