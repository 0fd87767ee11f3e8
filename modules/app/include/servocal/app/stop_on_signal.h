// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>

namespace servocal::app {

/// While it lives, Ctrl-C, SIGTERM and a terminal that is closed (SIGHUP) call `stop` instead of ending the program; a
/// second signal ends it at once. A pipe whose reader is gone does not end it. A signal that was ignored when the
/// program began (nohup) stays ignored. One at a time.
class StopOnSignal {
 public:
  /// `stop` is called from a signal handler: it may do little more than set an atomic flag.
  explicit StopOnSignal(std::function<void()> stop);
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;
};

}  // namespace servocal::app
