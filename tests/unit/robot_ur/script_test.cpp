// SPDX-License-Identifier: GPL-3.0-or-later
// The program that is uploaded, and the interpreter it is tested in.
#include "script.h"

#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "script_machine.h"
#include "servocal/core/cell_config.h"

namespace servocal {
namespace {

using robot::ur::ScriptOptions;
using robot::ur::servoScript;
using sim::Vector6d;

class FakeHost final : public sim::ScriptHost {
 public:
  double stepTime() const override { return 0.008; }
  int inputInteger(int index) const override { return integers.count(index) ? integers.at(index) : 0; }
  double inputFloat(int index) const override { return floats.count(index) ? floats.at(index) : 0.0; }
  void outputInteger(int index, int value) override { outputs[index] = value; }
  void setWatchdog(const std::string& variable, double least_hz, const std::string& action) override {
    watchdog = variable + " " + action;
    watchdog_hz = least_hz;
  }
  void textMessage(const std::string&) override {}
  void speedl(const Vector6d& twist, double, double) override { twists.push_back(twist); }
  void speedj(const Vector6d& speeds, double) override { joints.push_back(speeds); }
  void stopl(double, double) override { ++stops; }
  void stopj(double) override { ++stops; }
  bool stands() const override { return true; }

  std::map<int, int> integers, outputs;
  std::map<int, double> floats;
  std::vector<Vector6d> twists, joints;
  std::string watchdog;
  double watchdog_hz = 0.0;
  int stops = 0;
};

ScriptOptions options() {
  ScriptOptions options;
  options.limits = defaultCell().limits;
  options.watchdog = std::chrono::milliseconds(100);
  options.token = 4711;
  return options;
}

/// Our program on the fake host, a step at a time, with or without a living heartbeat.
class ServoScript : public ::testing::Test {
 protected:
  void step(int count = 1, int beats = 1) {
    for (int i = 0; i < count; ++i) {
      host.integers[24] += beats;
      machine.step(host);
    }
  }
  void arm(int epoch) {
    host.integers[25] = 0;
    step();  // The epoch it finds at its start is an old one.
    host.integers[26] = epoch;
    step(2);
    ASSERT_EQ(host.outputs[24], 2);
    ASSERT_EQ(host.outputs[25], epoch);
  }
  void ask(double vz) {
    host.integers[25] = 1;
    host.floats[26] = vz;
  }
  bool isMoving() {  // Within three steps; stopl takes one.
    host.twists.clear();
    step(3);
    return !host.twists.empty() && host.twists.back()[2] != 0.0;
  }

  FakeHost host;
  sim::ScriptMachine machine{sim::parseScript(servoScript(options()))};
};

TEST_F(ServoScript, IsPlainTextThatBeginsAndEndsAsTheControllerDemands) {
  const std::string text = servoScript(options());
  EXPECT_EQ(text.rfind("def servocal():\n", 0), 0u);
  EXPECT_EQ(text.substr(text.size() - 5), "\nend\n");
  for (const char c : text) EXPECT_TRUE(c == '\n' || (c >= 32 && c < 127)) << static_cast<int>(c);
  EXPECT_EQ(text.find("{{"), std::string::npos);
}

TEST_F(ServoScript, MovesOnlyOnceArmed) {
  step();
  EXPECT_EQ(host.watchdog, "input_int_register_24 stop");
  EXPECT_NEAR(host.watchdog_hz, 10.0, 1e-5);
  EXPECT_EQ(host.outputs[26], 4711);
  ask(0.1);
  step(5);
  EXPECT_TRUE(host.twists.empty());
  arm(77);
  ask(0.1);
  step();
  ASSERT_FALSE(host.twists.empty());
  EXPECT_EQ(host.twists.back()[2], 0.1);
}

TEST_F(ServoScript, AnEpochThatComesTogetherWithAMotionDoesNotArm) {
  step();
  ask(0.1);
  host.integers[26] = 5;
  step(5);
  EXPECT_TRUE(host.twists.empty());
  EXPECT_EQ(host.outputs[24], 1);
}

TEST_F(ServoScript, HeartbeatThatStandsStillStopsAndNeedsANewEpoch) {
  arm(1);
  ask(0.1);
  EXPECT_TRUE(isMoving());
  step(9, 0);  // 72 ms: still trusted.
  EXPECT_EQ(host.outputs[24], 2);
  step(3, 0);
  EXPECT_EQ(host.outputs[24], 1);
  EXPECT_EQ(host.twists.back()[2], 0.0);
  EXPECT_FALSE(isMoving());  // The heartbeat is back, the epoch is not new.
  host.integers[25] = 0;
  step(20);
  ask(0.1);
  EXPECT_FALSE(isMoving());
  arm(2);
  ask(0.1);
  EXPECT_TRUE(isMoving());
}

TEST_F(ServoScript, HeartbeatThatLeaptIsAPauseAndNeedsANewEpoch) {
  arm(1);
  ask(0.1);
  step(3, 2);
  EXPECT_TRUE(isMoving());
  step(1, 14);  // More than a watchdog's time at 125 Hz.
  EXPECT_EQ(host.outputs[24], 1);
  EXPECT_FALSE(isMoving());
}

TEST_F(ServoScript, ScalesDownToTheLimitsAndKeepsTheDirection) {
  arm(1);
  ask(2.0);
  host.floats[24] = 1.0;
  step();
  const Vector6d twist = host.twists.back();
  EXPECT_NEAR(twist.head<3>().norm(), 1.05 * defaultCell().limits.max_speed_mps, 1e-5);
  EXPECT_NEAR(twist[2], 2.0 * twist[0], 1e-9);
  host.floats[29] = 30.0;
  step();
  EXPECT_NEAR(host.twists.back()[5], 1.05 * defaultCell().limits.max_angular_speed_radps, 1e-3);
}

TEST_F(ServoScript, HoldBrakesStepByStepThenStops) {
  arm(1);
  ask(0.1);
  step(5);
  host.integers[25] = 0;
  step();
  EXPECT_TRUE(host.twists.back().isZero());
  EXPECT_EQ(host.stops, 0);
  step(40);
  EXPECT_EQ(host.stops, 1);
  ask(0.1);
  EXPECT_TRUE(isMoving());  // Holding is no interruption.
}

TEST_F(ServoScript, JointSpeedsGoTheSameWay) {
  arm(1);
  host.integers[25] = 2;
  host.floats[24] = 0.3;
  step();
  ASSERT_FALSE(host.joints.empty());
  EXPECT_EQ(host.joints.back()[0], 0.3);
  EXPECT_TRUE(host.twists.empty());
}

TEST_F(ServoScript, EndsWhenTold) {
  arm(1);
  host.integers[25] = 3;
  step(3);
  EXPECT_TRUE(machine.ended());
}

std::string faultOf(const std::string& text, int steps = 3) {
  try {
    sim::ScriptMachine machine{sim::parseScript(text)};
    FakeHost host;
    for (int i = 0; i < steps && !machine.ended(); ++i) machine.step(host);
  } catch (const sim::ScriptFault& fault) {
    return std::to_string(fault.line) + ":" + std::to_string(fault.column) + " " + fault.what();
  }
  return "";
}

TEST(ScriptInterpreter, ReportsMistakesAsTheControllerDoes) {
  EXPECT_EQ(faultOf("def a():\n  x = 1\n  sync()\nend\n"), "");
  EXPECT_EQ(faultOf("def a():\n  calldoesntexist()\nend\n"),
            "2:3 compile_error_name_not_found:calldoesntexist:");
  EXPECT_EQ(faultOf("def a():\n  x = y\nend\n"), "2:7 compile_error_name_not_found:y:");
  EXPECT_EQ(faultOf("def a():\n  sync(\nend\n"), "2:8 syntax_error_on_line:2:  sync(:");
  EXPECT_EQ(faultOf("def a():\n  thread b():\n  end\nend\n"), "2:10 syntax_error_on_line:2:  thread b()::");
  EXPECT_EQ(faultOf("def a():\nsync()\nend\n"), "2:1 syntax_error_on_line:2:sync():");
  EXPECT_EQ(faultOf("def a():\n  while True:\n    sync()\nend\n").substr(0, 2), "4:");
  EXPECT_EQ(faultOf("x = 1\n").substr(0, 2), "1:");
  EXPECT_EQ(faultOf("def a():\n  sqrt(True)\nend\n"), "2:3 Type error: argument 1 of sqrt");
  EXPECT_EQ(faultOf("def a():\n  x = 1 / 0\nend\n"), "2:9 Value error: division by zero");
  EXPECT_EQ(faultOf("def a():\n  speedl([0, 0, 0], 1, 1)\nend\n"),
            "2:3 Type error: speedl needs a list of 6 numbers");
  EXPECT_EQ(faultOf("def a():\n  if 1:\n    sync()\n  end\nend\n"),
            "2:6 Type error: a truth value is needed");
  EXPECT_NE(faultOf("def a():\n  while True:\n    x = 1\n  end\nend\n").find("infinite loop"),
            std::string::npos);
}

TEST(ScriptInterpreter, ComputesAndBranches) {
  FakeHost host;
  sim::ScriptMachine machine{sim::parseScript(
      "def a():\n"
      "  i = 0  # comment\n"
      "  while i < 3 and not i == 9:\n"
      "    i = i + 1\n"
      "    if i == 1:\n      write_output_integer_register(24, 2 + 3 * 4 - -1)\n"
      "    elif i == 2:\n      write_output_integer_register(25, (2 + 3) * 4 % 7)\n"
      "    else:\n      write_output_integer_register(26, sqrt(16) + norm([3, 4]))\n    end\n"
      "  end\n"
      "  while True:\n    break\n  end\n"
      "  textmsg(\"done # not a comment\")\n"
      "end\n")};
  machine.step(host);
  EXPECT_TRUE(machine.ended());
  EXPECT_EQ(host.outputs[24], 15);
  EXPECT_EQ(host.outputs[25], 6);
  EXPECT_EQ(host.outputs[26], 9);
}

}  // namespace
}  // namespace servocal
