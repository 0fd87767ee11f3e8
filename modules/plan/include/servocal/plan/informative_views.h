// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/forecast.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/pose.h"
#include "servocal/coverage/coverage.h"
#include "servocal/plan/detectability.h"
#include "servocal/plan/next_view.h"
#include "servocal/robot/guard.h"

namespace servocal::plan {

/// One stream that can be driven by and that looks on at the stops of the others.
struct Viewer {
  std::size_t camera = 0;  ///< Index into the forecast's JointSolution::cameras.
  Belief belief;           ///< Where it stands, by which goals become flange poses.
  Detectability detectability;
  const coverage::Coverage* floor = nullptr;  ///< What it has to have seen, whatever the forecast says.
  std::vector<Pose<Color, Board>>
      tried;           ///< Goals driven to by it; candidates close to them are not proposed.
  std::string device;  ///< Which camera it is a stream of.
  bool looks_on =
      true;  ///< At the stops of other cameras too. False where the streams of its own exclude each other.
  bool wanted = true;             ///< False: views are not made for it, its goals are met; it only looks on.
  double image_margin_px = 13.0;  ///< Between the squares' outline and the image border.
};

struct InformativeOptions {
  double near_m = 0.45;  ///< Range of distances along the optical axis.
  double far_m = 0.8;
  double max_tilt_rad = 0.79;  ///< Against the image plane. More adds little (bench: planner_bench).
  double max_roll_rad = 0.79;
  double least_probability = 0.5;    ///< Of being detected, to be proposed at all.
  double min_singular_value = 0.03;  ///< As PlanOptions.
  double stop_time_s = 3.0;          ///< Of a stop beside the travel: the servo's end, settling, the frames.
  double floor_worth =
      0.3;               ///< Of an image cell filled, a distance or a tilt that is missing, in units of gain.
  double least_worth = 0.0;  ///< Gain and floors together; a view worth less is not proposed, however near.
  int candidates = 700;  ///< Of all viewers together.
  int draw = 0;          ///< Candidates are drawn anew with each number; the same ones with the same.
};

/// A view worth driving to.
struct InformativeView {
  std::size_t viewer = 0;       ///< Which one it is made for: index into the viewers.
  Pose<Color, Board> cdMo;      ///< In that one's camera frame.
  Pose<Base, EndEffector> bMe;  ///< Where the flange will be, as far as the belief is right.
  bool straight = true;  ///< From where the arm stands before it. False: only on a way round what is there.
  calib::PlannedStop stop;  ///< What the forecast takes it for.
};

/// The view that takes away most uncertainty of all streams together per second of robot time, the
/// probability of detection allowed for. Nothing if no candidate worth it can be reached.
///
/// Board poses are drawn over image position, distance, tilt and roll of every viewer (Halton, "On the
/// efficiency of certain quasi-random sequences of points", 1960). To choose one at a time, from candidates drawn
/// anew, takes a quarter fewer views than to choose four from the same ones and to bring them into the shortest
/// order, and no more time (docs/results.md).
///
/// @param forecast of the joint solution, in units of information; see there.
/// @param current_q where the arm stands.
[[nodiscard]] std::optional<InformativeView> informativeView(const calib::Forecast& forecast,
                                                             const std::vector<Viewer>& viewers,
                                                             const BoardSpec& board, const robot::Guard& guard,
                                                             const Eigen::VectorXd& current_q,
                                                             const InformativeOptions& options);

}  // namespace servocal::plan
