// SPDX-License-Identifier: GPL-3.0-or-later
// A folder as a loss of power leaves it.
#pragma once

#include <cstdint>
#include <filesystem>

namespace servocal::test {

/// Keeps beside a folder what of it is certain to survive a loss of power, and no more: of a file what it
/// held when it was last synced, of a folder the names it had when it was last synced. Files and names are
/// told apart as disks do it: a file that was synced and renamed still has its old name, or none, until its
/// folder is synced.
class SurvivingDisk {
 public:
  /// All that is in `folder` now survives. What survives later is kept in `shadow`, an empty folder.
  SurvivingDisk(const std::filesystem::path& folder, const std::filesystem::path& shadow);

  /// To be called in place of fsync(descriptor), in whichever process; it may be killed in here.
  void sync(int descriptor) const;

  /// What was not synced is lost; or of it, sector by sector of 512 bytes and name by name, some is lost and
  /// some is not.
  enum class Unsynced { kLost, kPartly };
  /// Makes of `to`, an empty folder, what is found after the power comes back.
  void restore(const std::filesystem::path& to, Unsynced unsynced, std::uint64_t seed) const;

 private:
  std::filesystem::path folder_, shadow_;
};

}  // namespace servocal::test
