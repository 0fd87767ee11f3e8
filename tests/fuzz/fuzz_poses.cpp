// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever stands in a pose file is a pose or an Error. The first byte chooses how the file is described.
#include <array>

#include "fuzz_files.h"
#include "servocal/core/error.h"
#include "servocal/session/image_set.h"

namespace {

constexpr std::array kDescriptions = {
    "format: matrix\n  length_unit: m\n  files: poses.txt",
    "format: matrix\n  length_unit: mm\n  files: poses.txt\n  key: pose.matrix",
    "format: quaternion\n  length_unit: m\n  files: poses.txt\n  keys: [x, y, z, q.x, q.y, q.z, q.w]",
    "format: rotation_vector\n  length_unit: m\n  angle_unit: deg\n  table: poses.txt\n  columns: [image, x, y, z, rx, ry, rz]",
    "format: euler\n  length_unit: mm\n  angle_unit: rad\n  euler_order: intrinsic_zyz\n  table: poses.txt\n  columns: [x, y, z, rx, ry, rz]\n  skip_lines: 1",
    "format: quaternion\n  length_unit: m\n  table: poses.txt\n  columns: [image, skip, x, y, z, qx, qy, qz, qw]",
    "format: matrix\n  length_unit: m\n  table: poses.txt\n  columns: [image, matrix]",
    "format: visp\n  files: poses.txt"};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace servocal;
  if (size < 1) return 0;
  static const std::filesystem::path folder = [] {
    const auto made = fuzz::ownFolder("poses");
    for (const char* name : {"a1.png", "a2.png"}) fuzz::writeImage(made / name);
    for (std::size_t i = 0; i < kDescriptions.size(); ++i) {
      fuzz::write(made / (std::to_string(i) + ".yaml"),
                  std::string("board: {squares_x: 7, squares_y: 5, square_size_m: 0.03}\nimages: \"*.png\"\n"
                              "mount: eye_to_hand\nposes:\n  pose: bMe\n  ") +
                      kDescriptions[i] + "\n");
    }
    return made;
  }();
  fuzz::write(folder / "poses.txt", bytes + 1, size - 1);
  try {
    session::loadImageSets(folder / (std::to_string(bytes[0] % kDescriptions.size()) + ".yaml"));
  } catch (const Error&) {
  }
  return 0;
}
