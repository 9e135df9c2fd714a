// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/design/analyse.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Dense>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

#include "polypod/core/nearest_word.hpp"
#include "polypod/design/cell_study.hpp"
#include "polypod/design/optimize.hpp"

namespace polypod::design {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Ranks from 1, equal values with the mean of theirs; then without mean and with a deviation of 1. Empty where all are
/// equal.
Eigen::VectorXd standard_ranks(const std::vector<double>& values) {
  const std::size_t n = values.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  // What differs by rounding alone has one rank.
  constexpr double kRounding = 1e-12;
  const double same = n == 0 ? 0 : kRounding * std::max(std::abs(values[order[0]]), std::abs(values[order[n - 1]]));
  Eigen::VectorXd out(static_cast<Eigen::Index>(n));
  for (std::size_t i = 0; i < n;) {
    std::size_t end = i;
    while (end < n && values[order[end]] - values[order[i]] <= same) ++end;
    const double rank = 0.5 * static_cast<double>(i + end + 1);
    for (; i < end; ++i) out[static_cast<Eigen::Index>(order[i])] = rank;
  }
  out.array() -= out.mean();
  const double size = out.norm();
  if (!(size > 0)) return {};
  return out / size;
}

/// How a row's number of this name is found. The study must outlive it.
std::function<double(const Row&)> column_of(const Study& study, const std::string& name) {
  if (name == "row") return [](const Row& row) { return static_cast<double>(row.row); };
  if (name == "seconds") return [](const Row& row) { return row.evaluation.seconds; };
  if (name == "objective") return [](const Row& row) { return row.evaluation.objective.value; };
  const std::vector<Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i)
    if (name == info_of(figures[i]).name) return [i](const Row& row) { return row.evaluation.figures[i].value; };
  for (std::size_t i = 0; i < study.vary.size(); ++i)
    if (name == study.vary[i].key) return [i](const Row& row) { return row.varied[i]; };
  return [&study, name](const Row& row) {
    for (const auto& [key, value] : parameters_of(study, row))
      if (key == name) return value;
    return kNone;
  };
}

std::vector<std::string> names_of(const Study& study) {
  std::vector<std::string> out{"row", "seconds"};
  if (!study.wants_front()) out.emplace_back("objective");
  for (const Figure f : study.figures()) out.emplace_back(info_of(f).name);
  for (const Vary& v : study.vary) out.push_back(v.key);
  for (const Tie& t : study.ties) out.push_back(t.key);
  return out;
}

/// A figure of a row; NaN where the study does not ask for it.
Value value_of(const Study& study, const Row& row, Figure figure) {
  const std::vector<Figure> figures = study.figures();
  const auto at = static_cast<std::size_t>(std::find(figures.begin(), figures.end(), figure) - figures.begin());
  return at < figures.size() ? row.evaluation.figures[at] : Value{};
}

bool is_volume(Figure f) {
  return f == Figure::volume || f == Figure::largest_box;
}

/// A field of a table as RFC 4180 has it.
std::string field(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}
std::string field(double value) {
  return std::isfinite(value) ? fmt::format("{}", value) : "";
}

}  // namespace

std::vector<Sensitivity> sensitivities(const Study& study, const std::vector<Row>& rows) {
  constexpr std::size_t kRowsEach = 3;
  std::vector<std::string> asked;
  if (!study.wants_front()) asked.emplace_back("objective");
  for (const Figure f : study.figures()) asked.emplace_back(info_of(f).name);
  std::vector<Sensitivity> out;
  const std::size_t n = study.vary.size();
  // Most figures are known of the same rows: their parameters are ranked once.
  std::vector<std::size_t> ranked, moving;
  Eigen::MatrixXd X;
  for (const std::string& name : asked) {
    const auto column = column_of(study, name);
    std::vector<double> y;
    std::vector<std::size_t> which;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      const Row& row = rows[r];
      if (row.evaluation.state != State::done && row.evaluation.state != State::dropped) continue;
      const double value = column(row);
      const bool whole = std::none_of(row.varied.begin(), row.varied.end(), [](double v) { return std::isnan(v); });
      if (!std::isfinite(value) || !whole) continue;
      y.push_back(value);
      which.push_back(r);
    }
    if (y.size() < kRowsEach * (n + 1)) continue;
    const Eigen::VectorXd ranks = standard_ranks(y);
    if (ranks.size() == 0) continue;
    if (which != ranked) {
      ranked = which;
      moving.clear();
      X.resize(ranks.size(), 0);
      for (std::size_t i = 0; i < n; ++i) {
        std::vector<double> x;
        for (const std::size_t r : which) x.push_back(rows[r].varied[i]);
        const Eigen::VectorXd of_x = standard_ranks(x);
        if (of_x.size() == 0) continue;
        moving.push_back(i);
        X.conservativeResize(Eigen::NoChange, X.cols() + 1);
        X.col(X.cols() - 1) = of_x;
      }
    }
    if (moving.empty()) continue;
    const Eigen::VectorXd b = X.completeOrthogonalDecomposition().solve(ranks);
    Sensitivity s{name, std::vector<double>(n, kNone), 1 - (ranks - X * b).squaredNorm(), static_cast<int>(y.size())};
    for (std::size_t k = 0; k < moving.size(); ++k) s.coefficients[moving[k]] = b[static_cast<Eigen::Index>(k)];
    out.push_back(std::move(s));
  }
  return out;
}

Result<Condition> condition_of(const Study& study, const std::string& text) {
  const auto bad = [&](const std::string& why, const std::string& hint) {
    return fail("OP120", fmt::format("{}: {}", text, why), {}, hint);
  };
  const std::size_t at = text.find_first_of("<>=");
  if (at == std::string::npos || at == 0) return bad("no condition", "write volume_mm3>=20000");
  Condition out;
  out.name = text.substr(0, at);
  const bool equal = text.compare(at + 1, 1, "=") == 0 && text[at] != '=';
  using Is = Condition::Is;
  out.is = text[at] == '='   ? Is::equal
           : text[at] == '<' ? (equal ? Is::at_most : Is::below)
                             : (equal ? Is::at_least : Is::above);
  const char* begin = text.data() + at + (equal ? 2 : 1);
  const char* const end = text.data() + text.size();
  const auto [rest, code] = std::from_chars(begin, end, out.value);
  if (begin == end || code != std::errc{} || rest != end || !std::isfinite(out.value)) {
    return bad("there is no number behind the sign", "write volume_mm3>=20000");
  }
  const std::vector<std::string> known = names_of(study);
  if (std::find(known.begin(), known.end(), out.name) == known.end()) {
    return bad(fmt::format("this study has no {}", out.name),
               did_you_mean(out.name, known) + fmt::format("known: {}", fmt::join(known, ", ")));
  }
  return out;
}

std::function<bool(const Row&)> test_of(const Study& study, const Condition& c) {
  return [column = column_of(study, c.name), is = c.is, bound = c.value](const Row& row) {
    const double x = column(row);
    switch (is) {
      case Condition::Is::below:
        return x < bound;
      case Condition::Is::at_most:
        return x <= bound;
      case Condition::Is::above:
        return x > bound;
      case Condition::Is::at_least:
        return x >= bound;
      case Condition::Is::equal:
        break;
    }
    return x == bound;
  };
}

namespace {

/// As "row 7 (pose 1: leg 2 is too short)": what the reason says behind the hold.
std::string nearest_row(const Row& row, const std::string& hold) {
  const std::string& reason = row.evaluation.reason;
  return fmt::format("row {}{}", row.row, reason.substr(reason.find(hold) + hold.size()));
}

}  // namespace

std::string HoldSummary::in_words() const {
  std::string nearer;
  if (std::isfinite(nearest)) nearer = fmt::format("; the nearest has {:.6g}", nearest);
  if (!reason.empty()) nearer = "; the nearest: " + reason;
  return fmt::format("{} of the {} whose figure is known do not keep: {}{}", broken, judged, hold, nearer);
}

std::vector<HoldSummary> hold_summaries(const Study& study, const std::vector<Row>& rows) {
  const bool start_counts = start_is_candidate(study);
  std::vector<HoldSummary> out;
  for (const Hold& h : study.holds) {
    HoldSummary s;
    s.hold = h.in_words();
    double least = std::numeric_limits<double>::infinity();
    for (const Row& row : rows) {
      if (row.phase == Phase::start && !start_counts) continue;
      if (h.box) {
        const bool broken = row.evaluation.reason.find(s.hold) != std::string::npos;
        s.judged += broken || row.evaluation.state == State::done ? 1 : 0;
        s.broken += broken ? 1 : 0;
        if (broken && row.evaluation.violation < least) {
          least = row.evaluation.violation;
          s.reason = nearest_row(row, s.hold);
        }
        continue;
      }
      const Value v = value_of(study, row, h.figure);
      if (std::isnan(v.value)) continue;
      ++s.judged;
      // Coarse bounds, of a row that something else ended, break a hold where both do.
      const bool ended_here = row.evaluation.reason.find(s.hold) != std::string::npos;
      const double low = ended_here ? v.lower : v.upper, high = ended_here ? v.upper : v.lower;
      const double below = h.min ? *h.min - low : 0, above = h.max ? high - *h.max : 0, by = std::max(below, above);
      if (!(by > 0)) continue;
      ++s.broken;
      if (by >= least) continue;
      least = by;
      s.nearest = below > above ? low : high;
    }
    out.push_back(std::move(s));
  }
  for (const char* duty : {kAllPoses, kMotion}) {
    HoldSummary s;
    s.hold = duty;
    double least = std::numeric_limits<double>::infinity();
    for (const Row& row : rows) {
      if (row.phase == Phase::start && !start_counts) continue;
      const bool broken = row.evaluation.reason.find(duty) != std::string::npos;
      s.judged += broken || row.evaluation.state == State::done ? 1 : 0;
      s.broken += broken ? 1 : 0;
      if (!broken || row.evaluation.violation >= least) continue;
      least = row.evaluation.violation;
      s.reason = nearest_row(row, s.hold);
    }
    if (s.broken > 0) out.push_back(std::move(s));
  }
  return out;
}

namespace {

/// The area between a corner and points in a plane, to which points are added one by one.
class Staircase {
 public:
  Staircase(double x, double y) : x_(x), y_(y) {}
  [[nodiscard]] double area() const { return area_; }
  void add(double x, double y) {
    auto right = steps_.upper_bound(x);
    double level = right == steps_.end() ? y_ : right->second;
    if (level >= y) return;
    // The strips between what was there and the new step, from it to the left.
    double from = x;
    auto step = right;
    while (step != steps_.begin() && std::prev(step)->second <= y) {
      --step;
      area_ += (from - step->first) * (y - level);
      from = step->first;
      level = step->second;
    }
    const double end = step == steps_.begin() ? x_ : std::prev(step)->first;
    area_ += (from - end) * (y - level);
    steps_.erase(step, right);
    steps_.emplace(x, y);
  }

 private:
  double x_, y_, area_ = 0;
  std::map<double, double> steps_;  // y of each x, falling
};

}  // namespace

double hypervolume(std::vector<std::vector<double>> points, const std::vector<double>& corner) {
  std::erase_if(points, [&](const auto& p) {
    for (std::size_t i = 0; i < corner.size(); ++i)
      if (!(p[i] > corner[i])) return true;
    return false;
  });
  if (points.empty()) return 0;
  const std::size_t last = corner.size() - 1;
  std::sort(points.begin(), points.end(), [&](const auto& a, const auto& b) { return a[last] > b[last]; });
  if (last == 0) return points.front()[0] - corner[0];
  // Slices between the heights of the last goal: in each those points count that reach above it.
  double out = 0;
  std::vector<std::vector<double>> above;
  const std::vector<double> base(corner.begin(), corner.end() - 1);
  Staircase steps(corner[0], corner[1]);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double next = i + 1 < points.size() ? points[i + 1][last] : corner[last];
    if (last <= 2) {
      steps.add(points[i][0], points[i][1]);
      out = last == 1 ? steps.area() : out + (points[i][last] - next) * steps.area();
      continue;
    }
    above.emplace_back(points[i].begin(), points[i].end() - 1);
    if (points[i][last] > next) out += (points[i][last] - next) * hypervolume(above, base);
  }
  return out;
}

std::optional<FrontVolume> front_volume(const Study& study, const std::vector<Row>& rows,
                                        const std::vector<std::size_t>& front, const std::vector<double>& reference) {
  const std::size_t n = study.goals.size();
  if (front.empty() || n < 2) return {};
  const auto sign = [&](std::size_t i) { return study.goals[i].maximise ? 1.0 : -1.0; };
  std::vector<std::vector<double>> points;
  for (const std::size_t r : front) {
    std::vector<double> p;
    for (std::size_t i = 0; i < n; ++i) p.push_back(sign(i) * value_of(study, rows[r], study.goals[i].figure).value);
    points.push_back(std::move(p));
  }
  FrontVolume out;
  std::vector<double> corner;
  double box = 1;
  bool any_given = false;
  for (std::size_t i = 0; i < n; ++i) {
    double least = points[0][i], most = least;
    for (const auto& p : points) {
      least = std::min(least, p[i]);
      most = std::max(most, p[i]);
    }
    constexpr double kBeyond = 0.1;
    const bool given = i < reference.size() && !std::isnan(reference[i]);
    any_given = any_given || given;
    corner.push_back(given ? sign(i) * reference[i] : least - kBeyond * (most - least));
    box *= std::max(0.0, most - corner[i]);
    out.best.push_back(sign(i) * most);
    out.reference.push_back(sign(i) * corner[i]);
  }
  if (!any_given && !(box > 0)) return {};
  out.volume = hypervolume(std::move(points), corner);
  out.share = box > 0 ? out.volume / box : 0;
  return out;
}

std::string in_words(const Study& study, const FrontVolume& volume) {
  std::string reference;
  for (std::size_t i = 0; i < study.goals.size(); ++i) {
    reference +=
        fmt::format("{}{} {:.6g}", i > 0 ? ", " : "", info_of(study.goals[i].figure).name, volume.reference[i]);
  }
  return fmt::format("hypervolume {:.6g}, {:.3g} % of the box between the best of each goal and the reference point {}",
                     volume.volume, 100 * volume.share, reference);
}

std::vector<std::string> unchanged_goals(const Study& study, const std::vector<Row>& rows) {
  constexpr std::size_t kFew = 3;
  std::vector<std::string> out;
  for (const Goal& goal : study.goals) {
    std::vector<double> values;
    for (const Row& row : rows) {
      if (row.evaluation.state == State::done) values.push_back(value_of(study, row, goal.figure).value);
    }
    if (values.size() >= kFew && standard_ranks(values).size() == 0) out.emplace_back(info_of(goal.figure).name);
  }
  return out;
}

std::vector<std::pair<std::string, int>> refusals(const std::vector<Row>& rows) {
  std::map<std::string, int> count;
  for (const Row& row : rows)
    if (row.evaluation.state == State::refused && row.phase != Phase::start) ++count[row.evaluation.reason];
  std::vector<std::pair<std::string, int>> out(count.begin(), count.end());
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  return out;
}

std::vector<std::string> binding(const Study& study, const Row& row) {
  std::vector<std::string> out;
  constexpr double kNear = 0.01;
  for (const Hold& h : study.holds) {
    if (h.box) continue;
    const Value v = value_of(study, row, h.figure);
    const auto near = [&](double x, const std::optional<double>& bound) {
      return bound && std::abs(x - *bound) <= kNear * std::abs(*bound);
    };
    if (near(v.lower, h.min) || near(v.upper, h.max)) out.push_back(h.in_words());
  }
  for (std::size_t i = 0; i < study.vary.size(); ++i) {
    const Vary& v = study.vary[i];
    const double u = v.share_of(row.varied[i]);
    const auto count = v.count();
    const double end = !v.values.empty() ? 0.5 / static_cast<double>(*count) : 0;
    constexpr double kRounding = 1e-9;
    if (count && *count < 2) continue;
    if (u <= end + kRounding || u >= 1 - end - kRounding)
      out.push_back(fmt::format("{} at an end of its {}", v.key, v.values.empty() ? "range" : "list"));
  }
  return out;
}

std::vector<std::pair<std::string, double>> parameters_of(const Study& study, const Row& row) {
  auto out = study.parameters(row.varied);
  if (row.phase == Phase::start && !start_is_candidate(study)) {
    for (std::size_t i = study.vary.size(); i < out.size(); ++i) out[i].second = kNone;
  }
  return out;
}

std::string rows_csv(const Study& study, const std::vector<Row>& rows, const std::vector<std::size_t>& which) {
  const std::vector<Figure> figures = study.figures();
  std::string out = "row,state,phase,objective,objective_lower,objective_upper,violation";
  for (const Vary& v : study.vary) out += "," + field(v.key);
  for (const Tie& t : study.ties) out += "," + field(t.key);
  for (const Figure f : figures) {
    const std::string name = info_of(f).name;
    out += "," + name;
    if (is_volume(f)) out += "," + name + "_lower," + name + "_upper";
  }
  out += ",seconds,version,at,reason\n";
  for (const std::size_t k : which) {
    const Row& row = rows[k];
    const Evaluation& e = row.evaluation;
    out += fmt::format("{},{},{},{},{},{},{}", row.row, name_of(e.state), name_of(row.phase), field(e.objective.value),
                       field(e.objective.lower), field(e.objective.upper), field(e.violation));
    for (const auto& [key, value] : parameters_of(study, row)) out += "," + field(value);
    for (std::size_t i = 0; i < figures.size(); ++i) {
      const Value& v = e.figures[i];
      out += "," + field(v.value);
      if (is_volume(figures[i])) out += "," + field(v.lower) + "," + field(v.upper);
    }
    out += fmt::format(",{},{},{},{}\n", field(e.seconds), field(row.version), field(row.at), field(e.reason));
  }
  return out;
}

namespace {

/// Where a candidate comes from, and what it is worth.
std::string origin_of(const Study& study, const Row& row) {
  const Evaluation& e = row.evaluation;
  std::string text = fmt::format("row {} of the study {} on {} (seed {}, Polypod {})", row.row, study.file,
                                 study.machine, study.seed, row.version);
  if (!std::isnan(e.objective.value)) text += fmt::format("; objective {:.6g}", e.objective.value);
  const std::vector<Figure> figures = study.figures();
  for (std::size_t i = 0; i < figures.size(); ++i)
    text += fmt::format("; {} {:.6g}", info_of(figures[i]).name, e.figures[i].value);
  text += "; set by the search: ";
  std::vector<std::string> set;
  for (const auto& [key, value] : study.parameters(row.varied)) set.push_back(fmt::format("{} = {}", key, value));
  return text + fmt::format("{}", fmt::join(set, ", "));
}

}  // namespace

Result<std::string> file_of_row(const Study& study, const Row& row) {
  if (!study.of_cell) {
    POLYPOD_ASSIGN(m, machine_of_row(study, row));
    return machine::to_toml(m);
  }
  if (row.phase == Phase::start) return study.machine_toml;
  const auto made = cell_at(study, row.varied);
  if (!made) {
    return fail("OP121", fmt::format("row {} has no cell: {}", row.row, made.error().message), {}, "take another row");
  }
  std::string origin = origin_of(study, row);
  std::replace_if(
      origin.begin(), origin.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  return fmt::format("# {}\n{}", origin, *made);
}

Result<AnyMachine> machine_of_row(const Study& study, const Row& row) {
  if (row.phase == Phase::start) return study.start;
  auto made = study.machine_at(row.varied);
  if (!made) {
    return fail("OP121", fmt::format("row {} has no machine: {}", row.row, made.error().message), {},
                "take another row");
  }
  const std::string text = origin_of(study, row) +
                           "; what other entries say of these figures is true of the machine that the study began with";
  machine::note(*made, "study", text);
  return std::move(*made);
}

}  // namespace polypod::design
