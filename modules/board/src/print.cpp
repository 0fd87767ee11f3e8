// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/board/print.h"

#include <cairo-pdf.h>
#include <cairo.h>

#include <array>
#include <cmath>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

#include "servocal/board/artwork.h"
#include "servocal/core/error.h"

namespace servocal::board {
namespace {

constexpr double kPointsPerMm = 72.0 / 25.4;
constexpr double kPageMarginMm = 7.0;  // Most printers cannot print nearer to the edge.
constexpr double kFooterMm = 14.0;     // Ruler and text below the board.
constexpr double kRulerMm = 100.0;

struct Page {
  const char* name;
  double width_mm, height_mm;
};

constexpr std::array<Page, 5> kPages = {
    {{"A4", 297, 210}, {"A3", 420, 297}, {"A2", 594, 420}, {"A1", 841, 594}, {"A0", 1189, 841}}};

struct CairoDeleter {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};

// In mm, the board frame's origin at the origin.
void drawArtwork(cairo_t* context, const BoardSpec& board) {
  for (const Shape& shape : artwork(board)) {
    const double ink = shape.black ? 0.0 : 1.0;
    cairo_set_source_rgb(context, ink, ink, ink);
    const Eigen::Vector2d centre = 1000.0 * shape.centre, half = 1000.0 * shape.half_size;
    if (shape.kind == Shape::Kind::kDisc) {
      cairo_arc(context, centre.x(), centre.y(), half.x(), 0, 2 * M_PI);
    } else {
      cairo_rectangle(context, centre.x() - half.x(), centre.y() - half.y(), 2 * half.x(), 2 * half.y());
    }
    cairo_fill(context);
  }
}

// A tick every mm, longer at 5 and 10, starting at the origin.
void drawRuler(cairo_t* context) {
  cairo_set_source_rgb(context, 0, 0, 0);
  cairo_set_line_width(context, 0.15);
  for (int mm = 0; mm <= static_cast<int>(kRulerMm); ++mm) {
    const double length = mm % 10 == 0 ? 4.0 : mm % 5 == 0 ? 3.0 : 2.0;
    cairo_move_to(context, mm, 0);
    cairo_line_to(context, mm, length);
  }
  cairo_move_to(context, 0, 0);
  cairo_line_to(context, kRulerMm, 0);
  cairo_stroke(context);
  cairo_set_font_size(context, 2.6);
  for (int mm = 0; mm <= static_cast<int>(kRulerMm); mm += 10) {
    cairo_move_to(context, mm - 0.8, 7.0);
    cairo_show_text(context, std::to_string(mm).c_str());
  }
}

std::string dataLine(const BoardSpec& board) {
  std::ostringstream text;
  text << "servocal board: " << board.describe() << ", rim " << board.margin_m * 1000.0 << " mm";
  return text.str();
}

}  // namespace

void printBoard(const BoardSpec& board, const std::filesystem::path& pdf) {
  const Eigen::Vector3d far = board.patternOutline()[2];
  const double width = 2000.0 * far.x();
  const double height = 2000.0 * far.y();
  const double rim = board.margin_m * 1000.0;
  const Page* page = nullptr;
  for (const Page& candidate : kPages) {
    if (width + 2 * rim + 2 * kPageMarginMm > candidate.width_mm) continue;
    if (height + 2 * rim + 2 * kPageMarginMm + kFooterMm > candidate.height_mm) continue;
    page = &candidate;
    break;
  }
  if (!page) {
    throw std::invalid_argument("printBoard: a board of " + std::to_string(width + 2 * rim) + " x " +
                                std::to_string(height + 2 * rim) + " mm is larger than A0");
  }

  const std::unique_ptr<cairo_surface_t, CairoDeleter> surface(
      cairo_pdf_surface_create(pdf.c_str(), page->width_mm * kPointsPerMm, page->height_mm * kPointsPerMm));
  const std::unique_ptr<cairo_t, CairoDeleter> context(cairo_create(surface.get()));
  cairo_pdf_surface_set_metadata(surface.get(), CAIRO_PDF_METADATA_TITLE, dataLine(board).c_str());
  cairo_scale(context.get(), kPointsPerMm, kPointsPerMm);
  cairo_select_font_face(context.get(), "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);

  const double left = 0.5 * (page->width_mm - width);
  const double top =
      kPageMarginMm + rim + 0.5 * (page->height_mm - kFooterMm - 2 * kPageMarginMm - 2 * rim - height);
  cairo_save(context.get());
  cairo_translate(context.get(), left + 0.5 * width, top + 0.5 * height);
  drawArtwork(context.get(), board);
  cairo_restore(context.get());

  // Where to cut: hairlines at the corners of the rim.
  cairo_set_source_rgb(context.get(), 0.6, 0.6, 0.6);
  cairo_set_line_width(context.get(), 0.1);
  for (const double x : {left - rim, left + width + rim}) {
    for (const double y : {top - rim, top + height + rim}) {
      cairo_move_to(context.get(), x - 3, y);
      cairo_line_to(context.get(), x + 3, y);
      cairo_move_to(context.get(), x, y - 3);
      cairo_line_to(context.get(), x, y + 3);
    }
  }
  cairo_stroke(context.get());

  const double footer = page->height_mm - kPageMarginMm - kFooterMm + 1.5;
  cairo_save(context.get());
  cairo_translate(context.get(), kPageMarginMm + 5.0, footer);
  drawRuler(context.get());
  cairo_move_to(context.get(), kRulerMm + 6.0, 3.0);
  cairo_show_text(context.get(), "Print at 100 %. This ruler must measure 100 mm; measure the pattern too.");
  cairo_move_to(context.get(), 0, 11.5);
  cairo_show_text(context.get(), (dataLine(board) + ", " + page->name).c_str());
  cairo_restore(context.get());
  cairo_show_page(context.get());
  cairo_surface_finish(surface.get());

  const cairo_status_t status = cairo_surface_status(surface.get());
  if (status != CAIRO_STATUS_SUCCESS || cairo_status(context.get()) != CAIRO_STATUS_SUCCESS) {
    throw Error(ErrorKind::kBadData, "Cannot write " + pdf.string() + ": " + cairo_status_to_string(status) +
                                         ". Check that the folder exists and has space.");
  }
}

}  // namespace servocal::board
