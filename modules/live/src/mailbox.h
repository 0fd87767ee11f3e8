// SPDX-License-Identifier: GPL-3.0-or-later
// Between the run's thread and the server's: the newest of everything, never a queue that could fill.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servocal/procedure/calibrate.h"

namespace servocal::live {

using EyeName = std::pair<std::string, Stream>;

struct NumberedLook {
  std::uint64_t number = 0;  ///< Rises with every look at any eye.
  procedure::Look look;
};

/// A moment of a drive, for the curves.
struct ServoSample {
  double at_s = 0.0;
  std::optional<double> error_px;
  double speed_mps = 0.0;
  std::optional<double> wanted_mps;  ///< Speed that is commanded.
  double turn_radps = 0.0;
};

struct SigmaSample {
  double at_s = 0.0;
  double sigma_m = 0.0;
};

struct Ending {
  bool goal_met = false;
  std::string verdict;
};

/// Everything the page shows, at one moment. Looks are shared, not copied.
struct Snapshot {
  std::optional<procedure::Event> event;  ///< The newest.
  std::map<EyeName, std::shared_ptr<const NumberedLook>> looks;
  std::deque<ServoSample> servo;
  std::map<EyeName, std::deque<SigmaSample>> sigma;
  std::deque<std::pair<double, std::string>> messages;  ///< With the run's time, s.
  std::optional<Ending> ending;
};

/// put() and snapshot() hold a lock for as long as copying takes. put(look) does not even wait for that lock:
/// the look is dropped, another one is soon to come.
class Mailbox {
 public:
  void put(const procedure::Event& event);
  void put(const procedure::Look& look);
  void put(const Ending& ending);
  Snapshot snapshot() const;
  std::shared_ptr<const NumberedLook> look(const EyeName& eye) const;

 private:
  mutable std::mutex mutex_;
  Snapshot newest_;
  std::uint64_t looks_ = 0;
};

}  // namespace servocal::live
