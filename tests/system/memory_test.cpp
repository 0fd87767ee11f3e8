// SPDX-License-Identifier: GPL-3.0-or-later
// Memory runs out: the run ends, the arm stands, and what was observed is there.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <new>
#include <random>

#include "cells.h"
#include "errors.h"
#include "run_program.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/session/check.h"
#include "servocal/sim/cell.h"
#include "session_scene.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

constexpr long kEnough = std::numeric_limits<long>::max();

thread_local long allocations_left = kEnough;  ///< Of this thread; then none succeeds.

void* allocated(std::size_t size) {
  if (allocations_left != kEnough && --allocations_left < 0) {
    allocations_left = 0;
    throw std::bad_alloc();
  }
  if (void* const memory = std::malloc(size > 0 ? size : 1)) return memory;
  throw std::bad_alloc();
}

}  // namespace
}  // namespace servocal

void* operator new(std::size_t size) { return servocal::allocated(size); }
void* operator new[](std::size_t size) { return servocal::allocated(size); }
void* operator new(std::size_t size, const std::nothrow_t&) noexcept try {
  return servocal::allocated(size);
} catch (const std::bad_alloc&) {
  return nullptr;
}
void* operator new[](std::size_t size, const std::nothrow_t& nothrow) noexcept { return operator new(size, nothrow); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

namespace servocal {
namespace {

CellConfig shortRun() {
  CellConfig cell = loadCell(SERVOCAL_CELLS "/ur_one_camera.yaml");
  cell.coverage.max_views = 3;
  cell.coverage.revisit_views = cell.coverage.check_views = 0;
  return cell;
}

/// A run that may allocate so often; returns how often it did, if it came to an end.
long run(long allocations, const std::filesystem::path& folder) {
  const CellConfig cell = shortRun();
  sim::Cell simulation(cell, 3);
  const robot::Kinematics kinematics(cell.arm);
  robot::Guard guard(simulation.arm(), kinematics, simulation.clock(), cell);
  session::Session session = session::Session::create(folder, cell.text, cell.board, 3);
  allocations_left = allocations;
  try {
    (void)procedure::calibrate(cell, {simulation.clock(), guard, {&simulation.camera("cam1")}}, session, {});
    const long left = allocations_left;
    allocations_left = kEnough;
    return allocations - left;
  } catch (const std::bad_alloc&) {
  }
  allocations_left = kEnough;
  simulation.clock().sleepFor(std::chrono::milliseconds(300));
  const Twist<Base> twist = simulation.arm().state().twist;
  EXPECT_TRUE(twist.isZero()) << twist.linear_mps.norm() << " m/s, " << twist.angular_radps.norm()
                              << " rad/s";
  return 0;
}

TEST(Memory, WhereverItRunsOutTheArmStandsAndNothingIsLost) {
  const test::TemporaryFolder whole;
  const long needed = run(kEnough - 1, whole / "session");
  ASSERT_GT(needed, 1000);
  std::mt19937_64 random(5);
  int observations = 0;
  for (int i = 0; i < 4; ++i) {
    const test::TemporaryFolder folder;
    const long allowed = std::uniform_int_distribution<long>(0, needed)(random);
    // A program of its own: an exception at the wrong place would end it.
    const int status = test::statusOfChild([&] {
      EXPECT_EQ(run(allowed, folder / "session"), 0);
      if (testing::Test::HasFailure()) _exit(1);
    });
    ASSERT_TRUE(WIFEXITED(status)) << "after " << allowed << " of " << needed;
    EXPECT_EQ(WEXITSTATUS(status), 42) << "after " << allowed << " of " << needed;
    const session::SessionCheck check = session::checkSession(folder / "session");
    EXPECT_TRUE(check.whole());
    observations += check.observations;
  }
  std::cout << needed << " allocations; " << observations << " observations kept\n";
  EXPECT_GT(observations, 4);
}

}  // namespace
}  // namespace servocal
