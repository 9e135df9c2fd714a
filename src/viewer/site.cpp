// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/viewer/site.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "polypod/cell/judge.hpp"
#include "polypod/control/growing.hpp"
#include "polypod/control/watch.hpp"
#include "polypod/core/config.hpp"
#include "polypod/core/files.hpp"
#include "polypod/core/units.hpp"
#include "polypod/kinematics/any_machine.hpp"
#include "polypod/kinematics/parts.hpp"
#include "polypod/machining/correct.hpp"
#include "polypod/machining/unrolling.hpp"
#include "polypod/pages/cell.hpp"
#include "polypod/pages/correction.hpp"
#include "polypod/pages/machine.hpp"
#include "polypod/pages/program.hpp"
#include "polypod/pages/watch.hpp"
#include "polypod/report/html.hpp"
#include "polypod/workspace/task_directions.hpp"
#include "polypod/workspace/volume.hpp"
#include "surface_page.hpp"

namespace polypod::viewer {
namespace {

using Json = nlohmann::ordered_json;
using machine::AnyMachine;
using machine::JointVector;

std::string in_small_letters(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

std::string ending_of(const std::string& path) {
  return in_small_letters(std::filesystem::path(path).extension().string());
}

std::string name_of(const std::string& path) {
  return std::filesystem::path(path).filename().string();
}

/// Whether a file has the tables of a cell, right or wrong.
bool is_cell(const std::string& path) {
  const auto top = config::read_file(path);
  if (!top || !top->has("machine") || !top->has("task")) return false;
  const auto machines = top->tables("machine");
  return machines && !machines->empty();
}

constexpr std::string_view kJson = "application/json";

std::string text_of(const Json& document) {
  return document.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Response refused(int status, const std::string& what) {
  return {status, "text/plain; charset=utf-8", what + "\n"};
}

/// A page that says what went wrong.
Response error_page(const std::string& title, const Error& error,
                    const std::vector<std::pair<std::string, std::string>>& links = {}) {
  report::Report page(title, "This cannot be shown");
  page.add_verdict(report::Verdict::bad, to_string(error));
  page.add_links(links);
  return {200, "text/html; charset=utf-8", page.to_html()};
}

/// mm or deg as a form shows it: rounding of a pose that is 0 is 0.
double without_rounding(double value) {
  constexpr double kNothing = 1e-9;
  return std::abs(value) < kNothing ? 0 : value;
}
double user_value(const AnyMachine& m, int joint, double q) {
  return without_rounding(kinematics::joint_kind(m, joint) == machine::JointKind::revolute ? units::to_deg(q)
                                                                                           : units::to_mm(q));
}
const char* joint_unit(const AnyMachine& m, int joint) {
  return kinematics::joint_kind(m, joint) == machine::JointKind::revolute ? "deg" : "mm";
}
std::vector<double> user_pose(const AnyMachine& m, const Pose& X) {
  const machine::Task task = kinematics::task(m);
  std::vector<double> c = kinematics::coordinates_of(task, X);
  for (std::size_t i = 0; i < c.size(); ++i)
    c[i] = without_rounding(task.is_angle(static_cast<int>(i)) ? units::to_deg(c[i]) : units::to_mm(c[i]));
  return c;
}

/// Numbers of a list of a question. Errors: VW120.
Result<std::vector<double>> numbers_in(const Json& question, const char* key, int count) {
  const auto at = question.find(key);
  const bool right = at != question.end() && at->is_array() && at->size() == static_cast<std::size_t>(count);
  std::vector<double> out;
  for (int i = 0; right && i < count; ++i) {
    const Json& value = (*at)[static_cast<std::size_t>(i)];
    constexpr double kMost = 1e9;
    if (!value.is_number()) break;
    const double v = value.get<double>();
    if (!(std::abs(v) <= kMost))
      return fail("VW120", fmt::format("{}: its number {} is {:g}, beyond -{:g} to {:g}", key, i + 1, v, kMost, kMost));
    out.push_back(v);
  }
  if (out.size() != static_cast<std::size_t>(count))
    return fail("VW120", fmt::format("{}: not a list of {} numbers", key, count));
  return out;
}

/// The machine of an item with the figures that the form changes. Errors: VW120, those of machine::load.
Result<AnyMachine> machine_in(const Json& question, const std::string& path) {
  std::vector<machine::Override> overrides;
  if (const auto sets = question.find("sets"); sets != question.end()) {
    if (!sets->is_object()) return fail("VW120", "sets: not an object");
    for (const auto& [key, value] : sets->items()) {
      if (!value.is_string()) return fail("VW120", "sets: a value is no text");
      overrides.push_back({key, value.get<std::string>()});
    }
  }
  return machine::load(path, overrides);
}

Result<pages::MachineAt> place_in(const Json& question, const AnyMachine& m) {
  if (question.contains("joints")) {
    const int count = kinematics::joint_count(m);
    POLYPOD_ASSIGN(values, numbers_in(question, "joints", count));
    JointVector q(count);
    for (int i = 0; i < count; ++i) {
      const double v = values[static_cast<std::size_t>(i)];
      q[i] = kinematics::joint_kind(m, i) == machine::JointKind::revolute ? units::from_deg(v) : units::from_mm(v);
    }
    return pages::machine_at(m, q);
  }
  const machine::Task task = kinematics::task(m);
  POLYPOD_ASSIGN(c, numbers_in(question, "pose", task.size()));
  for (std::size_t i = 0; i < c.size(); ++i)
    c[i] = task.is_angle(static_cast<int>(i)) ? units::from_deg(c[i]) : units::from_mm(c[i]);
  return pages::machine_at(m, kinematics::pose_of(task, c));
}

Json number_or_null(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json place_json(const AnyMachine& m, const pages::MachineAt& at) {
  Json out;
  if (!at.reason.empty()) {
    out["reason"] = at.reason;
    return out;
  }
  Json joints = Json::array();
  for (int i = 0; i < at.q.size(); ++i) joints.push_back(user_value(m, i, at.q[i]));
  out["pose"] = user_pose(m, at.X);
  out["joints"] = joints;
  out["violations"] = at.violations;
  out["condition"] = number_or_null(at.condition);
  out["sigma_min"] = number_or_null(at.sigma_min);
  return out;
}

/// `scene` is JSON already.
std::string with_scene(const Json& document, const report::Scene& scene) {
  std::string out = text_of(document);
  out.pop_back();
  return out + (out.size() > 1 ? "," : "") + "\"scene\":" + report::scene_data(scene) + "}";
}

/// What the script of a page needs to know of a machine.
Json live_data(const AnyMachine& m, std::size_t item) {
  const Pose X = pages::start_pose(m);
  const pages::MachineAt at = pages::machine_at(m, X);
  const machine::Task task = kinematics::task(m);
  const machine::Reach reach = kinematics::reach(m);
  Json pose = Json::array(), joints = Json::array(), settings = Json::array();
  const std::vector<double> c = user_pose(m, X);
  for (int i = 0; i < task.size(); ++i) {
    const std::string name(machine::name_of(task[i]));
    double low = -90, high = 90;
    if (!task.is_angle(i)) {
      const int axis = name[0] - 'x';
      low = units::to_mm(reach.low[axis]);
      high = units::to_mm(reach.high[axis]);
    }
    pose.push_back({{"name", name},
                    {"value", c[static_cast<std::size_t>(i)]},
                    {"unit", task.is_angle(i) ? "deg" : "mm"},
                    {"low", low},
                    {"high", high}});
  }
  for (int i = 0; i < kinematics::joint_count(m); ++i) {
    const machine::JointRange range = kinematics::joint_range(m, i);
    joints.push_back({{"value", at.q.size() > i ? user_value(m, i, at.q[i]) : 0.0},
                      {"min", number_or_null(user_value(m, i, range.min))},
                      {"max", number_or_null(user_value(m, i, range.max))},
                      {"unit", joint_unit(m, i)}});
  }
  std::set<std::string> keys;
  const auto add = [&](const machine::Parameter& p, bool single) {
    const std::string key = machine::key_of(p);
    if (!keys.insert(key).second) return;
    settings.push_back({{"key", key},
                        {"name", p.key},
                        {"value", units::to_user(p.value, p.unit)},
                        {"unit", p.unit},
                        {"single", single}});
  };
  for (const machine::Parameter& p : machine::settings(m)) add(p, false);
  for (const machine::Parameter& p : kinematics::parameters(m)) add(p, true);
  return {{"address", fmt::format("/{}", item)},
          {"settings", settings},
          {"pose", pose},
          {"joints", joints},
          {"turns", workspace::tilts(task)}};
}

/// How far a page has read a record, from its question. Errors: VW120.
Result<control::RecordPlace> record_place_in(const Json& question) {
  control::RecordPlace out;
  constexpr double kMost = 9e15;  // bytes: whole numbers that a page can name
  const auto from = question.find("from"), file = question.find("file"), time = question.find("time_s");
  if (from == question.end() || !from->is_number() || !(from->get<double>() >= 0 && from->get<double>() <= kMost) ||
      from->get<double>() != std::floor(from->get<double>())) {
    return fail("VW120", "from: not a count of bytes");
  }
  out.from = static_cast<std::uint64_t>(from->get<double>());
  if (file != question.end()) {
    if (!file->is_string()) return fail("VW120", "file: not a text");
    out.file = file->get<std::string>();
  }
  if (time != question.end() && !time->is_null()) {
    if (!time->is_number()) return fail("VW120", "time_s: not a number");
    out.time = time->get<double>();
  }
  return out;
}

/// The rows of a record that came since a page asked last: the machine at the newest, and the path of its tip.
Result<std::string> record_news(const std::string& path, const AnyMachine& m, const Json& question) {
  POLYPOD_ASSIGN(place, record_place_in(question));
  POLYPOD_ASSIGN(news, control::news_of(m, path, place));
  Json out;
  out["there"] = news.there;
  out["anew"] = news.anew;
  out["next"] = {{"from", news.next.from}, {"file", news.next.file}, {"time_s", number_or_null(news.next.time)}};
  out["rows"] = news.rows.size();
  out["skipped"] = news.skipped;
  out["unfinished"] = news.unfinished;
  out["refused"] = news.refused;
  out["why"] = news.why;
  if (news.rows.empty()) return text_of(out);
  const control::RecordRow& last = news.rows.back();
  const pages::MachineAt at = pages::machine_at(m, last.joints);
  Json row = place_json(m, at);
  Json joints = Json::array();
  for (int i = 0; i < last.joints.size(); ++i) joints.push_back(user_value(m, i, last.joints[i]));
  row["joints"] = joints;
  row["time_s"] = last.time;
  row["line"] = last.line;
  if (at.reason.empty()) row["deviation_um"] = units::to_um((at.X.p - last.command.p).norm());
  out["row"] = row;
  report::Scene scene = pages::machine_scene(m, at);
  if (!at.violations.empty()) {
    for (report::Line3& line : scene.lines)
      if (line.colour == report::Colour::ink) line.colour = report::Colour::vermillion;
  }
  constexpr std::size_t kMostPoints = 400;  // forward kinematics of an answer
  const std::size_t stride = (news.rows.size() + kMostPoints - 1) / kMostPoints;
  report::Line3 trail{"path of the tip", {}, report::Colour::green};
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t k = (news.rows.size() - 1) % stride; k < news.rows.size(); k += stride) {
    const auto found = kinematics::forward(m, news.rows[k].joints);
    const double turned = kinematics::hangs_down(m) ? -1 : 1;
    if (found.poses.empty()) {
      trail.points.push_back({kNone, kNone, kNone});
      continue;
    }
    const Vec3 p = found.poses.front().p * units::kMmPerMetre;
    trail.points.push_back({p.x(), turned * p.y(), turned * p.z()});
  }
  scene.lines.push_back(std::move(trail));
  return with_scene(out, scene);
}

/// What `polypod watch` says of a record without limits, and the machine that moves along it.
Response record_page(const std::string& path, const std::string& machine, const std::string& live,
                     const std::string& version, const std::atomic<bool>& stopped) {
  const std::string name = name_of(path);
  const auto m = machine::load(machine);
  if (!m) return error_page(name, m.error());
  const auto rows = control::read_record(*m, path);
  if (!rows) return error_page(name, rows.error(), {{live, "Follow the record as it grows"}});
  control::WatchOptions options;
  options.progress = [&stopped](double) { return !stopped; };
  const auto watch = control::watch(*m, *rows, options);
  if (!watch) return error_page(name, watch.error());
  pages::WatchPageOptions how;
  how.record = path;
  how.machine = machine;
  how.answer = "not judged: no limit was given";
  how.version = version;
  how.live = live;
  how.moving = &*m;
  how.rows = &*rows;
  return {200, "text/html; charset=utf-8", pages::watch_page(*watch, nullptr, nullptr, how)};
}

/// A page that Polypod has written. Errors: FI100, VW103.
Result<std::string> report_of(const std::string& path) {
  POLYPOD_ASSIGN(text, files::read(path));
  if (text.find("<meta name=\"generator\" content=\"Polypod\">") == std::string::npos) {
    return fail("VW103", fmt::format("{} is no page that Polypod has written", path), {},
                "open other pages in a browser of your own");
  }
  return text;
}

}  // namespace

Site::Runs::Run Site::Runs::next(const std::string& client) {
  const std::lock_guard lock(mutex_);
  constexpr std::size_t kMostClients = 1000;
  if (newest_.size() > kMostClients) newest_.clear();
  return {client, ++newest_[client]};
}

bool Site::Runs::is_over(const Run& run) const {
  if (run.client.empty()) return false;
  const std::lock_guard lock(mutex_);
  const auto at = newest_.find(run.client);
  return at == newest_.end() || at->second != run.number;
}

Result<Site> Site::of(const std::vector<std::string>& files, const std::string& version) {
  Site site;
  site.version_ = version;
  if (files.empty())
    return fail("VW100", "no file is given", {},
                "name a machine, a report, a program and its job, a record and its machine, a cell, or a surface");
  std::vector<std::string> programs, jobs, records;
  for (const std::string& file : files) {
    const std::string end = ending_of(file);
    if (end == ".html" || end == ".htm") {
      POLYPOD_TRY(report_of(file));
      site.items_.push_back({Item::Kind::report, file, ""});
    } else if (end == ".ngc" || end == ".nc" || end == ".tap" || end == ".gcode") {
      programs.push_back(file);
    } else if (end == ".csv") {
      records.push_back(file);
    } else if (end == ".stl" || end == ".vtp") {
      if (!std::filesystem::exists(file)) return fail("FI100", fmt::format("cannot read {}: no such file", file));
      site.items_.push_back({Item::Kind::surface, file, ""});
    } else if (end == ".toml" || end == ".urdf" || end.empty() || !std::filesystem::exists(file)) {
      const auto m = machine::load(file);
      if (m) {
        site.items_.push_back({Item::Kind::machine, file, ""});
        continue;
      }
      if (end == ".toml" && is_cell(file)) {
        POLYPOD_ASSIGN(cell, cell::read(file));
        site.items_.push_back({Item::Kind::cell, file, ""});
        continue;
      }
      if (end != ".toml" || !machining::read_job(file)) return tl::unexpected(m.error());
      jobs.push_back(file);
    } else {
      return fail(
          "VW101", fmt::format("{}: files of this kind are not shown", file), {},
          "view shows machines, reports (.html), programs (.ngc, .nc, .tap, .gcode) with or without their job, records "
          "(.csv) with their machine, cells, and surfaces (.stl, .vtp)");
    }
  }
  if (jobs.size() > 1 || (programs.empty() && !jobs.empty())) {
    return fail(
        "VW102",
        jobs.size() > 1 ? "two jobs are given" : fmt::format("{} is a job, and no program is given", jobs.front()), {},
        "give programs and their one job: polypod view program.ngc job.toml");
  }
  for (const std::string& program : programs)
    site.items_.push_back({Item::Kind::program, program, jobs.empty() ? "" : jobs.front()});
  if (!records.empty()) {
    const auto is_machine = [](const Item& item) { return item.kind == Item::Kind::machine; };
    const auto count = std::count_if(site.items_.begin(), site.items_.end(), is_machine);
    if (count != 1) {
      return fail("VW104",
                  fmt::format("{} is given {}", records.front(),
                              count == 0 ? "without its machine" : "with more than one machine"),
                  {}, "give records and their one machine: polypod view record.csv hexapod-strut");
    }
    const std::string machine = std::find_if(site.items_.begin(), site.items_.end(), is_machine)->path;
    std::vector<Item> items;
    for (const std::string& record : records) items.push_back({Item::Kind::record, record, machine});
    site.items_.insert(site.items_.begin(), items.begin(), items.end());
  }
  return site;
}

Response Site::list() const {
  report::Report page("Polypod", "What was given to `polypod view`");
  std::vector<std::pair<std::string, std::string>> links;
  for (std::size_t i = 0; i < items_.size(); ++i) {
    const char* what = items_[i].kind == Item::Kind::machine   ? "machine"
                       : items_[i].kind == Item::Kind::report  ? "report"
                       : items_[i].kind == Item::Kind::record  ? "record"
                       : items_[i].kind == Item::Kind::cell    ? "cell"
                       : items_[i].kind == Item::Kind::surface ? "surface"
                                                               : "program";
    links.emplace_back(fmt::format("/{}", i), fmt::format("{} ({})", name_of(items_[i].path), what));
    if (items_[i].kind == Item::Kind::record)
      links.emplace_back(fmt::format("/{}/live", i), fmt::format("{} (as it grows)", name_of(items_[i].path)));
  }
  page.add_links(links);
  return {200, "text/html; charset=utf-8", page.to_html()};
}

Response Site::page(std::size_t number) const {
  const Item& item = items_[number];
  const std::string name = name_of(item.path);
  if (item.kind == Item::Kind::report) {
    const auto text = report_of(item.path);  // it may be another file by now
    return text ? Response{200, "text/html; charset=utf-8", *text} : error_page(name, text.error());
  }
  if (item.kind == Item::Kind::machine) {
    const auto m = machine::load(item.path);
    if (!m) return error_page(name, m.error());
    Json live = live_data(*m, number);
    live["file"] = item.path;
    return {200, "text/html; charset=utf-8", pages::machine_page(*m, {version_, text_of(live)})};
  }
  if (item.kind == Item::Kind::cell) {
    auto cell = cell::read(item.path);
    if (!cell) return error_page(name, cell.error());
    cell::CellQuestion question = cell::question_of(*cell);
    question.settings.record = true;
    question.settings.progress = [this](double) { return !*stopped_; };
    return {200, "text/html; charset=utf-8", pages::cell_page(cell::judge_cell(std::move(*cell), question), version_)};
  }
  if (item.kind == Item::Kind::record)
    return record_page(item.path, item.beside, fmt::format("/{}/live", number), version_, *stopped_);
  if (item.kind == Item::Kind::surface) {
    const auto text = surface_page(item.path, version_);
    return text ? Response{200, "text/html; charset=utf-8", *text} : error_page(name, text.error());
  }
  if (item.beside.empty()) {
    const auto program = gcode::understand(item.path, {});
    if (!program) return error_page(name, program.error());
    return {200, "text/html; charset=utf-8", pages::program_page(*program, version_)};
  }
  const auto job = machining::read_job(item.beside);
  if (!job) return error_page(name, job.error());
  const auto understood = gcode::understand(item.path, machining::unroll_options(*job));
  if (!understood) return error_page(name, understood.error());
  machining::CorrectOptions options;
  options.keep_samples = true;
  options.again = true;
  options.progress = [this](const char*, double) { return !*stopped_; };
  const auto correction = machining::correct(*job, understood->program, understood->interpretation, options);
  if (!correction) return error_page(name, correction.error());
  pages::CorrectionPageOptions how;
  how.version = version_;
  return {200, "text/html; charset=utf-8", pages::correction_page(*job, understood->program, *correction, how)};
}

Response Site::live_page(std::size_t number) const {
  const Item& item = items_[number];
  const auto m = machine::load(item.beside);
  if (!m) return error_page(name_of(item.path), m.error());
  const pages::MachineAt at = pages::machine_at(*m, pages::start_pose(*m));
  std::vector<std::pair<std::string, std::string>> facts{{"record", item.path}, {"machine", item.beside}};
  if (!version_.empty()) facts.emplace_back("made with", "Polypod " + version_);
  report::Report page(name_of(item.path), "The record as it grows", facts);
  page.add_section("The machine at the newest row");
  report::Scene scene = pages::machine_scene(*m, at);
  scene.lines.push_back({"path of the tip", {}, report::Colour::green, 2.4});
  page.add_scene(
      scene, fmt::format("{}The machine by the joints of the newest row, red where it breaks a limit, and the path of "
                         "its tip. Until the first row comes it is drawn at its start.",
                         kinematics::hangs_down(*m) ? "The base is above: z of the machine points down. " : ""));
  Json live = live_data(*m, number);
  live["record"] = item.path;
  live.erase("settings");
  page.make_live(text_of(live));
  page.add_text(
      "Of several rows between two pictures the newest is shown and judged by the limits of the machine file. The "
      "deviation is that "
      "of the tip by the joints from the command of the same row. Rows without an end wait; a file that becomes "
      "shorter or is "
      "replaced is begun anew. Of a file that grows by more than a megabyte between two pictures the newest megabyte "
      "is read.");
  page.add_links({{fmt::format("/{}", number), "The record as it is now, with all its rows"}});
  return {200, "text/html; charset=utf-8", page.to_html()};
}

Result<std::string> Site::ask(const Item& item, const std::string& what, const std::string& body) const {
  const Json question = Json::parse(body, nullptr, false);
  if (!question.is_object()) return fail("VW120", "the question is no JSON object");
  if (what == "rows") {
    POLYPOD_ASSIGN(m, machine::load(item.beside));
    return record_news(item.path, m, question);
  }
  // A page that asks for another workspace, or for none, does not wait for the one before.
  Runs::Run run;
  if (const auto client = question.find("client"); what != "pose" && client != question.end() && client->is_string()) {
    run = runs_->next(client->get<std::string>());
  }
  if (what == "cancel") return text_of({{"cancelled", true}});
  POLYPOD_ASSIGN(m, machine_in(question, item.path));
  POLYPOD_ASSIGN(at, place_in(question, m));
  if (what == "pose") return with_scene(place_json(m, at), pages::machine_scene(m, at));

  workspace::Options options;
  if (const auto tilt = question.find("tilt_deg"); tilt != question.end()) {
    constexpr double kMostTilt = 89;
    if (!tilt->is_number() || !(tilt->get<double>() >= 0 && tilt->get<double>() <= kMostTilt))
      return fail("VW120", "the tilt must be a number of 0 to 89 deg");
    options.directions.tilt = units::from_deg(tilt->get<double>());
  }
  constexpr std::int64_t kCells = 30'000;
  options.max_cells = kCells;
  options.bounds_tolerance = 0;
  options.cancelled = [this, run] { return *stopped_ || runs_->is_over(run); };
  POLYPOD_ASSIGN(volume, workspace::volume(m, options));
  constexpr int kResolution = 24;
  report::Scene scene = pages::machine_scene(m, at);
  if (!kinematics::task(m).places()) {
    return with_scene({{"proven", volume.proven}, {"volume", pages::region_in_words(m, options, volume)}}, scene);
  }
  if (!volume.empty) {
    POLYPOD_ASSIGN(found, pages::workspace_scene(m, options, at, kResolution));
    scene = std::move(found);
  }
  const auto mm3 = [](double v) { return report::number(v * 1e9, 5); };
  Json document;
  document["volume_mm3"] = volume.volume * 1e9;
  document["volume_lower_mm3"] = volume.lower * 1e9;
  document["volume_upper_mm3"] = volume.upper * 1e9;
  document["proven"] = volume.proven;
  const std::string bounds =
      fmt::format("{} between {} and {} mm³", volume.proven ? "certainly" : "by a sample with 95 %", mm3(volume.lower),
                  mm3(volume.upper));
  document["volume"] = volume.empty ? std::string("No point is reachable. This is proven.")
                                    : fmt::format("{} mm³, {}.", mm3(volume.volume), bounds);
  // Where so few boxes leave the bounds wide, a sample says more, and proves nothing.
  if (volume.proven && !volume.empty && volume.upper - volume.lower > options.relative_tolerance * volume.volume) {
    POLYPOD_ASSIGN(sample, workspace::sampled_volume(m, options));
    document["volume_sample_mm3"] = sample.volume * 1e9;
    document["volume"] = fmt::format("About {} mm³ (by a sample, with 95 % between {} and {}); {}.", mm3(sample.volume),
                                     mm3(sample.lower), mm3(sample.upper), bounds);
  }
  return with_scene(document, scene);
}

Response Site::answer(const Request& request, int port) const {
  // A page from elsewhere that this computer's browser shows may not ask, by whatever name it reaches 127.0.0.1.
  bool known = false, same = request.origin.empty();
  // Names of hosts have no case, and browsers leave the port of http out.
  const std::string host = in_small_letters(request.host), origin = in_small_letters(request.origin);
  constexpr int kHttp = 80;
  for (const char* name : {"127.0.0.1", "localhost"}) {
    for (const std::string& mine : {fmt::format("{}:{}", name, port), std::string(port == kHttp ? name : "")}) {
      if (mine.empty()) continue;
      known = known || host == mine;
      same = same || origin == "http://" + mine;
    }
  }
  if (!known || !same) return refused(403, "Only pages of this server may ask it.");
  const bool reads = request.method == "GET" || request.method == "HEAD";
  if (!reads && request.method != "POST") return refused(405, "Not a method of this server.");
  const std::string& path = request.path;
  if (path == "/") {
    if (!reads) return refused(405, "Not a method of this page.");
    return items_.size() == 1 ? page(0) : list();
  }
  // "/3" or "/3/pose"
  std::size_t number = 0;
  const char* const end = path.data() + path.size();
  const auto [rest, code] = std::from_chars(path.data() + 1, end, number);
  if (code != std::errc{} || number >= items_.size()) return refused(404, "There is no such page.");
  const std::string what(rest, end);
  if (what.empty() && reads) return page(number);
  const Item::Kind kind = items_[number].kind;
  if (what == "/live" && reads && kind == Item::Kind::record) return live_page(number);
  if (kind == Item::Kind::machine ? what == "/pose" || what == "/workspace" || what == "/cancel"
                                  : what == "/rows" && kind == Item::Kind::record) {
    if (request.method != "POST") return refused(405, "Not a method of this page.");
    const auto found = ask(items_[number], what.substr(1), request.body);
    if (!found) return {200, std::string(kJson), text_of({{"error", to_string(found.error())}})};
    return {200, std::string(kJson), *found};
  }
  return refused(404, "There is no such page.");
}

}  // namespace polypod::viewer
