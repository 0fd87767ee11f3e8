// SPDX-License-Identifier: GPL-3.0-or-later
// The part of URScript that servocal's programs use, from text to instructions: one def, assignments, while,
// if/elif/else, halt, break, function calls, arithmetic, comparisons, and/or/not, lists. Everything else is a
// mistake, reported in the controller's words.
#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace servocal::sim {

/// What the controller reports as a runtime exception, compile errors included.
struct ScriptFault : std::runtime_error {
  ScriptFault(int at_line, int at_column, const std::string& text)
      : std::runtime_error(text), line(at_line), column(at_column) {}
  int line;    ///< From 1.
  int column;  ///< From 1.
};

struct ScriptExpression {
  enum class Kind { kNumber, kText, kTruth, kList, kName, kCall, kUnary, kBinary };
  Kind kind = Kind::kNumber;
  double number = 0.0;  ///< Also 0 or 1 of a truth value.
  std::string text;     ///< Name, operator, or the text itself.
  std::vector<ScriptExpression> parts;
  int line = 0;
  int column = 0;
};

struct ScriptInstruction {
  enum class Kind { kAssign, kEvaluate, kJump, kJumpIfFalse, kHalt };
  Kind kind = Kind::kHalt;
  std::string name;  ///< Of the variable that is assigned.
  ScriptExpression value;
  std::size_t target = 0;  ///< Of a jump.
};

struct ScriptProgram {
  std::string name;
  std::vector<ScriptInstruction> instructions;  ///< Ends with kHalt.
};

/// @throws ScriptFault: "syntax_error_on_line:3:...:" or, for a function or variable that does not exist,
///   "compile_error_name_not_found:...:".
ScriptProgram parseScript(const std::string& text);

/// Whether the controller has a function of this name, as far as this simulator knows.
bool isScriptFunction(const std::string& name);

}  // namespace servocal::sim
