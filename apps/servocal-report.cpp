// SPDX-License-Identifier: GPL-3.0-or-later
#include <filesystem>
#include <fstream>
#include <iostream>

#include "servocal/app/main.h"
#include "servocal/core/error.h"
#include "servocal/report/page.h"
#include "servocal/report/report.h"

namespace {

using namespace servocal;

constexpr const char* kFooter = R"(
The page is one file, opens offline and prints; its numbers stand in report.json beside it (docs/report.md).
From a session it also shows what only the observations know: residual vectors, depth errors, visited
poses, hand-eye error against the number of views, the timeline.

Moves no robot. The exit code says whether the goal was met, as the calibration's did.

Example:
  $ servocal-report runs/first
  Goal met.
  Wrote runs/first/report.html and runs/first/report.json
)";

void write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw Error(ErrorKind::kBadData, "cannot write '" + file.string() + "'");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Writes a calibration as a page: verdict first, then what it rests on.", "servocal-report");
  cli.footer(kFooter);
  std::filesystem::path input, out;
  cli.add_option("INPUT", input, "Session folder that holds a result.yaml, or a result file")->required();
  cli.add_option("--out", out, "The page; report.html beside the result if not given")
      ->check([](const std::string& name) {
        return std::filesystem::path(name).extension() == ".html" ? "" : "must end in .html";
      });
  return app::guardedMain(cli, argc, argv, [&] {
    const report::ReportInput read = report::loadReportInput(input);
    if (out.empty())
      out = (std::filesystem::is_directory(input) ? input : input.parent_path()) / "report.html";
    const std::string json = report::reportJson(read);
    const std::filesystem::path numbers = std::filesystem::path(out).replace_extension(".json");
    std::error_code ignored;
    if (out.has_parent_path()) std::filesystem::create_directories(out.parent_path(), ignored);
    write(numbers, json);
    write(out, report::reportPage(json));
    std::cout << (read.result.goal_met ? "Goal met.\n" : "Goal not met.\n");
    for (const std::string& missing : read.result.missing) std::cout << "  - " << missing << '\n';
    std::cout << "Wrote " << out.string() << " and " << numbers.string() << '\n';
    return read.result.goal_met ? app::kOk : app::kGoalNotMet;
  });
}
