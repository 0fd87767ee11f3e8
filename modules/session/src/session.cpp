// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/session/session.h"

#include <sys/stat.h>

#include <cstdlib>
#include <opencv2/core/version.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "database.h"
#include "durable_file.h"
#include "layout.h"
#include "resolved_cell.h"
#include "rows.h"
#include "servocal/core/config_reader.h"
#include "servocal/core/error.h"
#include "sha256.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;

/// Which file a name stands for; nothing if it stands for none.
std::optional<std::pair<dev_t, ino_t>> identity(const fs::path& file) {
  struct stat status = {};
  if (::stat(file.c_str(), &status) != 0) return std::nullopt;
  return std::pair(status.st_dev, status.st_ino);
}

std::string programVersions() {
  return std::string("servocal ") + SERVOCAL_VERSION + ", OpenCV " + CV_VERSION + ", SQLite " +
         sqlite3_libversion() + ", Eigen " + std::to_string(EIGEN_WORLD_VERSION) + "." +
         std::to_string(EIGEN_MAJOR_VERSION) + "." + std::to_string(EIGEN_MINOR_VERSION);
}

/// "images/000012_cam1_color.png"; characters that file systems dislike become '-'.
std::string imageName(std::int64_t id, const StreamObservation& view, Stream stream) {
  std::string number = std::to_string(id);
  number.insert(0, 6 - std::min<std::size_t>(6, number.size()), '0');
  std::string camera = view.camera;
  for (char& c : camera) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '.') c = '-';
  }
  return "images/" + number + "_" + camera + "_" + toString(stream) + ".png";
}

void checkFinite(const Observation& observation) {
  const auto refuse = [&](const char* what) {
    throw std::invalid_argument("observation of stage '" + observation.stage + "': " + what +
                                " is not finite");
  };
  if (const auto& robot = observation.robot) {
    if (!robot->bMe.isFinite()) refuse("bMe");
    if (!robot->q.allFinite()) refuse("q");
    if (!robot->twist.isFinite()) refuse("the twist");
  }
  for (const StreamObservation& view : observation.views) {
    for (const Corner& corner : view.detection.corners) {
      if (!corner.pixel.allFinite()) refuse("a corner's pixel");
    }
  }
}

}  // namespace

struct Session::Impl {
  fs::path folder;
  std::unique_ptr<FileLock> lock;  ///< Held by the writer only.
  std::unique_ptr<Database> database;
  std::int64_t next_id = 1;
  std::optional<std::pair<dev_t, ino_t>> file;  ///< The database's, as it was opened.

  /// A removed file can be written to its heart's content: nobody would find it.
  void demandPresent() const {
    if (identity(databaseFile(folder)) == file) return;
    throw Error(ErrorKind::kBadData,
                "the session folder '" + folder.string() +
                    "' was removed or replaced while it was being written; what is observed "
                    "from now on has no place to go");
  }
  void demandWriter() const {
    if (lock == nullptr) throw std::invalid_argument("this session was opened for reading");
  }

  std::string text(const char* key) const {
    if (auto value = metaText(*database, key)) return *std::move(value);
    throw Error(ErrorKind::kBadData, "session '" + folder.string() + "' lacks '" + key + "' in table meta");
  }
};

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;

Session Session::create(const fs::path& folder, const std::string& cell_text, const BoardSpec& board,
                        std::uint64_t seed) {
  auto impl = std::make_unique<Impl>();
  impl->folder = folder;
  makeFolder(folder);
  impl->lock = std::make_unique<FileLock>(folder / "session.lock");
  makeFolder(folder / "images");
  impl->database = std::make_unique<Database>(databaseFile(folder), Database::Access::kCreate);
  const Database& database = *impl->database;
  // A file without tables is left over from a program that died while making it; it holds nothing.
  if (database.hasTable("meta")) {
    throw Error(ErrorKind::kBadData,
                "folder '" + folder.string() + "' already holds a session; choose another one, or resume it");
  }
  makeDurable(database);
  Transaction transaction(database);
  makeTables(database);
  putMeta(database, "cell_text", cell_text);
  putMeta(database, "seed", std::to_string(seed));  // as text: SQLite's integers are signed
  putMeta(database, "programs", programVersions());
  std::string board_text;
  for (const auto& [key, value] : boardKeys(board)) board_text += key + ": " + value + "\n";
  putMeta(database, "board_text", board_text);
  transaction.commit();
  syncFolder(folder);
  impl->file = identity(databaseFile(folder));
  return Session(std::move(impl));
}

Session Session::create(const fs::path& folder, const CellConfig& cell, std::uint64_t seed) {
  Session session = create(folder, cell.text, cell.board, seed);
  putMeta(*session.impl_->database, "cell_resolved", resolvedCell(cell));
  if (const auto urdf = urdfText(cell)) putMeta(*session.impl_->database, "urdf_text", *urdf);
  return session;
}

Session Session::open(const fs::path& folder) {
  auto impl = std::make_unique<Impl>();
  impl->folder = folder;
  impl->database = openDatabase(folder, Database::Access::kRead);
  return Session(std::move(impl));
}

Session Session::openForAppend(const fs::path& folder) {
  if (!isSession(folder)) throw noSession(folder);
  auto impl = std::make_unique<Impl>();
  impl->folder = folder;
  impl->lock = std::make_unique<FileLock>(folder / "session.lock");
  impl->database = openDatabase(folder, Database::Access::kWrite);
  makeDurable(*impl->database);
  migrate(*impl->database);
  makeFolder(folder / "images");
  Statement last(*impl->database, "SELECT max(id) FROM observation");
  last.step();
  impl->next_id = last.integer(0) + 1;
  impl->file = identity(databaseFile(folder));
  return Session(std::move(impl));
}

Observation Session::add(Observation observation, const std::vector<ViewImages>& images) {
  impl_->demandWriter();
  if (!images.empty() && images.size() != observation.views.size()) {
    throw std::invalid_argument("an observation of " + std::to_string(observation.views.size()) +
                                " views cannot have " + std::to_string(images.size()) + " images");
  }
  checkFinite(observation);
  observation.id = impl_->next_id;
  ImageHashes hashes;
  const auto write = [&](const StreamObservation& view, Stream stream, const cv::Mat& image) -> std::string {
    if (image.empty()) return "";
    const std::string name = imageName(observation.id, view, stream);
    std::vector<unsigned char> png;
    // Level 1: nearly as small as the default for camera images, and several times as fast.
    if (!cv::imencode(".png", image, png, {cv::IMWRITE_PNG_COMPRESSION, 1})) {
      throw std::invalid_argument("the image of camera '" + view.camera + "' cannot be stored as PNG");
    }
    writeWhole(impl_->folder / name, png.data(), png.size());
    hashes[name] = sha256(png.data(), png.size());
    return name;
  };
  for (std::size_t i = 0; i < images.size(); ++i) {
    StreamObservation& view = observation.views[i];
    view.image_file = write(view, view.stream, images[i].image);
    if (view.depth) view.depth->image_file = write(view, Stream::kDepth, images[i].depth);
  }
  if (!hashes.empty()) syncFolder(impl_->folder / "images");
  Transaction transaction(*impl_->database);
  insertObservation(*impl_->database, observation, hashes);
  transaction.commit();
  impl_->demandPresent();
  ++impl_->next_id;
  return observation;
}

Attempt Session::add(Attempt attempt) {
  impl_->demandWriter();
  attempt.id = 0;
  attempt.id = insertAttempt(*impl_->database, attempt);
  impl_->demandPresent();
  return attempt;
}

void Session::event(Instant stamp, const std::string& kind, const std::string& message) {
  impl_->demandWriter();
  insertEvent(*impl_->database, {stamp, kind, message});
  impl_->demandPresent();
}

std::vector<Observation> Session::observations() const { return selectObservations(*impl_->database); }

std::vector<Attempt> Session::attempts() const { return selectAttempts(*impl_->database); }

std::vector<SessionEvent> Session::events() const { return selectEvents(*impl_->database); }

std::uint64_t Session::seed() const { return std::strtoull(impl_->text("seed").c_str(), nullptr, 10); }

std::string Session::programs() const { return metaText(*impl_->database, "programs").value_or(""); }

std::string Session::cellText() const { return impl_->text("cell_text"); }

BoardSpec Session::board() const {
  return readBoard(
      ConfigReader::fromText(impl_->text("board_text"), "board in " + databaseFile(impl_->folder).string()));
}

const fs::path& Session::folder() const { return impl_->folder; }

bool isSession(const fs::path& folder) {
  std::error_code ignored;
  return fs::is_regular_file(databaseFile(folder), ignored);
}

}  // namespace servocal::session
