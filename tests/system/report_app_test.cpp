// SPDX-License-Identifier: GPL-3.0-or-later
// servocal-export and servocal-report as a person runs them; the page in the browser it is for.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "errors.h"
#include "recorded_cell.h"
#include "run_program.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

using test::expectPart;

constexpr const char* kByPage = "\"initiator\":\"null\"";

std::string slurp(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

/// Processor time of the programs that were run and have ended, s.
double childrenS() {
  rusage usage{};
  getrusage(RUSAGE_CHILDREN, &usage);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

/// What a page wrote to the console. A driver's remark on its own speed is not the page's.
std::string complaints(const std::string& log) {
  std::istringstream lines(log);
  std::string found;
  for (std::string line; std::getline(lines, line);) {
    const bool said = line.find("CONSOLE") != std::string::npos;
    if (said && line.find("GL Driver Message (OpenGL, Performance") == std::string::npos)
      found += line + "\n";
  }
  return found;
}

class ReportApps : public ::testing::Test {
 protected:
  const test::TemporaryFolder folder_;

  std::string path(const std::string& name) const { return test::shellWord((folder_ / name).string()); }
  void record(int cameras, int stops) const { test::RecordedCell(cameras, stops).save(folder_ / "run"); }

  /// Runs Chromium on a page that was written, without network, and returns the page as it ended up (stdout)
  /// and what the console said (stderr).
  test::ProgramRun browse(const std::string& page) const {
    return test::runProgram(
        "timeout 240 chromium --headless=new --no-sandbox --disable-gpu --disable-dev-shm-usage "
        "--use-angle=swiftshader --enable-unsafe-swiftshader --user-data-dir=" +
        path("profile") + " --log-net-log=" + path("net.json") +
        " --enable-logging=stderr --virtual-time-budget=60000 --window-size=1200,2000 --dump-dom file://" +
        (folder_ / page).string());
  }
};

TEST_F(ReportApps, ExportSaysWhatItWroteAndWhereFramesAre) {
  record(2, 12);
  const test::ProgramRun run =
      test::runProgram(SERVOCAL_EXPORT " " + path("run") + " --format ros2-static-tf --out " + path("ros") +
                       " --driver cam2=cam2_base,0,0.02,0,-0.5,0.5,-0.5,0.5");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  expectPart(run.out, "cam1_link in base: calibrated, bMc");
  expectPart(run.out, "cam2_base in base: calibrated, bMc; the frame from which the driver publishes");
  EXPECT_EQ(run.out.substr(run.out.rfind("Wrote")),
            "Wrote " + (folder_ / "ros/static_transforms.launch.py\n").string());
  EXPECT_TRUE(std::filesystem::exists(folder_ / "ros/static_transforms.launch.py"));
}

TEST_F(ReportApps, ExportRefusesWithReasonAndExitCode) {
  record(1, 12);
  const auto expectRefusal = [&](const std::string& arguments, int exit_code, const std::string& part) {
    const test::ProgramRun run = test::runProgram(SERVOCAL_EXPORT " " + arguments + " --out " + path("out"));
    EXPECT_EQ(run.exit_code, exit_code) << run.err;
    expectPart(run.err, part);
    EXPECT_EQ(run.out, "");
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out"));
  };
  expectRefusal(path("run") + " --format kalibr", 2, "Kalibr's radtan (k1 k2 p1 p2) has no k3");
  expectRefusal(path("run") + " --format word", 2, "--format");
  expectRefusal(path("run") + " --format urdf --driver cam1=link,0,0", 2,
                "must be CAMERA=FRAME,x,y,z,qx,qy,qz,qw");
  expectRefusal(path("run") + " --format urdf --driver cam9=link,0,0,0,0,0,0,1", 2,
                "'cam9', which the result does not have");
  expectRefusal(path("nowhere.yaml") + " --format urdf", 8, "there is no such file");
}

TEST_F(ReportApps, ReportOfAResultAlone) {
  record(1, 12);
  CalibrationResult result = session::loadResult(folder_ / "run/result.yaml");
  result.goal_met = false;
  result.missing = {"cam1: 3 of 40 image cells are not filled </script>"};
  session::saveResult(folder_ / "alone.json", result);
  const test::ProgramRun run =
      test::runProgram(SERVOCAL_REPORT " " + path("alone.json") + " --out " + path("new/page.html"));
  EXPECT_EQ(run.exit_code, 4) << run.err;
  expectPart(run.out, "Goal not met.\n  - cam1: 3 of 40");
  const auto numbers = nlohmann::json::parse(slurp(folder_ / "new/page.json"));
  EXPECT_EQ(numbers["verdict"]["missing"][0], result.missing[0]);
  EXPECT_EQ(numbers["next_steps"][0], "Still missing: " + result.missing[0] + ".");
  // Text of the data cannot leave its place in the page.
  const std::string page = slurp(folder_ / "new/page.html");
  EXPECT_EQ(page.find("filled </script>"), std::string::npos);
  expectPart(page, "filled \\u003c/script>");
}

TEST_F(ReportApps, AnUnsolvedSessionSaysSo) {
  record(1, 12);
  std::filesystem::remove(folder_ / "run/result.yaml");
  const test::ProgramRun run = test::runProgram(SERVOCAL_REPORT " " + path("run"));
  EXPECT_EQ(run.exit_code, 2);
  expectPart(run.err, "has no result.yaml yet; solve it first: servocal-solve");
}

// Three cameras and 200 stops, as large as a report gets: the time, the size, and the page in a browser.
TEST_F(ReportApps, LargeReportIsQuickSmallAndOpensWithoutErrorOrRequest) {
  record(3, 200);
  const double before_s = childrenS();
  const test::ProgramRun run = test::runProgram(SERVOCAL_REPORT " " + path("run"));
  const double took_s = childrenS() - before_s;
  ASSERT_EQ(run.exit_code, 0) << run.err;
  std::cout << "report: " << took_s << " s of processor time, "
            << std::filesystem::file_size(folder_ / "run/report.html") / 1e6 << " MB\n";
  EXPECT_LT(took_s, 3.0);
  EXPECT_LT(std::filesystem::file_size(folder_ / "run/report.html"), 8'000'000u);

  if (test::runProgram("chromium --version").exit_code != 0) GTEST_SKIP() << "chromium is not installed";
  const test::ProgramRun page = browse("run/report.html");
  ASSERT_EQ(page.exit_code, 0) << page.err;
  EXPECT_EQ(complaints(page.err), "");
  const std::string body = page.out.substr(0, page.out.find("<script type=\"application/json\""));
  EXPECT_EQ(body.find("has no WebGL"), std::string::npos);
  // Every chart that was asked for has drawn itself.
  std::smatch drawn;
  ASSERT_TRUE(std::regex_search(page.out, drawn, std::regex("data-drawn=\"(\\d+)\"")))
      << "the page did not finish";
  EXPECT_GT(std::stoi(drawn[1]), 40);
  std::size_t charts = 0;
  const std::string mark = "class=\"chart vega-embed";
  for (std::size_t at = 0; (at = body.find(mark, at)) != std::string::npos; ++at) ++charts;
  EXPECT_EQ(charts + 1, static_cast<std::size_t>(std::stoi(drawn[1])));  // and the 3D view
  // No request: in the browser's log those of a page from a file have the initiator "null", its own have
  // none.
  const std::string net = slurp(folder_ / "net.json");
  ASSERT_GT(net.size(), 1000u);
  EXPECT_EQ(net.find(kByPage), std::string::npos);
}

// On a phone nothing is wider than the screen; on paper every page has something on it, and the charts are
// there.
TEST_F(ReportApps, IsReadableOnAPhoneAndPrints) {
  for (const char* program : {"chromium --version", "pdftoppm -v"}) {
    if (test::runProgram(program).exit_code != 0) GTEST_SKIP() << program << " is not installed";
  }
  record(2, 40);
  ASSERT_EQ(test::runProgram(SERVOCAL_REPORT " " + path("run")).exit_code, 0);
  const auto browser = test::runProgram("timeout 300 python3 " SERVOCAL_REPORT_BROWSER " " +
                                        path("run/report.html") + " " + path("seen"));
  ASSERT_EQ(browser.exit_code, 0) << browser.err;
  const auto seen = nlohmann::json::parse(browser.out);
  for (const char* screen : {"phone", "desk"}) {
    EXPECT_GT(seen[screen]["drawn"], 20) << browser.out;
    EXPECT_EQ(seen[screen]["overflow"], 0) << screen;
    EXPECT_EQ(seen[screen]["cut"], nlohmann::json::array()) << screen;
    EXPECT_EQ(seen[screen]["blank"], 0) << screen;
  }
  EXPECT_GE(seen["pages"].size(), 5u);
  double most_color = 0.0, least_ink = 1.0;
  for (const auto& page : seen["pages"]) {
    most_color = std::max(most_color, page["color"].get<double>());
    least_ink = std::min(least_ink, page["ink"].get<double>());
  }
  std::cout << seen["pages"].size() << " pages, the emptiest with " << 100 * least_ink << " % ink\n";
  EXPECT_GT(least_ink, 0.005) << "a page is blank";
  EXPECT_GT(most_color, 0.05) << "no chart has color";
  const auto text = test::runProgram("pdftotext -layout " + path("seen/report.pdf") + " -");
  // The last columns of wide tables are not cut off.
  for (const char* part : {"Goal met", "good is", "below 1 mm", "rotation vector", "Good looks like",
                           "Tilt limits", "Residual per view", "Timeline", "Provenance"})
    expectPart(text.out, part);
}

// Negative control: a page that does ask and does complain is noticed by the same measures.
TEST_F(ReportApps, TheBrowserCheckSeesErrorsAndRequests) {
  if (test::runProgram("chromium --version").exit_code != 0) GTEST_SKIP() << "chromium is not installed";
  folder_.write("bad.html",
                "<html><body><img "
                "src='http://127.0.0.1:9/picture.png'><script>console.error('oh')</script></body></html>");
  const test::ProgramRun page = browse("bad.html");
  expectPart(complaints(page.err), "oh");
  const std::string net = slurp(folder_ / "net.json");
  expectPart(net, "127.0.0.1:9");
  expectPart(net, kByPage);
}

}  // namespace
}  // namespace servocal
