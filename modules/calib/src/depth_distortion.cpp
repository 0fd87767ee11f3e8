// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/depth_distortion.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <stdexcept>

#include "depth_fit.h"
#include "depth_views.h"
#include "median.h"

namespace servocal::calib {
namespace {

/// A view whose residual is this many times the typical one contradicts the others.
constexpr double kOutlierRatio = 4.0;
/// Where DepthResult::sigma_at_m looks beyond the ranges visited, m.
constexpr double kFarSigma_m = 1.5;

struct Source {
  const Observation* observation = nullptr;
  const StreamObservation* seen = nullptr;
};

void check(const CameraModel& infrared, const DepthOptions& options) {
  if (options.nodes_x < 2 || options.nodes_y < 2 || options.min_views < 1 ||
      !(options.board_pose_sigma_m > 0.0) || !(options.board_pose_sigma_rad > 0.0) ||
      !(options.board_pose_common_m >= 0.0)) {
    throw std::invalid_argument("an option of the depth correction is out of range");
  }
  if (options.intrinsics_covariance && (options.intrinsics_covariance->rows() != infrared.parameters.size() ||
                                        options.intrinsics_covariance->cols() != infrared.parameters.size())) {
    throw std::invalid_argument("the covariance of the intrinsics has another number of parameters than the camera");
  }
}

std::vector<DepthView> viewsOf(const BoardSpec& board, const CameraModel& infrared,
                               const std::vector<Source>& sources, const DepthOptions& options) {
  std::vector<DepthView> views;
  for (const Source& source : sources) {
    if (auto view = depthView(board, infrared, *source.observation, *source.seen, options)) {
      views.push_back(*std::move(view));
    }
  }
  return views;
}

/// How far a view's patches are from the plane under a model, in units of what its pose, its patches and the
/// uncertainty of the model there explain: as a whole, and in shape.
struct Misfit {
  double whole = 0.0;
  double shape = 0.0;
};

/// Covariance of what a model says of a view's patches, m^2; empty: not known.
using ModelCovariance = std::function<Eigen::MatrixXd(const DepthView&)>;

Misfit misfit(const DepthModel& model, const ModelCovariance& uncertain, const DepthView& view) {
  const Eigen::Index count = view.raw_m.size();
  Eigen::VectorXd residual(count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const auto corrected = model.correct(view.pixels[static_cast<std::size_t>(k)], view.raw_m[k]);
    if (!corrected) return {INFINITY, INFINITY};
    residual[k] = view.plane_m[k] - *corrected;
  }
  const double patch_variance = view.raw_sigma_m.cwiseAbs2().mean();
  Eigen::MatrixXd covariance = view.plane_covariance_m2;
  if (uncertain) covariance += uncertain(view);
  const double common = covariance.mean();
  const double total = covariance.diagonal().mean();
  const double rms = std::sqrt((residual.array() - residual.mean()).square().mean());
  return {std::abs(residual.mean()) / std::sqrt(common + patch_variance / static_cast<double>(count)),
          rms / std::sqrt(std::max(total - common, 0.0) + patch_variance)};
}

/// The views that agree with a model, by rank against the typical one.
std::vector<bool> agreeing(const DepthModel& model, const ModelCovariance& uncertain,
                           const std::vector<DepthView>& views) {
  std::vector<double> wholes, shapes;
  for (const DepthView& view : views) {
    const Misfit fit = misfit(model, uncertain, view);
    wholes.push_back(fit.whole);
    shapes.push_back(fit.shape);
  }
  const double whole = std::max(1.4826 * median(wholes), 1.0), shape = std::max(median(shapes), 1.0);
  std::vector<bool> keep(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    keep[i] = wholes[i] <= kOutlierRatio * whole && shapes[i] <= kOutlierRatio * shape;
  }
  return keep;
}

std::vector<DepthView> chosen(const std::vector<DepthView>& views, const std::vector<bool>& keep) {
  std::vector<DepthView> out;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (keep[i]) out.push_back(views[i]);
  }
  return out;
}

/// Slope 1 and the offset of the typical view: where the robust rounds start.
DepthModel startModel(const DepthModel& shape, const std::vector<DepthView>& views) {
  std::vector<double> offsets;
  for (const DepthView& view : views) {
    for (Eigen::Index k = 0; k < view.raw_m.size(); ++k) {
      offsets.push_back(shape.sensor == DepthSensor::kTimeOfFlight
                            ? (view.plane_m[k] - view.raw_m[k]) * view.stretch[k]
                            : 1.0 / view.plane_m[k] - 1.0 / view.raw_m[k]);
    }
  }
  DepthModel model = shape;
  model.nodes = Eigen::VectorXd::Zero(shape.nodes_x * shape.nodes_y);
  model.offset = median(std::move(offsets));
  return model;
}

/// Farthest over nearest view.
double rangeRatio(const std::vector<DepthView>& views) {
  double near = INFINITY, far = 0.0;
  for (const DepthView& view : views) {
    near = std::min(near, view.raw_m.mean());
    far = std::max(far, view.raw_m.mean());
  }
  return far / near;
}

/// With nodes for the wiggling error from a little before the nearest to a little behind the farthest patch.
DepthModel withWiggle(DepthModel shape, const std::vector<DepthView>& views) {
  constexpr double kMarginM = 0.3, kStepM = 0.05;
  double near_m = INFINITY, far_m = 0.0;
  for (const DepthView& view : views) {
    const Eigen::VectorXd ranges = view.raw_m.cwiseProduct(view.stretch);
    near_m = std::min(near_m, ranges.minCoeff());
    far_m = std::max(far_m, ranges.maxCoeff());
  }
  shape.wiggle_from_m = near_m - kMarginM;
  shape.wiggle_to_m = far_m + kMarginM;
  const double steps = std::ceil((shape.wiggle_to_m - shape.wiggle_from_m) / kStepM);
  shape.wiggle = Eigen::VectorXd::Zero(1 + static_cast<Eigen::Index>(steps));
  return shape;
}

std::string text(const char* format, double a, double b) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, a, b);
  return buffer;
}

/// Cells of the lattice in which no patch lies.
int emptyCells(const DepthModel& shape, const std::vector<DepthView>& views) {
  std::vector<bool> seen(static_cast<std::size_t>((shape.nodes_x - 1) * (shape.nodes_y - 1)), false);
  for (const DepthView& view : views) {
    for (const Eigen::Vector2d& pixel : view.pixels) {
      const int column = std::clamp(static_cast<int>(pixel.x() / shape.camera.width_px * (shape.nodes_x - 1)), 0,
                                    shape.nodes_x - 2);
      const int row = std::clamp(static_cast<int>(pixel.y() / shape.camera.height_px * (shape.nodes_y - 1)), 0,
                                 shape.nodes_y - 2);
      seen[static_cast<std::size_t>(row * (shape.nodes_x - 1) + column)] = true;
    }
  }
  return static_cast<int>(std::count(seen.begin(), seen.end(), false));
}

Eigen::Vector2d middlePixel(const CameraModel& camera) {
  return {0.5 * (camera.width_px - 1), 0.5 * (camera.height_px - 1)};
}

/// Variance of the correction at some ranges by the intrinsics: the whole solution again with another camera.
Eigen::VectorXd varianceByIntrinsics(const BoardSpec& board, const CameraModel& infrared,
                                     const std::vector<Source>& sources, const DepthFit& fit, bool free_slope,
                                     const Eigen::VectorXd& at_m, const DepthOptions& options) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> modes(*options.intrinsics_covariance);
  const auto corrected = [&](const DepthModel& model) {
    Eigen::VectorXd out(at_m.size());
    for (Eigen::Index k = 0; k < at_m.size(); ++k) {
      out[k] = model.correct(middlePixel(infrared), at_m[k]).value_or(NAN);
    }
    return out;
  };
  const Eigen::VectorXd nominal = corrected(fit.model);
  Eigen::VectorXd variance = Eigen::VectorXd::Zero(at_m.size());
  for (Eigen::Index i = 0; i < modes.eigenvalues().size(); ++i) {
    if (!(modes.eigenvalues()[i] > 0.0)) continue;  // a parameter that was held
    DepthModel other = fit.model;
    other.camera.parameters += std::sqrt(modes.eigenvalues()[i]) * modes.eigenvectors().col(i);
    auto views = viewsOf(board, other.camera, sources, options);
    if (views.empty()) continue;
    const Eigen::VectorXd moved =
        corrected(DepthProblem(other, free_slope, std::move(views)).solveAt(fit.scales).model);
    variance += (moved - nominal).cwiseAbs2();
  }
  return variance;
}

}  // namespace

const char* toString(DepthStatus status) {
  switch (status) {
    case DepthStatus::kSolved: return "the depth correction was solved";
    case DepthStatus::kTooFewViews:
      return "too few views of the board carry depth: take more, at two distances and all over the image";
    case DepthStatus::kInconsistent:
      return "depth and infrared image contradict each other in too many views: another board, a board that was "
             "moving, or depth and infrared that do not share their pixels";
  }
  return "";
}

DepthOutcome solveDepth(const BoardSpec& board, const CameraModel& infrared,
                        const std::vector<Observation>& observations, const std::string& camera,
                        DepthSensor sensor, const DepthOptions& options) {
  check(infrared, options);
  std::vector<Source> sources;
  for (const Observation& observation : observations) {
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera == camera && seen.stream == Stream::kInfrared && seen.depth) {
        sources.push_back({&observation, &seen});
      }
    }
  }
  const std::vector<DepthView> views = viewsOf(board, infrared, sources, options);
  DepthOutcome outcome;
  if (static_cast<int>(views.size()) < options.min_views) {
    outcome.reason = text("%.0f views of the board carry depth, at least %.0f are needed",
                          static_cast<double>(views.size()), static_cast<double>(options.min_views));
    return outcome;
  }

  DepthModel shape;
  shape.sensor = sensor;
  shape.camera = infrared;
  shape.nodes_x = options.nodes_x;
  shape.nodes_y = options.nodes_y;
  std::vector<bool> keep = agreeing(startModel(shape, views), {}, views);
  std::vector<DepthView> used = chosen(views, keep);
  bool free_slope = false;
  std::optional<DepthFit> fit;
  const auto shapeFor = [&](const std::vector<DepthView>& of, bool at_several_ranges) {
    return sensor == DepthSensor::kTimeOfFlight && at_several_ranges ? withWiggle(shape, of) : shape;
  };
  const auto enough = [&] {
    return static_cast<int>(used.size()) >= options.min_views && 3 * used.size() >= 2 * views.size();
  };
  for (int round = 0; round < 8 && enough(); ++round) {
    free_slope = rangeRatio(used) >= options.min_range_ratio;
    const DepthProblem problem(shapeFor(used, free_slope), free_slope, used);
    fit = problem.solve(fit ? fit->scales : DepthScales{});
    // Where no view in use was, the model does not contradict one that was left out.
    const std::vector<bool> next =
        agreeing(fit->model, [&](const DepthView& view) { return problem.covarianceAt(*fit, view); }, views);
    if (next == keep) break;
    keep = next;
    used = chosen(views, keep);
  }
  if (!fit || !enough()) {
    outcome.status = DepthStatus::kInconsistent;
    outcome.reason = text("only %.0f of %.0f views agree on one depth correction", static_cast<double>(used.size()),
                          static_cast<double>(views.size()));
    return outcome;
  }
  const DepthProblem problem(shapeFor(used, free_slope), free_slope, used);
  fit = problem.solve(fit->scales);
  if (fit->scales.common_m > options.max_scatter_m) {
    outcome.status = DepthStatus::kInconsistent;
    outcome.reason = text("depth and infrared corners disagree by %.0f mm from view to view, in %.0f views",
                          1e3 * fit->scales.common_m, static_cast<double>(used.size()));
    return outcome;
  }
  std::vector<Source> used_sources;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (!keep[i]) outcome.left_out.push_back(views[i].id);
  }
  for (const Source& source : sources) {
    const bool is_used = std::any_of(used.begin(), used.end(),
                                     [&](const DepthView& view) { return view.id == source.observation->id; });
    if (is_used) used_sources.push_back(source);
  }

  DepthResult result;
  result.model = fit->model;
  result.views = static_cast<int>(used.size());
  double before = 0.0, after = 0.0;
  result.model.near_m = INFINITY;
  for (std::size_t i = 0; i < used.size(); ++i) {
    result.patches += static_cast<int>(used[i].raw_m.size());
    before += (used[i].plane_m - used[i].raw_m).squaredNorm();
    after += fit->residual_m[i].squaredNorm();
    result.model.near_m = std::min(result.model.near_m, used[i].raw_m.minCoeff());
    result.model.far_m = std::max(result.model.far_m, used[i].raw_m.maxCoeff());
  }
  result.rms_before_m = std::sqrt(before / result.patches);
  result.rms_after_m = std::sqrt(after / result.patches);

  result.sigma_at_m.resize(4);
  result.sigma_at_m << result.model.near_m, 0.5 * (result.model.near_m + result.model.far_m), result.model.far_m,
      kFarSigma_m;
  Eigen::VectorXd variance(4);
  for (Eigen::Index k = 0; k < 4; ++k) {
    const Eigen::VectorXd gradient = problem.gradient(result.model, middlePixel(infrared), result.sigma_at_m[k]);
    variance[k] = gradient.dot(fit->covariance * gradient);
  }
  if (options.intrinsics_covariance && options.board_poses.empty()) {
    variance += varianceByIntrinsics(board, infrared, used_sources, *fit, free_slope, result.sigma_at_m, options);
  }
  variance.array() += options.board_pose_common_m * options.board_pose_common_m;
  result.sigma_m = variance.cwiseSqrt();
  constexpr double kNoWiggle_m = 1e-5;
  if (result.model.wiggle.size() > 0 && result.model.wiggle.lpNorm<Eigen::Infinity>() < kNoWiggle_m)
    result.model.wiggle.resize(0);

  if (!free_slope) {
    result.notes.push_back(text("all boards were at about one distance (%.2f to %.2f m): how the depth error changes "
                                "with distance is not determined, and taken not to",
                                result.model.near_m, result.model.far_m));
  }
  if (const int empty = emptyCells(shape, used); empty > 0) {
    result.notes.push_back(text("no board was seen in %.0f of %.0f cells of the image; the depth correction there "
                                "continues that of its surroundings",
                                empty, (shape.nodes_x - 1.0) * (shape.nodes_y - 1.0)));
  }
  outcome.status = DepthStatus::kSolved;
  outcome.result = std::move(result);
  return outcome;
}

}  // namespace servocal::calib
