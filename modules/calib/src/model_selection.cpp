// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/model_selection.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <tuple>

namespace servocal::calib {
namespace {

using StreamKey = std::pair<std::string, Stream>;

constexpr double kStrongEvidence = 3.0;  // Twenty times as probable (Kass and Raftery, Bayes Factors, 1995).

/// Some stops that are fitted, and others that are not.
struct Part {
  std::vector<Observation> fitted, held_out;
  std::vector<StreamKey> left_out;  // Streams that the former do not determine; in neither.
};

/// Predictions of one description: log density by stop and view.
struct Predictions {
  std::map<std::int64_t, std::map<StreamKey, double>> log_density;
  int parts = 0, views = 0;
  double squares_px2 = 0.0, squares_m2 = 0.0, count = 0.0,
         chi_square = 0.0;  // count: residuals, two per corner
};

std::map<StreamKey, int> viewsByStream(const std::vector<Observation>& observations) {
  std::map<StreamKey, int> views;
  for (const Observation& observation : observations) {
    for (const StreamObservation& view : observation.views) ++views[{view.camera, view.stream}];
  }
  return views;
}

/// The stops with a robot pose, by id, with views of the streams that the options name.
std::vector<Observation> usable(const std::vector<Observation>& observations, const JointOptions& options) {
  const auto isAsked = [&](const StreamObservation& view) {
    return options.streams.empty() ||
           std::any_of(options.streams.begin(), options.streams.end(), [&](const JointStream& stream) {
             return stream.camera == view.camera && stream.stream == view.stream;
           });
  };
  std::vector<Observation> out;
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    Observation kept = observation;
    kept.views.clear();
    std::copy_if(observation.views.begin(), observation.views.end(), std::back_inserter(kept.views), isAsked);
    if (!kept.views.empty()) out.push_back(std::move(kept));
  }
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  return out;
}

/// Of each stream the stops at which no other has fewer views in all are cut into runs; a part holds out one
/// run of each. A calibration goes from camera to camera: a fifth of its stops may be all that one of them
/// ever saw.
std::vector<Part> partsOf(const std::vector<Observation>& sorted, int count) {
  const std::map<StreamKey, int> views = viewsByStream(sorted);
  std::map<StreamKey, std::vector<std::size_t>> strata;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const auto rank = [&](const StreamObservation& view) {
      const StreamKey key(view.camera, view.stream);
      return std::make_pair(views.at(key), key);
    };
    const auto rarest = std::min_element(sorted[i].views.begin(), sorted[i].views.end(),
                                         [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
    strata[{rarest->camera, rarest->stream}].push_back(i);
  }
  std::vector<int> part_of(sorted.size());
  for (const auto& [stream, stops] : strata) {
    for (int part = 0; part < count; ++part) {
      const auto cut = [count, all = stops.size()](int at) {
        return all * static_cast<std::size_t>(at) / static_cast<std::size_t>(count);
      };
      for (std::size_t i = cut(part); i < cut(part + 1); ++i) part_of[stops[i]] = part;
    }
  }
  std::vector<Part> parts(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    for (int part = 0; part < count; ++part) {
      Part& its = parts[static_cast<std::size_t>(part)];
      (part_of[i] == part ? its.held_out : its.fitted).push_back(sorted[i]);
    }
  }
  return parts;
}

void eraseStream(const StreamKey& stream, std::vector<Observation>& observations) {
  for (Observation& observation : observations) {
    auto& views = observation.views;
    views.erase(
        std::remove_if(views.begin(), views.end(),
                       [&](const auto& view) { return StreamKey(view.camera, view.stream) == stream; }),
        views.end());
  }
  observations.erase(std::remove_if(observations.begin(), observations.end(),
                                    [](const Observation& observation) { return observation.views.empty(); }),
                     observations.end());
}

JointOptions optionsFor(const Part& part, JointOptions options) {
  auto& streams = options.streams;
  streams.erase(std::remove_if(streams.begin(), streams.end(),
                               [&](const JointStream& stream) {
                                 const StreamKey key(stream.camera, stream.stream);
                                 return std::find(part.left_out.begin(), part.left_out.end(), key) !=
                                        part.left_out.end();
                               }),
                streams.end());
  return options;
}

/// The part fitted. Streams are taken out of it, that of the fewest views first, until those that stay are
/// determined; nothing if none are.
std::optional<JointSolution> fitDetermined(const BoardSpec& board, const JointOptions& options, Part& part) {
  for (;;) {
    JointOutcome outcome = solveJoint(board, part.fitted, optionsFor(part, options));
    if (outcome.solution) return std::move(outcome.solution);
    if (outcome.status != JointStatus::kTooFewViews && outcome.status != JointStatus::kNotDetermined)
      return std::nullopt;
    std::map<StreamKey, int> fitted = viewsByStream(part.fitted);
    for (const auto& held_out : viewsByStream(part.held_out)) fitted.try_emplace(held_out.first, 0);
    if (fitted.size() < 2) return std::nullopt;
    const StreamKey fewest = std::min_element(fitted.begin(), fitted.end(), [](const auto& a, const auto& b) {
                               return a.second < b.second;
                             })->first;
    part.left_out.push_back(fewest);
    eraseStream(fewest, part.fitted);
    eraseStream(fewest, part.held_out);
  }
}

void add(const BoardSpec& board, const Part& part, const JointSolution& solution, Predictions& out) {
  const std::vector<HeldOutView> predicted = predictHeldOut(board, part.held_out, solution).views;
  out.parts += predicted.empty() ? 0 : 1;
  for (const HeldOutView& view : predicted) {
    out.log_density[view.observation_id][{view.camera, view.stream}] = view.log_density;
    ++out.views;
    out.squares_px2 += view.rms_px * view.rms_px * view.degrees;
    out.squares_m2 += view.error_m * view.error_m * view.degrees;
    out.count += view.degrees;
    out.chi_square += view.chi_square;
  }
}

/// Sum of the differences over the stops, and its standard deviation by their scatter. Held-out views that
/// are no views of this cell (wrong boards, foreign poses) are improbable under either model; a stop's say is
/// limited.
std::pair<double, double> gainOf(const Predictions& richer, const Predictions& leaner) {
  constexpr double kMostSay = 50.0;
  std::vector<double> gains;
  for (const auto& [stop, views] : richer.log_density) {
    const auto before = leaner.log_density.find(stop);
    if (before == leaner.log_density.end()) continue;
    double gain = 0;
    for (const auto& [key, density] : views) {
      const auto other = before->second.find(key);
      if (other != before->second.end()) gain += density - other->second;
    }
    if (std::isfinite(gain)) gains.push_back(std::clamp(gain, -kMostSay, kMostSay));
  }
  double sum = 0, squares = 0;
  for (const double gain : gains) sum += gain;
  const double mean = gains.empty() ? 0.0 : sum / static_cast<double>(gains.size());
  for (const double gain : gains) squares += (gain - mean) * (gain - mean);
  return {sum, std::sqrt(squares)};
}

ModelScore scoreOf(const std::string& name, const Predictions& predictions) {
  ModelScore score;
  score.name = name;
  score.solved = true;
  score.views = predictions.views;
  score.rms_px = std::sqrt(predictions.squares_px2 / predictions.count);
  score.rms_m = std::sqrt(predictions.squares_m2 / predictions.count);
  score.z = std::sqrt(predictions.chi_square / predictions.count);
  return score;
}

}  // namespace

std::optional<ModelSelection> selectModel(const BoardSpec& board,
                                          const std::vector<Observation>& observations,
                                          const JointOptions& base, const std::vector<ModelTerm>& terms,
                                          int blocks) {
  if (blocks < 2) throw std::invalid_argument("cross-validation takes at least two blocks");
  std::vector<Part> parts = partsOf(usable(observations, base), blocks);
  Predictions best;
  for (auto part = parts.begin(); part != parts.end();) {
    const auto solution = fitDetermined(board, base, *part);
    if (solution) add(board, *part, *solution, best);
    part = solution ? part + 1 : parts.erase(part);
  }
  if (2 * best.parts <= blocks) return std::nullopt;
  ModelSelection selection;
  selection.options = base;
  selection.score = scoreOf("", best);
  selection.score.kept = true;
  selection.scores = {selection.score};
  std::string kept, refused;
  for (const ModelTerm& term : terms) {
    JointOptions richer = selection.options;
    term.allow(richer);
    Predictions predictions;
    for (const Part& part : parts) {
      const JointOutcome outcome = solveJoint(board, part.fitted, optionsFor(part, richer));
      if (outcome.solution) add(board, part, *outcome.solution, predictions);
    }
    ModelScore score;
    score.name = term.name;
    if (2 * predictions.parts > blocks) {
      score = scoreOf(term.name, predictions);
      std::tie(score.gain, score.gain_sigma) = gainOf(predictions, best);
      score.kept = score.gain > std::max(kStrongEvidence, score.gain_sigma);
    }
    if (score.kept) {
      best = std::move(predictions);
      selection.options = std::move(richer);
      selection.score = score;
    }
    std::string& list = score.kept ? kept : refused;
    list += (list.empty() ? "" : ", ") + term.name;
    selection.scores.push_back(score);
  }
  if (!kept.empty()) selection.sentence = "Supported by the views held out: " + kept + ".";
  if (!refused.empty()) {
    selection.sentence +=
        (kept.empty() ? "" : " ") + ("Not supported by the views held out: " + refused) + ".";
  }
  std::map<StreamKey, int> left_out;
  for (const Part& part : parts) {
    for (const StreamKey& stream : part.left_out) ++left_out[stream];
  }
  for (const auto& [stream, times] : left_out) {
    selection.sentence += " " + stream.first + " " + toString(stream.second) + " was not compared in " +
                          std::to_string(times) + " of " + std::to_string(blocks) +
                          " parts: the rest of its views does not determine it.";
  }
  return selection;
}

}  // namespace servocal::calib
