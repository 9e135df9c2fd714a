// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "commands.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/quality/singularity.hpp"
#include "survey_options.hpp"

namespace polypod::app {
namespace {

struct Varied {
  std::string key;
  std::vector<std::string> values;
};

constexpr std::size_t kMostRows = 10'000;

/// a, a + step, ... up to b (and b itself, within a millionth of a step), as text that reads back to the same numbers.
Result<std::vector<std::string>> range_of(const std::string& key, const std::string& text) {
  const auto bad = [&](const char* why) {
    return fail("AP154", fmt::format("--set {}={}: {}", key, text, why), {}, "write key=80:100:5, from:to:step");
  };
  std::string list = text;
  std::replace(list.begin(), list.end(), ':', ',');
  if (text.find(',') != std::string::npos) return bad("a list or a range, not both");
  POLYPOD_ASSIGN(n, numbers_of(list, "--set"));
  if (n.size() != 3) return bad("not from:to:step");
  const double steps = (n[1] - n[0]) / n[2];
  if (!(steps >= 0) || !std::isfinite(steps)) return bad("the steps do not lead from the first number to the second");
  if (steps >= static_cast<double>(kMostRows)) return bad("more than 10000 values");
  std::vector<std::string> out;
  for (int k = 0; k <= steps + 1e-6; ++k) out.push_back(fmt::format("{:.12g}", n[0] + k * n[2]));
  return out;
}

/// `key=a,b,c` and `key=a:b:step` are varied, `key=a` are fixed.
Result<std::vector<Varied>> varied_of(const std::vector<std::string>& sets, std::vector<std::string>& fixed) {
  std::vector<Varied> out;
  for (const std::string& set : sets) {
    const std::size_t equals = set.find('=');
    if (equals == std::string::npos || set.find_first_of(",:", equals) == std::string::npos) {
      fixed.push_back(set);
      continue;
    }
    Varied v{set.substr(0, equals), {}};
    if (set.find(':', equals) != std::string::npos) {
      POLYPOD_ASSIGN(values, range_of(v.key, set.substr(equals + 1)));
      v.values = std::move(values);
      out.push_back(std::move(v));
      continue;
    }
    POLYPOD_TRY(numbers_of(set.substr(equals + 1), "--set"));
    for (std::size_t start = equals + 1; start <= set.size();) {
      const std::size_t comma = std::min(set.find(',', start), set.size());
      v.values.push_back(set.substr(start, comma - start));
      start = comma + 1;
    }
    out.push_back(std::move(v));
  }
  if (out.empty()) {
    return fail("AP155", "nothing to sweep: no --set has a list of values", {},
                "write --set leg.length_max_mm=80,90,100 or leg.length_max_mm=80:100:10");
  }
  return out;
}

std::string bar(double value, double largest) {
  constexpr int kWidth = 40;
  const int n = largest > 0 && std::isfinite(value) ? static_cast<int>(kWidth * value / largest + 0.5) : 0;
  return std::string(static_cast<std::size_t>(std::clamp(n, 0, kWidth)), '#');
}

struct Options {
  std::string machine, analysis = "workspace", csv;
  std::vector<std::string> sets, errors, tolerances;
  bool together = false;
  SurveyArguments where;
};

/// What an analysis says of one machine: named numbers, the first of them for the bars.
struct Numbers {
  std::vector<std::pair<std::string, double>> values;
  bool converged = true;
  std::string singular;        ///< that the machine is singular at every pose, in few words
  std::string missing;         ///< why there are none
  Json more = Json::object();  ///< what else the JSON document says
};

using Named = std::vector<std::pair<std::string, double>>;

Named measure_numbers(const Region& region) {
  std::string unit = region.unit;
  std::replace(unit.begin(), unit.end(), ' ', '_');
  return {{"measure_" + unit, region.measure},
          {"measure_lower_" + unit, region.lower},
          {"measure_upper_" + unit, region.upper}};
}

/// How large what was surveyed is.
Named size_numbers(const quality::Survey& survey) {
  const Region size = size_of(survey);
  if (!survey.task.places()) return measure_numbers(size);
  return {{"volume_mm3", size.measure}, {"volume_lower_mm3", size.lower}, {"volume_upper_mm3", size.upper}};
}

Result<Numbers> workspace_numbers(const Options& o, const machine::AnyMachine& m, const Context& context) {
  POLYPOD_ASSIGN(options, o.where.workspace.options(m, context));
  POLYPOD_ASSIGN(v, workspace::volume(m, options));
  if (const machine::Task task = kinematics::task(m); !task.places()) {
    return Numbers{
        measure_numbers(region_of(task, v.volume, v.lower, v.upper)), v.converged, {}, {}, region_json(m, v)};
  }
  return Numbers{{{"volume_mm3", units::to_mm3(v.volume)},
                  {"volume_lower_mm3", units::to_mm3(v.lower)},
                  {"volume_upper_mm3", units::to_mm3(v.upper)}},
                 v.converged,
                 {},
                 {},
                 volume_json(v)};
}

Result<Numbers> quality_numbers(const Options& o, const machine::AnyMachine& m, const Context& context) {
  POLYPOD_ASSIGN(options, o.where.options(m, context));
  options.progress = nullptr;
  const auto found = quality::survey(m, options);
  // A machine of the sweep without a workspace is a row without numbers, not an error.
  if (!found && found.error().id == "QU110") return Numbers{{}, true, {}, found.error().message, Json::object()};
  if (!found) return tl::unexpected(found.error());
  const quality::Survey& survey = *found;
  const auto with_size = [&](Named values) {
    for (auto& [name, value] : size_numbers(survey)) values.emplace_back(name, value);
    return Numbers{std::move(values), true, {}, {}, Json::object()};
  };
  if (o.analysis == "dexterity") {
    POLYPOD_ASSIGN(f, quality::dexterity_field(m, survey, options));
    const auto seen = [&](const quality::Quantity& quantity, std::size_t number) {
      return quality::statistics_seen(m, survey, options, quantity, f.anywhere, number);
    };
    const auto worst = [&](const quality::Quantity& quantity, std::size_t number, double sign) {
      return quality::worst_seen(m, survey, options, quantity, f.anywhere, number, sign).value;
    };
    const auto kappa = seen(f.condition, 0), sigma = seen(f.sigma_min, 1), det = seen(f.determinant, 2);
    return with_size({{"condition_mean", kappa.mean},
                      {"condition_mean_min", kappa.min},
                      {"condition_mean_max", kappa.max},
                      {"condition_max", worst(f.condition, 0, 1)},
                      {"sigma_min_mean", sigma.mean},
                      {"sigma_min_mean_max", sigma.max},
                      {"sigma_min_min", worst(f.sigma_min, 1, -1)},
                      {"determinant_mean", det.mean},
                      {"determinant_mean_max", det.max}});
  }
  const bool tolerances = !o.tolerances.empty();
  POLYPOD_ASSIGN(sizes, sizes_argument(m, o.errors, o.tolerances));
  POLYPOD_ASSIGN(f, tolerances ? quality::tolerance_field(m, survey, options, sizes)
                               : quality::known_error_field(m, survey, options, sizes));
  const auto position = quality::statistics_seen(m, survey, options, f.position, f.anywhere, 0),
             turn = quality::statistics_seen(m, survey, options, f.orientation, f.anywhere, 1);
  const auto worst = quality::worst_seen(m, survey, options, f.position, f.anywhere, 0),
             worst_turned = quality::worst_seen(m, survey, options, f.orientation, f.anywhere, 1);
  return with_size({{"position_mean_mm", units::to_mm(position.mean)},
                    {"position_mean_max_mm", units::to_mm(position.max)},
                    {"position_max_mm", units::to_mm(worst.value)},
                    {"orientation_mean_rad", turn.mean},
                    {"orientation_mean_max_rad", turn.max},
                    {"orientation_max_rad", worst_turned.value}});
}

Result<Numbers> numbers_of_machine(const Options& o, const machine::AnyMachine& m, const Context& context) {
  const quality::PoseIndependentSingularity s = quality::pose_independent_singularity(m);
  const std::string words =
      s.never_held()
          ? fmt::format(
                "singular at {0} of {0} poses that were judged (type 2): the drives do not constrain the platform",
                s.poses)
          : "";
  if (o.analysis == "workspace") {
    POLYPOD_ASSIGN(numbers, workspace_numbers(o, m, context));
    numbers.singular = words;
    return numbers;
  }
  if (!words.empty()) return Numbers{{}, true, words, words, Json::object()};
  return quality_numbers(o, m, context);
}

/// Each analysis has options of its own.
Status refuse_unused(const Options& o, const Context& context) {
  if (o.analysis != "errors") {
    POLYPOD_TRY(refuse(context, {"--error", "--tolerance"}, "it serves --analysis errors"));
  }
  if (o.analysis == "workspace") {
    return refuse(context, {"--box", "--resolution"}, "it serves --analysis dexterity and errors");
  }
  return refuse(context, {"--rel-tol"}, "it serves --analysis workspace");
}

}  // namespace

Command sweep_command() {
  auto o = std::make_shared<Options>();
  return {"sweep", "An analysis against one or more parameters of a machine",
          "polypod sweep hexapod-strut --set leg.length_max_mm=80,90,100 --tilt 20",
          [o](Arguments& a) {
            a.positional("MACHINE", o->machine, "A machine file or a name of `polypod machines`");
            a.option("--set", o->sets, "key=a,b,c or key=a:b:step: values to try; key=a: fixed (repeatable)", true);
            a.option("--analysis", o->analysis, "workspace (default), dexterity or errors");
            a.option("--error", o->errors, "KEY=mm: of the analysis errors (repeatable)");
            a.option("--tolerance", o->tolerances, "KEY=mm: of the analysis errors (repeatable)");
            a.flag("--together", o->together, "Several lists change together, not in all combinations");
            a.option("--csv", o->csv, "Write the table to this file too");
            o->where.declare_region(a);
            a.option("--rel-tol", o->where.workspace.rel_tol,
                     "Of the analysis workspace: gap between the bounds as a fraction of the volume (default 0.01)");
          },
          [o](const Context& context) -> Result<int> {
            if (o->analysis != "workspace" && o->analysis != "dexterity" && o->analysis != "errors") {
              return fail("AP156", fmt::format("--analysis {}: unknown", o->analysis), {},
                          "known: workspace, dexterity, errors");
            }
            POLYPOD_TRY(check_files({o->machine}, {o->csv}, context.json));
            POLYPOD_TRY(refuse_unused(*o, context));
            std::vector<std::string> fixed;
            POLYPOD_ASSIGN(varied, varied_of(o->sets, fixed));
            if (o->together && varied.size() < 2) {
              POLYPOD_TRY(refuse(context, {"--together"}, "it serves two lists and more"));
            }
            std::size_t rows = o->together ? varied.front().values.size() : 1;
            for (const Varied& v : varied) {
              if (o->together && v.values.size() != rows) {
                return fail("AP157", fmt::format("--together needs lists of one length: {} has {} values, {} has {}",
                                                 varied.front().key, rows, v.key, v.values.size()));
              }
              if (!o->together) rows *= v.values.size();
            }
            if (rows > kMostRows)
              return fail("AP158", fmt::format("{} combinations are more than {}", rows, kMostRows));

            Json list = Json::array();
            std::vector<std::vector<std::string>> keys;
            std::vector<Numbers> found;
            for (std::size_t row = 0; row < rows; ++row) {
              std::vector<std::string> sets = fixed;
              Json entry = Json::object();
              std::size_t rest = row;
              keys.emplace_back();
              for (const Varied& v : varied) {
                const std::string& value = v.values[o->together ? row : rest % v.values.size()];
                if (!o->together) rest /= v.values.size();
                sets.push_back(v.key + "=" + value);
                POLYPOD_ASSIGN(number, numbers_of(value, "--set"));
                entry[v.key] = number[0];
                keys.back().push_back(value);
              }
              POLYPOD_ASSIGN(m, machine_of(o->machine, sets));
              POLYPOD_ASSIGN(numbers, numbers_of_machine(*o, m, context));
              for (const auto& [name, value] : numbers.values) entry[name] = number_json(value);
              for (const auto& [name, value] : numbers.more.items()) entry[name] = value;
              entry["converged"] = numbers.converged;
              if (!numbers.missing.empty()) entry["missing"] = numbers.missing;
              if (!numbers.singular.empty()) {
                entry["singular_everywhere"] = true;
                entry["note"] = numbers.singular;
              }
              found.push_back(std::move(numbers));
              list.push_back(entry);
              if (context.progress) fmt::print(stderr, "\rsweep {} of {}\x1b[K", row + 1, rows);
            }
            if (context.progress) fmt::print(stderr, "\r\x1b[K");
            bool all_answered = true;
            double largest = 0;
            std::vector<std::string> names;
            for (const Numbers& n : found) {
              all_answered = all_answered && n.converged && (n.singular.empty() || !n.values.empty());
              if (n.values.empty()) continue;
              if (std::isfinite(n.values[0].second)) largest = std::max(largest, n.values[0].second);
              if (!names.empty()) continue;
              for (const auto& [name, value] : n.values) names.push_back(name);
            }
            std::string csv;
            for (const Varied& v : varied) csv += v.key + ",";
            csv += fmt::format("{}\n", fmt::join(names, ","));
            for (std::size_t row = 0; row < rows; ++row) {
              csv += fmt::format("{}", fmt::join(keys[row], ","));
              for (std::size_t k = 0; k < names.size(); ++k)
                csv += found[row].values.empty() || std::isnan(found[row].values[k].second)
                           ? ","
                           : fmt::format(",{:.6g}", found[row].values[k].second);
              csv += "\n";
            }
            if (!o->csv.empty()) POLYPOD_TRY(files::write_whole(o->csv, csv));
            if (context.json) {
              print_json({{"analysis", o->analysis}, {"rows", list}});
            } else {
              for (const Varied& v : varied) fmt::print("{:>24}", v.key);
              for (const std::string& name : names) fmt::print(" {:>24}", name);
              fmt::print("\n");
              for (std::size_t row = 0; row < rows; ++row) {
                for (const std::string& key : keys[row]) fmt::print("{:>24}", key);
                for (const auto& [name, value] : found[row].values)
                  fmt::print(" {:>24}", std::isnan(value) ? "-" : fmt::format("{:.6g}", value));
                const std::string& singular = found[row].singular;
                fmt::print("  {}{}\n",
                           found[row].values.empty() ? found[row].missing : bar(found[row].values[0].second, largest),
                           singular.empty() || singular == found[row].missing ? "" : " " + singular);
              }
            }
            return all_answered ? kDone : kAnswerIsNo;
          }};
}

}  // namespace polypod::app
