// SPDX-License-Identifier: GPL-3.0-or-later
#include <filesystem>
#include <iostream>

#include "servocal/app/main.h"
#include "servocal/board/print.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/error.h"

int main(int argc, char** argv) {
  using namespace servocal;
  CLI::App cli("Writes a calibration board as a vector PDF at true size, with a ruler to check the print. "
               "Moves no robot.",
               "servocal-board");
  std::string board_file;
  std::filesystem::path out = "board.pdf";
  cli.add_option("--board", board_file,
                 "Board file (YAML); the default board, 7 x 5 squares of 30 mm with a hollow corner, if not given");
  cli.add_option("--out", out, "PDF to write")->capture_default_str();
  cli.footer("Example:\n"
             "  $ servocal-board --out board.pdf\n"
             "  Wrote board.pdf: 7 x 5 squares of 30 mm. Print at 100 % and measure the ruler.\n");
  return app::guardedMain(cli, argc, argv, [&] {
    const BoardSpec board = board_file.empty() ? BoardSpec() : loadBoard(board_file);
    try {
      board::printBoard(board, out);
    } catch (const std::invalid_argument& error) {
      throw Error(ErrorKind::kInvalidConfig, std::string(error.what()) + ". Print fewer or smaller squares.");
    }
    std::cout << "Wrote " << out.string() << ": " << board.describe() << ". Print at 100 % and measure the ruler.\n";
    return app::kOk;
  });
}
