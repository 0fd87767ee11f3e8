// SPDX-License-Identifier: GPL-3.0-or-later
// The statistics of a validity check: views explained by a stored calibration and deviations from it.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "servocal/procedure/check.h"

namespace servocal::procedure {

/// Probability that chi-square with this many degrees of freedom exceeds a value.
double chiSquareTail(double value, int degrees);

/// Which parts are free of their prior.
struct FreeParts {
  std::vector<std::size_t> cameras, intrinsics;  ///< Indices of the model's cameras.
  bool mount = false;
};

/// Deviations from the stored calibration that explain the views best, given what is free.
struct CheckFit {
  double cost = 0.0;                        ///< Twice the negative log likelihood, up to a constant.
  std::vector<Eigen::VectorXd> cameras;     ///< Per camera 6: displacement, turn.
  std::vector<Eigen::VectorXd> intrinsics;  ///< Per camera.
  Eigen::VectorXd mount;                    ///< 6
  std::vector<Eigen::VectorXd> cameras_sigma, intrinsics_sigma;
  Eigen::VectorXd mount_sigma;
};

class CheckModel {
 public:
  CheckModel(const CalibrationResult& stored, const std::vector<Observation>& views,
             const CheckOptions& options);

  std::size_t cameras() const { return cameras_.size(); }
  const std::string& name(std::size_t camera) const { return cameras_[camera].stored->camera; }
  int intrinsics(std::size_t camera) const {
    return static_cast<int>(cameras_[camera].stored->intrinsics.camera.parameters.size());
  }
  int views(std::size_t camera) const;
  double rmsPx(std::size_t camera) const;
  CheckFit fit(const FreeParts& free) const;

 private:
  struct Camera {
    const CameraResult* stored;
    Eigen::MatrixXd intrinsics_covariance;
    Eigen::MatrixXd pose_by_intrinsics;  ///< See check_prior.h.
    int at = 0;                          ///< First of its 6 + p parameters.
  };
  struct View {
    std::size_t camera = 0, stop = 0;
    BoardDetection detection;
    Pose<Color, Board> seen;   ///< From this image alone.
    double noise_scale = 1.0;  ///< Corner noise over what the detector claims.
  };
  struct State;
  State startOf(const FreeParts& free) const;
  Eigen::MatrixXd priorInformation(const FreeParts& free) const;
  /// Cost; with `information` and `gradient` of the views too.
  double costOf(const State& state, const Eigen::MatrixXd& prior, Eigen::MatrixXd* information,
                Eigen::VectorXd* gradient) const;
  State moved(const State& state, const Eigen::VectorXd& step) const;
  Eigen::VectorXd deviation(const State& state) const;

  const CalibrationResult& stored_;
  CheckOptions options_;
  std::vector<Camera> cameras_;
  std::vector<View> views_;
  std::vector<Pose<Base, EndEffector>> stops_;
  int mount_at_ = 0, stops_at_ = 0, size_ = 0;
};

}  // namespace servocal::procedure
