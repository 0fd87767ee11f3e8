// SPDX-License-Identifier: GPL-3.0-or-later
// Detection on rendered frames, next to OpenCV's two finders and to libapriltag: recall by tilt, corner
// error, wrong orientations and boards, z-scores, CPU time. One thread.
#include <CLI/CLI.hpp>
#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>

#include "detection_frames.h"
#include "detection_peers.h"
#include "detection_records.h"
#include "servocal/board/detector.h"
#include "tag_pictures.h"

namespace {

using namespace servocal;
using bench::Record;
using Eigen::Vector2d;
using test::Picture;
using test::PictureOptions;

struct Options {
  int vga = 2800, ir = 1400, hd = 800;  // Frames with a board.
  int first = 0;
  int peers_every = 8, hd_peers_every = 5;
  int repeat = 3;
  unsigned seed = 1;
  bool ours = true;
  std::string records, pictures;
};

double cpuMs() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return time.tv_sec * 1e3 + time.tv_nsec * 1e-6;
}

double rms(const peers::Points& found, const peers::Points& truth) {
  double sum = 0;
  for (std::size_t k = 0; k < found.size(); ++k) sum += (found[k] - truth[k]).squaredNorm();
  return std::sqrt(sum / found.size());
}

// Where the board's orientation is not known: the better of both orders counts.
double rmsEitherWay(const peers::Points& found, peers::Points truth) {
  const double straight = rms(found, truth);
  std::reverse(truth.begin(), truth.end());
  return std::min(straight, rms(found, truth));
}

// The median time of a few repetitions: other programs disturb single ones.
template <class Work>
auto timed(int repeat, Record& record, Work work) {
  std::vector<double> ms;
  while (true) {
    const double start = cpuMs();
    auto result = work();
    ms.push_back(cpuMs() - start);
    if (static_cast<int>(ms.size()) < repeat) continue;
    std::nth_element(ms.begin(), ms.begin() + ms.size() / 2, ms.end());
    record.cpu_ms = ms[ms.size() / 2];
    record.found = static_cast<bool>(result);
    return result;
  }
}

class Run {
 public:
  Run(const cv::Size& camera, const Options& options)
      : camera_(camera), options_(options),
        camera_name_(std::to_string(camera.width) + 'x' + std::to_string(camera.height)) {}

  std::vector<Record> records;

  void boards(int frame, bool peers_too) {
    const PictureOptions o = test::boardFrame(options_.seed, board_, camera_, frame);
    const Picture picture = test::renderPicture(board_, o);
    Record record = begin("board", frame);
    record.mark_px = test::markSidePx(board_, o);
    if (options_.ours) {
      board::Detector detector(board_);
      const auto detection = timed(options_.repeat, record, [&] {
        detector.reset();
        return detector.detect(picture.gray);
      });
      if (detection) judge(*detection, picture, record);
      add(record, "servocal");
      const bool poor =
          !detection || record.error_px > 1 || record.turn < 0 || (record.mark_px >= 6 && record.turn == 0);
      if (poor) keep(picture.gray, record);
      if (detection) track(detector, o, frame);
    }
    if (!peers_too) return;
    const cv::Size size(6, 4);
    for (const bool sectors : {false, true}) {
      Record theirs = begin("board", frame);
      const double start = cpuMs();
      const auto corners =
          sectors ? peers::sectorBased(picture.gray, size) : peers::classic(picture.gray, size);
      theirs.cpu_ms = cpuMs() - start;
      theirs.found = corners.has_value();
      if (corners) theirs.error_px = rmsEitherWay(*corners, picture.corners);
      add(theirs, sectors ? "sectors" : "classic");
    }
  }

  // Frames in which the board is not. `kind`: clutter and texture, boards of another size, a covered one.
  void withoutBoard(const std::string& kind, int frame, bool peers_too) {
    const cv::Mat gray = kind == "empty"     ? test::emptyFrame(options_.seed, camera_, frame)
                         : kind == "covered" ? test::coveredFrame(options_.seed, camera_, frame)
                                             : test::otherBoardFrame(options_.seed, camera_, frame);
    if (options_.ours) {
      expectNothing(kind, frame, gray, board_);
      if (kind == "other")
        expectNothing("other-plain", frame, gray, BoardSpec{Checkerboard{7, 5, 0.03, false}});
    }
    // The classic finder may take minutes for one large texture.
    if (!peers_too || (kind == "empty" && camera_.area() > 1000000)) return;
    for (const bool sectors : {false, true}) {
      Record record = begin(kind, frame);
      const double start = cpuMs();
      record.found = (sectors ? peers::sectorBased(gray, {6, 4}) : peers::classic(gray, {6, 4})).has_value();
      record.cpu_ms = cpuMs() - start;
      add(record, sectors ? "sectors" : "classic");
    }
  }

  void tags(int frame) {
    TagGrid grid;
    grid.tags_x = 4;
    grid.tags_y = 3;
    const BoardSpec board{grid};
    std::mt19937 random = test::frameRandom(options_.seed, camera_, 4, frame);
    test::TagPictureOptions o;
    static_cast<PictureOptions&>(o) =
        test::drawVisible(random, board, camera_, test::kTilts[frame % 8], 20, 80);
    const Picture picture = test::renderTags(board, o);
    Record record = begin("tags", frame);
    record.shown = grid.tags_x * grid.tags_y;
    board::Detector detector(board);
    const auto detection = timed(options_.repeat, record, [&] {
      detector.reset();
      return detector.detect(picture.gray);
    });
    if (detection) {
      record.found = static_cast<int>(detection->corners.size()) / 4;
      scores(*detection, picture, record);
    }
    add(record, "servocal");

    Record theirs = begin("tags", frame);
    theirs.shown = record.shown;
    std::map<int, peers::Points> seen;
    timed(options_.repeat, theirs, [&] {
      seen = april_.read(picture.gray);
      return !seen.empty();
    });
    theirs.found = 0;
    double squares = 0;
    for (int place = 0; place < theirs.shown; ++place) {
      const auto tag = seen.find(grid.code(place));
      if (tag == seen.end()) continue;
      ++theirs.found;
      for (int k = 0; k < 4; ++k) squares += (tag->second[k] - picture.corners[4 * place + k]).squaredNorm();
    }
    theirs.error_px = theirs.found ? std::sqrt(squares / (4 * theirs.found)) : 0;
    add(theirs, "apriltag");
  }

 private:
  Record begin(const std::string& kind, int frame) const {
    Record record;
    record.camera = camera_name_;
    record.kind = kind;
    record.frame = frame;
    record.tilt_deg = kind == "board" || kind == "tags" || kind == "tracked" ? test::kTilts[frame % 8] : 0;
    return record;
  }

  void add(Record record, const std::string& by) {
    record.by = by;
    records.push_back(record);
  }

  void keep(const cv::Mat& gray, const Record& record) const {
    if (options_.pictures.empty()) return;
    cv::imwrite(options_.pictures + '/' + record.camera + '-' + record.kind + '-' +
                    std::to_string(record.frame) + ".png",
                gray);
  }

  static void scores(const BoardDetection& detection, const Picture& picture, Record& record) {
    double squares = 0;
    for (const Corner& corner : detection.corners) {
      const Vector2d error = corner.pixel - picture.corners[corner.id];
      squares += error.squaredNorm();
      record.z_squares += corner.covariance_px2.llt().matrixL().solve(error).squaredNorm();
      record.z_count += 2;
    }
    record.error_px = std::sqrt(squares / detection.corners.size());
  }

  static void judge(const BoardDetection& detection, const Picture& picture, Record& record) {
    peers::Points found;
    for (const Corner& corner : detection.corners) found.push_back(corner.pixel);
    record.error_px = rmsEitherWay(found, picture.corners);
    if (!detection.orientation_known) return;
    record.turn = record.error_px < rms(found, picture.corners) ? -1 : 1;
    if (record.turn > 0 && record.error_px < 2) scores(detection, picture, record);
  }

  void track(board::Detector& detector, PictureOptions o, int frame) {
    std::mt19937 random = test::frameRandom(options_.seed, camera_, 5, frame);
    for (int step = 0; step < 2; ++step) {
      o.centre_px += Vector2d(8, -5);
      o.roll_rad += 0.01;
      o.seed = random();
      if (!test::wholePlateInside(board_, o)) return;
      const Picture picture = test::renderPicture(board_, o);
      Record record = begin("tracked", frame);
      const double start = cpuMs();
      const auto detection = detector.track(picture.gray);
      record.cpu_ms = cpuMs() - start;
      record.found = detection.has_value();
      if (detection) judge(*detection, picture, record);
      add(record, "servocal");
      if (!detection) return;
    }
  }

  void expectNothing(const std::string& kind, int frame, const cv::Mat& gray, const BoardSpec& board) {
    Record record = begin(kind, frame);
    board::Detector detector(board);
    timed(options_.repeat, record, [&] {
      detector.reset();
      return detector.detect(gray).has_value();
    });
    add(record, "servocal");
    if (record.found) keep(gray, record);
  }

  const BoardSpec board_;
  const cv::Size camera_;
  const Options& options_;
  const std::string camera_name_;
  peers::AprilTag april_;
};

std::vector<Record> run(const cv::Size& camera, int frames, const Options& options) {
  Run run(camera, options);
  const int every = camera.area() > 1000000 ? options.hd_peers_every : options.peers_every;
  for (int frame = options.first; frame < options.first + frames; ++frame) {
    // Groups of eight hold every tilt once.
    const bool peers_too = every > 0 && frame / 8 % every == 0;
    if (options.ours || peers_too) run.boards(frame, peers_too);
    // One frame without a board to four with: clutter, textures, other boards, covered ones in turn.
    if (frame % 4 == 0) {
      const int number = frame / 4;
      const char* kind = number % 4 < 2 ? "empty" : number % 4 == 2 ? "other" : "covered";
      const bool theirs = every > 0 && number / 4 % every == 0;
      if (options.ours || theirs)
        run.withoutBoard(kind, number % 4 < 2 ? number / 4 * 2 + number % 4 : number / 4, theirs);
    }
    if (options.ours && frame / 8 % 4 == 0) run.tags(frame);
  }
  return run.records;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Measures board detection on rendered frames, next to OpenCV's finders and libapriltag.",
               "detection_bench");
  Options options;
  std::vector<std::string> merge;
  cli.add_option("--vga", options.vga, "Frames with a board at 640 x 480; a quarter as many without")
      ->capture_default_str();
  cli.add_option("--ir", options.ir, "The same at 512 x 424")->capture_default_str();
  cli.add_option("--hd", options.hd, "The same at 1920 x 1080")->capture_default_str();
  cli.add_option("--first", options.first, "Number of the first frame: parts of a run by range")
      ->capture_default_str();
  cli.add_option("--peers-every", options.peers_every,
                 "OpenCV sees one group of 8 frames in this many; 0: none")
      ->capture_default_str();
  cli.add_option("--hd-peers-every", options.hd_peers_every,
                 "The same at 1920 x 1080, where it takes seconds per frame")
      ->capture_default_str();
  cli.add_option("--repeat", options.repeat, "Runs of our detector per frame; CPU times are their median")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  cli.add_option("--seed", options.seed, "Seed of the frames")->capture_default_str();
  cli.add_flag("!--only-peers", options.ours, "Leave our own detector out");
  cli.add_option("--records", options.records, "Append one line per frame and detector to this file");
  cli.add_option("--pictures", options.pictures,
                 "Directory for pictures of misses, false boards, undecided turns");
  cli.add_option("--merge", merge, "Measure nothing: print the tables of these files of records");
  CLI11_PARSE(cli, argc, argv);
  cv::setNumThreads(1);
  std::vector<Record> records;
  for (const std::string& file : merge) {
    std::ifstream in(file);
    if (!in) {
      std::cerr << "Cannot read " << file << '\n';
      return 2;
    }
    for (Record record; in >> record;) records.push_back(record);
  }
  if (merge.empty()) {
    const std::pair<cv::Size, int> cameras[] = {
        {{640, 480}, options.vga}, {{512, 424}, options.ir}, {{1920, 1080}, options.hd}};
    for (const auto& [camera, frames] : cameras) {
      const std::vector<Record> some = run(camera, frames, options);
      records.insert(records.end(), some.begin(), some.end());
    }
    if (!options.records.empty()) {
      std::ofstream out(options.records, std::ios::app);
      for (const Record& record : records) out << record.line() << '\n';
    }
  }
  bench::printTables(records);
  return 0;
}
