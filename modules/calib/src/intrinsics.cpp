// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/intrinsics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "arrow.h"
#include "corner_weight.h"
#include "homography.h"
#include "servocal/calib/board_pose.h"

namespace servocal::calib {
namespace {

struct View {
  const StreamObservation* seen = nullptr;
  std::size_t report = 0;  // index into IntrinsicsResult::views
};

struct State {
  CameraModel camera;
  std::vector<Eigen::Isometry3d> cMo;
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

/// The least-squares problem over the views in use.
class Problem {
 public:
  Problem(const BoardSpec& board, const IntrinsicsOptions& options, std::vector<int> free)
      : options_(options), points_o_(board.corners()), free_(std::move(free)) {
    if (!options.prior) return;
    const Eigen::Index count = static_cast<Eigen::Index>(free_.size());
    Eigen::MatrixXd covariance(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      for (Eigen::Index k = 0; k < count; ++k) covariance(i, k) = options.prior->covariance(free_[i], free_[k]);
    }
    prior_information_ = scaledInverse(covariance);
  }

  void setViews(const std::vector<View>& views) { views_ = views; }
  /// Standard deviation of a corner (kEqual: px; kCovariance: in units of its claimed one). It matters
  /// only beside a prior; without one the optimum does not depend on it.
  void setNoise(double noise) { noise_ = noise; }
  double noise() const { return noise_; }

  std::optional<ArrowSystem> linearize(const State& state) const {
    const Eigen::Index shared = static_cast<Eigen::Index>(free_.size());
    ArrowSystem system(static_cast<int>(shared), static_cast<int>(views_.size()));
    ProjectionJacobian derivative;
    Eigen::MatrixXd jacobian;
    Eigen::VectorXd residual;
    for (std::size_t i = 0; i < views_.size(); ++i) {
      const std::vector<Corner>& corners = views_[i].seen->detection.corners;
      jacobian.resize(2 * corners.size(), shared + 6);
      residual.resize(2 * corners.size());
      for (std::size_t k = 0; k < corners.size(); ++k) {
        const Eigen::Vector3d point_c = state.cMo[i] * points_o_[corners[k].id];
        const std::optional<Eigen::Vector2d> pixel = state.camera.project(point_c, derivative);
        if (!pixel) return std::nullopt;
        const Eigen::Matrix2d weight = weightOf(corners[k]);
        const Eigen::Index row = 2 * static_cast<Eigen::Index>(k);
        residual.segment<2>(row) = weight * (*pixel - corners[k].pixel);
        for (Eigen::Index p = 0; p < shared; ++p) {
          jacobian.block<2, 1>(row, p) = weight * derivative.parameters.col(free_[p]);
        }
        jacobian.block<2, 6>(row, shared) = weight * derivative.point * pointByMotion(point_c);
      }
      system.add(static_cast<int>(i), jacobian, residual);
    }
    if (options_.prior) {
      Eigen::VectorXd offset(shared);
      for (Eigen::Index p = 0; p < shared; ++p) {
        offset[p] = state.camera.parameters[free_[p]] - options_.prior->camera.parameters[free_[p]];
      }
      system.matrix += prior_information_;
      system.gradient += prior_information_ * offset;
      system.cost += offset.dot(prior_information_ * offset);
    }
    return system;
  }

  State move(const State& state, const ArrowStep& step) const {
    State out = state;
    for (std::size_t p = 0; p < free_.size(); ++p) out.camera.parameters[free_[p]] += step.shared[p];
    for (std::size_t i = 0; i < out.cMo.size(); ++i) out.cMo[i] = moved(state.cMo[i], step.blocks[i]);
    return out;
  }

  /// Sum of squares of the weighted residuals alone, in units of setNoise(1).
  double residualSquares(const State& state) const {
    double sum = 0;
    for (std::size_t i = 0; i < views_.size(); ++i) {
      for (const Corner& corner : views_[i].seen->detection.corners) {
        const auto pixel = state.camera.project(state.cMo[i] * points_o_[corner.id]);
        if (pixel) sum += (noise_ * weightOf(corner) * (*pixel - corner.pixel)).squaredNorm();
      }
    }
    return sum;
  }

  double viewRmsPx(const State& state, std::size_t i) const {
    double sum = 0;
    const std::vector<Corner>& corners = views_[i].seen->detection.corners;
    for (const Corner& corner : corners) {
      const auto pixel = state.camera.project(state.cMo[i] * points_o_[corner.id]);
      if (!pixel) return INFINITY;
      sum += (*pixel - corner.pixel).squaredNorm();
    }
    return std::sqrt(sum / corners.size());
  }

  int degreesOfFreedom() const {
    int corners = 0;
    for (const View& view : views_) corners += static_cast<int>(view.seen->detection.corners.size());
    const int parameters = options_.prior ? 0 : static_cast<int>(free_.size());  // a prior pays for them
    return std::max(1, 2 * corners - parameters - 6 * static_cast<int>(views_.size()));
  }

 private:
  Eigen::Matrix2d weightOf(const Corner& corner) const {
    if (options_.weighting == CornerWeighting::kEqual) return Eigen::Matrix2d::Identity() / noise_;
    return whitening(corner) / noise_;
  }

  const IntrinsicsOptions& options_;
  std::vector<Eigen::Vector3d> points_o_;
  std::vector<int> free_;
  Eigen::MatrixXd prior_information_;
  std::vector<View> views_;
  double noise_ = 1.0;
};

std::vector<int> freeParameters(const IntrinsicsOptions& options) {
  const std::vector<std::string>& names = parameterNames(options.lens);
  for (const std::string& name : options.fixed) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw std::invalid_argument("no intrinsic parameter is called '" + name + "'");
    }
  }
  std::vector<int> free;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool fixed = std::find(options.fixed.begin(), options.fixed.end(), names[i]) != options.fixed.end();
    if (!fixed) free.push_back(static_cast<int>(i));
  }
  return free;
}

void checkPrior(const IntrinsicsOptions& options, int width_px, int height_px) {
  if (!options.prior) return;
  const CameraModel& camera = options.prior->camera;
  const Eigen::MatrixXd& covariance = options.prior->covariance;
  const int count = parameterCount(options.lens);
  if (camera.lens != options.lens || camera.parameters.size() != count) {
    throw std::invalid_argument("the prior is of another lens model");
  }
  if (camera.width_px != width_px || camera.height_px != height_px) {
    throw std::invalid_argument("the prior is of another image size");
  }
  if (covariance.rows() != count || covariance.cols() != count || !covariance.allFinite() ||
      covariance.llt().info() != Eigen::Success) {
    throw std::invalid_argument("the prior's covariance is not positive definite");
  }
}

CameraModel startCamera(const BoardSpec& board, const std::vector<View>& views,
                        const IntrinsicsOptions& options) {
  if (options.prior) return options.prior->camera;
  const int width_px = views.front().seen->width_px, height_px = views.front().seen->height_px;
  // A field of view that most cameras are not far from, if the views do not say better.
  constexpr double kUsualFovRad = 1.1;
  CameraModel camera = CameraModel::fromFieldOfView(width_px, height_px, kUsualFovRad, options.lens);
  std::vector<Eigen::Matrix3d> homographies;
  for (const View& view : views) {
    std::vector<Eigen::Vector2d> plane, image;
    for (const Corner& corner : view.seen->detection.corners) {
      plane.push_back(board.corner(corner.id).head<2>());
      image.push_back(corner.pixel);
    }
    if (const auto found = homography(plane, image)) homographies.push_back(*found);
  }
  const auto focal = focalFromHomographies(homographies, camera.parameters.segment<2>(2));
  if (focal && *focal > 0.3 * width_px && *focal < 10.0 * width_px) {
    camera.parameters[0] = camera.parameters[1] = *focal;
  }
  return camera;
}

using Fit = ArrowFit<State>;

std::optional<Fit> minimize(const Problem& problem, const State& start) {
  return minimizeArrow(
      start, [&](const State& state) { return problem.linearize(state); },
      [&](const State& state, const ArrowStep& step) { return problem.move(state, step); }, 200);
}

/// Puts views that sit in the wrong one of the two planar poses into the other. True if there were any.
bool leaveWrongPoses(const BoardSpec& board, const Problem& problem, const std::vector<View>& views,
                     State& state) {
  bool changed = false;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const double rms_px = problem.viewRmsPx(state, i);
    if (rms_px < 1e-6) continue;
    const std::vector<BoardPose> poses = boardPoses(board, state.camera, views[i].seen->detection);
    if (poses.empty() || poses.front().rms_px > 0.95 * rms_px) continue;
    state.cMo[i] = poses.front().cMo.isometry();
    changed = true;
  }
  return changed;
}

/// Condition of what the views say of fx, fy, cx and cy, distortion eliminated: a distortion term that the
/// data hardly determine is no reason to refuse, a focal length is.
double pinholeCondition(const Eigen::MatrixXd& information, const std::vector<int>& free) {
  const Eigen::Index count = information.rows();
  const Eigen::Index pinhole = std::count_if(free.begin(), free.end(), [](int index) { return index < 4; });
  if (pinhole == 0) return 1.0;
  if (pinhole == count) return scaledCondition(information);
  const auto cross = information.topRightCorner(pinhole, count - pinhole);
  const Eigen::MatrixXd eliminated = cross *
      scaledInverse(information.bottomRightCorner(count - pinhole, count - pinhole)) * cross.transpose();
  // Scaled as before elimination, so that what distortion can imitate counts as lost.
  const Eigen::VectorXd scale = information.diagonal().head(pinhole).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd left =
      scale.asDiagonal() * (information.topLeftCorner(pinhole, pinhole) - eliminated) * scale.asDiagonal();
  return symmetricCondition(left);
}

}  // namespace

const char* toString(IntrinsicsStatus status) {
  switch (status) {
    case IntrinsicsStatus::kSolved: return "Solved.";
    case IntrinsicsStatus::kTooFewViews:
      return "Too few views show the board. Add views, or check that this is the board in the images.";
    case IntrinsicsStatus::kViewsParallel:
      return "The views do not determine the focal length: the board was (nearly) parallel in all of them. "
             "Add views with the board tilted by 20 degrees or more, in several directions.";
    case IntrinsicsStatus::kNotConverged:
      return "The solve did not converge. Check the board's number of squares, and look for wrong "
             "detections; fix distortion terms if there are few views.";
  }
  return "Unknown status.";
}

IntrinsicsPrior nominalPrior(const CameraModel& nominal) {
  IntrinsicsPrior prior{nominal, Eigen::MatrixXd::Zero(nominal.parameters.size(), nominal.parameters.size())};
  Eigen::VectorXd sigma(nominal.parameters.size());
  sigma.fill(0.3);
  sigma.segment<2>(0) = 0.05 * nominal.parameters.head<2>();
  sigma.segment<2>(2).fill(30.0);
  sigma[4] = 0.15;
  sigma.segment<2>(6).fill(0.005);
  prior.covariance = sigma.cwiseAbs2().asDiagonal();
  // fx and fy err together; what is left apart is a percent of their difference.
  const double apart = 0.01 / 0.05;
  prior.covariance(0, 1) = prior.covariance(1, 0) = sigma[0] * sigma[1] * (1.0 - 0.5 * apart * apart);
  return prior;
}

IntrinsicsOutcome solveIntrinsics(const BoardSpec& board, const std::vector<Observation>& observations,
                                  const std::string& camera, Stream stream,
                                  const IntrinsicsOptions& options) {
  const std::vector<int> free = freeParameters(options);
  IntrinsicsResult result;
  std::vector<View> views;
  for (const Observation& observation : observations) {
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera != camera || seen.stream != stream) continue;
      if (!views.empty() && (seen.width_px != views.front().seen->width_px ||
                             seen.height_px != views.front().seen->height_px)) {
        throw std::invalid_argument("images of different sizes among the views");
      }
      views.push_back({&seen, result.views.size()});
      const std::string& name = seen.image_file.empty() ? observation.stage : seen.image_file;
      result.views.push_back({observation.id, name, 0.0, true, ""});
    }
  }
  IntrinsicsOutcome outcome;
  if (views.empty()) return outcome;
  checkPrior(options, views.front().seen->width_px, views.front().seen->height_px);

  // Start: camera, then the board poses it implies.
  State state{startCamera(board, views, options), {}};
  std::vector<View> usable;
  for (const View& view : views) {
    const std::vector<BoardPose> poses = boardPoses(board, state.camera, view.seen->detection);
    if (poses.empty()) {
      result.views[view.report].used = false;
      result.views[view.report].reason = "too few corners, or all on one line";
      continue;
    }
    usable.push_back(view);
    state.cMo.push_back(poses.front().cMo.isometry());
  }
  views = std::move(usable);
  if (static_cast<int>(views.size()) < std::max(1, options.min_views)) return outcome;

  Problem problem(board, options, free);
  problem.setViews(views);
  std::optional<Fit> fit = minimize(problem, state);
  for (int round = 0; fit && round < 4; ++round) {
    State next = fit->state;
    bool changed = leaveWrongPoses(board, problem, views, next);
    if (options.prior) {
      const double noise = std::sqrt(problem.residualSquares(next) / problem.degreesOfFreedom());
      const double floor = options.weighting == CornerWeighting::kEqual ? 0.02 : 0.2;
      if (std::abs(std::max(noise, floor) - problem.noise()) > 0.02 * problem.noise()) {
        problem.setNoise(std::max(noise, floor));
        changed = true;
      }
    } else if (!changed && options.outlier_ratio > 0) {
      std::vector<double> rms_px;
      for (std::size_t i = 0; i < views.size(); ++i) rms_px.push_back(problem.viewRmsPx(next, i));
      const double limit_px = std::max(1.0, options.outlier_ratio * median(rms_px));
      std::vector<View> kept;
      std::vector<Eigen::Isometry3d> poses;
      for (std::size_t i = 0; i < views.size(); ++i) {
        if (rms_px[i] <= limit_px) {
          kept.push_back(views[i]);
          poses.push_back(next.cMo[i]);
        } else {
          ViewResidual& report = result.views[views[i].report];
          report.used = false;
          report.rms_px = rms_px[i];
          report.reason = "does not fit the other views (wrong board, wrong detection or blurred)";
          changed = true;
        }
      }
      if (static_cast<int>(kept.size()) < std::max(1, options.min_views)) return outcome;
      views = std::move(kept);
      next.cMo = std::move(poses);
      problem.setViews(views);
    }
    if (!changed) break;
    fit = minimize(problem, next);
  }
  outcome.status = IntrinsicsStatus::kNotConverged;
  if (!fit) return outcome;

  const Eigen::MatrixXd information = reducedMatrix(fit->system);
  if (pinholeCondition(information, free) > options.max_condition) {
    outcome.status = IntrinsicsStatus::kViewsParallel;
    return outcome;
  }
  // With a prior the noise is part of the weights already.
  const double variance =
      options.prior ? 1.0 : problem.residualSquares(fit->state) / problem.degreesOfFreedom();
  const Eigen::MatrixXd covariance = variance * scaledInverse(information);
  const int count = parameterCount(options.lens);
  result.camera = fit->state.camera;
  result.covariance = Eigen::MatrixXd::Zero(count, count);
  for (std::size_t i = 0; i < free.size(); ++i) {
    for (std::size_t k = 0; k < free.size(); ++k) result.covariance(free[i], free[k]) = covariance(i, k);
  }
  result.sigma = result.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  if (!(result.sigma[0] <= options.max_focal_sigma * std::abs(result.camera.fx()))) {
    outcome.status = IntrinsicsStatus::kViewsParallel;
    return outcome;
  }
  if (!fit->converged) return outcome;

  double squares_px2 = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const double rms_px = problem.viewRmsPx(fit->state, i);
    const int corners = static_cast<int>(views[i].seen->detection.corners.size());
    result.views[views[i].report].rms_px = rms_px;
    squares_px2 += rms_px * rms_px * corners;
    result.corners += corners;
  }
  result.rms_px = std::sqrt(squares_px2 / result.corners);
  outcome.status = IntrinsicsStatus::kSolved;
  outcome.result = std::move(result);
  return outcome;
}

}  // namespace servocal::calib
