// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::session {

/// The pictures behind one view; an empty one is not kept. A plain image stands for a view without depth.
struct ViewImages {
  ViewImages() = default;
  ViewImages(const cv::Mat& view_image) : image(view_image) {}  // NOLINT: implicit on purpose
  ViewImages(const cv::Mat& view_image, const cv::Mat& raw_depth) : image(view_image), depth(raw_depth) {}
  cv::Mat image;
  cv::Mat depth;  ///< CV_16UC1, raw; kept only with StreamObservation::depth.
};

/// A line of the session's log.
struct SessionEvent {
  Instant stamp{};
  std::string kind;
  std::string message;
};

/// A run on disk: `session.sqlite` for what was observed and decided, `images/*.png`, the cell file, the
/// result. Everything is durable before the call that stores it returns, and a stored observation never
/// points to a missing or partial image. The schema is documented in docs/session-format.md.
class Session {
 public:
  /// Makes a new session in `folder` (created; must not hold a session yet) and locks it.
  /// @throws Error (kBadData) if the folder cannot be written, is locked, or holds a session.
  static Session create(const std::filesystem::path& folder, const std::string& cell_text,
                        const BoardSpec& board, std::uint64_t seed);
  /// The same, and keeps beside the cell's text what its keys were resolved to, defaults included, and the
  /// URDF file it names.
  static Session create(const std::filesystem::path& folder, const CellConfig& cell, std::uint64_t seed);
  /// Opens a session for reading, also while it is being written.
  /// @throws Error (kBadData) if there is none, or it cannot be read.
  static Session open(const std::filesystem::path& folder);
  /// Opens a session to write on where it ended, and locks it. One of an older schema becomes one of this.
  /// @throws Error (kBadData) if there is none, it cannot be read or written, or is locked.
  static Session openForAppend(const std::filesystem::path& folder);
  ~Session();
  Session(Session&&) noexcept;

  /// Stores images (one entry per view, in the order of observation.views) and then the observation; fills in
  /// its id and the image files' names, and returns it. No images at all is allowed.
  /// @throws Error (kBadData) if the disk refuses, or the session's folder is not there anymore.
  /// @throws std::invalid_argument if the session was opened for reading, the numbers of views and images
  ///   differ, or a robot pose, joint angle or corner is not finite.
  Observation add(Observation observation, const std::vector<ViewImages>& images);
  /// Stores an attempt and returns it with its id. A goal pose that is not finite is stored as absent.
  Attempt add(Attempt attempt);
  /// A line in the session's log.
  void event(Instant stamp, const std::string& kind, const std::string& message);

  std::vector<Observation> observations() const;
  std::vector<Attempt> attempts() const;
  std::vector<SessionEvent> events() const;
  std::string cellText() const;
  BoardSpec board() const;
  std::uint64_t seed() const;
  /// What wrote it: program and libraries with their versions; empty in sessions of schema 3 and older.
  std::string programs() const;
  const std::filesystem::path& folder() const;

 private:
  struct Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// True if the folder holds a session.
bool isSession(const std::filesystem::path& folder);

/// Writes the result as YAML (".yaml") or JSON (".json"), whole or not at all; docs/result-schema.md.
/// Makes the file's folder if it is missing.
/// @throws Error (kBadData) if the file cannot be written.
/// @throws std::invalid_argument for another extension.
void saveResult(const std::filesystem::path& file, const CalibrationResult& result);
/// Reads what saveResult wrote, YAML or JSON: saved again it is the same file, byte by byte. Numbers are
/// identical but for angles (degrees in the file), which may differ in their last bit, and for what is not
/// finite (null in the file), which becomes not-a-number. Strict: keys that are unknown, missing or
/// contradict each other are refused.
/// @throws Error (kBadData) naming file, line and key.
CalibrationResult loadResult(const std::filesystem::path& file);
/// What saveResult would put into a ".json" file.
std::string resultJson(const CalibrationResult& result);

}  // namespace servocal::session
