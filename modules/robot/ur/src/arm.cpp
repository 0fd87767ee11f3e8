// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot_ur/arm.h"

#include <chrono>
#include <random>
#include <stdexcept>
#include <utility>

#include "dashboard.h"
#include "link.h"
#include "script.h"

namespace servocal::robot::ur {
namespace {

constexpr Duration kPatience =
    std::chrono::seconds(5);  // Until the program runs; the controller compiles it.
constexpr Duration kStandsWithin = std::chrono::seconds(1);
constexpr Duration kLook = std::chrono::milliseconds(2);
constexpr double kStandsMps = 0.001;
constexpr double kStandsRadps = 0.003;

// Different in every upload and session, so that what an earlier one left in a register never matches.
int drawNumber() { return static_cast<int>(std::random_device()() >> 3) + 1; }

const UrConfig& required(const ArmConfig& config, const ArmOptions& options) {
  if (!config.ur) throw std::invalid_argument("ur::Arm: the cell's arm is not of the backend 'ur'");
  if (options.watchdog < std::chrono::milliseconds(20) || options.watchdog > std::chrono::seconds(1))
    throw std::invalid_argument("ur::Arm: the watchdog must be 20 ms to 1 s");
  if (options.dead_peer <= Duration::zero() || options.reply_timeout <= Duration::zero())
    throw std::invalid_argument("ur::Arm: dead_peer and reply_timeout must be positive");
  if (options.rate_hz < 0.0 || options.rate_hz > 500.0)
    throw std::invalid_argument("ur::Arm: rate_hz must be 1 to 500, or 0");
  return *config.ur;
}

}  // namespace

struct Arm::Impl {
  UrConfig config;
  MotionLimits limits;
  Clock& clock;
  ArmOptions options;
  ControllerFacts facts;
  ArmInfo info;
  std::unique_ptr<Link> link;

  Impl(const UrConfig& ur, const MotionLimits& motion_limits, Clock& run_clock, const ArmOptions& arm_options)
      : config(ur), limits(motion_limits), clock(run_clock), options(arm_options) {
    RtdeClient client(config.host, config.rtde_port, options.reply_timeout);
    askDashboard(client.version());
    client.start(options.rate_hz);
    ControllerState first = client.receive().back();
    facts.rate_hz = client.rateHz();
    facts.eMtcp = Pose<EndEffector, Tcp>(fromVector(first.tcp_offset));
    facts.payload_kg = first.payload_kg;
    info = {facts.model, facts.serial, 6, facts.rate_hz};
    link = std::make_unique<Link>(std::move(client), clock, options, first);
  }

  void askDashboard(const ControllerVersion& version) {
    Dashboard dashboard(config.host, config.dashboard_port, options.reply_timeout);
    facts.address = config.host + ":" + std::to_string(config.rtde_port);
    facts.polyscope = version.toString();
    facts.model = dashboard.model();
    facts.serial = dashboard.serialNumber();
    if (facts.serial != config.serial) {
      throw Error(ErrorKind::kRefusedToMove, "The arm at " + config.host + " has the serial number " +
                                                 facts.serial + ", the cell file names " + config.serial +
                                                 ": this is another robot. Check 'host' and 'serial'.");
    }
    if (version.eSeries() && !dashboard.inRemoteControl()) {
      throw Error(
          ErrorKind::kRefusedToMove,
          "The controller is in local control and takes no program from the network. Switch it to remote "
          "control at the pendant, then start again.");
    }
  }

  template <class Condition>
  bool waitFor(Duration patience, const Condition& condition) const {
    const Instant give_up = clock.now() + patience;
    while (!condition()) {
      if (clock.now() > give_up) return false;
      clock.sleepFor(kLook);
    }
    return true;
  }

  void upload() {
    ScriptOptions script;
    script.limits = limits;
    script.tcp_lever_m = facts.eMtcp.translation().norm();
    script.watchdog = options.watchdog;
    script.rate_hz = facts.rate_hz;
    script.token = drawNumber();
    Socket primary(config.host, config.program_port, "robot's program port", options.reply_timeout);
    primary.send(ByteWriter().text(servoScript(script)).bytes(), options.reply_timeout);
    link->watchProgram(std::move(primary));

    std::optional<ProgramMessage> exception;
    const bool decided = waitFor(kPatience, [&] {
      exception = link->takeException();
      const ControllerState state = link->newest();
      return exception || link->stopped() || (state.programRuns() && state.script_token == script.token);
    });
    if (const auto stop = link->stopped()) throw *stop;
    if (exception || !decided) {
      throw Error(ErrorKind::kHardwareAbsent,
                  exception
                      ? "The controller refused our program at " + exception->toString() +
                            ". Please report this with its PolyScope version, " + facts.polyscope + "."
                      : "The controller did not start our program within 5 s. See the log at the pendant; on "
                        "an e-Series check that it is in remote control.");
    }
    Expected expected = link->expected();
    expected.token = script.token;
    link->expect(expected);
  }

  void arm() {
    link->forgetStop();
    if (const auto stop = link->stopped()) throw *stop;
    if (const auto reason = objection(link->newest(), link->expected(), 0.0)) {
      throw Error(ErrorKind::kRefusedToMove, *reason);
    }
    upload();
    Expected expected = link->expected();
    expected.epoch = drawNumber();
    // The epoch goes out first; that the program took it is demanded afterwards.
    link->announce(expected.epoch);
    const bool taken = waitFor(kPatience, [&] {
      const ControllerState newest = link->newest();
      return link->stopped() || (newest.script_state == 2 && newest.script_epoch == expected.epoch);
    });
    if (const auto stop = link->stopped()) throw *stop;
    if (!taken) {
      throw Error(
          ErrorKind::kHardwareAbsent,
          "Our program runs on the controller but did not answer. Stop it at the pendant, then start again.");
    }
    link->expect(expected);
  }

  void move(ScriptMode mode, const Vector6d& velocity, Duration valid_for) {
    if (const auto stop = link->stopped()) throw *stop;
    if (link->expected().epoch == 0) {
      throw Error(ErrorKind::kRefusedToMove,
                  "The arm is not armed: nobody gave consent to move the robot " + facts.serial + ".");
    }
    link->command({mode, velocity, clock.now() + valid_for});
  }

  bool stands() const {
    const Vector6d speed = link->newest().actual_tcp_speed;
    return speed.head<3>().norm() < kStandsMps && speed.tail<3>().norm() < kStandsRadps;
  }
};

Arm::Arm(const ArmConfig& config, const MotionLimits& limits, Clock& clock, const ArmOptions& options)
    : impl_(std::make_unique<Impl>(required(config, options), limits, clock, options)) {}

Arm::~Arm() {
  // Heartbeats go on until the arm stands, else the watchdog would end its braking.
  Link& link = *impl_->link;
  if (link.expected().token == 0 || link.stopped()) return;
  link.command({});
  impl_->waitFor(kStandsWithin, [&] { return link.stopped() || impl_->stands(); });
  link.command({ScriptMode::kEnd, Vector6d::Zero(), {}});
  impl_->waitFor(kStandsWithin, [&] { return link.stopped() || !link.newest().programRuns(); });
}

const ControllerFacts& Arm::facts() const { return impl_->facts; }
LinkReport Arm::report() const { return impl_->link->report(); }
const ArmInfo& Arm::info() const { return impl_->info; }
RobotState Arm::state() { return impl_->link->state(); }
RobotState Arm::stateAt(Instant stamp) { return impl_->link->stateAt(stamp); }
bool Arm::armed() const { return impl_->link->expected().epoch != 0 && !impl_->link->stopped(); }

void Arm::arm(const std::string& consent) {
  if (consent != impl_->facts.serial) {
    throw Error(ErrorKind::kRefusedToMove,
                "No consent: '" + consent + "' is not the serial number of the robot. Nothing was moved.");
  }
  impl_->arm();
}

void Arm::move(MotionKey, const Twist<Base>& twist, Duration valid_for) {
  if (!twist.isFinite()) throw std::invalid_argument("ur::Arm::move: the twist is not finite");
  // The controller moves its TCP; the flange is rigidly attached to it.
  const Eigen::Matrix3d bRe = impl_->link->state().bMe.rotation();
  const Eigen::Vector3d to_tcp = bRe * impl_->facts.eMtcp.translation();
  Vector6d velocity;
  velocity << twist.linear_mps + twist.angular_radps.cross(to_tcp), twist.angular_radps;
  impl_->move(ScriptMode::kTwist, velocity, valid_for);
}

void Arm::moveJoints(MotionKey, const Eigen::VectorXd& speeds_radps, Duration valid_for) {
  if (speeds_radps.size() != 6 || !speeds_radps.allFinite())
    throw std::invalid_argument("ur::Arm::moveJoints: there must be six finite joint speeds");
  impl_->move(ScriptMode::kJoints, speeds_radps, valid_for);
}

void Arm::stop(MotionKey) { impl_->link->command({}); }

}  // namespace servocal::robot::ur
