// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever a manifest says of a folder with three pictures is a set of images or an Error.
#include "fuzz_files.h"
#include "servocal/core/error.h"
#include "servocal/session/image_set.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace servocal;
  static const std::filesystem::path folder = [] {
    const auto made = fuzz::ownFolder("manifest");
    for (const char* name : {"a1", "a2", "a10"}) {
      fuzz::writeImage(made / (std::string(name) + ".png"));
      fuzz::write(made / (std::string(name) + ".txt"), "1 0 0 0\n0 1 0 0\n0 0 1 0.5\n0 0 0 1\n");
    }
    fuzz::write(made / "poses.csv", "a1,0,0,0.5,0,0,0\na2,0,0,0.6,0,0.1,0\na10,0,0,0.7,0.2,0,0\n");
    return made;
  }();
  fuzz::write(folder / "set.yaml", bytes, size);
  try {
    session::loadImageSets(folder / "set.yaml");
  } catch (const Error&) {
  }
  return 0;
}
