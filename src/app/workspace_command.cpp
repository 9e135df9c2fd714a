// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <thread>
#include <utility>

#include "commands.hpp"
#include "interrupt.hpp"
#include "messages.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/memory.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/pages/workspace.hpp"
#include "polypod/workspace/beyond.hpp"
#include "polypod/workspace/shape.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "survey_options.hpp"
#include "workspace_files.hpp"
#include "workspace_options.hpp"

namespace polypod::app {
namespace {

constexpr double kMbPerByte = 1e-6;

/// What `text` says of the progress, on stderr, ten times a second at most.
std::function<void(const workspace::Progress&)> drawn_now_and_then(
    std::function<std::string(const workspace::Progress&)> text) {
  using Clock = std::chrono::steady_clock;
  return [text = std::move(text), last = Clock::time_point{}](const workspace::Progress& p) mutable {
    constexpr std::chrono::milliseconds kBetween{100};
    if (Clock::now() - last < kBetween) return;
    last = Clock::now();
    fmt::print(stderr, "\r{}\x1b[K", text(p));
    std::fflush(stderr);
  };
}
}  // namespace

void WorkspaceOptions::declare(Arguments& a) {
  declare_directions(a);
  a.option("--rel-tol", rel_tol, "Gap between the bounds as a fraction of the volume, 1e-6 to 1 (default 0.01)");
  declare_limits(a);
  declare_threads(a);
}

void WorkspaceOptions::declare_directions(Arguments& a) {
  a.option("--tilt", tilt_deg, "Reachable with every tilt up to this angle from z, deg");
  a.option("--a-range", a_range, "lo,hi: reachable with every A of this range, deg");
  a.option("--b-range", b_range, "lo,hi: reachable with every B of this range, deg");
}

void WorkspaceOptions::declare_limits(Arguments& a) {
  a.flag("--interference", interference, "Legs may not touch each other");
  a.option(
      "--without", without,
      "Switch limits off. Hexapods: length, base-joint, platform-joint, joint, legs, base, coordinates; deltas: drive, "
      "joint, coordinates, mode, table, rods, base; arms: joint numbers");
  a.option("--singularity-distance", clearance, "Deltas: least distance from singular poses, mm");
  a.option("--max-memory", max_memory,
           "Memory for the boxes, in MB or with a suffix as in 2G; the run ends with what is proven when it is used up "
           "(default: half of the machine's)");
}

void WorkspaceOptions::declare_threads(Arguments& a) {
  a.option("--threads", threads, "How many threads (default: all; the result is the same)");
}

Result<workspace::Options> WorkspaceOptions::options(const machine::AnyMachine& m, const Context& context) const {
  workspace::Options out;
  out.directions.tilt = units::from_deg(tilt_deg);
  for (const auto& [text, range, name] : {std::tuple{&a_range, &out.directions.a_range, "--a-range"},
                                          std::tuple{&b_range, &out.directions.b_range, "--b-range"}}) {
    if (text->empty()) continue;
    POLYPOD_ASSIGN(values, numbers_of(*text, name));
    if (values.size() != 2) return fail("AP150", fmt::format("{} {}: not two numbers lo,hi", name, *text));
    *range = std::array<double, 2>{units::from_deg(values[0]), units::from_deg(values[1])};
  }
  POLYPOD_TRY(in_range("WS100", "--tilt", tilt_deg, {0, 90, false, true}, "deg"));
  POLYPOD_TRY(in_range("WS101", "--rel-tol", rel_tol, {1e-6, 1}));
  POLYPOD_TRY(in_range("AP151", "--threads", threads, {0, 1024}));
  out.relative_tolerance = rel_tol;
  out.interference = interference;
  out.singular_distance = units::from_mm(clearance);
  // More threads than cores are no faster, and TBB starts none of them.
  out.threads = std::min(threads, std::max(1, static_cast<int>(std::thread::hardware_concurrency())));
  POLYPOD_ASSIGN(memory, memory_argument(max_memory));
  out.max_memory = memory;
  POLYPOD_ASSIGN(off, workspace::limit_bits(m, without));
  const workspace::LimitBits pairs = workspace::interference_bits(m);
  if (interference && pairs == 0) {
    return fail("AP107", "--interference does nothing here", {},
                "this machine has no legs that could touch each other");
  }
  const bool thin = std::visit(
      [](const auto& one) {
        if constexpr (requires { one.leg_diameter; }) return !(one.leg_diameter > 0);
        return false;
      },
      m);
  if (interference && thin) {
    return fail("AP107", "--interference does nothing here", {},
                "legs without a thickness never touch; give them one with --set leg.diameter_mm=...");
  }
  if (interference && pairs != 0 && (off & pairs) == pairs) {
    return fail("AP107", fmt::format("--interference does nothing beside --without {}", without), {},
                "the one asks for the limits between legs, the other switches them off; leave one of them out");
  }
  out.limits &= ~off;
  out.cancelled = [] { return interrupted(); };
  if (context.progress) {
    out.progress = drawn_now_and_then([](const workspace::Progress& p) {
      if (p.sampled) {
        return fmt::format("workspace about {:.0f} .. {:.0f} mm3, a sample of {} points", units::to_mm3(p.lower),
                           units::to_mm3(p.upper), p.cells);
      }
      return fmt::format("workspace {:.0f} .. {:.0f} mm3, {} boxes, {:.0f} of about {:.0f} MB", units::to_mm3(p.lower),
                         units::to_mm3(p.upper), p.cells, kMbPerByte * p.bytes, kMbPerByte * p.bytes_estimate);
    });
  }
  return out;
}

namespace {

/// "xy", "xz" and "yz"; of a task without x, y, z its coordinates in their place, "zA".
std::string plane_name(const machine::Task& task, int normal) {
  std::string out;
  for (int k = 0; k < workspace::coordinates_of_points(task); ++k)
    if (k != normal) out += workspace::coordinate_name(task, k);
  return out;
}

/// In any order, small or large.
bool same_letters(const std::string& a, const std::string& b) {
  return std::is_permutation(a.begin(), a.end(), b.begin(), b.end(),
                             [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
}

}  // namespace

std::string plane_names(const machine::Task& task) {
  return workspace::coordinates_of_points(task) < 3
             ? plane_name(task, 2)
             : fmt::format("{}, {} or {}", plane_name(task, 2), plane_name(task, 1), plane_name(task, 0));
}

std::optional<int> normal_of(const machine::Task& task, const std::string& plane) {
  const int least = workspace::coordinates_of_points(task) < 3 ? 2 : 0;  // of two coordinates the only plane
  for (int axis = 2; axis >= least; --axis)
    if (same_letters(plane_name(task, axis), plane)) return axis;
  return {};
}

Result<std::size_t> memory_argument(const std::string& text) {
  if (text.empty()) return machine_memory() / 2;
  const char suffix = text.back();
  const double unit = suffix == 'G' || suffix == 'g' ? 1e9 : 1e6;
  const bool suffixed = std::isalpha(static_cast<unsigned char>(suffix)) != 0;
  const auto n = numbers_of(text.substr(0, text.size() - (suffixed ? 1 : 0)), "--max-memory");
  constexpr double kLeast = 1e6, kMost = 1e15;
  if ((suffixed && std::strchr("GgMm", suffix) == nullptr) || !n || n->size() != 1 ||
      !((*n)[0] * unit >= kLeast && (*n)[0] * unit <= kMost)) {
    return fail("AP153", fmt::format("--max-memory {}: not an amount of memory of at least 1 MB", text), {},
                "write a number of MB, or 800M, or 2G");
  }
  return static_cast<std::size_t>((*n)[0] * unit);
}

bool came_within(const workspace::Volume& v, const workspace::Options& options) {
  if (v.converged) return true;
  if (!v.proven) {
    fmt::print(stderr, "polypod: the sample of {} points did not come within the tolerance\n", v.points);
    return false;
  }
  const std::string why =
      v.stopped == workspace::Stopped::memory
          ? fmt::format("the {:.0f} MB of --max-memory are used up; the tolerance would take about {:.0f} MB",
                        kMbPerByte * static_cast<double>(options.max_memory), kMbPerByte * v.memory_estimate)
          : fmt::format("{} boxes are used up", v.points);
  fmt::print(stderr, "polypod: the bounds did not come within the tolerance: {}. The bounds are proven as they are\n",
             why);
  return false;
}

namespace {

Json stopped_json(const workspace::Volume& v) {
  return v.stopped == workspace::Stopped::memory  ? Json("memory")
         : v.stopped == workspace::Stopped::cells ? Json("boxes")
                                                  : Json();
}

}  // namespace

Json volume_json(const workspace::Volume& v) {
  const auto mm = [](const Vec3& p) {
    return Json::array({units::to_mm(p.x()), units::to_mm(p.y()), units::to_mm(p.z())});
  };
  return {{"volume_mm3", units::to_mm3(v.volume)},
          {"volume_lower_mm3", units::to_mm3(v.lower)},
          {"volume_upper_mm3", units::to_mm3(v.upper)},
          {"bounds_mm", {{"min", mm(v.min)}, {"max", mm(v.max)}}},
          {"reached_mm", v.reached ? Json{{"min", mm(v.reached->min)}, {"max", mm(v.reached->max)}} : Json()},
          {"proven", v.proven},
          {"points", v.points},
          {"converged", v.converged},
          {"stopped_by", stopped_json(v)},
          {"empty", v.empty},
          {"seconds", v.seconds}};
}

Json measure_json(const machine::Task& task, const Region& region) {
  Json names = Json::array(), unit = Json::array();
  for (int i = 0; i < task.size(); ++i) {
    names.push_back(machine::name_of(task[i]));
    unit.push_back(workspace::unit_of(task, i));
  }
  return {{"volume_mm3", Json()},
          {"coordinates", names},
          {"coordinate_units", unit},
          {"measure", region.measure},
          {"measure_lower", number_json(region.lower)},
          {"measure_upper", number_json(region.upper)},
          {"measure_unit", region.unit}};
}

Json region_json(const machine::AnyMachine& machine, const workspace::Volume& v) {
  const machine::Task task = kinematics::task(machine);
  Json out = measure_json(task, region_of(task, v.volume, v.lower, v.upper));
  out.update({{"bounds", {{"min", point_json(task, v.min)}, {"max", point_json(task, v.max)}}},
              {"reached",
               v.reached ? Json{{"min", point_json(task, v.reached->min)}, {"max", point_json(task, v.reached->max)}}
                         : Json()},
              {"proven", v.proven},
              {"points", v.points},
              {"converged", v.converged},
              {"stopped_by", stopped_json(v)},
              {"empty", v.empty},
              {"seconds", v.seconds}});
  return out;
}

namespace {

/// "123 mm3, certainly between 122 and 124": two digits more than the bounds agree in, four at least.
std::string volume_text(const workspace::Volume& v, bool bounded) {
  if (!v.proven) {
    const double error = units::to_mm3(std::max(v.upper - v.volume, 1e-30));
    const double unit = std::pow(10.0, std::floor(std::log10(error)) - 1);  // two digits of the error
    const int decimals = std::clamp(static_cast<int>(-std::log10(unit)), 0, 9);
    return fmt::format("{:.{}f} +- {:.{}f} mm3 (95 % of the sample); nothing is proven: {}",
                       unit * std::round(units::to_mm3(v.volume) / unit), decimals, unit * std::round(error / unit),
                       decimals, bounded ? "bounds would take too many boxes" : "no bounds are known");
  }
  constexpr int kLeast = 4, kMost = 9;
  const double gap = (v.upper - v.lower) / v.volume;
  const int digits = gap > 0 ? std::clamp(static_cast<int>(std::ceil(-std::log10(gap))) + 2, kLeast, kMost) : kMost;
  const Figures mm3(units::to_mm3(v.volume), 0, digits);
  return fmt::format("{} mm3, certainly between {} and {}", mm3(units::to_mm3(v.volume)), mm3(units::to_mm3(v.lower)),
                     mm3(units::to_mm3(v.upper)));
}

Status refuse_beside_contains(const Context& context) {
  return refuse(context, {"--rel-tol", "--largest", "--report", "--stl", "--vtp", "--vti"},
                "--contains answers for one box alone; leave one of the two out");
}

Result<int> contains(const machine::AnyMachine& m, const workspace::Options& options, const std::string& text,
                     const Context& context) {
  POLYPOD_ASSIGN(n, numbers_of(text, "--contains"));
  const machine::Task task = kinematics::task(m);
  const int count = workspace::coordinates_of_points(task);
  if (n.size() != 2 * static_cast<std::size_t>(count)) {
    std::string corner;
    for (int k = 0; k < count; ++k) corner += (k > 0 ? "," : "") + workspace::coordinate_name(task, k);
    return fail(
        "AP152",
        fmt::format("--contains {}: not {} numbers", text, task.places() ? "six" : fmt::format("{}", 2 * count)), {},
        fmt::format("write {} of the lower corner, then of the upper one", corner));
  }
  Vec3 low = Vec3::Constant(-workspace::kAcross), high = -low;
  for (int k = 0; k < count; ++k) {
    low[k] = units::from_user(n[static_cast<std::size_t>(k)], workspace::unit_of(task, k));
    high[k] = units::from_user(n[static_cast<std::size_t>(count + k)], workspace::unit_of(task, k));
  }
  if (!((high - low).minCoeff() > 0)) {
    return fail("AP152", fmt::format("--contains {}: the first corner must lie below the second", text));
  }
  POLYPOD_TRY(workspace::near_home(m, low, high));
  const workspace::Shape box{workspace::ShapeKind::box, 0.5 * (low + high), 0.5 * (high - low)};
  POLYPOD_ASSIGN(held, workspace::certainly_holds(m, options, box));
  const auto missed = held ? std::nullopt : workspace::missed_in(m, options, box);
  const std::vector<double> pose = !missed         ? std::vector<double>{}
                                   : task.places() ? whole_pose_for_user(missed->pose)
                                                   : pose_for_user(m, missed->pose);
  if (context.json) {
    Json document{{"certainly_inside", held}};
    if (missed) document["not_reached"] = {{"pose", pose}, {"reason", missed->reason}};
    print_json(document);
  } else if (held) {
    fmt::print("certainly inside\n");
  } else if (missed && !task.places()) {
    std::string at;
    for (int k = 0; k < count; ++k)
      at += fmt::format("{}{} {:.7g} {}", k > 0 ? ", " : "", workspace::coordinate_name(task, k),
                        pose[static_cast<std::size_t>(k)], workspace::unit_of(task, k));
    fmt::print("not wholly inside: {} is out of reach: {}\n", at, missed->reason);
  } else if (missed) {
    fmt::print(
        "not wholly inside: x {:.9g}, y {:.9g}, z {:.9g} mm with A {:.7g}, B {:.7g}, C {:.7g} deg is out of "
        "reach: {}\n",
        pose[0], pose[1], pose[2], pose[3], pose[4], pose[5], missed->reason);
  } else {
    fmt::print(
        "not proven: all of 125 points of the box that were looked at are reached, but no proof was found for "
        "those between them; a slightly smaller box may have one\n");
  }
  return held ? kDone : kAnswerIsNo;
}

/// What lies beyond singular poses, in a sentence; empty where a sample saw nothing.
std::string beyond_note(const machine::AnyMachine& m, const workspace::BeyondSingular& beyond) {
  return beyond_text(m, beyond, "points drawn from it", "The volume includes");
}

/// Why a machine may reach nothing: its tool points away from the directions that are asked for, which are about z of
/// M.
void print_where_home_points(const machine::AnyMachine& m) {
  const std::optional<Pose> home = kinematics::home_pose(m);
  if (!home || !kinematics::task(m).turns()) return;
  const Vec3 k = home->R.col(2);
  constexpr double kAway = 0.5;  // cosine of 60 deg
  if (k.z() > kAway) return;
  const auto shown = [](double x) { return unsigned_zero(fmt::format("{:.2f}", x)); };
  fmt::print(
      "at home z of the tool points to ({}, {}, {}) in M, and directions are asked for about z of M: "
      "turn the tool's frame, so that its z points from the tip to the spindle, or the base\n",
      shown(k.x()), shown(k.y()), shown(k.z()));
}

/// Whether a pose prescribes x, y, z and the turn about z, as of four-armed deltas and SCARA arms.
bool turns_alone(const machine::Task& task) {
  return task.places() && task.holds(machine::Coordinate::c) && !workspace::tilts(task);
}

/// The region of a task that does not hold x, y, z, in the coordinates of the task.
Result<int> in_coordinates(const machine::AnyMachine& m, const workspace::Options& options, const WorkspaceFiles& files,
                           const std::string& machine_name, const std::vector<std::string>& sets,
                           const Context& context) {
  POLYPOD_TRY(
      refuse(context, {"--largest", "--stl", "--vtp", "--vti"}, "it serves machines whose task holds x, y and z"));
  POLYPOD_TRY(files.refuse_unused(context));
  POLYPOD_TRY(files.check(machine_name, context));
  workspace::Options of_region = options;
  if (options.progress) {  // in shares: the region is in no mm3
    of_region.progress = drawn_now_and_then([](const workspace::Progress& p) {
      return fmt::format("workspace: bounds {:.1f} % apart, {} boxes",
                         p.upper > 0 ? 100 * (p.upper - p.lower) / p.upper : 100.0, p.cells);
    });
  }
  POLYPOD_ASSIGN(v, workspace::volume(m, of_region));
  if (options.progress) fmt::print(stderr, "\r\x1b[K");
  const workspace::BeyondSingular beyond = workspace::beyond_singular(m, options, v);
  POLYPOD_TRY(files.write(m, options, v, machine_name, sets, context));
  if (context.json) {
    Json document = region_json(m, v);
    document["beyond_singular"] = beyond_json(beyond);
    print_json(document);
  } else if (!v.proven && !v.reached) {
    fmt::print("the sample of {} points found none that is reached; that there is none is not proven\n", v.points);
  } else if (v.empty) {
    fmt::print("no coordinates of the task are reachable (proven with {} boxes)\n", v.points);
  } else {
    const machine::Task task = kinematics::task(m);
    const Region region = region_of(task, v.volume, v.lower, v.upper);
    std::string text;
    for (int i = 0; i < task.size(); ++i) {
      text += fmt::format("{}        {}\n", machine::name_of(task[i]),
                          pages::extent_text(v, i, workspace::unit_of(task, i)));
    }
    fmt::print("region of the task's coordinates: {:.4g} {}, {} {:.4g} and {:.4g}{}{}\n{}{}   {}\nseconds  {:.2f}\n{}",
               region.measure, region.unit, v.proven ? "certainly between" : "between", region.lower, region.upper,
               v.proven ? "" : " (95 % of the sample; nothing is proven: no bounds are known)",
               task.turns() ? "; angles within 90 deg of home were looked at" : "", text,
               v.proven ? "boxes " : "points", v.points, v.seconds, beyond_note(m, beyond));
  }
  return came_within(v, options) ? kDone : kAnswerIsNo;
}

}  // namespace

namespace {

/// Whoever interrupts a long run is told the bounds that it had come to.
Result<workspace::Volume> volume_or_so_far(const machine::AnyMachine& m, const workspace::Options& options,
                                           const Context& context) {
  workspace::Progress last;
  bool said = false;
  const auto say = [&] {  // at once: what the run holds may take longer to give back than an interrupted program has
    if (std::exchange(said, true) || context.json || last.sampled || !(last.upper > 0)) return;
    fmt::print("stopped  after {} boxes: the volume is certainly between {:.0f} and {:.0f} mm3\n", last.cells,
               std::floor(units::to_mm3(last.lower)), std::ceil(units::to_mm3(last.upper)));
    std::fflush(stdout);
  };
  workspace::Options told = options;
  told.progress = [&](const workspace::Progress& p) {
    last = p;
    if (options.progress) options.progress(p);
    if (interrupted()) say();
  };
  return workspace::volume(m, told);
}

}  // namespace

Command workspace_command() {
  struct Options {
    std::string machine;
    std::vector<std::string> sets;
    WorkspaceOptions workspace;
    std::string largest, contains;
    WorkspaceFiles files;
  };
  auto o = std::make_shared<Options>();
  return {"workspace",
          "Volume of the points that are reachable from every required direction, between proven bounds where they are "
          "known",
          "polypod workspace hexapod-strut --tilt 20",
          [o](Arguments& a) {
            declare_machine(a, o->machine, o->sets);
            o->workspace.declare(a);
            a.option("--largest", o->largest, "box, cylinder or ellipsoid: a largest one that is certainly inside");
            a.option("--contains", o->contains,
                     "x0,y0,z0,x1,y1,z1: is this box certainly inside? (mm; of a task without x, y, z its own "
                     "coordinates, mm and deg)");
            o->files.declare(a);
          },
          [o](const Context& context) -> Result<int> {
            POLYPOD_ASSIGN(m, machine_of(o->machine, o->sets));
            POLYPOD_ASSIGN(options, o->workspace.options(m, context));
            const SingularNote singular(m, context);
            if (!kinematics::task(m).places() && o->contains.empty()) {
              return in_coordinates(m, options, o->files, o->machine, o->sets, context);
            }
            POLYPOD_TRY(o->files.refuse_unused(context));
            if (!o->contains.empty()) {
              POLYPOD_TRY(refuse_beside_contains(context));
              return contains(m, options, o->contains, context);
            }
            POLYPOD_TRY(o->files.check(o->machine, context));
            POLYPOD_ASSIGN(v, volume_or_so_far(m, options, context));
            Json document = volume_json(v);
            const workspace::BeyondSingular beyond = workspace::beyond_singular(m, options, v);
            document["beyond_singular"] = beyond_json(beyond);
            if (turns_alone(kinematics::task(m))) document["c_deg"] = 0;
            workspace::Shape shape;
            if (!o->largest.empty()) {
              POLYPOD_ASSIGN(kind, workspace::shape_kind(o->largest));
              POLYPOD_ASSIGN(found, workspace::largest_inside(m, options, kind));
              shape = found;
              document["largest"] = {{"shape", o->largest},
                                     {"center_mm", vector_json(shape.center * units::kMmPerMetre)},
                                     {"half_mm", vector_json(shape.half * units::kMmPerMetre)},
                                     {"volume_mm3", units::to_mm3(shape.volume())}};
            }
            if (context.progress) fmt::print(stderr, "\r\x1b[K");
            POLYPOD_TRY(o->files.write(m, options, v, o->machine, o->sets, context));
            if (context.json) {
              print_json(singular.in(document));
            } else if (!v.proven && !v.reached) {
              fmt::print(
                  "the sample of {} points found none that is reached from every direction; that there is none "
                  "is not proven\n",
                  v.points);
              print_where_home_points(m);
            } else if (v.empty) {
              fmt::print("no point is reachable from every direction (proven with {} boxes)\n", v.points);
              print_where_home_points(m);
            } else {
              fmt::print("volume   {}\n", volume_text(v, workspace::has_bounds(m)));
              for (int k = 0; k < 3; ++k) {
                fmt::print("{}        {}\n", "xyz"[k], pages::extent_text(v, k));
              }
              if (turns_alone(kinematics::task(m)))
                fmt::print("C        0 deg throughout: the workspace at other angles may differ\n");
              fmt::print("{}   {}\nseconds  {:.2f}\n", v.proven ? "boxes " : "points", v.points, v.seconds);
              fmt::print("{}", beyond_note(m, beyond));
              if (!o->largest.empty()) {
                const Vec3 sides = 2 * shape.half * units::kMmPerMetre;
                const Figures mm(sides.minCoeff(), 1);
                fmt::print("certainly inside: {} of {} x {} x {} mm about {}, {} mm3\n", o->largest, mm(sides.x()),
                           mm(sides.y()), mm(sides.z()), place_text(shape.center),
                           figure(units::to_mm3(shape.volume()), 0));
              }
            }
            return came_within(v, options) ? kDone : kAnswerIsNo;
          }};
}

}  // namespace polypod::app
