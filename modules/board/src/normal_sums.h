// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <opencv2/core/hal/intrin.hpp>
#include <vector>

namespace servocal::board {

/// The normal equations of a small fit over many samples: fills in derivatives and error sample by sample,
/// sums their products four samples at a time. In single precision: the sums are good to 1e-6.
class NormalSums {
 public:
  static constexpr int kMost = 8;  ///< Parameters.

  /// For `parameters` of them and `samples` to come.
  void reset(int parameters, std::size_t samples) {
    parameters_ = parameters;
    stride_ = (samples + 3) / 4 * 4;
    table_.assign(stride_ * kColumns, 0.0f);
  }
  /// Derivative of sample `k` by a parameter.
  float& derivative(int parameter, std::size_t k) { return table_[parameter * stride_ + k]; }
  float& error(std::size_t k) { return table_[parameters_ * stride_ + k]; }

  /// Lower triangle of the derivatives' products, and the derivatives times the error.
  void sum(Eigen::Matrix<double, kMost, kMost>& normal, Eigen::Matrix<double, kMost, 1>& right) const {
    for (int row = 0; row <= parameters_; ++row) {
      // Four columns at a time, so that no sum waits for itself. Columns beyond the last are zero.
      for (int first = 0; first <= row; first += 4) {
        const std::array<float, 4> sums = products(row, first);
        for (int k = 0; k < 4 && first + k <= std::min(row, parameters_ - 1); ++k) {
          if (row < parameters_)
            normal(row, first + k) = sums[k];
          else
            right[first + k] = sums[k];
        }
      }
    }
  }

 private:
  static constexpr int kColumns = kMost + 4;

  std::array<float, 4> products(int row, int first) const {
    const float* a = table_.data() + row * stride_;
    const float* b = table_.data() + first * stride_;
    std::array<float, 4> sums{};
#if CV_SIMD128
    cv::v_float32x4 s0 = cv::v_setzero_f32(), s1 = s0, s2 = s0, s3 = s0;
    for (std::size_t k = 0; k < stride_; k += 4) {
      const cv::v_float32x4 left = cv::v_load(a + k);
      s0 = cv::v_muladd(left, cv::v_load(b + k), s0);
      s1 = cv::v_muladd(left, cv::v_load(b + stride_ + k), s1);
      s2 = cv::v_muladd(left, cv::v_load(b + 2 * stride_ + k), s2);
      s3 = cv::v_muladd(left, cv::v_load(b + 3 * stride_ + k), s3);
    }
    sums = {cv::v_reduce_sum(s0), cv::v_reduce_sum(s1), cv::v_reduce_sum(s2), cv::v_reduce_sum(s3)};
#else
    for (std::size_t k = 0; k < stride_; ++k)
      for (int column = 0; column < 4; ++column) sums[column] += a[k] * b[column * stride_ + k];
#endif
    return sums;
  }

  int parameters_ = 0;
  std::size_t stride_ = 0;
  std::vector<float> table_;
};

}  // namespace servocal::board
