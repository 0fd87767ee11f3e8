// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever stands in a pose file is a pose or an Error. The first byte chooses how the file is described.
#include <array>

#include "fuzz_files.h"
#include "servocal/core/error.h"
#include "servocal/session/image_set.h"

namespace {

/// How a file is described, and one that is sound.
struct Format {
  const char* description;
  const char* sound;
};

constexpr std::array kFormats = {
    Format{"format: matrix\n  length_unit: m\n  files: \"{stem}.txt\"",
           "1 0 0 0\n0 1 0 0\n0 0 1 0.5\n0 0 0 1\n"},
    Format{"format: matrix\n  length_unit: mm\n  files: \"{stem}.txt\"\n  key: pose.matrix",
           "pose: {matrix: [[1, 0, 0, 100], [0, 1, 0, 200], [0, 0, 1, 500], [0, 0, 0, 1]]}\n"},
    Format{"format: quaternion\n  length_unit: m\n  files: \"{stem}.txt\"\n  keys: [x, y, z, q.x, q.y, q.z, "
           "q.w]",
           "x: 0.1\ny: 0.2\nz: 0.3\nq: {x: 0, y: 0, z: 0, w: 1}\n"},
    Format{"format: rotation_vector\n  length_unit: m\n  angle_unit: deg\n  table: poses.txt\n"
           "  columns: [image, x, y, z, rx, ry, rz]",
           "a1, 0.1, 0.2, 0.3, 10, 20, 30 # comment\na2; 0.1; 0.2; 0.3; 11; 21; 31\n"},
    Format{"format: euler\n  length_unit: mm\n  angle_unit: rad\n  euler_order: intrinsic_zyz\n  table: "
           "poses.txt\n"
           "  columns: [x, y, z, a1, a2, a3]\n  skip_lines: 1",
           "x y z a b c\n100 200 300 0.1 0.2 0.3\n101 201 301 0.2 0.3 0.4\n"},
    Format{"format: quaternion\n  length_unit: m\n  table: poses.txt\n  columns: [image, skip, x, y, z, qx, "
           "qy, qz, qw]",
           "a1 9 0.1 0.2 0.3 0 0 0 1\na2 9 0.1 0.2 0.4 0 0 1 0\n"},
    Format{"format: matrix\n  length_unit: m\n  table: poses.txt\n  columns: [image, matrix]",
           "a1 1 0 0 0 0 1 0 0 0 0 1 0.5 0 0 0 1\na2 1 0 0 0 0 1 0 0 0 0 1 0.6 0 0 0 1\n"},
    Format{"format: visp\n  files: \"{stem}.txt\"",
           "rows: 6\ncols: 1\ndata:\n  - [0.1]\n  - [0.2]\n  - [0.3]\n  - [0.1]\n  - [0.2]\n  - [0.3]\n"}};

using namespace servocal;

void load(const std::filesystem::path& folder, std::size_t format, const void* bytes, std::size_t size) {
  for (const char* name : {"a1.txt", "a2.txt", "poses.txt"}) fuzz::write(folder / name, bytes, size);
  session::loadImageSets(folder / (std::to_string(format) + ".yaml"));
}

std::filesystem::path describedFolder() {
  const auto folder = fuzz::ownFolder("poses");
  for (const char* name : {"a1.png", "a2.png"}) fuzz::writeImage(folder / name);
  for (std::size_t i = 0; i < kFormats.size(); ++i) {
    fuzz::write(folder / (std::to_string(i) + ".yaml"),
                std::string("board: {squares_x: 7, squares_y: 5, square_size_m: 0.03, hollow_corner: true}\n"
                            "images: \"*.png\"\nmount: eye_to_hand\nposes:\n  pose: bMe\n  ") +
                    kFormats[i].description + "\n");
    // An Error here would mean that no input ever gets as far as its pose file.
    const std::string sound = kFormats[i].sound;
    load(folder, i, sound.data(), sound.size());
  }
  return folder;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  if (size < 1) return 0;
  static const std::filesystem::path folder = describedFolder();
  try {
    load(folder, bytes[0] % kFormats.size(), bytes + 1, size - 1);
  } catch (const Error&) {
  }
  return 0;
}
