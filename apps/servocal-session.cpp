// SPDX-License-Identifier: GPL-3.0-or-later
#include <iostream>

#include "servocal/app/main.h"
#include "servocal/session/check.h"

namespace {

using namespace servocal;

constexpr const char* kFooter = R"(
Moves no robot.

Example (an image was damaged on its disk):
  $ servocal-session check runs/first
  damaged: observation 12: image 'runs/first/images/000012_cam1_color.png' is not what was stored (40960 bytes)
  runs/first: 71 observations and 70 images can be read; see: servocal-session repair runs/first
  $ servocal-session repair runs/first
  dropped: observation 12: image '...' is not what was stored (40960 bytes); its corners are kept
  Saved 71 observations. The database as it was is in runs/first/backup-1
)";

void print(const char* what, const std::vector<std::string>& sentences) {
  for (const std::string& sentence : sentences) std::cout << what << ": " << sentence << '\n';
}

int check(const std::string& folder) {
  const session::SessionCheck check = session::checkSession(folder);
  print("damaged", check.damage);
  print("note", check.notes);
  std::cout << folder << ": " << check.observations << " observations and " << check.images
            << " images can be read"
            << (check.whole() ? "; nothing is damaged" : "; see: servocal-session repair " + folder) << '\n';
  return check.whole() ? app::kOk : app::kBadData;
}

int repair(const std::string& folder) {
  const session::SessionRepair repair = session::repairSession(folder);
  if (repair.backup.empty()) {
    std::cout << "Nothing is damaged; nothing was changed.\n";
    return app::kOk;
  }
  print("dropped", repair.dropped);
  std::cout << "Saved " << repair.observations << " observations. The database as it was is in "
            << repair.backup.string() << '\n';
  return app::kOk;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli(
      "Looks at the session that a run left behind: what is in it, whether it is whole; rebuilds a damaged "
      "one.",
      "servocal-session");
  cli.require_subcommand(1);
  cli.footer(kFooter);
  std::string folder;
  CLI::App* const check_verb =
      cli.add_subcommand("check", "Reads everything; exit code 8 if something is damaged");
  CLI::App* const show_verb = cli.add_subcommand("show", "What was observed and tried, and how it ended");
  CLI::App* const repair_verb =
      cli.add_subcommand("repair", "Keeps a backup, drops what cannot be read, says what that was");
  for (CLI::App* verb : {check_verb, show_verb, repair_verb}) {
    verb->add_option("FOLDER", folder, "Session folder")->required();
  }
  return app::guardedMain(cli, argc, argv, [&] {
    if (check_verb->parsed()) return check(folder);
    if (repair_verb->parsed()) return repair(folder);
    std::cout << session::describeSession(session::Session::open(folder));
    return static_cast<int>(app::kOk);
  });
}
