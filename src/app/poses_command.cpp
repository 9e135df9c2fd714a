// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>

#include "busy_line.hpp"
#include "calibration_options.hpp"
#include "commands.hpp"
#include "polypod/calibration/poses.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"

namespace polypod::app {
namespace {

struct Options {
  std::string machine, what = "geometry", kind = "points", criterion = "d", out, frame, target, curve;
  std::vector<std::string> sets, anchors, estimate, only, hold, keep_out;
  std::string instrument;
  double floor = 0;
  int count = 30, candidates = 400, seed = 1;
  double noise_um = 20, noise_deg = 0.002, force = 250, clearance = 0, acceptance = 180;
};

constexpr double kGridTilt = 20;  // deg
// The readings are divided by it.
constexpr config::Range kNoise_um{1e-3, 1e6}, kNoise_deg{1e-7, 180};

constexpr config::Range kHeight_mm{-1e6, 1e6}, kClearance_mm{0, 1e5};

constexpr std::array<const char*, 5> kKinds = {"points", "axes", "poses", "distances", "gauge"};

Json number_or_null(double x) {
  return std::isfinite(x) ? Json(x) : Json();
}
Json json_of(const calibration::Uncertainty& u, double noise) {
  return {{"prediction_um", number_or_null(units::to_um(u.reading * noise))},
          {"mean_percent", number_or_null(100 * u.mean)},
          {"worst_percent", number_or_null(100 * u.worst)}};
}

std::optional<calibration::Criterion> criterion_named(const std::string& name) {
  if (name == "d") return calibration::Criterion::determinant;
  if (name == "e") return calibration::Criterion::eigenvalue;
  if (name == "v") return calibration::Criterion::reading;
  return std::nullopt;
}

tl::unexpected<Error> not_one_of(const char* option, const std::string& given, const char* choices) {
  return fail("AP184", fmt::format("{} {}: not {}", option, given, choices));
}

Result<calibration::Site> site_of(const Options& o, const Context& context) {
  calibration::Site site;
  for (const std::string& text : o.keep_out) {
    POLYPOD_ASSIGN(n, numbers_of(text, "--keep-out"));
    calibration::Box box;
    if (n.size() == 6) {
      box.low = units::from_mm(1.0) * Vec3(n[0], n[1], n[2]);
      box.high = units::from_mm(1.0) * Vec3(n[3], n[4], n[5]);
    }
    if (n.size() != 6 || !(box.low.array() <= box.high.array()).all()) {
      return fail("AP152", fmt::format("--keep-out {}: not six numbers, the first corner below the second", text), {},
                  "x0,y0,z0,x1,y1,z1 in mm, in M");
    }
    site.keep_out.push_back(box);
  }
  if (context.given("--floor")) site.floor = units::from_mm(o.floor);
  if (!o.instrument.empty()) {
    POLYPOD_ASSIGN(places, points_of({o.instrument}, "--instrument"));
    site.instrument = places.front();
  }
  if (const auto box = calibration::box_round_instrument(site)) {
    return fail("AP152",
                fmt::format("--instrument {} stands in the box --keep-out {}, from where nothing is seen", o.instrument,
                            o.keep_out[*box]),
                {}, "both are places in M, in mm");
  }
  site.clearance = units::from_mm(o.clearance);
  site.acceptance = units::from_deg(o.acceptance);
  return site;
}

Json json_of(const calibration::Candidates& from, const calibration::Site& site) {
  using calibration::Hindrance;
  const auto left = [&](Hindrance why) { return from.left_out[static_cast<std::size_t>(why)]; };
  Json out = {{"poses_drawn", from.drawn}, {"clearance_mm", units::to_mm(site.clearance)}};
  if (site.floor) out["below_floor"] = left(Hindrance::floor);
  if (!site.keep_out.empty()) out["in_a_box"] = left(Hindrance::box);
  if (site.instrument) {
    out["turned_away"] = left(Hindrance::turned_away);
    out["hidden"] = left(Hindrance::hidden);
  }
  return out;
}

/// What the answer does not hold for.
std::vector<std::string> notes_of(const calibration::Site& site, const calibration::SiteCheck& check) {
  std::vector<std::string> notes;
  if (site.instrument && site.clearance == 0) {
    notes.emplace_back("without --clearance the machine's lines have no thickness and hide nothing of the target");
  }
  if (check.foundation_in_a_box()) {
    notes.emplace_back(
        "a fixed part of the machine reaches into a box of --keep-out, which no choice of poses can change: is the box "
        "given in M, in mm?");
  }
  return notes;
}

void print_site(const calibration::Candidates& from, const calibration::Site& site) {
  using calibration::Hindrance;
  const auto left = [&](Hindrance why) { return from.left_out[static_cast<std::size_t>(why)]; };
  std::vector<std::string> parts;
  if (site.floor) parts.push_back(fmt::format("{} come below the floor", left(Hindrance::floor)));
  if (!site.keep_out.empty()) parts.push_back(fmt::format("{} reach into a box", left(Hindrance::box)));
  if (site.instrument) {
    parts.push_back(fmt::format("at {} the target is turned away", left(Hindrance::turned_away)));
    parts.push_back(fmt::format("at {} it is hidden", left(Hindrance::hidden)));
  }
  fmt::print(
      "Of {} poses that were drawn {}. The machine is represented by the lines of its picture, with a clearance of "
      "{:g} mm.\n\n",
      from.drawn, fmt::join(parts, ", "), units::to_mm(site.clearance));
}

std::string stands_csv(const machine::AnyMachine& m, const std::vector<calibration::Stand>& stands,
                       const std::vector<std::size_t>& chosen) {
  std::string out;
  for (int i = 0; i < kinematics::joint_count(m); ++i) out += fmt::format("q{},", i + 1);
  out += "nominal_x_mm,nominal_y_mm,nominal_z_mm,nominal_a_deg,nominal_b_deg,nominal_c_deg\n";
  for (const std::size_t i : chosen) {
    for (const double q : joints_for_user(m, stands[i].q)) out += fmt::format("{:.6f},", q);
    std::vector<double> pose = pose_for_user(m, stands[i].X_MT);
    pose.resize(6, 0);
    for (std::size_t k = 0; k < 6; ++k) out += fmt::format("{:.6f}{}", pose[k], k == 5 ? "\n" : ",");
  }
  return out;
}

}  // namespace

Command poses_command() {
  auto o = std::make_shared<Options>();
  return {
      "poses", "Which poses to measure for a calibration, and how certain the machine will be then",
      "polypod poses hexapod-strut --count 30 --kind points -o poses.csv",
      [o](Arguments& a) {
        declare_machine(a, o->machine, o->sets);
        a.option("--count", o->count, {1, 100000}, "Poses to choose (default 30)");
        a.option("--for", o->what, "geometry (default) or compliance");
        a.option("--kind", o->kind, "What will be measured: points (default), axes, poses, distances or gauge");
        a.option("--criterion", o->criterion,
                 "d: the least volume of uncertainty (default); e: the best worst direction; v: what the model "
                 "then says is most certain");
        a.option("--candidates", o->candidates, {1, 5000}, "Poses to choose from (default 400)");
        a.option("--seed", o->seed, {0, kAnyCount.max}, "Of the candidates (default 1)");
        a.option("--noise-um", o->noise_um, kNoise_um,
                 "Of the instrument, each coordinate or displacement (default 20)");
        a.option("--noise-deg", o->noise_deg, kNoise_deg, "Of the instrument, each angle (default 0.002)");
        a.option("--force", o->force, kForce_N, "N, for compliance (default 250)");
        a.option("--anchor", o->anchors, "x,y,z in mm: a ball-bar's fixed ball (repeatable, in turn)");
        a.option("--estimate", o->estimate, "frame, target, scale: as for `polypod calibrate` (repeatable)");
        a.option("--frame", o->frame, kFrameHelp);
        a.option("--target", o->target, kTargetHelp);
        a.option("--parameter", o->only, "Beginning of a key: identify these only (repeatable)");
        a.option("--fix", o->hold, "Beginning of a key: keep these fixed (repeatable)");
        a.option("--floor", o->floor, kHeight_mm, "z in M, mm: nothing that moves comes below");
        a.option("--keep-out", o->keep_out,
                 "x0,y0,z0,x1,y1,z1 in M, mm: the machine stays out of this box (repeatable)");
        a.option("--instrument", o->instrument, "x,y,z in M, mm: from there the target is seen past machine and boxes");
        a.option("--acceptance", o->acceptance, {0, 180},
                 "deg: the target is seen within this angle from its z axis (default 180)");
        a.option("--clearance", o->clearance, kClearance_mm,
                 "mm that the lines of the machine keep from floor, boxes and line of sight: half of its thickness "
                 "(default 0)");
        a.option("--curve", o->curve, "n1,n2,...: the uncertainty for these numbers of poses, too");
        a.option("-o,--output", o->out, "The chosen poses, CSV");
      },
      [o](const Context& context) -> Result<int> {
        POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
        POLYPOD_TRY(check_files({o->machine}, {o->out}, context.json));
        const auto kind = std::find(kKinds.begin(), kKinds.end(), o->kind);
        const bool compliance = o->what == "compliance";
        const auto criterion = criterion_named(o->criterion);
        if (!compliance && o->what != "geometry") return not_one_of("--for", o->what, "geometry or compliance");
        if (kind == kKinds.end()) return not_one_of("--kind", o->kind, "points, axes, poses, distances or gauge");
        if (!criterion) return not_one_of("--criterion", o->criterion, "d, e or v");
        if (o->candidates < o->count) {
          return fail("AP184", fmt::format("--count {}: more than the {} candidates", o->count, o->candidates), {},
                      fmt::format("give --candidates {} or more (up to 5000)", std::min(5 * o->count, 5000)));
        }
        if (compliance) {
          POLYPOD_TRY(
              refuse(context,
                     {"--kind", "--anchor", "--estimate", "--frame", "--target", "--parameter", "--fix", "--noise-deg"},
                     "it serves --for geometry"));
        } else {
          POLYPOD_TRY(refuse(context, {"--force"}, "it serves --for compliance"));
          if (o->kind == "points" || o->kind == "axes" || o->kind == "poses") {
            POLYPOD_TRY(refuse(context, {"--anchor"}, "it serves --kind distances"));
          }
        }
        calibration::CalibrationOptions options;
        options.only = o->only;
        options.hold = o->hold;
        options.noise_position = units::from_um(o->noise_um);
        options.noise_angle = units::from_deg(o->noise_deg);
        POLYPOD_ASSIGN(X_SM, frame_argument(o->frame, "--frame"));
        POLYPOD_ASSIGN(X_TR, frame_argument(o->target, "--target"));
        options.X_SM = X_SM;
        options.X_TR = X_TR;
        options.estimate_frame = std::find(o->estimate.begin(), o->estimate.end(), "frame") != o->estimate.end();
        options.estimate_target = std::find(o->estimate.begin(), o->estimate.end(), "target") != o->estimate.end();
        options.estimate_scale = std::find(o->estimate.begin(), o->estimate.end(), "scale") != o->estimate.end();
        POLYPOD_ASSIGN(anchors, points_of(o->anchors, "--anchor"));
        POLYPOD_ASSIGN(site, site_of(*o, context));
        if (!site.any())
          POLYPOD_TRY(refuse(context, {"--clearance"}, "it serves --floor, --keep-out and --instrument"));
        if (!site.instrument) POLYPOD_TRY(refuse(context, {"--acceptance"}, "it serves --instrument"));
        std::vector<double> counts;
        if (!o->curve.empty()) {
          POLYPOD_ASSIGN(list, numbers_of(o->curve, "--curve"));
          counts = list;
        }
        const auto measured_kind = static_cast<calibration::Kind>(kind - kKinds.begin());
        const auto seed = static_cast<std::uint64_t>(o->seed);
        const auto many = static_cast<std::size_t>(o->candidates);
        if (const auto no = refused_as_singular(m, context, {"poses"})) return *no;
        const auto make = [&] {
          return compliance ? calibration::compliance_candidates(m, many, seed, o->force, options.noise_position, site,
                                                                 options.X_TR)
                            : calibration::geometry_candidates(m, many, seed, measured_kind, anchors, options, site);
        };
        BusyLine busy(context, "choosing among the candidates");
        POLYPOD_ASSIGN(from, make());
        const auto pick = [&](const std::vector<std::size_t>& chosen) {
          std::vector<Eigen::MatrixXd> out;
          for (const std::size_t i : chosen) out.push_back(from.equations[i]);
          return calibration::uncertainty(out, from.equations);
        };
        POLYPOD_ASSIGN(chosen, calibration::choose(from.equations, static_cast<std::size_t>(o->count), *criterion));
        const calibration::Uncertainty best = pick(chosen);
        const calibration::LostPose loss = calibration::worst_loss(from.equations, chosen, from.equations);
        const std::size_t lost = chosen[loss.lost];
        std::vector<calibration::Stand> of_chosen;
        for (const std::size_t i : chosen) of_chosen.push_back(from.stands[i]);
        const calibration::SiteCheck check(m, site, options.X_TR, from.stands);
        const calibration::Way way = calibration::shortest_way(m, of_chosen, site.obstructs() ? &check : nullptr);
        double as_drawn = 0;
        for (std::size_t k = 0; k + 1 < of_chosen.size(); ++k)
          as_drawn += calibration::way_between(m, of_chosen[k].q, of_chosen[k + 1].q);
        std::vector<std::size_t> ordered;
        for (const std::size_t k : way.order) ordered.push_back(chosen[k]);
        const auto place = std::find(ordered.begin(), ordered.end(), lost) - ordered.begin() + 1;
        const auto grid = [&](double tilt_deg) {
          const auto stands =
              calibration::grid_stands(m, from.stands, static_cast<std::size_t>(o->count), units::from_deg(tilt_deg));
          return calibration::uncertainty(
              compliance ? calibration::compliance_equations(m, stands, o->force, options.noise_position)
                         : calibration::geometry_equations(m, stands, measured_kind, anchors, options, from),
              from.equations);
        };
        const calibration::Uncertainty upright = grid(0), tilted = grid(kGridTilt);
        // The bound is tightest from the set of the greatest determinant.
        std::vector<std::size_t> densest = chosen;
        if (*criterion != calibration::Criterion::determinant) {
          POLYPOD_ASSIGN(d, calibration::choose(from.equations, chosen.size(), calibration::Criterion::determinant));
          densest = d;
        }
        const double least = calibration::least_mean(from.equations, densest);
        std::vector<std::size_t> first(static_cast<std::size_t>(o->count));
        for (std::size_t i = 0; i < first.size(); ++i) first[i] = i;
        const calibration::Uncertainty random = pick(first);
        Json curve = Json::array();
        for (const double n : counts) {
          if (!(n >= 1) || n > o->candidates) return fail("AP184", fmt::format("--curve: {:g} poses", n));
          POLYPOD_ASSIGN(some, calibration::choose(from.equations, static_cast<std::size_t>(n), *criterion));
          Json point = json_of(pick(some), options.noise_position);
          point["count"] = some.size();
          curve.push_back(point);
        }
        busy.end();
        if (!o->out.empty()) POLYPOD_TRY(files::write_whole(o->out, stands_csv(m, from.stands, ordered)));
        if (context.json) {
          Json list = Json::array();
          for (const std::size_t i : ordered) {
            list.push_back(
                {{"joints", joints_for_user(m, from.stands[i].q)}, {"pose", pose_for_user(m, from.stands[i].X_MT)}});
          }
          const auto moves = [](const std::vector<std::size_t>& which) {
            Json out = Json::array();
            for (const std::size_t k : which) out.push_back({{"from_pose", k + 1}, {"to_pose", k + 2}});
            return out;
          };
          Json way_of_all = {{"ranges_of_the_busiest_drive", way.length}, {"as_drawn", as_drawn}};
          if (site.obstructs()) {
            way_of_all["moves_not_free"] = moves(way.not_free);
            way_of_all["moves_not_judged"] = moves(way.not_judged);
          }
          Json one_lost = json_of(loss.left, options.noise_position);
          one_lost["pose"] = place;
          Json answer = {{"poses", list},
                         {"unknowns", from.unknowns},
                         {"fixed", from.held},
                         {"unknowns_identifiable", from.unknowns.size()},
                         {"unknowns_total", from.total},
                         {"chosen", json_of(best, options.noise_position)},
                         {"random", json_of(random, options.noise_position)},
                         {"grid", json_of(tilted, options.noise_position)},
                         {"grid_zero_tilt", json_of(upright, options.noise_position)},
                         {"least_mean_percent", 100 * least},
                         {"travel", way_of_all},
                         {"one_lost", one_lost},
                         {"curve", curve}};
          if (site.any()) {
            answer["site"] = json_of(from, site);
            answer["site"]["notes"] = notes_of(site, check);
          }
          print_json(answer);
          return kDone;
        }
        fmt::print("{} of {} poses; {} of {} unknowns identifiable\n\n", chosen.size(), o->candidates,
                   from.unknowns.size(), from.total);
        if (site.any()) print_site(from, site);
        const auto line = [&](const std::string& what, const calibration::Uncertainty& u) {
          const auto cell = [](double x) { return std::isfinite(x) ? fmt::format("{:14.3f}", x) : "unidentifiable"; };
          fmt::print("{:<16} {} {} {}\n", what, cell(units::to_um(u.reading * options.noise_position)),
                     cell(100 * u.mean), cell(100 * u.worst));
        };
        fmt::print("{:<16} {:>14} {:>14} {:>14}\n", "uncertainty", "prediction, um", "mean, %", "worst, %");
        line("chosen", best);
        line("one lost", loss.left);
        line("random", random);
        const bool turns = kinematics::task(m).turns();
        line(turns ? "grid, zero tilt" : "grid", upright);
        if (turns) line("grid, tilted", tilted);
        fmt::print("{:<16} {:>14} {:14.3f}   (proven: no {} of these candidates come below)\n", "bound", "",
                   100 * least, chosen.size());
        for (const Json& point : curve) {
          fmt::print("{:<16} {:14.3f} {:14.3f} {:14.3f}\n", fmt::format("{} chosen", point["count"].get<int>()),
                     point["prediction_um"].get<double>(), point["mean_percent"].get<double>(),
                     point["worst_percent"].get<double>());
        }
        fmt::print(
            "\nThe poses are in an order with short travel: the busiest drives travel {:.1f} times their range ({:.1f} "
            "as "
            "drawn).\nThe loss of pose {} costs most.\n",
            way.length, as_drawn, place);
        const auto print_moves = [](const std::vector<std::size_t>& which, const char* what) {
          if (which.empty()) return;
          std::vector<std::string> names;
          for (const std::size_t k : which) names.push_back(fmt::format("{} to {}", k + 1, k + 2));
          fmt::print("{}: {}\n", what, fmt::join(names, ", "));
        };
        print_moves(way.not_free, "Moves that are obstructed");
        print_moves(way.not_judged, "Moves that were not judged (no pose of the machine found between)");
        for (const std::string& note : notes_of(site, check)) fmt::print("note: {}\n", note);
        if (!o->out.empty()) fmt::print("wrote {}\n", o->out);
        return kDone;
      }};
}

}  // namespace polypod::app
