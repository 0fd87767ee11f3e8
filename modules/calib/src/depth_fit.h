// SPDX-License-Identifier: GPL-3.0-or-later
// The linear model of a depth correction, fitted to views whose patches err together.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "depth_views.h"
#include "servocal/core/depth_model.h"

namespace servocal::calib {

/// What the data decide by their evidence.
struct DepthScales {
  double patch = 1.0;        ///< Factor on the patches' standard deviations.
  double common_m = 1e-3;    ///< Standard deviation of one error common to a view's depth.
  double lattice_m = 1e-3;   ///< Of the difference of neighboring nodes, as depth at the middle of the ranges.
  double wiggle_m = 1e-4;    ///< Of the wiggling error.
};

struct DepthFit {
  DepthModel model;
  DepthScales scales;
  Eigen::MatrixXd covariance;        ///< Of offset, slope (zero if fixed), wiggle and nodes; posterior.
  double log_evidence = 0.0;
  std::vector<Eigen::VectorXd> residual_m;  ///< By view: plane less corrected depth, m.
};

class DepthProblem {
 public:
  /// `shape` says how many nodes lattice and wiggle have, and where; a wiggle of none is not fitted.
  DepthProblem(DepthModel shape, bool free_slope, std::vector<DepthView> views);

  /// The fit whose scales maximize the evidence, searched from `start`.
  DepthFit solve(const DepthScales& start = {}) const;
  /// The fit with these scales.
  DepthFit solveAt(const DepthScales& scales) const;
  /// Gradient of the corrected depth (m) by offset, slope, wiggle and nodes.
  Eigen::VectorXd gradient(const DepthModel& model, const Eigen::Vector2d& pixel, double raw_m) const;
  /// Covariance of the corrected depth at a view's patches by that of a fit, m^2.
  Eigen::MatrixXd covarianceAt(const DepthFit& fit, const DepthView& view) const;

 private:
  /// A patch in the quantity that is linear: range or inverse depth.
  struct Rows {
    Eigen::MatrixXd design;       // by offset, slope, wiggle, free combinations of nodes
    Eigen::VectorXd target;       // less the raw value
    Eigen::VectorXd to_linear;    // d(linear quantity) / d(depth), absolute
    Eigen::MatrixXd plane_covariance;
    Eigen::VectorXd patch_variance;
  };
  struct Normal;
  Normal normal(const DepthScales& scales) const;
  double linear(double depth_m, double stretch) const;

  DepthModel shape_;
  bool free_slope_ = true;
  std::vector<DepthView> views_;
  std::vector<Rows> rows_;
  double middle_m_ = 1.0;         // of the ranges
  double middle_linear_ = 1.0;    // the slope turns about it
  Eigen::MatrixXd basis_;         // nodes = basis * free combinations: mean zero over the image
  Eigen::MatrixXd roughness_;     // of the free combinations: sum of squared differences of neighbors
  double roughness_log_determinant_ = 0.0;
  Eigen::MatrixXd wiggle_precision_;  // of the wiggle's nodes, at a standard deviation of 1
  double wiggle_log_determinant_ = 0.0;
};

}  // namespace servocal::calib
