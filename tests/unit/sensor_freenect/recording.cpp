// SPDX-License-Identifier: GPL-3.0-or-later
#include "recording.h"

#include <cstdio>
#include <fstream>
#include <string>

namespace servocal::test {
namespace {

void write(const std::filesystem::path& path, const std::string& header, const cv::Mat& pixels) {
  std::ofstream file(path, std::ios::binary);
  file << header << '\n';
  const cv::Mat continuous = pixels.clone();
  file.write(reinterpret_cast<const char*>(continuous.data),
             static_cast<std::streamsize>(continuous.total() * continuous.elemSize()));
}

}  // namespace

KinectRecording::KinectRecording(const cv::Mat& rgb, const cv::Mat& depth, double seconds,
                                 std::uint32_t first_stamp) {
  write(folder_ / "color", "P6 640 480 255", rgb);
  write(folder_ / "depth", "P5 640 480 65535",
        depth);  // In the computer's own order of bytes, as "record" does.
  std::ofstream index(folder_ / "INDEX.txt");
  constexpr double kPeriodS = 1.0 / 30.0;
  for (int i = 0; i * kPeriodS < seconds; ++i) {
    for (const bool color : {true, false}) {
      const double since_s = (i + (color ? 0.0 : 0.5)) * kPeriodS;
      // Unsigned numbers turn over as the device's.
      const auto stamp = static_cast<std::uint32_t>(first_stamp + static_cast<std::uint64_t>(60e6 * since_s));
      char name[80];
      std::snprintf(name, sizeof name, "%c-%.6f-%u.%s", color ? 'r' : 'd', 1e6 + since_s, stamp,
                    color ? "ppm" : "pgm");
      std::filesystem::create_symlink(color ? "color" : "depth", folder_ / name);
      index << name << '\n';
    }
  }
}

}  // namespace servocal::test
