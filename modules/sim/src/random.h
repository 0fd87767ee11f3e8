// SPDX-License-Identifier: GPL-3.0-or-later
// Random numbers from the run's seed. Own generators, because the standard's distributions may give
// other numbers with another standard library, and a seed is quoted in published results.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <string_view>

namespace servocal::sim {

/// Scrambles 64 bits (splitmix64, Steele et al. 2014).
inline std::uint64_t scramble(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// A stream of draws for one subject ("mount", "camera0", ...). Streams of different subjects do not
/// disturb each other: a draw added to one leaves the rest of a seed's cell as it was.
class Random {
 public:
  Random(std::uint64_t seed, std::string_view subject) : state_(scramble(seed)) {
    for (const char c : subject) state_ = scramble(state_ ^ static_cast<unsigned char>(c));
  }

  std::uint64_t bits() { return scramble(state_++); }
  /// In [0, 1).
  double unit() { return static_cast<double>(bits() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * unit(); }
  int integer(int low, int high) { return low + static_cast<int>(bits() % (high - low + 1)); }
  double normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - unit()));
    return radius * std::cos(2.0 * M_PI * unit());
  }
  /// Each component in [-half_range, half_range).
  Eigen::Vector3d box(double half_range) {
    const double x = uniform(-half_range, half_range);
    const double y = uniform(-half_range, half_range);
    return {x, y, uniform(-half_range, half_range)};
  }
  /// Uniform on the unit sphere.
  Eigen::Vector3d direction() {
    const double z = uniform(-1.0, 1.0);
    const double angle = uniform(0.0, 2.0 * M_PI);
    const double r = std::sqrt(1.0 - z * z);
    return {r * std::cos(angle), r * std::sin(angle), z};
  }

 private:
  std::uint64_t state_;
};

}  // namespace servocal::sim
