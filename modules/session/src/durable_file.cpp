// SPDX-License-Identifier: GPL-3.0-or-later
#include "durable_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "servocal/core/error.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& what, int error_number) {
  std::string message = what + ": " + std::strerror(error_number);
  if (error_number == ENOSPC || error_number == EDQUOT) {
    message += "; what was stored before is safe, free some space and start again";
  }
  throw Error(ErrorKind::kBadData, message);
}

/// Closes a file descriptor on every way out.
struct Descriptor {
  int value;
  ~Descriptor() {
    if (value >= 0) ::close(value);
  }
};

void writeAll(int descriptor, const char* data, std::size_t size, const fs::path& file) {
  while (size > 0) {
    const ssize_t written = ::write(descriptor, data, size);
    if (written < 0) {
      if (errno == EINTR) continue;
      refuse("cannot write '" + file.string() + "'", errno);
    }
    data += written;
    size -= static_cast<std::size_t>(written);
  }
}

}  // namespace

void writeWhole(const fs::path& file, const void* data, std::size_t size) {
  const fs::path temporary = file.string() + ".tmp";
  try {
    const Descriptor out{::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644)};
    if (out.value < 0) refuse("cannot write '" + file.string() + "'", errno);
    writeAll(out.value, static_cast<const char*>(data), size, file);
    if (::fsync(out.value) != 0) refuse("cannot write '" + file.string() + "'", errno);
    if (::rename(temporary.c_str(), file.c_str()) != 0) refuse("cannot write '" + file.string() + "'", errno);
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
}

void syncFolder(const fs::path& folder) {
  const Descriptor descriptor{
      ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
  // Some network file systems cannot sync a folder (EINVAL); they order names by themselves.
  if (descriptor.value < 0 || (::fsync(descriptor.value) != 0 && errno != EINVAL)) {
    refuse("cannot write to folder '" + folder.string() + "'", errno);
  }
}

void makeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) refuse("cannot make folder '" + folder.string() + "'", error.value());
  syncFolder(fs::absolute(folder).lexically_normal().parent_path());
}

FileLock::FileLock(const fs::path& file) {
  descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor_ < 0) refuse("cannot write '" + file.string() + "'", errno);
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) == 0) return;
  const int error_number = errno;
  ::close(descriptor_);
  if (error_number == EWOULDBLOCK) {
    throw Error(ErrorKind::kBadData, "session '" + file.parent_path().string() +
                                         "' is being written by another program; wait for it to end or use "
                                         "another folder");
  }
  refuse("cannot lock '" + file.string() + "'", error_number);
}

FileLock::~FileLock() { ::close(descriptor_); }

}  // namespace servocal::session
