// SPDX-License-Identifier: GPL-3.0-or-later
#include <iostream>
#include <map>

#include "servocal/app/main.h"
#include "servocal/core/error.h"
#include "servocal/procedure/recorded.h"
#include "servocal/procedure/summary.h"
#include "servocal/session/image_set.h"
#include "servocal/session/session.h"

namespace {

using namespace servocal;

constexpr const char* kFooter = R"(
Views that contradict the others are left out and named with the cause (another board or camera,
blurred, wrong robot pose, pose flip); the result with them stands beside. Where robot poses and images
contradict each other altogether, the way to read the poses in which they agree is named, not applied:
units, inversion, order of angles, mount, size of the board. Exit code 8.

Moves no robot.

Example (one robot pose is 40 mm off):
  $ servocal-solve set.yaml
  Goal met.
  Camera cam
    Intrinsics, 640 x 480 px, plumb_bob, from 9 of 10 views (270 corners), residual 0.004 px RMS
      fx      699.897 +- 0.048 px    fy      699.908 +- 0.049 px
      ...
    Hand-eye
      ...
      left out: view5.png (wrong robot pose: it is 40.0 mm and 0.01 deg from where the image puts the arm)
  Wrote result.yaml
)";

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli(
      "Solves a recorded session, or folders of images described by a manifest: intrinsics, with robot\n"
      "poses where the camera stands, and of several cameras how they stand to each other.",
      "servocal-solve");
  cli.footer(kFooter);
  std::filesystem::path input, root, out;
  bool json = false;
  procedure::SolveOverrides overrides;
  const std::map<std::string, LensModel> lenses = {{"plumb_bob", LensModel::kPlumbBob},
                                                   {"rational_polynomial", LensModel::kRational}};
  cli.add_option("INPUT", input, "Session folder, or manifest of a folder of images (docs/manifest.md)")
      ->required();
  cli.add_option("--root", root, "Where the manifest's relative paths start; its own folder if not given");
  cli.add_option("--out", out,
                 "Result file, .yaml or .json; result.yaml if neither --out nor --json is given")
      ->check([](const std::string& name) {
        const std::string ending = std::filesystem::path(name).extension();
        return ending == ".yaml" || ending == ".yml" || ending == ".json" ? "" : "must end in .yaml or .json";
      });
  cli.add_flag("--json", json, "Print the result as JSON on stdout, the summary on stderr");
  cli.add_option("--lens", overrides.lens,
                 "Lens model instead of the input's: plumb_bob, rational_polynomial")
      ->transform(CLI::CheckedTransformer(lenses));
  cli.add_option("--fixed", overrides.fixed, "Distortion parameters held at zero, e.g. p1,p2,k3")
      ->delimiter(',')
      ->check(CLI::IsMember({"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}));
  return app::guardedMain(cli, argc, argv, [&] {
    const bool recorded = session::isSession(input);
    if (!recorded && std::filesystem::is_directory(input)) {
      throw Error(ErrorKind::kBadData,
                  "folder '" + input.string() + "' holds no session; name a session or a manifest");
    }
    CalibrationResult result = recorded
                                   ? procedure::solveRecorded(session::Session::open(input), overrides)
                                   : procedure::solveImages(session::loadImageSets(input, root), overrides);
    result.provenance = "servocal-solve " + input.string();
    (json ? std::cerr : std::cout) << procedure::summary(result);
    if (json) std::cout << session::resultJson(result);
    if (out.empty() && !json) out = "result.yaml";
    if (!out.empty()) {
      session::saveResult(out, result);
      (json ? std::cerr : std::cout) << "Wrote " << out.string() << '\n';
    }
    return result.goal_met ? app::kOk : app::kGoalNotMet;
  });
}
