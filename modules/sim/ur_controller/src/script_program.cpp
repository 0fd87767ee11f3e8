// SPDX-License-Identifier: GPL-3.0-or-later
#include "script_program.h"

#include <cctype>
#include <cstdlib>
#include <set>
#include <sstream>

namespace servocal::sim {
namespace {

using Expression = ScriptExpression;
using Instruction = ScriptInstruction;

struct Token {
  enum class Kind { kName, kNumber, kText, kSign, kEnd };
  Kind kind = Kind::kEnd;
  std::string text;
  int column = 0;
};

struct Line {
  int number = 0;
  std::string text;
  std::vector<Token> tokens;  ///< Ends with kEnd.
};

[[noreturn]] void failSyntax(const Line& line, int column) {
  throw ScriptFault(line.number, column,
                    "syntax_error_on_line:" + std::to_string(line.number) + ":" + line.text + ":");
}

std::vector<Token> cut(const Line& line) {
  static const std::set<std::string> kTwoSigns = {"==", "!=", "<=", ">="};
  const std::string& text = line.text;
  std::vector<Token> tokens;
  for (std::size_t at = 0; at < text.size();) {
    const char c = text[at];
    const int column = static_cast<int>(at) + 1;
    std::size_t end = at + 1;
    if (c == '#') break;
    if (std::isspace(static_cast<unsigned char>(c))) {
      at = end;
      continue;
    }
    Token token;
    token.column = column;
    if (std::isalpha(static_cast<unsigned char>(c)) || c == '_') {
      while (end < text.size() && (std::isalnum(static_cast<unsigned char>(text[end])) || text[end] == '_'))
        ++end;
      token.kind = Token::Kind::kName;
    } else if (std::isdigit(static_cast<unsigned char>(c))) {
      char* stop = nullptr;
      std::strtod(text.c_str() + at, &stop);
      end = static_cast<std::size_t>(stop - text.c_str());
      token.kind = Token::Kind::kNumber;
    } else if (c == '"') {
      end = text.find('"', at + 1);
      if (end == std::string::npos) failSyntax(line, column);
      tokens.push_back({Token::Kind::kText, text.substr(at + 1, end - at - 1), column});
      at = end + 1;
      continue;
    } else if (std::string("+-*/%()[],=<>:!").find(c) != std::string::npos) {
      if (kTwoSigns.count(text.substr(at, 2)) > 0) end = at + 2;
      token.kind = Token::Kind::kSign;
    } else {
      failSyntax(line, column);
    }
    token.text = text.substr(at, end - at);
    tokens.push_back(token);
    at = end;
  }
  tokens.push_back({Token::Kind::kEnd, "", static_cast<int>(text.size()) + 1});
  return tokens;
}

/// Expressions of one line, by precedence: or, and, not, comparison, sum, product, sign.
class ExpressionParser {
 public:
  ExpressionParser(const Line& line, std::size_t first) : line_(line), at_(first) {}

  Expression expression() { return disjunction(); }
  bool takes(const std::string& text) {
    if (now().text != text || now().kind == Token::Kind::kText) return false;
    ++at_;
    return true;
  }
  void demand(const std::string& text) {
    if (!takes(text)) failSyntax(line_, now().column);
  }
  void demandEnd() {
    if (now().kind != Token::Kind::kEnd) failSyntax(line_, now().column);
  }

 private:
  const Token& now() const { return line_.tokens[at_]; }
  Expression made(Expression::Kind kind, const Token& token) const {
    Expression expression;
    expression.kind = kind;
    expression.text = token.text;
    expression.line = line_.number;
    expression.column = token.column;
    return expression;
  }
  template <class Operand>
  Expression leftToRight(const std::set<std::string>& operators, const Operand& operand) {
    Expression left = operand();
    while (now().kind != Token::Kind::kText && operators.count(now().text) > 0) {
      Expression both = made(Expression::Kind::kBinary, line_.tokens[at_++]);
      both.parts.push_back(std::move(left));
      both.parts.push_back(operand());
      left = std::move(both);
    }
    return left;
  }
  Expression disjunction() {
    return leftToRight({"or"}, [this] { return conjunction(); });
  }
  Expression conjunction() {
    return leftToRight({"and"}, [this] { return negation(); });
  }
  Expression negation() {
    if (now().text != "not") return comparison();
    Expression expression = made(Expression::Kind::kUnary, line_.tokens[at_++]);
    expression.parts.push_back(negation());
    return expression;
  }
  Expression comparison() {
    return leftToRight({"==", "!=", "<", ">", "<=", ">="}, [this] { return sum(); });
  }
  Expression sum() {
    return leftToRight({"+", "-"}, [this] { return product(); });
  }
  Expression product() {
    return leftToRight({"*", "/", "%"}, [this] { return sign(); });
  }
  Expression sign() {
    if (now().text != "-") return primary();
    Expression expression = made(Expression::Kind::kUnary, line_.tokens[at_++]);
    expression.parts.push_back(sign());
    return expression;
  }
  void list(Expression& expression, const std::string& close) {
    if (takes(close)) return;
    do expression.parts.push_back(disjunction());
    while (takes(","));
    demand(close);
  }
  Expression primary() {
    const Token token = now();
    ++at_;
    if (token.kind == Token::Kind::kNumber) {
      Expression expression = made(Expression::Kind::kNumber, token);
      expression.number = std::strtod(token.text.c_str(), nullptr);
      return expression;
    }
    if (token.kind == Token::Kind::kText) return made(Expression::Kind::kText, token);
    if (token.kind == Token::Kind::kName) {
      if (token.text == "True" || token.text == "False") {
        Expression expression = made(Expression::Kind::kTruth, token);
        expression.number = token.text == "True" ? 1.0 : 0.0;
        return expression;
      }
      if (!takes("(")) return made(Expression::Kind::kName, token);
      Expression expression = made(Expression::Kind::kCall, token);
      list(expression, ")");
      return expression;
    }
    if (token.text == "[") {
      Expression expression = made(Expression::Kind::kList, token);
      list(expression, "]");
      return expression;
    }
    if (token.text == "(") {
      Expression expression = disjunction();
      demand(")");
      return expression;
    }
    failSyntax(line_, token.column);
  }

  const Line& line_;
  std::size_t at_;
};

class ProgramParser {
 public:
  explicit ProgramParser(std::vector<Line> lines) : lines_(std::move(lines)) {}

  ScriptProgram parse() {
    const Line& first = lines_.at(0);
    ExpressionParser head(first, 2);
    if (first.tokens[0].text != "def" || first.tokens[1].kind != Token::Kind::kName) failSyntax(first, 1);
    program_.name = first.tokens[1].text;
    head.demand("(");
    head.demand(")");
    head.demand(":");
    head.demandEnd();
    at_ = 1;
    block({"end"});
    if (at_ + 1 < lines_.size()) failSyntax(lines_[at_ + 1], 1);
    program_.instructions.emplace_back();
    for (const Instruction& instruction : program_.instructions) checkNames(instruction.value);
    return std::move(program_);
  }

 private:
  std::size_t emit(Instruction::Kind kind, Expression value = {}) {
    Instruction instruction;
    instruction.kind = kind;
    instruction.value = std::move(value);
    program_.instructions.push_back(std::move(instruction));
    return program_.instructions.size() - 1;
  }
  std::size_t here() const { return program_.instructions.size(); }

  /// Statements up to a line that starts with one of `ends`; at_ is that line then.
  void block(const std::set<std::string>& ends) {
    for (; at_ < lines_.size(); ++at_) {
      if (ends.count(lines_[at_].tokens[0].text) > 0) return;
      statement();
    }
    failSyntax(lines_.back(), 1);
  }

  Expression condition(const Line& line, std::size_t first) {
    ExpressionParser parser(line, first);
    Expression expression = parser.expression();
    parser.demand(":");
    parser.demandEnd();
    return expression;
  }

  void statement() {
    const Line& line = lines_[at_];
    const std::string& word = line.tokens[0].text;
    if (word == "while") return loop();
    if (word == "if") return choice();
    if (word == "halt") {
      ExpressionParser(line, 1).demandEnd();
      emit(Instruction::Kind::kHalt);
      return;
    }
    if (word == "break") {
      if (breaks_.empty()) failSyntax(line, line.tokens[0].column);
      breaks_.back().push_back(emit(Instruction::Kind::kJump));
      return;
    }
    if (line.tokens[0].kind != Token::Kind::kName) failSyntax(line, line.tokens[0].column);
    const bool assigns = line.tokens[1].text == "=";
    ExpressionParser parser(line, assigns ? 2 : 0);
    Expression value = parser.expression();
    parser.demandEnd();
    if (!assigns && value.kind != Expression::Kind::kCall) failSyntax(line, line.tokens[0].column);
    const std::size_t index =
        emit(assigns ? Instruction::Kind::kAssign : Instruction::Kind::kEvaluate, std::move(value));
    if (assigns) {
      program_.instructions[index].name = word;
      variables_.insert(word);
    }
  }

  void loop() {
    const std::size_t start = here();
    const std::size_t leave = emit(Instruction::Kind::kJumpIfFalse, condition(lines_[at_], 1));
    breaks_.emplace_back();
    ++at_;
    block({"end"});
    program_.instructions[emit(Instruction::Kind::kJump)].target = start;
    program_.instructions[leave].target = here();
    for (const std::size_t jump : breaks_.back()) program_.instructions[jump].target = here();
    breaks_.pop_back();
  }

  void choice() {
    std::vector<std::size_t> to_end;
    for (;;) {
      const std::size_t skip = emit(Instruction::Kind::kJumpIfFalse, condition(lines_[at_], 1));
      ++at_;
      block({"elif", "else", "end"});
      to_end.push_back(emit(Instruction::Kind::kJump));
      program_.instructions[skip].target = here();
      if (lines_[at_].tokens[0].text != "elif") break;
    }
    if (lines_[at_].tokens[0].text == "else") {
      ExpressionParser parser(lines_[at_], 1);
      parser.demand(":");
      parser.demandEnd();
      ++at_;
      block({"end"});
    }
    for (const std::size_t jump : to_end) program_.instructions[jump].target = here();
  }

  void checkNames(const Expression& expression) const {
    const bool unknown =
        (expression.kind == Expression::Kind::kCall && !isScriptFunction(expression.text)) ||
        (expression.kind == Expression::Kind::kName && variables_.count(expression.text) == 0);
    if (unknown) {
      throw ScriptFault(expression.line, expression.column,
                        "compile_error_name_not_found:" + expression.text + ":");
    }
    for (const Expression& part : expression.parts) checkNames(part);
  }

  std::vector<Line> lines_;
  std::size_t at_ = 0;
  ScriptProgram program_;
  std::set<std::string> variables_;
  std::vector<std::vector<std::size_t>> breaks_;
};

}  // namespace

ScriptProgram parseScript(const std::string& text) {
  std::vector<Line> lines;
  std::istringstream stream(text);
  int number = 0;
  for (std::string content; std::getline(stream, content);) {
    Line line;
    line.number = ++number;
    line.text = content;
    line.tokens = cut(line);
    if (line.tokens.size() == 1) continue;  // Empty, or a comment.
    // The controller takes what starts in column 0 for the beginning or the end of a program.
    const bool indented = std::isspace(static_cast<unsigned char>(content[0])) != 0;
    const bool outer = lines.empty() || content == "end";
    if (indented == outer) failSyntax(line, 1);
    lines.push_back(std::move(line));
  }
  if (lines.empty()) throw ScriptFault(1, 1, "syntax_error_on_line:1::");
  return ProgramParser(std::move(lines)).parse();
}

}  // namespace servocal::sim
