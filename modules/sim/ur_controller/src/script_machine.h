// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "script_program.h"

namespace servocal::sim {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// What a program can do to the controller it runs on.
class ScriptHost {
 public:
  virtual ~ScriptHost() = default;
  virtual double stepTime() const = 0;
  virtual int inputInteger(int index) const = 0;
  virtual double inputFloat(int index) const = 0;
  virtual void outputInteger(int index, int value) = 0;
  virtual void setWatchdog(const std::string& variable, double least_hz, const std::string& action) = 0;
  virtual void textMessage(const std::string& text) = 0;
  virtual void speedl(const Vector6d& twist, double acceleration, double angular_acceleration) = 0;
  virtual void speedj(const Vector6d& speeds, double acceleration) = 0;
  virtual void stopl(double acceleration, double angular_acceleration) = 0;
  virtual void stopj(double acceleration) = 0;
  virtual bool stands() const = 0;
};

/// Runs one program, a step of the controller at a time.
class ScriptMachine {
 public:
  explicit ScriptMachine(ScriptProgram program) : program_(std::move(program)) {}

  const std::string& name() const { return program_.name; }
  bool ended() const { return ended_; }
  /// Goes on until a function needs time (speedl, stopl, sync, sleep) or the program ends.
  /// @throws ScriptFault
  void step(ScriptHost& host);

 private:
  using List = std::vector<double>;
  using Value = std::variant<std::monostate, bool, double, std::string, List>;
  struct Call;

  Value evaluate(const ScriptExpression& expression, ScriptHost& host);
  Value call(const ScriptExpression& expression, ScriptHost& host);
  Value binary(const ScriptExpression& expression, ScriptHost& host);
  bool truth(const ScriptExpression& expression, ScriptHost& host);

  ScriptProgram program_;
  std::size_t next_ = 0;
  bool ended_ = false;
  std::map<std::string, Value> variables_;
  double wait_s_ = 0.0;          ///< Left of a function that takes time.
  bool wait_for_stand_ = false;  ///< Of stopl and stopj.
};

}  // namespace servocal::sim
