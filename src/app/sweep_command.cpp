// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "commands.hpp"
#include "interrupt.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "workspace_options.hpp"

namespace polypod::app {
namespace {

struct Varied {
  std::string key;
  std::vector<std::string> values;
};

/// `key=a,b,c` are varied, `key=a` are fixed.
Result<std::vector<Varied>> varied_of(const std::vector<std::string>& sets, std::vector<std::string>& fixed) {
  std::vector<Varied> out;
  for (const std::string& set : sets) {
    const std::size_t equals = set.find('=');
    if (equals == std::string::npos || set.find(',') == std::string::npos) {
      fixed.push_back(set);
      continue;
    }
    Varied v{set.substr(0, equals), {}};
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
                "write --set leg.length_max_mm=80,90,100");
  }
  return out;
}

std::string bar(double value, double largest) {
  constexpr int kWidth = 40;
  const int n = largest > 0 ? static_cast<int>(kWidth * value / largest + 0.5) : 0;
  return std::string(static_cast<std::size_t>(std::clamp(n, 0, kWidth)), '#');
}

}  // namespace

Command sweep_command() {
  struct Options {
    std::string machine, analysis = "workspace", csv;
    std::vector<std::string> sets;
    bool together = false;
    WorkspaceOptions workspace;
  };
  auto o = std::make_shared<Options>();
  return {"sweep", "An analysis against one or more parameters of a machine",
          "polypod sweep hexapod-strut --set leg.length_max_mm=80,90,100 --tilt 20",
          [o](Arguments& a) {
            a.positional("MACHINE", o->machine, "A machine file or a name of `polypod machines`");
            a.option("--set", o->sets, "key=a,b,c: values to try; key=a: fixed (repeatable)", true);
            a.option("--analysis", o->analysis, "workspace (default)");
            a.flag("--together", o->together, "Several lists change together, not in all combinations");
            a.option("--csv", o->csv, "Write the table to this file too");
            o->workspace.declare(a);
          },
          [o](const Context& context) -> Result<int> {
            if (o->analysis != "workspace") {
              return fail("AP156", fmt::format("--analysis {}: unknown", o->analysis), {}, "known: workspace");
            }
            std::vector<std::string> fixed;
            POLYPOD_ASSIGN(varied, varied_of(o->sets, fixed));
            std::size_t rows = o->together ? varied.front().values.size() : 1;
            for (const Varied& v : varied) {
              if (o->together && v.values.size() != rows) {
                return fail("AP157", fmt::format("--together needs lists of one length: {} has {} values, {} has {}",
                                                 varied.front().key, rows, v.key, v.values.size()));
              }
              if (!o->together) rows *= v.values.size();
            }
            constexpr std::size_t kMostRows = 10'000;
            if (rows > kMostRows)
              return fail("AP158", fmt::format("{} combinations are more than {}", rows, kMostRows));

            Json list = Json::array();
            std::string csv;
            for (const Varied& v : varied) csv += v.key + ",";
            csv += "volume_mm3,volume_lower_mm3,volume_upper_mm3\n";
            double largest = 0;
            bool all_converged = true;
            for (std::size_t row = 0; row < rows; ++row) {
              std::vector<std::string> sets = fixed;
              Json entry = Json::object();
              std::size_t rest = row;
              for (const Varied& v : varied) {
                const std::string& value = v.values[o->together ? row : rest % v.values.size()];
                if (!o->together) rest /= v.values.size();
                sets.push_back(v.key + "=" + value);
                POLYPOD_ASSIGN(number, numbers_of(value, "--set"));
                entry[v.key] = number[0];
                csv += value + ",";
              }
              POLYPOD_ASSIGN(m, machine_of(o->machine, sets));
              POLYPOD_ASSIGN(options, o->workspace.options(m, context));
              POLYPOD_ASSIGN(result, workspace::volume(m, options));
              all_converged = all_converged && result.converged;
              const Json volume = volume_json(result);
              for (const auto& [key, value] : volume.items()) entry[key] = value;
              largest = std::max(largest, units::to_mm3(result.volume));
              csv += fmt::format("{:.6g},{:.6g},{:.6g}\n", units::to_mm3(result.volume), units::to_mm3(result.lower),
                                 units::to_mm3(result.upper));
              list.push_back(entry);
            }
            if (context.progress) fmt::print(stderr, "\r\x1b[K");
            if (!o->csv.empty()) POLYPOD_TRY(files::write_whole(o->csv, csv));
            if (context.json) {
              print_json({{"analysis", o->analysis}, {"rows", list}});
            } else {
              for (const Varied& v : varied) fmt::print("{:>24}", v.key);
              fmt::print("{:>14}{:>24}\n", "volume_mm3", "bounds");
              for (const Json& entry : list) {
                for (const Varied& v : varied) fmt::print("{:>24g}", entry[v.key].get<double>());
                fmt::print("{:>14.0f}{:>24}  {}\n", entry["volume_mm3"].get<double>(),
                           fmt::format("{:.0f} .. {:.0f}", entry["volume_lower_mm3"].get<double>(),
                                       entry["volume_upper_mm3"].get<double>()),
                           bar(entry["volume_mm3"].get<double>(), largest));
              }
            }
            return all_converged ? kDone : kAnswerIsNo;
          }};
}

}  // namespace polypod::app
