// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace servocal::session {

/// Writes a file whole or not at all: to a temporary name beside it, synced to the disk, renamed. The
/// name itself is durable after syncFolder().
/// @throws Error (kBadData) naming the file and the system's reason; the temporary file is removed.
void writeWhole(const std::filesystem::path& file, const void* data, std::size_t size);

/// Makes the names in a folder durable.
/// @throws Error (kBadData).
void syncFolder(const std::filesystem::path& folder);

/// Makes a folder with its parents, names durable.
/// @throws Error (kBadData).
void makeFolder(const std::filesystem::path& folder);

/// An exclusive lock on a file, held until destruction and dropped by the system if the program dies.
class FileLock {
 public:
  /// @throws Error (kBadData) if the file cannot be made, or somebody else holds the lock.
  explicit FileLock(const std::filesystem::path& file);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  int descriptor_ = -1;
};

}  // namespace servocal::session
