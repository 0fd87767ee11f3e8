// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <new>
#include <type_traits>

#include "servocal/robot/arm.h"

namespace servocal::test {

/// A key to drive an arm without the guard, for tests of the arm itself. Only the guard can make keys;
/// a test copies one from bytes.
inline robot::MotionKey forgedMotionKey() {
  static_assert(std::is_trivially_copyable_v<robot::MotionKey> && std::is_empty_v<robot::MotionKey>);
  alignas(robot::MotionKey) static unsigned char bytes[sizeof(robot::MotionKey)] = {};
  return *std::launder(reinterpret_cast<const robot::MotionKey*>(bytes));
}

}  // namespace servocal::test
