// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "busy_line.hpp"
#include "commands.hpp"
#include "messages.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/families/delta/page.hpp"
#include "polypod/families/delta/study.hpp"
#include "polypod/report/csv.hpp"

namespace polypod::app {
namespace {

Json mm_json(double m) {
  return std::isfinite(m) ? Json(units::to_mm(m)) : Json();
}

Json counts_json(const workspace::DeltaCounts& c) {
  return {{"points", c.points},
          {"near_by_geometry", c.geometry},
          {"near_by_determinant", c.determinant},
          {"near_by_both", c.both},
          {"agree_percent", c.agree_percent()},
          {"stretched", c.stretched},
          {"folded", c.folded},
          {"level", c.level},
          {"flat", c.flat},
          {"least_mm",
           {{"stretched", mm_json(c.least_stretched)},
            {"folded", mm_json(c.least_folded)},
            {"drop", mm_json(c.least_drop)},
            {"poses", mm_json(c.least_poses)}}}};
}

void print_counts(const char* name, const workspace::DeltaCounts& c) {
  fmt::print("{:<6} {:>9} {:>10} {:>12} {:>9} {:>9.2f} {:>10} {:>7} {:>7} {:>7}\n", name, c.points, c.geometry,
             c.determinant, c.both, c.agree_percent(), c.stretched, c.folded, c.level, c.flat);
}

std::string points_csv(const workspace::DeltaStudy& study) {
  report::Csv csv({"x_mm", "y_mm", "z_mm", "elbow_gap_mm", "pose_gap_mm", "drop_mm", "det_A", "det_B",
                   "near_by_geometry", "near_by_determinant", "deep"});
  for (const workspace::DeltaPoint& p : study.points) {
    csv.add({units::to_mm(p.X.x()), units::to_mm(p.X.y()), units::to_mm(p.X.z()), units::to_mm(p.close.elbow_gap),
             units::to_mm(p.close.pose_gap), units::to_mm(p.close.drop), p.close.det_A, p.close.det_B,
             p.by_geometry ? 1.0 : 0.0, p.by_determinant ? 1.0 : 0.0, p.deep ? 1.0 : 0.0});
  }
  return csv.text();
}

}  // namespace

Command delta_command() {
  struct Options {
    std::string machine, csv, report, cloud;
    std::vector<std::string> sets;
    int steps = 40;
    double step = 20, d_min = 10, h_min = 1e-5, border = 20;
  };
  auto o = std::make_shared<Options>();
  return {
      "delta", "Singular and near-singular poses of a delta: by geometry and by determinants, side by side",
      "polypod delta delta-brno --set drive.angle_min_deg=20",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--step", o->step, {1, 100}, "Grid over the workspace, mm (default 20)");
        a.option("--d-min", o->d_min, {0, 1e6}, "Near-singular below this distance, mm (default 10)");
        a.option("--h-min", o->h_min, {0, 1e6}, "Near-singular below this determinant of A or B, m (default 1e-5)");
        a.option("--boundary", o->border, {0, 1e6}, "Points so far inside count as deep, mm (default 20)");
        a.option("--csv", o->csv, "A row a point");
        a.option("--cloud", o->cloud, "Tool points of all combinations of drive positions, as x_mm,y_mm,z_mm");
        a.option("--steps", o->steps, {2, 200}, "Positions of each drive for --cloud, 2 to 200 (default 40)");
        a.option("--report", o->report,
                 "An HTML page: picture in space, sections, chains, near-singular points in red");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_TRY(check_files({o->machine}, {o->csv, o->cloud, o->report}, context.json));
        if (o->cloud.empty()) POLYPOD_TRY(refuse(context, {"--steps"}, "it serves --cloud; name a file"));
        workspace::DeltaStudyOptions options;
        options.step = units::from_mm(o->step);
        options.d_min = units::from_mm(o->d_min);
        options.h_min = o->h_min;
        options.border = units::from_mm(o->border);
        BusyLine busy(context, "computing the workspace");
        POLYPOD_ASSIGN(study, workspace::delta_study(m, options));
        files::Outputs together;
        if (!o->csv.empty()) POLYPOD_TRY(together.add(o->csv, points_csv(study)));
        if (!o->cloud.empty()) {
          POLYPOD_ASSIGN(points, workspace::drive_cloud(m, o->steps));
          report::Csv csv({"x_mm", "y_mm", "z_mm"});
          for (const Vec3& X : points) csv.add({units::to_mm(X.x()), units::to_mm(X.y()), units::to_mm(X.z())});
          POLYPOD_TRY(together.add(o->cloud, csv.text()));
        }
        if (!o->report.empty()) {
          POLYPOD_ASSIGN(page, pages::delta_page(m, study, options, POLYPOD_VERSION, command_line()));
          POLYPOD_TRY(together.add(o->report, std::move(page)));
        }
        POLYPOD_TRY(together.commit());
        busy.end();
        if (context.json) {
          Json apart = Json::array();
          constexpr std::size_t kMost = 100;
          for (const workspace::DeltaPoint& p : study.points) {
            if (p.by_geometry == p.by_determinant || apart.size() >= kMost) continue;
            apart.push_back({{"at_mm", vector_json(p.X * units::kMmPerMetre)},
                             {"near_by", p.by_geometry ? "geometry" : "determinant"},
                             {"deep", p.deep}});
          }
          print_json({{"all", counts_json(study.all)}, {"deep", counts_json(study.deep)}, {"disagreements", apart}});
        } else {
          fmt::print("{:<6} {:>9} {:>10} {:>12} {:>9} {:>9} {:>10} {:>7} {:>7} {:>7}\n", "", "points", "geometry",
                     "determinant", "both", "agree %", "stretched", "folded", "level", "flat");
          print_counts("all", study.all);
          print_counts("deep", study.deep);
          const workspace::DeltaCounts& c = study.all;
          const auto least = [](double distance) {
            return std::isfinite(distance) ? fmt::format("{:.1f} mm", units::to_mm(distance)) : std::string("-");
          };
          fmt::print("least  elbows {} stretched, {} folded; rods {} from level; poses {} apart\n",
                     least(c.least_stretched), least(c.least_folded), least(c.least_drop), least(c.least_poses));
          int shown = 0;
          constexpr int kShown = 10;
          for (const workspace::DeltaPoint& p : study.points) {
            if (p.by_geometry == p.by_determinant || shown++ >= kShown) continue;
            const Vec3 X = p.X * units::kMmPerMetre;
            fmt::print(
                "{:9.1f} {:9.1f} {:9.1f} mm  near by {} alone: elbows {:.1f} mm, poses {:.1f} mm, drop {:.1f} mm, "
                "det A {:.2g}, det B {:.2g}\n",
                X.x(), X.y(), X.z(), p.by_geometry ? "geometry" : "determinant", units::to_mm(p.close.elbow_gap),
                units::to_mm(p.close.pose_gap), units::to_mm(p.close.drop), p.close.det_A, p.close.det_B);
          }
          for (const std::string* path : {&o->csv, &o->cloud, &o->report})
            if (!path->empty()) fmt::print("wrote {}\n", *path);
        }
        return kDone;
      }};
}

}  // namespace polypod::app
