// SPDX-License-Identifier: GPL-3.0-or-later
#include "run.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "log.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/core/error.h"
#include "servocal/robot/path_planner.h"
#include "servocal/servo/follow_path.h"
#include "stop.h"

namespace servocal::procedure {
namespace {

constexpr double kStillM = 0.0005;  // the arm may drift this much while a stop's frames are taken
constexpr double kStillRad = 0.001;
constexpr double kCameraRadiusM = 0.2;  // kept clear around a camera
constexpr double kBoardRadiusM = 0.13;  // and around a board that stands in the cell
constexpr int kMinViewsForIntrinsics = 5;
constexpr double kDriveMarginOfHeight = 0.0075;  // between the squares and the image border on the way: 8 px of 1080
constexpr double kMovingMps = 0.03;
constexpr std::ptrdiff_t kPathStates = 20000;
constexpr Duration kLookOnPeriod = std::chrono::milliseconds(330);

/// Lets the eyes that are not asked look too, while the arm moves.
class LookingOn final : public servo::Observer {
 public:
  LookingOn(Run& run, Eye& eye) : run_(run), eye_(eye) {}
  servo::Look look(Instant deadline) override {
    servo::Look look = eye_.observer().look(deadline);
    run_.noteMotion(eye_, look);
    run_.lookOn();
    return look;
  }

 private:
  Run& run_;
  Eye& eye_;
};

bool isWanted(const CalibrateOptions& options, const std::string& camera) {
  return options.cameras.empty() ||
         std::find(options.cameras.begin(), options.cameras.end(), camera) != options.cameras.end();
}

}  // namespace

Run::Run(const CellConfig& cell, const Devices& devices, session::Session& session, const EventSink& on_event,
         const CalibrateOptions& options, const LookSink& on_look)
    : cell_(cell), devices_(devices), session_(session), on_event_(on_event), options_(options), on_look_(on_look) {
  for (std::size_t i = 0; i < cell.cameras.size(); ++i) {
    const CameraConfig& camera = cell.cameras[i];
    if (camera.mount != mount()) {
      throw Error(ErrorKind::kInvalidConfig, "cameras '" + cell.cameras.front().name + "' and '" + camera.name +
                                                 "' are one in the cell and one on the flange; the board can only be "
                                                 "on the other: calibrate them in two runs (--camera does not help)");
    }
    if (!isWanted(options, camera.name)) continue;
    sensor::StampClockOptions stamps;
    stamps.nominal_latency = fromSeconds(camera.latency_s);
    sensor::GatedCamera& device =
        cameras_.emplace_back(*devices.cameras[i], devices.clock, sensor::FrameGateOptions{}, stamps);
    eyes_.emplace_back(cell, camera, device, Stream::kColor);
    // The few views of a hand-eye determine neither the infrared camera's place nor the depth.
    if (camera.infrared && !options.hand_eye_only) eyes_.emplace_back(cell, camera, device, Stream::kInfrared);
  }
  for (Eye& eye : eyes_) {
    if (const auto given = options.given_intrinsics.find({eye.camera(), eye.stream()});
        given != options.given_intrinsics.end()) {
      eye.observer().setModel(given->second);
    }
    eye.observer().setPrediction(
        [this, &eye](Instant stamp) { return eye.predict(guard().stateAt(stamp).bMe, eMo_); });
    if (on_look_) eye.observer().setWatcher([this, &eye](const SeenFrame& seen) { show(eye, seen); });
  }
}

Eye* Run::find(const std::string& camera, Stream stream) {
  for (Eye& eye : eyes_) {
    if (eye.camera() == camera && eye.stream() == stream) return &eye;
  }
  return nullptr;
}

std::vector<Eye*> Run::lookersBeside(Eye& wanted, bool excluded_streams) {
  const auto bMe = guard().state().bMe;
  std::vector<Eye*> lookers;
  for (Eye& eye : eyes_) {
    if (&eye == &wanted || !eye.mightSee(bMe, eMo_)) continue;
    const bool same_camera = eye.camera() == wanted.camera();
    // A camera whose streams exclude each other shows its infrared only in its own turn: switching takes time.
    const bool excluded = eye.excludesOthers() && (same_camera || eye.stream() == Stream::kInfrared);
    if (excluded ? excluded_streams && same_camera : !excluded_streams) lookers.push_back(&eye);
  }
  return lookers;
}

std::optional<Observation> Run::observe(const std::string& stage, Eye& wanted) {
  throwIfStopped();
  guard().stopAndWait();
  const Instant rest = clock().now();
  std::vector<Eye*> lookers = lookersBeside(wanted, false);
  lookers.insert(lookers.begin(), &wanted);
  std::vector<StopView> stop = gatherStop(clock(), lookers, rest, true);
  if (stop.empty()) return std::nullopt;
  for (StopView& view : gatherStop(clock(), lookersBeside(wanted, true), rest, false)) stop.push_back(std::move(view));

  const RobotState state = guard().stateAt(stop.front().first_frame->stamp);
  const RobotState after = guard().stateAt(stop.back().last_stamp);
  if (distanceM(state.bMe, after.bMe) > kStillM || angleRad(state.bMe, after.bMe) > kStillRad) return std::nullopt;
  if (!isStill(stop.front())) return std::nullopt;
  stop.erase(std::remove_if(stop.begin() + 1, stop.end(), [](const StopView& view) { return !isStill(view); }),
             stop.end());

  Observation observation;
  observation.stage = stage;
  observation.robot = state;
  std::vector<session::ViewImages> images;
  for (const StopView& view : stop) {
    observation.views.push_back(toObservation(view, cell_.board));
    images.emplace_back(view.first_frame->image, view.depth.empty() ? cv::Mat() : view.depth.front().image);
  }
  observation = session_.add(std::move(observation), images);
  observations_.push_back(observation);
  for (Eye* eye : lookers) {
    if (eye == &wanted || !eye->handEye() || !eye->shouldSee(state.bMe, eMo_)) continue;
    const bool detected = std::any_of(stop.begin(), stop.end(), [&](const StopView& view) { return view.eye == eye; });
    eye->trials.push_back({*eye->predict(state.bMe, eMo(*eye)), detected});
  }
  for (std::size_t i = 0; i < stop.size(); ++i) {
    Eye& eye = *stop[i].eye;
    eye.note(state, observation.views[i].detection);
    eye.count(observation.views[i]);
    if (!eye.bMc() && eMo_) believeFromMount(eye);
  }
  return observation;
}

Run::Visit Run::visit(const std::string& stage, Eye& eye, const Pose<Color, Board>& cdMo, servo::DriveOptions options) {
  throwIfStopped();
  options.keep_visible_o = cell_.board.patternOutline();
  options.image_margin_px = kDriveMarginOfHeight * eye.model().height_px;
  servo::CellEstimate estimate;
  estimate.camera = eye.model();
  estimate.mount = mount();
  if (mount() == Mount::kFixed) {
    estimate.eMo = eMo(eye);
    estimate.bMc = *eye.bMc();
  } else {
    estimate.eMc = relabel<EndEffector, Color>(*eye.bMc());
    estimate.bMo = relabel<Base, Board>(eMo(eye));
  }
  Attempt attempt;
  attempt.stage = stage;
  attempt.camera = eye.camera();
  attempt.cdMo = cdMo;
  attempt.start = clock().now();
  LookingOn observer(*this, eye);
  Visit visit;
  goal_ = Goal{&eye, cdMo};
  visit.drive = servo::drive(guard(), clock(), observer, cell_.board.corners(), cdMo, estimate, options);
  eye.compareClocks(path_, eMo(eye));
  eye.lost = visit.drive.status == DriveStatus::kTargetLost;
  const bool arrived = visit.drive.status == DriveStatus::kReached || visit.drive.status == DriveStatus::kPlateau;
  if (arrived) visit.observation = observe(stage, eye);
  if (arrived || visit.drive.status == DriveStatus::kTargetLost) eye.trials.push_back({cdMo, visit.observation.has_value()});
  goal_.reset();
  attempt.end = clock().now();
  attempt.status = visit.drive.status;
  attempt.reason = visit.drive.reason;
  if (visit.observation) attempt.observation_id = visit.observation->id;
  session_.add(attempt);
  throwIfStopped();
  return visit;
}

std::optional<std::string> Run::moveTo(const Pose<Base, EndEffector>& bMe) {
  throwIfStopped();
  const servo::DriveOutcome outcome = servo::moveTo(guard(), clock(), bMe);
  throwIfStopped();
  if (outcome.status != DriveStatus::kReached) return outcome.reason;
  return std::nullopt;
}

std::optional<std::string> Run::travelTo(const Pose<Base, EndEffector>& bMe) {
  throwIfStopped();
  const robot::Plan plan = robot::planTo(guard(), guard().state().q, bMe);
  if (plan.path.empty()) return plan.reason;
  const servo::DriveOutcome outcome = servo::followPath(guard(), clock(), plan.path);
  throwIfStopped();
  if (outcome.status != DriveStatus::kReached) return outcome.reason;
  return std::nullopt;
}

void Run::backInSight(Eye& eye) {
  if (eye.lost && eye.sighting && !travelTo(eye.sighting->robot.bMe)) eye.lost = false;
}

void Run::noteMotion(Eye& eye, const servo::Look& look) {
  RobotState state = guard().state();
  state.bMe = forMount(mount(), state.bMe);
  const bool is_new = path_.empty() || state.stamp > path_.back().stamp;
  if (is_new && eMo_ && !path_.empty()) {
    // The board's centre must move, not just turn: that is what is compared.
    const Eigen::Vector3d moved = state.bMe * eMo_->translation() - path_.back().bMe * eMo_->translation();
    board_speed_mps_ = moved.norm() / toSeconds(state.stamp - path_.back().stamp);
  }
  if (is_new) path_.push_back(state);
  if (static_cast<std::ptrdiff_t>(path_.size()) > kPathStates) path_.erase(path_.begin(), path_.begin() + kPathStates / 2);
  if (look.sight && board_speed_mps_ > kMovingMps) eye.noteMotion({look.sight->stamp, look.sight->cMo});
}

void Run::lookOn() {
  if (clock().now() < last_look_on_ + kLookOnPeriod) return;
  last_look_on_ = clock().now();
  for (Eye& eye : eyes_) {
    // Infrared follows from its camera's color stream.
    if (eye.bMc() || eye.stream() != Stream::kColor) continue;
    const auto seen = eye.observer().see(clock().now());
    if (!seen || !seen->detection || !eye.observer().isUsable(*seen->detection)) continue;
    eye.note(guard().stateAt(seen->frame.stamp), *seen->detection);
  }
}

void Run::report(const std::string& stage, const Eye& eye, int done, int planned, const std::string& message) {
  Event event;
  event.stamp = clock().now();
  event.stage = stage;
  event.camera = eye.name();
  event.done = done;
  event.planned = planned;
  event.eta_s = eta_s_;
  if (const auto& hand_eye = eye.handEye()) {
    event.rms_px = hand_eye->rms_px;
    event.scatter_m = hand_eye->scatter_m;
  }
  event.message = message;
  event.eyes = progress();
  if (std::string now = stage + ": " + eye.name(); now != stage_) {
    stage_ = std::move(now);
    log(kStage, stage_);
  }
  if (!message.empty()) session_.event(event.stamp, stage, eye.name() + ": " + message);
  if (on_event_) on_event_(event);
}

Pose<EndEffector, Board> Run::eMo(const Eye& eye) const {
  if (eye.handEye()) return Pose<EndEffector, Board>(eye.handEye()->board_pose);
  return *eMo_;
}

std::optional<std::string> Run::updateBelief(Eye& eye) {
  const bool given = options_.given_intrinsics.count({eye.camera(), eye.stream()}) > 0;
  if (!given && eye.views >= kMinViewsForIntrinsics) {
    calib::IntrinsicsOptions options;
    options.prior = calib::nominalPrior(eye.nominal());
    const auto intrinsics = calib::solveIntrinsics(cell_.board, observations_, eye.camera(), eye.stream(), options);
    if (intrinsics.result) eye.observer().setModel(intrinsics.result->camera);
  }
  calib::ReprojectionOptions options;
  options.mount = mount();
  options.robot_sigma_m = cell_.arm.accuracy_m;
  options.robot_sigma_rad = cell_.arm.accuracy_rad;
  options.start = eye.handEye();
  auto outcome = calib::solveHandEyeReprojection(cell_.board, eye.model(), observations_, eye.camera(), eye.stream(),
                                                 options);
  if (!outcome.solution) {
    if (!eMo_) return std::string(calib::toString(outcome.status));
    believeFromMount(eye);
    if (!eye.bMc()) return std::string(calib::toString(outcome.status));
    return std::nullopt;
  }
  believe(eye, *std::move(outcome.solution));
  return std::nullopt;
}

void Run::believeMount(const HandEyeSolution& solution) {
  if (eMo_) return;
  eMo_ = Pose<EndEffector, Board>(solution.board_pose);
  eMo_sigma_m_ = std::numeric_limits<double>::infinity();  // Any eye's own finding replaces it.
  keepClearOfWhatIsKnown();
}

void Run::believe(Eye& eye, HandEyeSolution solution) {
  const double sigma_m = solution.board_sigma.head<3>().norm();
  if (!eMo_ || sigma_m < eMo_sigma_m_) {
    eMo_ = Pose<EndEffector, Board>(solution.board_pose);
    eMo_sigma_m_ = sigma_m;
  }
  eye.believe(std::move(solution));
  keepClearOfWhatIsKnown();
}

void Run::keepClearOfWhatIsKnown() {
  if (mount() == Mount::kFlange) {
    // The guard goes on keeping a ball around the flange clear, where the cameras are.
    guard().setObstacles({{"board", eMo_->translation(), kBoardRadiusM}});
    return;
  }
  guard().setBoard(eMo_);
  std::vector<robot::Sphere> cameras;
  for (const Eye& eye : eyes_) {
    if (eye.stream() == Stream::kColor && eye.handEye()) cameras.push_back({eye.camera(), eye.bMc()->translation(), kCameraRadiusM});
  }
  guard().setObstacles(cameras);
}

void Run::believeFromMount(Eye& eye) {
  // The last view decides: nearer to the present intrinsics than a mean over all.
  for (auto observation = observations_.rbegin(); observation != observations_.rend(); ++observation) {
    for (const StreamObservation& view : observation->views) {
      if (view.camera != eye.camera() || view.stream != eye.stream()) continue;
      const auto poses = calib::boardPoses(cell_.board, eye.model(), view.detection);
      if (poses.empty()) continue;
      const auto bMcBy = [&](const calib::BoardPose& pose) {
        return forMount(mount(), observation->robot->bMe) * *eMo_ * pose.cMo.inverse();
      };
      Pose<Base, Color> bMc = bMcBy(poses.front());
      // Of the two poses that a plane has, the one that turns the camera's streams least against each other.
      const Eye* color = find(eye.camera(), Stream::kColor);
      if (poses.size() > 1 && color != &eye && color->bMc()) {
        const Pose<Base, Color> other = bMcBy(poses[1]);
        if (angleRad(other, *color->bMc()) < angleRad(bMc, *color->bMc())) bMc = other;
      }
      eye.believe(bMc);
      return;
    }
  }
}

void Run::throwIfStopped() const {
  if (devices_.guard.operatorStopped()) {
    throw Error(ErrorKind::kInterrupted, "Stopped by the operator. The arm stands still; what was observed is in " +
                                             session_.folder().string() + ".");
  }
}

}  // namespace servocal::procedure
