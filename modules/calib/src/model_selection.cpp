// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/model_selection.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <tuple>

namespace servocal::calib {
namespace {

using ViewKey = std::pair<std::string, Stream>;

/// Predictions of one description: log density by stop and view.
struct Predictions {
  std::map<std::int64_t, std::map<ViewKey, double>> log_density;
  int views = 0;
  double squares_px2 = 0.0, squares_m2 = 0.0, count = 0.0,
         chi_square = 0.0;  // count: residuals, two per corner
};

std::optional<Predictions> predict(const BoardSpec& board, const std::vector<Observation>& sorted,
                                   const JointOptions& options, int blocks) {
  Predictions out;
  for (int block = 0; block < blocks; ++block) {
    const std::size_t begin =
        sorted.size() * static_cast<std::size_t>(block) / static_cast<std::size_t>(blocks);
    const std::size_t end =
        sorted.size() * static_cast<std::size_t>(block + 1) / static_cast<std::size_t>(blocks);
    std::vector<Observation> fitted, held_out;
    for (std::size_t i = 0; i < sorted.size(); ++i)
      (i >= begin && i < end ? held_out : fitted).push_back(sorted[i]);
    const JointOutcome outcome = solveJoint(board, fitted, options);
    if (!outcome.solution) return std::nullopt;
    for (const HeldOutView& view : predictHeldOut(board, held_out, *outcome.solution).views) {
      out.log_density[view.observation_id][{view.camera, view.stream}] = view.log_density;
      ++out.views;
      out.squares_px2 += view.rms_px * view.rms_px * view.degrees;
      out.squares_m2 += view.error_m * view.error_m * view.degrees;
      out.count += view.degrees;
      out.chi_square += view.chi_square;
    }
  }
  return out;
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
  std::vector<Observation> sorted;
  for (const Observation& observation : observations) {
    if (observation.robot && !observation.views.empty()) sorted.push_back(observation);
  }
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const Observation& a, const Observation& b) { return a.id < b.id; });

  std::optional<Predictions> best = predict(board, sorted, base, blocks);
  if (!best) return std::nullopt;
  ModelSelection selection;
  selection.options = base;
  selection.score = scoreOf("", *best);
  selection.score.kept = true;
  selection.scores = {selection.score};
  std::string kept, refused;
  for (const ModelTerm& term : terms) {
    JointOptions richer = selection.options;
    term.allow(richer);
    std::optional<Predictions> predictions = predict(board, sorted, richer, blocks);
    ModelScore score;
    score.name = term.name;
    if (predictions) {
      score = scoreOf(term.name, *predictions);
      std::tie(score.gain, score.gain_sigma) = gainOf(*predictions, *best);
      score.kept = score.gain > 2.0 * score.gain_sigma;
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
  return selection;
}

}  // namespace servocal::calib
