// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/intrinsics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "arrow.h"
#include "corner_weight.h"
#include "homography.h"
#include "median.h"
#include "servocal/calib/board_pose.h"
#include "view_reasons.h"

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

/// All views in a given camera, each with the pose that fits it best.
struct Judged {
  std::vector<Eigen::Isometry3d> cMo;
  std::vector<double> rms_px;  // infinite if no pose explains the view
};

Judged judge(const BoardSpec& board, const CameraModel& camera, const std::vector<View>& views) {
  Judged out{std::vector<Eigen::Isometry3d>(views.size()), std::vector<double>(views.size(), INFINITY)};
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::vector<BoardPose> poses = boardPoses(board, camera, views[i].seen->detection);
    if (poses.empty()) continue;
    out.cMo[i] = poses.front().cMo.isometry();
    out.rms_px[i] = poses.front().rms_px;
  }
  return out;
}

/// Residual above which a view does not belong to the others. The floor is what good corners are off by, so
/// that among perfect views nobody is the worst; the spread keeps views that differ in honest ways.
double outlierLimitPx(const std::vector<double>& rms_px, double ratio) {
  constexpr double kFloorPx = 0.3;
  const double middle = median(rms_px);
  std::vector<double> deviations;
  for (const double rms : rms_px) deviations.push_back(std::abs(rms - middle));
  return std::max({kFloorPx, ratio * middle, middle + 8.0 * 1.4826 * median(deviations)});
}

/// A camera from few views that most others agree with: least median of squares over samples of views.
/// Deterministic. Source: P. Rousseeuw, "Least Median of Squares Regression", JASA 79(388), 1984.
std::optional<CameraModel> sampledCamera(const BoardSpec& board, const std::vector<View>& views,
                                         const IntrinsicsOptions& options, const std::vector<int>& free) {
  constexpr int kSamples = 60;  // 99.9 % to meet five good views of five among 30 % bad ones
  const std::size_t size = std::min<std::size_t>(5, (views.size() + 1) / 2);
  if (size < 3) return std::nullopt;
  // A sample is too small for a whole lens model: focal lengths, principal point and k1.
  std::vector<int> few;
  std::copy_if(free.begin(), free.end(), std::back_inserter(few), [](int index) { return index < 5; });
  std::mt19937 random(20001122);  // the same samples for the same input
  std::optional<CameraModel> best;
  double least_px = INFINITY;
  std::vector<View> sample = views;
  for (int draw = 0; draw < kSamples; ++draw) {
    sample = views;
    for (std::size_t i = 0; i < size; ++i) std::swap(sample[i], sample[i + random() % (sample.size() - i)]);
    sample.resize(size);
    State state{startCamera(board, sample, options), {}};
    const Judged start = judge(board, state.camera, sample);
    if (!(*std::max_element(start.rms_px.begin(), start.rms_px.end()) < INFINITY)) continue;
    state.cMo = start.cMo;
    Problem problem(board, options, few);
    problem.setViews(sample);
    const auto fit = minimizeArrow(
        state, [&](const State& at) { return problem.linearize(at); },
        [&](const State& at, const ArrowStep& step) { return problem.move(at, step); }, 30, 1e-4);
    if (!fit || !(fit->state.camera.fx() > 0) || !(fit->state.camera.fy() > 0)) continue;
    const double middle_px = median(judge(board, fit->state.camera, views).rms_px);
    if (middle_px >= least_px) continue;
    least_px = middle_px;
    best = fit->state.camera;
  }
  return best;
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
      ViewResidual& report = result.views[view.report];
      report.used = false;
      report.cause = ViewCause::kNoBoard;
      report.reason = "too few corners, or all on one line";
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
  const std::vector<View> all = views;
  const bool gated = !options.prior && options.outlier_ratio > 0;
  const int least_views = std::max(1, options.min_views);
  if (gated) {
    // Where views disagree, all of them together may have dragged the camera along: ask samples too.
    std::vector<double> rms_px(views.size(), INFINITY);
    for (std::size_t i = 0; fit && i < views.size(); ++i) rms_px[i] = problem.viewRmsPx(fit->state, i);
    const double worst_px = *std::max_element(rms_px.begin(), rms_px.end());
    if (!fit || !fit->converged || worst_px > std::max(0.3, 2.5 * median(rms_px))) {
      const auto camera_of_few = sampledCamera(board, views, options, free);
      const Judged judged = judge(board, camera_of_few.value_or(state.camera), views);
      if (camera_of_few && median(judged.rms_px) < median(rms_px)) {
        // What the few parameters of a sample leave over is a pixel or so.
        const double limit_px = std::max(1.0, 3.0 * median(judged.rms_px));
        State next{*camera_of_few, {}};
        views.clear();
        for (std::size_t i = 0; i < all.size(); ++i) {
          if (!(judged.rms_px[i] <= limit_px)) continue;
          views.push_back(all[i]);
          next.cMo.push_back(judged.cMo[i]);
        }
        problem.setViews(views);
        fit = minimize(problem, next);
      }
    }
  }
  std::vector<bool> heard(all.size(), false);
  for (int round = 0; fit && round < 20; ++round) {
    State next = fit->state;
    bool changed = leaveWrongPoses(board, problem, views, next);
    if (options.prior) {
      const double noise = std::sqrt(problem.residualSquares(next) / problem.degreesOfFreedom());
      const double floor = options.weighting == CornerWeighting::kEqual ? 0.02 : 0.2;
      if (std::abs(std::max(noise, floor) - problem.noise()) > 0.02 * problem.noise()) {
        problem.setNoise(std::max(noise, floor));
        changed = true;
      }
    } else if (!changed && gated) {
      // Every view is judged anew each round, those that are out too: one terrible view bends the camera
      // and hides another, or makes a good one look bad.
      const Judged judged = judge(board, next.camera, all);
      std::vector<double> rms_px = judged.rms_px, sharpness_px;
      std::vector<bool> in(all.size(), false);
      for (std::size_t i = 0; i < views.size(); ++i) {
        const auto k = std::find_if(all.begin(), all.end(),
                                    [&](const View& view) { return view.report == views[i].report; }) -
                       all.begin();
        rms_px[k] = problem.viewRmsPx(next, i);
        sharpness_px.push_back(claimedSigmaPx(views[i].seen->detection));
        in[k] = true;
      }
      const double usual_px = median(rms_px), usual_sigma_px = median(sharpness_px);
      const double limit_px = outlierLimitPx(rms_px, options.outlier_ratio);
      std::vector<bool> stays, blurred;
      for (std::size_t i = 0; i < all.size(); ++i) {
        blurred.push_back(usual_sigma_px > 0 &&
                          claimedSigmaPx(all[i].seen->detection) > kBlurRatio * usual_sigma_px &&
                          rms_px[i] > std::max(0.15, 2.5 * usual_px));
        stays.push_back(rms_px[i] <= limit_px && !blurred[i]);
      }
      changed = changed || stays != in;
      // Who had no say in the camera fits it worse. Before that counts against a view, it gets a say, once.
      for (std::size_t i = 0; i < all.size() && !changed; ++i) {
        if (stays[i] || blurred[i] || heard[i] || rms_px[i] > 2.0 * limit_px) continue;
        stays[i] = heard[i] = true;
        changed = true;
      }
      State kept{next.camera, {}};
      std::size_t at = 0;
      views.clear();
      for (std::size_t i = 0; i < all.size(); ++i) {
        ViewResidual& report = result.views[all[i].report];
        report = {report.observation_id, report.name, rms_px[i], true, "", ViewCause::kNone};
        if (stays[i]) {
          views.push_back(all[i]);
          kept.cMo.push_back(in[i] ? next.cMo[at] : judged.cMo[i]);
        } else {
          explainImage(all[i].seen->detection, usual_sigma_px, usual_px, rms_px[i], report);
        }
        if (in[i]) ++at;
      }
      if (static_cast<int>(views.size()) < least_views) return outcome;
      next = std::move(kept);
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
