// SPDX-License-Identifier: GPL-3.0-or-later
#include "detection_records.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

namespace servocal::bench {
namespace {

using Chosen = std::vector<const Record*>;

constexpr double kMisplacedPx = 2.0;
constexpr double kMarkPx = 6.0;

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(q * values.size()))];
}

Chosen choose(const std::vector<Record>& records, const std::string& camera, const std::string& kind,
              const std::string& by) {
  Chosen chosen;
  for (const Record& r : records)
    if (r.camera == camera && r.kind == kind && r.by == by) chosen.push_back(&r);
  return chosen;
}

bool isHit(const Record& r) { return r.found > 0 && r.error_px <= kMisplacedPx; }

int countMisplaced(const Chosen& records) {
  return static_cast<int>(std::count_if(records.begin(), records.end(),
                                        [](const Record* r) { return r->found > 0 && !isHit(*r); }));
}

std::vector<double> errors(const Chosen& records) {
  std::vector<double> values;
  for (const Record* r : records)
    if (isHit(*r)) values.push_back(r->error_px);
  return values;
}

std::string times(const Chosen& records) {
  std::vector<double> values;
  for (const Record* r : records) values.push_back(r->cpu_ms);
  if (values.empty()) return "";
  char text[64];
  std::snprintf(text, sizeof text, "%8.2f %8.2f", quantile(values, 0.5), quantile(values, 0.95));
  return text;
}

void recallLine(const std::string& name, const Chosen& records, const std::set<int>& tilts) {
  if (records.empty()) return;
  std::map<int, std::pair<int, int>> by_tilt;  // Found, shown.
  for (const Record* r : records) {
    by_tilt[r->tilt_deg].second += r->shown;
    if (isHit(*r)) by_tilt[r->tilt_deg].first += r->found;
  }
  std::printf("%-22s", name.c_str());
  for (const int tilt : tilts) std::printf(" %5.1f", 100.0 * by_tilt[tilt].first / by_tilt[tilt].second);
  std::printf(" | %6zu | %6.3f %6.3f | %5d | %s\n", records.size(), quantile(errors(records), 0.5),
              quantile(errors(records), 0.9), countMisplaced(records), times(records).c_str());
}

// Those of ours on the frames that a peer saw too.
Chosen sameFrames(const Chosen& ours, const Chosen& theirs) {
  std::set<int> frames;
  for (const Record* r : theirs) frames.insert(r->frame);
  Chosen same;
  for (const Record* r : ours)
    if (frames.count(r->frame)) same.push_back(r);
  return same;
}

// Median errors where all found what was shown.
void printCommon(const std::vector<Chosen>& finders, const std::vector<std::string>& names) {
  std::map<int, int> hits;
  for (const Chosen& finder : finders)
    for (const Record* r : finder) hits[r->frame] += isHit(*r) && r->found == r->shown;
  std::size_t count = 0;
  std::string line;
  for (std::size_t k = 0; k < finders.size(); ++k) {
    std::vector<double> values;
    for (const Record* r : finders[k])
      if (hits[r->frame] == static_cast<int>(finders.size())) values.push_back(r->error_px);
    count = values.size();
    char text[80];
    std::snprintf(text, sizeof text, " %s %.3f", names[k].c_str(), quantile(values, 0.5));
    line += text;
  }
  if (count > 0) std::printf("median RMS px on the %zu frames all found:%s\n", count, line.c_str());
}

void printFalse(const std::vector<Record>& records, const std::string& camera, const std::string& kind) {
  for (const std::string by : {"servocal", "classic", "sectors"}) {
    const Chosen chosen = choose(records, camera, kind, by);
    if (chosen.empty()) continue;
    const auto count =
        std::count_if(chosen.begin(), chosen.end(), [](const Record* r) { return r->found > 0; });
    std::printf("%-12s %-10s false %3ld of %5zu | CPU ms %s", kind.c_str(), by.c_str(),
                static_cast<long>(count), chosen.size(), times(chosen).c_str());
    int listed = 0;
    for (const Record* r : chosen)
      if (r->found > 0 && by == "servocal" && listed++ < 12) std::printf(" #%d", r->frame);
    std::printf("\n");
  }
}

// Of all frames in which the board is not, sought as it is.
void printBoardFree(const std::vector<Record>& records, const std::string& camera) {
  for (const std::string by : {"servocal", "classic", "sectors"}) {
    Chosen all;
    for (const char* kind : {"empty", "other", "covered"}) {
      const Chosen some = choose(records, camera, kind, by);
      all.insert(all.end(), some.begin(), some.end());
    }
    if (all.empty()) continue;
    std::printf("board-free   %-10s %5zu | CPU ms %s\n", by.c_str(), all.size(), times(all).c_str());
  }
}

double zStd(const Chosen& records) {
  double squares = 0.0;
  int count = 0;
  for (const Record* r : records) {
    squares += r->z_squares;
    count += r->z_count;
  }
  return std::sqrt(squares / std::max(count, 1));
}

void printCamera(const std::vector<Record>& records, const std::string& camera) {
  std::set<int> tilts;
  for (const Record& r : records)
    if (r.kind == "board" || r.kind == "tags") tilts.insert(r.tilt_deg);
  const Chosen ours = choose(records, camera, "board", "servocal");
  const Chosen classic = choose(records, camera, "board", "classic");
  const Chosen sectors = choose(records, camera, "board", "sectors");
  std::printf("\n%s\n%-22s", camera.c_str(), "recall % by tilt");
  for (const int tilt : tilts) std::printf(" %4d'", tilt);
  std::printf(" | frames | RMS px    p90 | >2 px | CPU ms      p95\n");
  recallLine("servocal", ours, tilts);
  recallLine(" on OpenCV's frames", sameFrames(ours, classic), tilts);
  recallLine("classic + cornerSubPix", classic, tilts);
  recallLine("sectors (SB)", sectors, tilts);
  printCommon({ours, classic, sectors}, {"servocal", "classic", "sectors"});

  int visible = 0, undecided = 0, wrong = 0;
  for (const Record* r : ours) {
    wrong += r->found > 0 && r->turn < 0;
    if (!isHit(*r) || r->mark_px < kMarkPx) continue;
    ++visible;
    undecided += r->turn == 0;
  }
  const Chosen tracked = choose(records, camera, "tracked", "servocal");
  const auto kept = std::count_if(tracked.begin(), tracked.end(), [](const Record* r) { return isHit(*r); });
  std::printf("wrong turns %d; undecided %d of %d with a mark of 6 px (%.2f %%); z std %.2f\n", wrong,
              undecided, visible, 100.0 * undecided / std::max(visible, 1), zStd(ours));
  std::printf("tracked %ld of %zu | CPU ms %s\n", static_cast<long>(kept), tracked.size(),
              times(tracked).c_str());
  for (const char* kind : {"empty", "other", "other-plain", "covered"}) printFalse(records, camera, kind);
  printBoardFree(records, camera);

  const Chosen tags = choose(records, camera, "tags", "servocal");
  const Chosen april = choose(records, camera, "tags", "apriltag");
  recallLine("tags: servocal", tags, tilts);
  recallLine("tags: libapriltag", april, tilts);
  printCommon({tags, april}, {"servocal", "libapriltag"});
  if (!tags.empty()) std::printf("tags: z std %.2f\n", zStd(tags));
}

}  // namespace

void printTables(const std::vector<Record>& records) {
  std::set<std::string> cameras;
  for (const Record& r : records) cameras.insert(r.camera);
  for (const std::string& camera : cameras) printCamera(records, camera);
}

}  // namespace servocal::bench
