// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/pages/workspace.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "machine_inputs.hpp"
#include "machine_lines.hpp"
#include "moving_machine.hpp"
#include "parts.hpp"
#include "polypod/core/figures.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/report/csv.hpp"
#include "polypod/report/html.hpp"
#include "polypod/report/scene.hpp"
#include "polypod/report/stl.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "workspace_section.hpp"

namespace polypod::pages {
namespace {

using machine::AnyMachine;
using report::fixed;
using report::number;
using report::Polyline;
using report::Report;
using report::Verdict;
using units::to_deg;
using units::to_mm;
using workspace::Field;
using workspace::Options;
using workspace::Section;
using workspace::Surface;
using workspace::Volume;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// A number as it was given: no digits that say nothing.
std::string given(double value) {
  const std::string text = fmt::format("{:.6g}", value == 0 ? 0.0 : value);
  return text[0] == '-' ? "−" + text.substr(1) : text;
}

std::string directions_of(const AnyMachine& machine, const Options& options) {
  const auto& d = options.directions;
  if (kinematics::orientation_follows(machine)) return "with the tilt of the tool that follows from its position";
  if (!kinematics::task(machine).turns()) return "with the one orientation that its tool has";
  if (!d.is_ranges()) {
    return d.tilt > 0 ? fmt::format("with every tilt up to {} deg", given(to_deg(d.tilt)))
                      : std::string("with the tool at zero tilt (R = 1)");
  }
  std::string out = "with every";
  const char* join = " ";
  for (const auto& [range, name] : {std::pair{d.a_range, "A"}, std::pair{d.b_range, "B"}}) {
    if (!range) continue;
    out += fmt::format("{}{} from {} to {} deg", join, name, given(to_deg((*range)[0])), given(to_deg((*range)[1])));
    join = " and ";
  }
  return out;
}

std::string plane_title(const Section& s) {
  const int axis = axis_of(s.plane.normal.normalized());
  if (axis >= 0) return fmt::format("{} = {} mm", "xyz"[axis], fixed(to_mm(s.plane.point[axis]), 1));
  return "slanted plane";
}

double largest_tilt(const Section& s) {
  double most = -1;
  for (const double t : s.field.tilt) most = std::max(most, t);
  return most;
}

Vec3 centroid(const Surface& s) {
  Vec3 sum = Vec3::Zero();
  double six = 0;
  for (const auto& t : s.triangles) {
    const auto p = [&](std::size_t k) { return s.points[static_cast<std::size_t>(t[k])]; };
    const double v = p(0).dot(p(1).cross(p(2)));
    sum += v / 4 * (p(0) + p(1) + p(2));
    six += v;
  }
  return six != 0 ? Vec3(sum / six) : Vec3::Zero();
}

report::Scene scene_of(const Surface& s, const Kinds& kinds, const MachineAt& start) {
  report::Scene scene;
  scene.title = start.lines.empty() ? "The workspace, in space" : "The workspace and the machine, in space";
  report::Mesh mesh;
  for (const Vec3& p : s.points) mesh.points.push_back({to_mm(p.x()), to_mm(p.y()), to_mm(p.z())});
  mesh.triangles = s.triangles;
  for (const int limit : s.limit) mesh.kind.push_back(kinds.of(limit));
  mesh.opacity = 0.55;  // an arm stands within its workspace
  scene.meshes.push_back(std::move(mesh));
  scene.kinds = kinds.names();
  scene.lines = start.lines;
  return scene;
}

/// Shares of the area by kind.
std::vector<double> area_by_kind(const Surface& s, const Kinds& kinds) {
  std::vector<double> out(kinds.names().size(), 0.0);
  double total = 0;
  for (const auto& t : s.triangles) {
    const auto p = [&](std::size_t k) { return s.points[static_cast<std::size_t>(t[k])]; };
    const double area = (p(1) - p(0)).cross(p(2) - p(0)).norm();
    total += area;
    for (const int v : t) {
      const int kind = kinds.of(s.limit[static_cast<std::size_t>(v)]);
      if (kind >= 0) out[static_cast<std::size_t>(kind)] += area / 3;
    }
  }
  for (double& share : out) share /= total > 0 ? total : 1;
  return out;
}

/// A unit of volume in which that of a machine is a short number.
struct VolumeUnit {
  double per_m3 = 1e9;
  const char* name = "mm³";

  explicit VolumeUnit(double largest) {
    if (largest >= 0.1) {
      per_m3 = 1;
      name = "m³";
    } else if (largest >= 1e-3) {
      per_m3 = 1e6;
      name = "cm³";
    }
  }
  [[nodiscard]] std::string text(double volume) const {
    return per_m3 == 1 ? fixed(volume, 3) : fixed(volume * per_m3, 0);
  }
  [[nodiscard]] std::string range(const Volume& v) const {
    return fmt::format("{}\u00a0…\u00a0{}", text(v.lower), text(v.upper));
  }
};

class Part {
 public:
  Part(Report& report, const AnyMachine& machine, const Options& options, const Volume& volume,
       const WorkspacePageOptions& page)
      : machine_(machine), options_(options), volume_(volume), page_(page), report_(report) {
    options_.progress = nullptr;
    options_.keep_cells = false;
  }

  Result<Entries> add() {
    if (!volume_.proven && !volume_.reached) {
      return fail("WS131", "the sample found no point that is reached: there is nothing to show", {},
                  "ask for less tilt");
    }
    if (volume_.empty) {
      report_.add_section("What is reached");
      report_.add_verdict(Verdict::bad,
                          fmt::format("No point is reachable {}. This is proven.", directions_of(machine_, options_)));
      POLYPOD_TRY(volume_against_tilt());
      return inputs();
    }
    POLYPOD_TRY(measure());
    answer();
    pictures();
    POLYPOD_TRY(volume_against_tilt());
    POLYPOD_TRY(limits());
    return inputs();
  }

 private:
  [[nodiscard]] std::function<void(double)> stage(const char* what) const {
    return [this, what](double share) {
      if (page_.progress) page_.progress(what, share);
    };
  }

  /// Whether the tool stands at zero tilt alone.
  [[nodiscard]] bool upright_only() const { return !options_.directions.is_ranges() && options_.directions.tilt == 0; }

  Status measure() {
    const auto progress = stage("surface");
    progress(0);
    // The boxes are found once: of a machine whose inverse is a search each takes as long as its volume.
    POLYPOD_ASSIGN(all, workspace::extent(machine_, options_, false));
    Options upright = options_;
    upright.directions = {};
    upright_box_ = all;
    if (!upright_only()) {
      POLYPOD_ASSIGN(of_upright, workspace::extent(machine_, upright, false));
      upright_box_ = of_upright;
    }
    workspace::Extent box = all.empty() ? upright_box_ : all;
    if (!upright_box_.empty()) {
      box.low = box.low.cwiseMin(upright_box_.low);
      box.high = box.high.cwiseMax(upright_box_.high);
    }
    workspace::SurfaceOptions surface_options;
    constexpr int kInSpace = 34;  // finer triangles than these a picture does not show
    workspace::FieldOptions field_options;
    field_options.tilt = false;
    constexpr double kOfField = 0.6;
    field_options.progress = [&](double share) { progress(kOfField * share); };
    surface_options.progress = [&](double share) { progress(kOfField + (1 - kOfField) * share); };
    if (all.empty()) {
      return fail("WS131", "no point is reachable from all required directions: there is no surface", {},
                  "ask for less tilt");
    }
    POLYPOD_ASSIGN(grid, workspace::grid_over(all.low, all.high, std::min(page_.resolution, kInSpace)));
    POLYPOD_ASSIGN(values, workspace::field(machine_, options_, grid, field_options));
    POLYPOD_ASSIGN(found, workspace::surface_of(machine_, options_, values, surface_options));
    surface_ = std::move(found);
    middle_ = centroid(surface_);
    field_options.tilt = tilts();
    field_options.progress = stage("sections");
    std::set<int> seen(surface_.limit.begin(), surface_.limit.end());
    for (const int axis : {2, 1, 0}) {
      POLYPOD_ASSIGN(
          s, workspace::section(machine_, options_, {middle_, Vec3::Unit(axis)}, box, page_.resolution, field_options));
      collect(seen, s);
      largest_ = std::max(largest_, largest_tilt(s));
      sections_.push_back(std::move(s));
    }
    kinds_ = Kinds(machine_, seen);
    return {};
  }

  void answer() {
    report_.add_section("What is reached");
    std::string behind = missed_in_words(volume_);
    if (!volume_.proven) {
      behind = fmt::format(" Nothing is proven: {}.", workspace::has_bounds(machine_)
                                                          ? "within this tolerance bounds would take too many boxes"
                                                          : "no bounds are known for the inverse of this machine") +
               behind;
    }
    report_.add_verdict(
        Verdict::neutral,
        fmt::format(
            fmt::runtime(volume_.proven ? "{}, every point of {} {} is reached: certainly between {} and {} {}.{}"
                                        : "{}, a sample finds {} {} to be reached, with 95 % between {} and {} {}.{}"),
            capital(), unit_.text(volume_.volume), unit_.name, unit_.text(volume_.lower), unit_.text(volume_.upper),
            unit_.name, behind));
    report_.add_text(what_is_answered());
    const std::string beyond =
        beyond_in_words(workspace::beyond_singular(machine_, options_, volume_), "points drawn from it");
    if (!beyond.empty()) report_.add_text(beyond);
    std::vector<report::KeyFigure> figures{
        {unit_.text(volume_.volume), unit_.name,
         fmt::format(fmt::runtime(volume_.proven ? "volume, ± {} % proven" : "volume, ± {} % (95 % of a sample)"),
                     number(50 * (volume_.upper - volume_.lower) / std::max(volume_.volume, 1e-30), 2)),
         Verdict::neutral}};
    if (tilts()) {
      figures.push_back(
          {fixed(to_deg(largest_), 1), "deg", "largest tilt at every azimuth in the three sections", Verdict::neutral});
    }
    const std::vector<double> shares = area_by_kind(surface_, kinds_);
    if (!shares.empty()) {
      const auto most = std::max_element(shares.begin(), shares.end());
      figures.push_back({fixed(100 * *most, 0), "%",
                         "of the boundary: " + kinds_.names()[static_cast<std::size_t>(most - shares.begin())],
                         Verdict::neutral});
    }
    report_.add_key_figures(figures);
    report_.add_definitions(
        {{"x", extent_text(volume_, 0)}, {"y", extent_text(volume_, 1)}, {"z", extent_text(volume_, 2)}});
  }

  void pictures() {
    report_.add_section("The workspace in space");
    const MachineAt start = machine_at(machine_, start_pose(machine_));
    report::Scene scene = scene_of(surface_, kinds_, start);
    report::Scene turns = scene;
    const double tilt = std::clamp(1.2 * largest_, units::from_deg(10), units::from_deg(60));
    add_poses(turns, turns.lines.size(), machine_, start, tilt);
    if (kinematics::hangs_down(machine_)) {
      hang(scene);
      hang(turns);
    }
    const std::string machine = start.lines.empty()
                                    ? ". The machine is not drawn: it takes no pose at the start: " + start.reason + "."
                                    : ", and the machine.";
    report_.add_scene(
        scene,
        "The boundary of the workspace, coloured by the limit that makes it" + machine +
            " The box of axes is in the machine's reference frame." +
            std::string(kinematics::hangs_down(machine_)
                            ? " The base is above: z of the machine points down, here and in the sections."
                            : ""),
        &turns);
    report_.add_section("Sections of the workspace");
    if (!tilts()) {
      report_.add_text(
          "Three planes through the middle of the workspace. The deeper the colour, the farther the tool is inside the "
          "limits; the colour says which limit is the nearest.");
    } else {
      report_.add_text(fmt::format(
          "Three planes through the middle of the workspace. The deeper the colour, the farther the tool "
          "may tilt from z "
          "at every azimuth before a limit stops it; the colour says which limit that is, grey where none does up to "
          "{:.0f} deg. {}",
          to_deg(workspace::FieldOptions{}.tilt_max),
          options_.directions.is_ranges() || options_.directions.tilt > 0
              ? fmt::format("The black line encloses what is reached {}.", directions_of(machine_, options_))
              : "At the boundary only zero tilt is left."));
    }
    std::vector<std::pair<std::string, report::Figure>> panels;
    for (const Section& s : sections_)
      panels.emplace_back(fmt::format("{}: {} mm²", plane_title(s), fixed(s.area * units::kMm2PerSquareMetre, 0)),
                          section_map(options_, s, kinds_, kinematics::hangs_down(machine_)));
    report::Scene other = scene;
    other.azimuth_deg += 180;
    other.elevation_deg = -12;
    other.max_aspect = 0.95;
    panels.emplace_back("from behind and below", other);
    report_.add_figure_grid(
        2, panels,
        tilts() ? std::string("Areas are those inside the black line. The largest tilt is sampled at 24 "
                              "azimuths with refinement between them") +
                      (volume_.proven ? "; the volume above is proven." : ".")
                : "Areas are those inside the black line.");
  }

  [[nodiscard]] bool tilts() const { return workspace::tilts(kinematics::task(machine_)); }

  /// A proven volume with few boxes, or one of a sample where no bounds are known. Of a cone of directions a box takes
  /// many times as long as of one.
  [[nodiscard]] Result<Volume> quick(Options options) const {
    const bool cone = options.directions.is_ranges() || options.directions.tilt > 0;
    const double enough = volume_.proven && !cone ? 0.02 : 0.05;
    options.relative_tolerance = std::max(options.relative_tolerance, enough);
    constexpr std::int64_t kCells = 30'000, kCellsOfCone = 8'000;
    options.max_cells = cone ? kCellsOfCone : kCells;
    options.bounds_tolerance = 0;
    return workspace::volume(machine_, options);
  }
  /// Over many directions at once the proof for an arm takes minutes: sampled volumes stand in for it, as where no
  /// bounds are known at all.
  [[nodiscard]] bool proves(const workspace::Directions& directions) const {
    return volume_.proven && (!kinematics::is_serial(machine_) || (!directions.is_ranges() && directions.tilt == 0));
  }

  /// A coarse grid over what the upright tool reaches, for sampled volumes.
  [[nodiscard]] Result<Field> sampled(const Options& options, bool tilt,
                                      const std::function<void(double)>& progress) const {
    Options upright = options;
    upright.directions = {};
    workspace::Extent box = upright_box_;
    if (!tilt || box.empty()) {
      POLYPOD_ASSIGN(found, workspace::extent(machine_, tilt ? upright : options, false));
      box = found;
    }
    if (box.empty()) return Field{};
    constexpr int kCoarse = 26;
    POLYPOD_ASSIGN(grid, workspace::grid_over(box.low, box.high, kCoarse));
    workspace::FieldOptions field_options;
    field_options.tilt = tilt;
    field_options.progress = progress;
    return workspace::field(machine_, tilt ? upright : options, grid, field_options);
  }
  /// The volume of the cells of that grid whose points are reached.
  [[nodiscard]] Result<Volume> counted(const Options& options) const {
    POLYPOD_ASSIGN(with, sampled(options, false, {}));
    const auto count = std::count_if(with.margin.begin(), with.margin.end(), [](double m) { return m >= 0; });
    Volume out;
    out.proven = false;
    out.volume = static_cast<double>(count) * cell_of(with);
    return out;
  }
  static double cell_of(const Field& f) {
    return f.grid.step[0].norm() * f.grid.step[1].norm() * f.grid.step[2].norm();
  }

  Status volume_against_tilt() {
    if (!tilts()) return {};
    const auto progress = stage("volume against tilt");
    POLYPOD_ASSIGN(field, sampled(options_, true, [&](double share) { progress(0.5 * share); }));
    double most = 0;
    for (const double t : field.tilt) most = std::max(most, t);
    report::LinePlot plot;
    plot.title = "Volume against tilt";
    plot.x = {"tilt in every direction", "deg", 0, {}, false};
    plot.y = {"volume", unit_.name, {}, {}, true};
    report::Series curve{"sampled on a grid", {}, {}, report::Colour::blue, report::LineStyle::solid, 2};
    constexpr int kPoints = 80;
    for (int k = 0; k <= kPoints && most > 0; ++k) {
      const double at = most * k / kPoints;
      const auto count = std::count_if(field.tilt.begin(), field.tilt.end(), [&](double t) { return t >= at; });
      curve.x.push_back(to_deg(at));
      curve.y.push_back(unit_.per_m3 * static_cast<double>(count) * cell_of(field));
    }
    plot.series.push_back(curve);
    report::Table table;
    table.columns = {{"tilt", "deg", 0},
                     {"volume", unit_.name},
                     {volume_.proven ? "proven bounds" : "95 % of a sample", unit_.name},
                     {"of that at zero tilt", "%", 1}};
    report::Series finer{volume_.proven ? "proven, between bounds" : "95 % of a finer sample",
                         {},
                         {},
                         report::Colour::vermillion,
                         report::LineStyle::points,
                         3.5};
    double first = 0;
    const auto add = [&](double tilt, const Volume& v) {
      finer.x.push_back(to_deg(tilt));
      finer.y.push_back(unit_.per_m3 * v.volume);
      report::Series bar{"",
                         {to_deg(tilt), to_deg(tilt)},
                         {unit_.per_m3 * v.lower, unit_.per_m3 * v.upper},
                         report::Colour::vermillion,
                         report::LineStyle::solid,
                         1.5};
      plot.series.push_back(bar);
      if (tilt == 0) first = v.volume;
      table.rows.push_back({to_deg(tilt), unit_.text(v.volume), v.empty ? "0, proven" : unit_.range(v),
                            first > 0 ? 100 * v.volume / first : 0.0});
    };
    constexpr int kSteps = 6;
    const double step =
        std::max(1.0, std::ceil(to_deg(most) / (kSteps - 1)));  // the last one is at or above the largest
    const auto& asked = options_.directions;
    bool shown = asked.is_ranges();
    for (int k = 0; k < kSteps; ++k) {
      Options at = options_;
      at.directions = {};
      at.directions.tilt = units::from_deg(std::min(k * step, 89.0));
      if (!shown && asked.tilt <= at.directions.tilt) {
        add(asked.tilt, volume_);
        shown = true;
        if (asked.tilt == at.directions.tilt) continue;
      }
      if (!proves(at.directions)) continue;
      POLYPOD_ASSIGN(v, quick(at));
      progress(0.5 + 0.5 * (k + 1.0) / kSteps);
      add(at.directions.tilt, v);
      if (v.empty) break;
    }
    if (!shown) add(asked.tilt, volume_);
    plot.series.push_back(finer);
    if (!asked.is_ranges() && asked.tilt > 0) {
      plot.x_levels.push_back({"asked for", to_deg(asked.tilt), report::Colour::muted});
    }
    report_.add_section("Volume against tilt");
    report_.add_figure(plot,
                       fmt::format("The volume that is reached with every tilt up to the one below, at every azimuth: "
                                   "sampled on a coarse grid as a line; as points {}.",
                                   volume_.proven ? "where it was proven, each with its bounds"
                                                  : "by a finer sample, each with its 95 %"));
    report_.add_table(table);
    return {};
  }

  /// Whether a volume without this limit means anything: without the ends of struts and rails a hexapod has no reach.
  [[nodiscard]] bool may_go(int limit) const {
    if (limit == workspace::kOutOfReach) return false;
    return kinematics::takes_any_posture(machine_) || !table_[static_cast<std::size_t>(limit)].holds_reach;
  }

  Status limits() {
    const std::vector<double> shares = area_by_kind(surface_, kinds_);
    const auto progress = stage("limits");
    report::Table table;
    table.caption = "Limits by their fraction of the area of the boundary, as in the picture in space";
    table.columns = {
        {"limit", ""}, {"fraction of the boundary", "%", 1}, {"volume without it", unit_.name}, {"gain", "%"}};
    std::vector<std::size_t> order;
    for (std::size_t k = 0; k < shares.size(); ++k)
      if (shares[k] > 0) order.push_back(k);
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return shares[a] > shares[b]; });
    std::size_t done = 0;
    progress(0);
    for (const std::size_t k : order) {
      LimitBits bits = 0;
      for (int i = 0; i < 64; ++i) {
        if (kinds_of_bits_.empty()) break;
        if (kinds_of_bits_[static_cast<std::size_t>(i)] == kinds_.names()[k] && may_go(i)) bits |= LimitBits{1} << i;
      }
      std::vector<report::Cell> row{kinds_.names()[k], 100 * shares[k]};
      if (bits != 0) {
        Options without = options_;
        without.limits &= ~bits;
        const bool proven = proves(options_.directions);
        Result<Volume> v = proven || !workspace::has_bounds(machine_) ? quick(without) : counted(without);
        if (!v && v.error().id != "WS108") return tl::unexpected(v.error());
        if (!v) {  // nothing else ends the machine
          row.emplace_back("without end");
          row.emplace_back("–");
        } else if (proven) {
          row.emplace_back(unit_.range(*v));
          // Both volumes are enclosed, so the gain is too.
          const double low = 100 * (v->lower / std::max(volume_.upper, 1e-30) - 1);
          const double high = 100 * (v->upper / std::max(volume_.lower, 1e-30) - 1);
          row.emplace_back(fmt::format("{}\u00a0…\u00a0{}", fixed(std::max(0.0, low), 1), fixed(high, 1)));
        } else {
          row.emplace_back("about " + unit_.text(v->volume));
          row.emplace_back("about " + fixed(std::max(0.0, 100 * (v->volume / volume_.volume - 1)), 0));
        }
      } else {
        row.emplace_back("–");
        row.emplace_back("–");
      }
      table.rows.push_back(std::move(row));
      progress(static_cast<double>(++done) / static_cast<double>(order.size()));
    }
    report_.add_section("Which limit cuts how much");
    report_.add_table(table);
    report_.add_text(
        fmt::format("{} Limits that make the machine's reach, such as the lengths of its legs, have none.",
                    proves(options_.directions)
                        ? "The volume without a limit is proven, with few boxes: the gain lies between the two numbers."
                        : "The volume without a limit is sampled coarsely, good to some per cent."));
    return {};
  }

  [[nodiscard]] Entries inputs() const {
    Entries entries{{"tool directions", directions_of(machine_, options_)},
                    {"tolerance of the volume", given(100 * options_.relative_tolerance) + " %"},
                    {"boxes examined", fixed(static_cast<double>(volume_.points), 0)},
                    {"points a side of a section", fixed(page_.resolution, 0)}};
    if (workspace::interference_bits(machine_) != 0)
      entries.emplace_back("leg against leg", options_.interference ? "checked" : "not checked");
    const LimitBits off = ~options_.limits;
    std::set<std::string> off_kinds;
    for (int i = 0; i < 64; ++i)
      if ((off >> i & 1U) != 0 && !kinds_of_bits_[static_cast<std::size_t>(i)].empty())
        off_kinds.insert(kinds_of_bits_[static_cast<std::size_t>(i)]);
    for (const std::string& kind : off_kinds) entries.emplace_back("switched off", kind);
    return entries;
  }

  [[nodiscard]] std::string capital() const {
    std::string text = directions_of(machine_, options_);
    text[0] = 'W';
    return text;
  }

  const AnyMachine& machine_;
  Options options_;
  const Volume& volume_;
  const WorkspacePageOptions& page_;
  Report& report_;
  Surface surface_;
  Vec3 middle_ = Vec3::Zero();
  workspace::Extent upright_box_;  ///< of what is reached with R = 1; empty before it is found
  std::vector<Section> sections_;
  double largest_ = -1;
  VolumeUnit unit_{volume_.volume};
  Kinds kinds_{machine_, {}};
  std::array<std::string, 64> kinds_of_bits_ = names_of_bits(machine_);
  machine::LimitTable table_ = kinematics::limit_table(machine_);

  using LimitBits = workspace::LimitBits;
  static std::array<std::string, 64> names_of_bits(const AnyMachine& machine) {
    std::array<std::string, 64> out;
    const auto count = static_cast<int>(kinematics::limit_table(machine).size());
    for (int i = 0; i < count; ++i) out[static_cast<std::size_t>(i)] = workspace::limit_kind(machine, i);
    return out;
  }
};

}  // namespace

report::Figure section_picture(const AnyMachine& machine, const Options& options, const Section& section) {
  std::set<int> seen;
  collect(seen, section);
  return section_map(options, section, Kinds(machine, seen), kinematics::hangs_down(machine));
}

std::string section_csv(const AnyMachine& machine, const Section& section) {
  std::vector<std::string> names;
  const int coordinates = workspace::coordinates_of_points(section.task);
  for (int k = 0; k < coordinates; ++k) names.push_back(workspace::column_name(section.task, k));
  names.insert(names.end(), {"margin_mm", "limit", "tilt_deg", "tilt_limit"});
  report::Csv csv(names);
  const Field& f = section.field;
  for (std::size_t i = 0; i < f.grid.size(); ++i) {
    const Vec3 p = f.grid.at(i);
    const auto name = [&](int limit) { return limit < 0 ? std::string() : workspace::limit_label(machine, limit); };
    const Vec3 shown = workspace::for_user(section.task, p);
    std::vector<report::Csv::Field> row(shown.begin(), shown.begin() + coordinates);
    row.insert(row.end(), {to_mm(f.margin[i]), name(f.limit[i])});
    if (!f.tilt.empty()) {
      row.emplace_back(f.tilt[i] < 0 ? kNone : to_deg(f.tilt[i]));
      row.emplace_back(name(f.tilt_limit[i]));
    }
    csv.add(row);
  }
  return csv.text();
}

Result<report::VtkImage> field_image(const Field& f) {
  report::VtkImage image;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3& step = f.grid.step[k];
    const double along = step[static_cast<Eigen::Index>(k)];
    if (!(along > 0) || step.norm() > along * (1 + 1e-12)) {
      return fail("RE101", "the grid of the field is not parallel to the axes, which a .vti file needs");
    }
    image.points[k] = f.grid.points[k];
    image.origin[k] = to_mm(f.grid.origin[static_cast<Eigen::Index>(k)]);
    image.spacing[k] = to_mm(along);
  }
  const auto numbers = [](const std::vector<int>& v) { return std::vector<double>(v.begin(), v.end()); };
  report::VtkArray margin{"margin_mm", 1, {}};
  for (const double m : f.margin) margin.values.push_back(to_mm(m));
  image.arrays = {margin, {"limit", 1, numbers(f.limit)}};
  if (!f.tilt.empty()) {
    report::VtkArray tilt{"tilt_deg", 1, {}};
    for (const double t : f.tilt) tilt.values.push_back(t < 0 ? kNone : to_deg(t));
    image.arrays.push_back(tilt);
    image.arrays.push_back({"tilt_limit", 1, numbers(f.tilt_limit)});
  }
  return image;
}

report::VtkPolyData surface_data(const Surface& s) {
  report::VtkPolyData data;
  for (const Vec3& p : s.points) data.points.push_back({to_mm(p.x()), to_mm(p.y()), to_mm(p.z())});
  for (const auto& t : s.triangles) data.polygons.push_back({t[0], t[1], t[2]});
  data.arrays = {{"limit", 1, std::vector<double>(s.limit.begin(), s.limit.end())}};
  return data;
}

Result<std::string> surface_stl(const Surface& s) {
  std::vector<std::array<double, 3>> points;
  for (const Vec3& p : s.points) points.push_back({to_mm(p.x()), to_mm(p.y()), to_mm(p.z())});
  return report::to_stl(points, s.triangles);
}

std::string extent_text(const Volume& v, int axis, const char* unit_of_axis) {
  const char* of = unit_of_axis != nullptr ? unit_of_axis : "mm";
  const auto shown = [&](double x) { return units::to_user(x, of); };
  // Digits go by the largest side; of coordinates of different units by their own.
  const auto extent = [&](const Vec3& low, const Vec3& high) {
    return shown(unit_of_axis != nullptr ? high[axis] - low[axis] : (high - low).maxCoeff());
  };
  if (!v.proven) {
    if (!v.reached) return "nothing seen";
    const Figures figure(extent(v.reached->min, v.reached->max), 0);
    return fmt::format("{} .. {} {} seen", figure(shown(v.reached->min[axis])), figure(shown(v.reached->max[axis])),
                       of);
  }
  constexpr double kShare = 1e-4;  // of the largest extent: ten times the tolerance of the bounds
  const double size = extent(v.min, v.max);
  const int digits = std::clamp(size > 0 ? static_cast<int>(std::floor(-std::log10(kShare * size))) : 2, 0, 9);
  const double unit = std::pow(10.0, digits);
  // Rounded to the digit: to nearest, down or up. Adding 0 makes -0 a 0.
  const auto text = [&](double m, double (*round)(double)) {
    return fmt::format("{:.{}f}", round(shown(m) * unit) / unit + 0.0, digits);
  };
  const auto nearest = [](double x) { return std::round(x); };
  const auto down = [](double x) { return std::floor(x); };
  const auto up = [](double x) { return std::ceil(x); };
  const std::string low = text(v.min[axis], nearest), high = text(v.max[axis], nearest);
  if (v.reached && low == text(v.reached->min[axis], nearest) && high == text(v.reached->max[axis], nearest)) {
    return fmt::format("{} .. {} {}", low, high, of);
  }
  const std::string beyond = fmt::format("not beyond {} .. {} {}", text(v.min[axis], down), text(v.max[axis], up), of);
  if (!v.reached) return beyond;
  return fmt::format("reached {} .. {} {}, {}", text(v.reached->min[axis], up), text(v.reached->max[axis], down), of,
                     beyond);
}

Result<std::string> workspace_page(const AnyMachine& machine, const Options& options, const Volume& volume,
                                   const WorkspacePageOptions& page) {
  Report report(fmt::format("Workspace of {}", machine::name_of(machine)),
                fmt::format("Which points the tool centre point (TCP, tool tip) reaches {}, and what stops it beyond",
                            directions_of(machine, options)),
                facts_of(machine, page, {"tool directions", directions_of(machine, options)}));
  POLYPOD_ASSIGN(inputs, add_workspace(report, machine, options, volume, page));
  add_inputs(report, machine, inputs, page.command);
  return report.to_html();
}

std::pair<std::string, std::string> volume_figure(const Volume& volume) {
  const VolumeUnit unit(volume.volume);
  return {unit.text(volume.volume), unit.name};
}

Result<Entries> add_workspace(Report& report, const AnyMachine& machine, const Options& options, const Volume& volume,
                              const WorkspacePageOptions& page) {
  return Part(report, machine, options, volume, page).add();
}

}  // namespace polypod::pages
