// SPDX-License-Identifier: GPL-3.0-or-later
// Stands between a test's program and the disk: fsync() and fdatasync() of everything in it, SQLite included.
#pragma once

#include <functional>

namespace servocal::test {

/// While it lives, `on_sync` is called in place of every fsync() and fdatasync() of this process and of those
/// it forks. One at a time. Link sync_hook.cpp into the test's program.
class SyncHook {
 public:
  explicit SyncHook(std::function<void(int descriptor)> on_sync);
  ~SyncHook();
  SyncHook(const SyncHook&) = delete;
  SyncHook& operator=(const SyncHook&) = delete;
};

}  // namespace servocal::test
