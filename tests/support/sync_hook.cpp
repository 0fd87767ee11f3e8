// SPDX-License-Identifier: GPL-3.0-or-later
#include "sync_hook.h"

#include <sys/syscall.h>
#include <unistd.h>

#include <utility>

namespace servocal::test {
namespace {

std::function<void(int)> hook;

int synced(int descriptor, long call) {
  if (!hook) return static_cast<int>(syscall(call, descriptor));
  hook(descriptor);
  return 0;
}

}  // namespace

SyncHook::SyncHook(std::function<void(int)> on_sync) { hook = std::move(on_sync); }
SyncHook::~SyncHook() { hook = nullptr; }

}  // namespace servocal::test

// The program's own come before the C library's, for the libraries it loads too.
extern "C" int fsync(int descriptor) { return servocal::test::synced(descriptor, SYS_fsync); }
extern "C" int fdatasync(int descriptor) { return servocal::test::synced(descriptor, SYS_fdatasync); }
