// SPDX-License-Identifier: GPL-3.0-or-later
// How far the board can be tilted before the detector loses it (the paper's stage of the same name).
#include <algorithm>
#include <cmath>

#include "resume.h"
#include "run.h"
#include "tilt_found.h"

namespace servocal::procedure {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr int kStrideDeg = 15;        // On the way to a limit, where every stop counts for coverage.
constexpr int kStepDeg = 5;           // Resolution of a limit,
constexpr int kInfraredStepDeg = 15;  // and of that of the stream that is not servoed on.
constexpr int kCapDeg = 75;
// What tells most leans by 45 degrees against the image, a little more against the sight.
constexpr int kUsefulCapDeg = 60;

struct Direction {
  const char* name;
  Eigen::Vector3d axis;  // in o: turns the board about its own centre
  int cap_deg;           // a multiple of the step
};

bool sees(const Observation& observation, const Eye& eye) {
  return std::any_of(observation.views.begin(), observation.views.end(), [&](const StreamObservation& view) {
    return view.camera == eye.camera() && view.stream == eye.stream();
  });
}

int roundedDown(double angle_deg) { return kStepDeg * static_cast<int>(std::floor(angle_deg / kStepDeg)); }

/// The search of one camera's two streams.
class TiltSearch {
 public:
  /// Stops on the way cost time; coverage wants their views, the planner by information finds better ones.
  TiltSearch(Run& run, Eye& color, const Pose<Color, Board>& cMo_facing)
      : run_(run), color_(color), infrared_(run.find(color.camera(), Stream::kInfrared)),
        cMo_facing_(cMo_facing), bMe_facing_(run.guard().state().bMe),
        in_strides_(run.cell().planner.choose_by != Planner::kInformation) {
    options_.lost_tries = 1;  // losing the board is what the search is for
    options_.settled_for = std::chrono::milliseconds(100);
  }

  /// In strides, or straight to the cap: the servo sees on the way where the board is lost. Then in single
  /// steps from there. A board that a long way lost, moving fast, may still be seen by one that rests.
  void find(const Direction& direction) {
    color_limit_ = infrared_limit_ = {};
    std::string ended_by = "cap";
    bool from_facing = false;
    int stride_deg = in_strides_ ? kStrideDeg : direction.cap_deg;
    for (int angle_deg = stride_deg;;) {
      const std::optional<Run::Visit> visit = tilt(direction, angle_deg);
      if (visit && visit->observation) {
        if (angle_deg == direction.cap_deg) break;
        angle_deg = std::min(angle_deg + stride_deg, direction.cap_deg);
        continue;
      }
      const bool out_of_reach = !visit || visit->drive.status == DriveStatus::kLimit ||
                                visit->drive.status == DriveStatus::kUnreachable;
      if (out_of_reach && !from_facing) {  // From the last direction's end the straight way may be barred.
        from_facing = true;
        run_.moveTo(bMe_facing_);
        continue;
      }
      if (angle_deg == color_limit_.seen_deg + kStepDeg) {
        ended_by = out_of_reach ? "reach" : "detection";
        break;
      }
      stride_deg = kStepDeg;
      int next_deg = angle_deg - kStepDeg;
      if (visit && visit->drive.last) {
        // Where the arm came to its limit; or where the board was lost, unless that was too early to be true.
        next_deg = roundedDown(angleOf(direction, visit->drive.last->cMo) / kDegree);
        if (!out_of_reach)
          next_deg = std::max(next_deg, roundedDown(0.5 * (color_limit_.seen_deg + angle_deg)));
      }
      angle_deg = std::clamp(next_deg, color_limit_.seen_deg + kStepDeg, angle_deg - kStepDeg);
    }
    const bool infrared_knows = infrared_ != nullptr && infrared_->bMc();
    while (infrared_knows && infrared_limit_.lost_deg &&
           *infrared_limit_.lost_deg - infrared_limit_.seen_deg > kInfraredStepDeg) {
      const int between_deg = roundedDown(0.5 * (infrared_limit_.seen_deg + *infrared_limit_.lost_deg));
      if (const auto visit = tilt(direction, between_deg); !visit || !visit->observation) break;
    }
    note(color_, {direction.name, color_limit_.seen_deg * kDegree, ended_by, Stream::kColor});
    if (infrared_knows) {
      note(*infrared_, {direction.name, infrared_limit_.seen_deg * kDegree,
                        infrared_limit_.lost_deg ? "detection" : ended_by, Stream::kInfrared});
    }
  }

 private:
  /// Nothing if the arm cannot be there.
  std::optional<Run::Visit> tilt(const Direction& direction, int angle_deg) {
    const auto turn =
        Pose<Board, Board>::fromRotationVector(angle_deg * kDegree * direction.axis, Eigen::Vector3d::Zero());
    const Pose<Color, Board> cdMo = cMo_facing_ * turn;
    const auto q = run_.guard().kinematics().inverse(run_.flangeFor(color_, cdMo), run_.guard().state().q,
                                                     run_.guard().limits().joint_margin_rad);
    if (!q || !run_.guard().allows(*q)) return std::nullopt;
    Run::Visit visit = run_.visit("tilt", color_, cdMo, options_);
    if (visit.observation) {
      color_limit_.note(angle_deg, true);
      if (infrared_ != nullptr) infrared_limit_.note(angle_deg, sees(*visit.observation, *infrared_));
    }
    return visit;
  }

  double angleOf(const Direction& direction, const Pose<Color, Board>& cMo) const {
    return (cMo_facing_.inverse() * cMo).rotationVector().dot(direction.axis);
  }

  void note(Eye& eye, TiltLimit limit) {
    eye.tilt_limits.push_back(std::move(limit));
    noteTiltLimit(run_, eye, eye.tilt_limits.back());
  }

  Run& run_;
  Eye& color_;
  Eye* const infrared_;
  const Pose<Color, Board> cMo_facing_;
  const Pose<Base, EndEffector> bMe_facing_;
  const bool in_strides_;
  servo::DriveOptions options_;
  TiltFound color_limit_, infrared_limit_;
};

}  // namespace

void findTiltLimits(Run& run, Eye& color) {
  using Eigen::Vector3d;
  const int cap_deg = run.cell().planner.choose_by == Planner::kInformation ? kUsefulCapDeg : kCapDeg;
  // From one to the next the board need not come back to the middle: neighbors are a right angle apart.
  std::vector<Direction> directions = {
      {"roll+", Vector3d::UnitZ(), 45},      {"pitch+", Vector3d::UnitX(), cap_deg},
      {"yaw+", Vector3d::UnitY(), cap_deg},  {"pitch-", -Vector3d::UnitX(), cap_deg},
      {"yaw-", -Vector3d::UnitY(), cap_deg}, {"roll-", -Vector3d::UnitZ(), 45}};
  const int planned = static_cast<int>(directions.size());
  directions.erase(
      std::remove_if(directions.begin(), directions.end(),
                     [&](const Direction& direction) { return hasTiltLimit(color, direction.name); }),
      directions.end());
  if (directions.empty()) return;  // Known from an earlier run, or from this one's first part.

  const Pose<Color, Board> cMo_facing(Eigen::Matrix3d::Identity(),
                                      {0, 0, 1.1 * run.cell().coverage.near_distance_m});
  run.report("tilt", color, 0, planned);
  run.visit("tilt", color, cMo_facing);
  run.updateBelief(color);
  TiltSearch search(run, color, cMo_facing);
  for (const Direction& direction : directions) {
    if (color.tooLate()) break;
    search.find(direction);
    run.updateBelief(color);
    const TiltLimit& limit = color.tilt_limits.back();
    run.report("tilt", color, static_cast<int>(color.tilt_limits.size()), planned,
               limit.direction + " " + std::to_string(std::lround(limit.limit_rad / kDegree)) +
                   " deg, ended by " + limit.ended_by);
  }
}

}  // namespace servocal::procedure
