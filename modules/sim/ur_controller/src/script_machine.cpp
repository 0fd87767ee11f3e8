// SPDX-License-Identifier: GPL-3.0-or-later
#include "script_machine.h"

#include <cmath>
#include <set>

namespace servocal::sim {
namespace {

// The controller ends a program that computes for too long without a function that takes time.
constexpr int kMostInstructionsPerStep = 20000;

[[noreturn]] void fail(const ScriptExpression& expression, const std::string& what) {
  throw ScriptFault(expression.line, expression.column, what);
}

const std::set<std::string> kFunctions = {"get_steptime",
                                          "sync",
                                          "sleep",
                                          "sqrt",
                                          "norm",
                                          "speedl",
                                          "speedj",
                                          "stopl",
                                          "stopj",
                                          "textmsg",
                                          "rtde_set_watchdog",
                                          "read_input_integer_register",
                                          "read_input_float_register",
                                          "write_output_integer_register"};

}  // namespace

bool isScriptFunction(const std::string& name) { return kFunctions.count(name) > 0; }

/// The arguments of a call, checked as they are taken.
struct ScriptMachine::Call {
  const ScriptExpression& expression;
  std::vector<Value> values;

  void count(std::size_t least, std::size_t most) const {
    if (values.size() < least || values.size() > most) {
      fail(expression, "Type error: " + expression.text + " takes " + std::to_string(least) + " to " +
                           std::to_string(most) + " arguments (" + std::to_string(values.size()) + " given)");
    }
  }
  template <class T>
  const T& get(std::size_t index) const {
    if (const T* value = std::get_if<T>(&values.at(index))) return *value;
    fail(expression, "Type error: argument " + std::to_string(index + 1) + " of " + expression.text);
  }
  double number(std::size_t index) const {
    const double value = get<double>(index);
    if (!std::isfinite(value))
      fail(expression, "Value error: argument of " + expression.text + " is not finite");
    return value;
  }
  double number(std::size_t index, double fallback) const {
    return index < values.size() ? number(index) : fallback;
  }
  int integer(std::size_t index) const { return static_cast<int>(std::lround(number(index))); }
  Vector6d vector6(std::size_t index) const {
    const List& list = get<List>(index);
    if (list.size() != 6) fail(expression, "Type error: " + expression.text + " needs a list of 6 numbers");
    return Eigen::Map<const Vector6d>(list.data());
  }
};

ScriptMachine::Value ScriptMachine::call(const ScriptExpression& expression, ScriptHost& host) {
  Call call{expression, {}};
  for (const ScriptExpression& part : expression.parts) call.values.push_back(evaluate(part, host));
  const std::string& name = expression.text;
  if (name == "get_steptime") {
    call.count(0, 0);
    return host.stepTime();
  }
  if (name == "sqrt") {
    call.count(1, 1);
    return std::sqrt(call.number(0));
  }
  if (name == "norm") {
    call.count(1, 1);
    double sum = 0.0;
    for (const double value : call.get<List>(0)) sum += value * value;
    return std::sqrt(sum);
  }
  if (name == "read_input_integer_register") {
    call.count(1, 1);
    return static_cast<double>(host.inputInteger(call.integer(0)));
  }
  if (name == "read_input_float_register") {
    call.count(1, 1);
    return host.inputFloat(call.integer(0));
  }
  if (name == "write_output_integer_register") {
    call.count(2, 2);
    host.outputInteger(call.integer(0), call.integer(1));
  } else if (name == "rtde_set_watchdog") {
    call.count(2, 3);
    host.setWatchdog(call.get<std::string>(0), call.number(1),
                     call.values.size() > 2 ? call.get<std::string>(2) : "pause");
  } else if (name == "textmsg") {
    call.count(1, 2);
    host.textMessage(call.get<std::string>(0));
  } else if (name == "sync") {
    call.count(0, 0);
    wait_s_ = host.stepTime();
  } else if (name == "sleep") {
    call.count(1, 1);
    wait_s_ = call.number(0);
  } else if (name == "speedl") {
    call.count(3, 4);
    host.speedl(call.vector6(0), call.number(1), call.number(3, call.number(1)));
    wait_s_ = call.number(2);
  } else if (name == "speedj") {
    call.count(3, 3);
    host.speedj(call.vector6(0), call.number(1));
    wait_s_ = call.number(2);
  } else if (name == "stopl") {
    call.count(1, 2);
    host.stopl(call.number(0), call.number(1, call.number(0)));
    wait_for_stand_ = true;
  } else if (name == "stopj") {
    call.count(1, 1);
    host.stopj(call.number(0));
    wait_for_stand_ = true;
  }
  return std::monostate{};
}

bool ScriptMachine::truth(const ScriptExpression& expression, ScriptHost& host) {
  const Value value = evaluate(expression, host);
  if (const bool* truth = std::get_if<bool>(&value)) return *truth;
  fail(expression, "Type error: a truth value is needed");
}

ScriptMachine::Value ScriptMachine::binary(const ScriptExpression& expression, ScriptHost& host) {
  const std::string& sign = expression.text;
  if (sign == "and") return truth(expression.parts[0], host) && truth(expression.parts[1], host);
  if (sign == "or") return truth(expression.parts[0], host) || truth(expression.parts[1], host);
  const Value left = evaluate(expression.parts[0], host), right = evaluate(expression.parts[1], host);
  if (sign == "==") return left == right;
  if (sign == "!=") return left != right;
  const double* a = std::get_if<double>(&left);
  const double* b = std::get_if<double>(&right);
  if (a == nullptr || b == nullptr) fail(expression, "Type error: '" + sign + "' needs two numbers");
  if (sign == "+") return *a + *b;
  if (sign == "-") return *a - *b;
  if (sign == "*") return *a * *b;
  if (sign == "<") return *a < *b;
  if (sign == ">") return *a > *b;
  if (sign == "<=") return *a <= *b;
  if (sign == ">=") return *a >= *b;
  if (*b == 0.0) fail(expression, "Value error: division by zero");
  return sign == "/" ? *a / *b : std::fmod(*a, *b);
}

ScriptMachine::Value ScriptMachine::evaluate(const ScriptExpression& expression, ScriptHost& host) {
  switch (expression.kind) {
    case ScriptExpression::Kind::kNumber: return expression.number;
    case ScriptExpression::Kind::kText: return expression.text;
    case ScriptExpression::Kind::kTruth: return expression.number != 0.0;
    case ScriptExpression::Kind::kCall: return call(expression, host);
    case ScriptExpression::Kind::kBinary: return binary(expression, host);
    case ScriptExpression::Kind::kName: {
      const auto variable = variables_.find(expression.text);
      if (variable == variables_.end())
        fail(expression, "Name error: " + expression.text + " has no value yet");
      return variable->second;
    }
    case ScriptExpression::Kind::kList: {
      List list;
      for (const ScriptExpression& part : expression.parts) {
        const Value value = evaluate(part, host);
        if (!std::holds_alternative<double>(value)) fail(part, "Type error: a list of numbers is needed");
        list.push_back(std::get<double>(value));
      }
      return list;
    }
    case ScriptExpression::Kind::kUnary: {
      if (expression.text == "not") return !truth(expression.parts[0], host);
      const Value value = evaluate(expression.parts[0], host);
      if (!std::holds_alternative<double>(value)) fail(expression, "Type error: '-' needs a number");
      return -std::get<double>(value);
    }
  }
  return std::monostate{};
}

void ScriptMachine::step(ScriptHost& host) {
  if (wait_s_ > 0.0) {
    wait_s_ -= host.stepTime();
    if (wait_s_ > 1e-9) return;
  }
  if (wait_for_stand_ && !host.stands()) return;
  wait_for_stand_ = false;
  wait_s_ = 0.0;
  for (int count = 0; count < kMostInstructionsPerStep; ++count) {
    const ScriptInstruction& instruction = program_.instructions[next_++];
    switch (instruction.kind) {
      case ScriptInstruction::Kind::kHalt: ended_ = true; return;
      case ScriptInstruction::Kind::kJump: next_ = instruction.target; break;
      case ScriptInstruction::Kind::kJumpIfFalse:
        if (!truth(instruction.value, host)) next_ = instruction.target;
        break;
      case ScriptInstruction::Kind::kAssign:
        variables_[instruction.name] = evaluate(instruction.value, host);
        break;
      case ScriptInstruction::Kind::kEvaluate: evaluate(instruction.value, host); break;
    }
    if (wait_s_ > 0.0 || wait_for_stand_) return;
  }
  const ScriptExpression& where = program_.instructions[next_ > 0 ? next_ - 1 : 0].value;
  throw ScriptFault(where.line, where.column, "Runtime error: infinite loop detected in the program");
}

}  // namespace servocal::sim
