// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "reader.hpp"

#include "polypod/core/files.hpp"
#include "polypod/kinematics/any_machine.hpp"

namespace polypod::cell {

Status Reader::spots() {
  POLYPOD_ASSIGN(tables, some("spot"));
  for (const Table& table : tables) {
    Spot out;
    out.place = table.place();
    POLYPOD_TRY(fresh_name(table, out.name));
    POLYPOD_ASSIGN(kind, table.text("kind"));
    if (kind == "pallet")
      out.kind = Spot::Kind::pallet;
    else if (kind == "holder")
      out.kind = Spot::Kind::holder;
    else if (kind == "opening")
      out.kind = Spot::Kind::opening;
    else if (kind == "pour")
      out.kind = Spot::Kind::pour;
    else
      return fail("CE102", fmt::format("kind \"{}\" is not known", one_line(kind)), table.place_of("kind"),
                  "pallet, holder, opening or pour");
    if (cell_.containers.empty())
      return fail("CE106", "the cell has no [container]", table.place(), "add a table [container]");
    POLYPOD_ASSIGN(at, point(table, "at_mm"));
    POLYPOD_ASSIGN(rows, table.optional_integer("rows", 1, 1, 100));
    POLYPOD_ASSIGN(columns, table.optional_integer("columns", 1, 1, 100));
    POLYPOD_ASSIGN(turn, optional_angle(table, "turn_deg", 0));
    double pitch = 0;
    if (rows * columns > kMostSlots) {
      return fail("CE106", fmt::format("{} places are more than {}", rows * columns, kMostSlots),
                  table.place_of("rows"));
    }
    if (rows * columns > 1 || table.has("pitch_mm")) {
      POLYPOD_ASSIGN(p, length(table, "pitch_mm"));
      pitch = p;
      if (rows * columns > 1 && pitch < cell_.containers[0].diameter) {
        return fail("CE103",
                    fmt::format("{} of {:g} mm do not fit side by side at a pitch of {:g} mm", cell_.containers[0].name,
                                units::to_mm(cell_.containers[0].diameter), units::to_mm(pitch)),
                    table.place_of("pitch_mm"));
      }
    }
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) {
        const double x = (c - (columns - 1) / 2.0) * pitch, y = (r - (rows - 1) / 2.0) * pitch;
        out.slots.push_back(at +
                            Vec3(std::cos(turn) * x - std::sin(turn) * y, std::sin(turn) * x + std::cos(turn) * y, 0));
      }
    }
    POLYPOD_ASSIGN(tool_pitch, optional_angle(table, "pitch_deg", std::numbers::pi / 2));
    POLYPOD_ASSIGN(roll, optional_angle(table, "roll_deg", 0));
    if (table.has("heading_deg")) {
      POLYPOD_ASSIGN(heading, optional_angle(table, "heading_deg", 0));
      out.heading = heading;
    }
    POLYPOD_ASSIGN(clearance, optional_length(table, "clearance_mm", 0.1));
    POLYPOD_ASSIGN(containers, table.optional_integer("containers", 0, 0, static_cast<int>(out.slots.size())));
    POLYPOD_ASSIGN(filled, table.optional_integer("filled", 0, 0, cell_.containers[0].capacity));
    POLYPOD_ASSIGN(zone, table.optional_text("zone", ""));
    POLYPOD_ASSIGN(time, table.optional_number("time_s", out.kind == Spot::Kind::pour ? 2 : 0, kSeconds));
    if (out.kind == Spot::Kind::pour) {
      POLYPOD_TRY(needs_item(table));
      POLYPOD_ASSIGN(conveyor, index_of(cell_.conveyors, table, "conveyor", "conveyor"));
      POLYPOD_ASSIGN(along, span(table, "along_mm", units::kMetrePerMm, kMaybeSize_mm));
      POLYPOD_ASSIGN(across, span(table, "across_mm", units::kMetrePerMm, kPlace_mm));
      POLYPOD_TRY(ordered(table, "along_mm", along[0], along[1]));
      POLYPOD_TRY(ordered(table, "across_mm", across[0], across[1]));
      const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(conveyor)];
      if (along[1] > c.length)
        return fail("CE105", fmt::format("{} is beyond the end of conveyor {}", out.name, c.name),
                    table.place_of("along_mm"));
      POLYPOD_TRY(on(c, table, "across_mm", across[0], across[1]));
      out.conveyor = conveyor;
      out.along_low = along[0];
      out.along_high = along[1];
      out.across_low = across[0];
      out.across_high = across[1];
    }
    POLYPOD_ASSIGN(size, optional_point(table, "size_mm", Vec3::Zero()));
    POLYPOD_ASSIGN(middle, optional_point(table, "body_at_mm", at));
    if ((size.array() < 0).any()) return fail("CE103", "a size is below 0", table.place_of("size_mm"));
    out.pitch = tool_pitch;
    out.roll = roll;
    out.clearance = clearance;
    out.containers = containers;
    out.filled = filled;
    out.zone = zone;
    out.time = time;
    out.size = size;
    out.middle = middle;
    out.turn = turn;
    POLYPOD_TRY(table.finish());
    cell_.spots.push_back(out);
  }
  return {};
}

Result<machine::AnyMachine> machine_of(const Table& table, const std::string& file) {
  POLYPOD_ASSIGN(sets, table.optional_texts("set"));
  std::vector<machine::Override> overrides;
  for (const std::string& set : sets) {
    const std::size_t equals = set.find('=');
    if (equals == std::string::npos)
      return fail("CE108", fmt::format("set \"{}\": not key=value", one_line(set)), table.place_of("set"));
    overrides.push_back({set.substr(0, equals), set.substr(equals + 1)});
  }
  if (table.has("model")) {
    if (table.has("file")) {
      return fail("CE106", "a machine has `file` and `model` at once", table.place_of("model"),
                  "`model` is the text of a machine file, `file` its name");
    }
    POLYPOD_ASSIGN(text, table.text("model"));
    Result<machine::AnyMachine> made = machine::from_text(text, "model", overrides);
    if (!made) {
      Error error = made.error();
      error.message = fmt::format("in the text of `model`, line {}: {}", error.place.line, error.message);
      error.place = table.place_of("model");
      return tl::unexpected(error);
    }
    return made;
  }
  POLYPOD_ASSIGN(model, table.text("file"));
  // A name with a suffix is a file beside the cell; others are those of the catalogue.
  const bool is_file = model.find('.') != std::string::npos || model.find('/') != std::string::npos;
  Result<machine::AnyMachine> loaded = machine::load(is_file ? config::beside(file, model) : model, overrides);
  if (!loaded) {
    Error error = loaded.error();
    if (error.place.file.empty()) error.place = table.place_of("file");
    return tl::unexpected(error);
  }
  return loaded;
}

Status Reader::machines(const std::string& file) {
  POLYPOD_ASSIGN(tables, some("machine"));
  for (const Table& table : tables) {
    Machine out;
    out.place = table.place();
    POLYPOD_TRY(fresh_name(table, out.name));
    POLYPOD_ASSIGN(name_of_file, table.optional_text("file", ""));
    out.file = name_of_file;
    POLYPOD_ASSIGN(loaded, machine_of(table, file));
    out.model = std::move(loaded);
    const int joints = kinematics::joint_count(out.model);
    const bool turns = kinematics::joint_kind(out.model, 0) == machine::JointKind::revolute;
    POLYPOD_ASSIGN(at, point(table, "at_mm"));
    std::vector<double> angles{0, 0, 0};
    if (table.has("angles_deg")) {
      POLYPOD_ASSIGN(a, table.numbers("angles_deg", 3, kAngle_deg));
      angles = a;
    }
    out.X_CM.p = at;
    out.X_CM.R = rotation_abc(units::from_deg(angles[0]), units::from_deg(angles[1]), units::from_deg(angles[2]));
    out.home = at;
    if (table.has("home_mm")) {
      POLYPOD_ASSIGN(home, point(table, "home_mm"));
      out.home = home;
    }
    const auto joint_values = [&](const std::string& key, double otherwise, Range range,
                                  bool mixed) -> Result<std::vector<double>> {
      std::vector<double> v;
      if (table.has(key)) {
        if (const auto one = table.number(key, range)) {
          v = {*one};
        } else {
          POLYPOD_ASSIGN(given, table.numbers(key, 0, range));
          v = given;
        }
        if (v.size() == 1) v.assign(static_cast<std::size_t>(joints), v[0]);
        if (static_cast<int>(v.size()) != joints) {
          return fail("CF105", fmt::format("{} has {} numbers; {} has {} joints", key, v.size(), out.name, joints),
                      table.place_of(key));
        }
      } else {
        v.assign(static_cast<std::size_t>(joints), otherwise);
        out.defaults.emplace_back(key, otherwise);
      }
      for (int j = 0; j < joints && mixed; ++j) {
        const bool angle = kinematics::joint_kind(out.model, j) == machine::JointKind::revolute;
        v[static_cast<std::size_t>(j)] =
            angle ? units::from_deg(v[static_cast<std::size_t>(j)]) : units::from_mm(v[static_cast<std::size_t>(j)]);
      }
      return v;
    };
    // Keys say deg where the first joint turns, else mm; joints of another kind count in mm or deg under the same
    // key.
    const std::string unit = turns ? "deg" : "mm";
    POLYPOD_ASSIGN(speed, joint_values("joint_speed_" + unit + "_per_s", 100, kSpeed, true));
    POLYPOD_ASSIGN(acceleration, joint_values("joint_acceleration_" + unit + "_per_s2", 500, kDerivative, true));
    out.joint_speed = speed;
    out.joint_acceleration = acceleration;
    if (table.has("home_joints_" + unit)) {
      POLYPOD_ASSIGN(home, joint_values("home_joints_" + unit, 0, {-1e6, 1e6}, true));
      out.home_joints = Eigen::Map<const Eigen::VectorXd>(home.data(), joints);
    }
    const auto number = [&](const std::string& key, double& to, double factor, Range range) -> Status {
      POLYPOD_ASSIGN(v, table.optional_number(key, to / factor, range));
      if (!table.has(key)) out.defaults.emplace_back(key, v);
      to = v * factor;
      return {};
    };
    constexpr double mm = units::kMetrePerMm;
    POLYPOD_TRY(number("tool_speed_mm_per_s", out.tool_speed, mm, kSpeed));
    POLYPOD_TRY(number("tool_acceleration_mm_per_s2", out.tool_acceleration, mm, kDerivative));
    POLYPOD_TRY(number("tool_jerk_mm_per_s3", out.tool_jerk, mm, kDerivative));
    const double drive = turns ? units::kRadPerDeg : mm;
    POLYPOD_TRY(number("drive_speed_" + unit + "_per_s", out.drive_speed, drive, kSpeed));
    POLYPOD_TRY(number("drive_acceleration_" + unit + "_per_s2", out.drive_acceleration, drive, kDerivative));
    POLYPOD_TRY(number("drive_jerk_" + unit + "_per_s3", out.drive_jerk, drive, kDerivative));
    POLYPOD_TRY(number("straight_speed_mm_per_s", out.straight_speed, mm, kSpeed));
    POLYPOD_TRY(number("lift_mm", out.lift, mm, kSize_mm));
    out.blend = std::min(out.blend, out.lift);
    POLYPOD_TRY(number("blend_mm", out.blend, mm, {0, units::to_mm(out.lift)}));
    POLYPOD_TRY(number("grip_s", out.grip, 1, kSeconds));
    POLYPOD_TRY(number("release_s", out.release, 1, kSeconds));
    POLYPOD_TRY(number("grip_failures", out.failure, 1, {0, 0.99}));
    POLYPOD_TRY(number("body_diameter_mm", out.body, mm, kMaybeSize_mm));
    POLYPOD_ASSIGN(mounted_on, table.optional_texts("mounted_on"));
    out.mounted_on = mounted_on;
    POLYPOD_ASSIGN(folds, table.optional_boolean("folds", false));
    if (folds && !kinematics::is_serial(out.model)) {
      return fail("CE106", fmt::format("{} has no first joint to turn about: only arms fold", out.name),
                  table.place_of("folds"), "leave out `folds`");
    }
    out.folds = folds;
    POLYPOD_TRY(number("payload_kg", out.payload, 1, {0, 1e6}));
    POLYPOD_TRY(number("hand_mass_g", out.hand_mass, 1e-3, {0, 1e9}));
    if (table.has("stopping_ms")) {
      POLYPOD_ASSIGN(stopping, optional_ms(table, "stopping_ms", 0));
      out.stopping = stopping;
    }
    POLYPOD_TRY(table.finish());
    cell_.machines.push_back(std::move(out));
  }
  return {};
}

Status Reader::tasks() {
  POLYPOD_ASSIGN(tables, some("task"));
  for (const Table& table : tables) {
    Task out;
    out.place = table.place();
    POLYPOD_TRY(fresh_name(table, out.name));
    POLYPOD_ASSIGN(machine, index_of(cell_.machines, table, "machine", "machine"));
    POLYPOD_ASSIGN(from, table.text("from"));
    out.machine = machine;
    for (std::size_t c = 0; c < cell_.conveyors.size(); ++c)
      if (cell_.conveyors[c].name == from) out.from_conveyor = static_cast<int>(c);
    if (out.from_conveyor < 0) {
      POLYPOD_ASSIGN(spot, index_of(cell_.spots, table, "from", "conveyor or spot"));
      out.from = spot;
    }
    POLYPOD_ASSIGN(to, index_of(cell_.spots, table, "to", "spot"));
    out.to = to;
    const auto kind = [&](int spot) { return cell_.spots[static_cast<std::size_t>(spot)].kind; };
    if (out.from >= 0 && kind(out.from) == Spot::Kind::pour)
      return fail("CE106", "nothing stands where containers are emptied", table.place_of("from"),
                  "take from a pallet, a holder or an opening");
    if (kind(to) == Spot::Kind::pour)
      return fail("CE106", "a container cannot be left where it is emptied", table.place_of("to"),
                  "name the spot in `via`");
    if (table.has("via")) {
      POLYPOD_ASSIGN(via, index_of(cell_.spots, table, "via", "spot"));
      if (kind(via) != Spot::Kind::pour)
        return fail(
            "CE106",
            fmt::format("via {}: containers are not emptied there", cell_.spots[static_cast<std::size_t>(via)].name),
            table.place_of("via"), "name a spot of kind pour");
      out.via = via;
    }
    POLYPOD_ASSIGN(which, table.optional_text("which", "any"));
    if (which == "full")
      out.which = Task::Which::full;
    else if (which == "empty")
      out.which = Task::Which::empty;
    else if (which != "any")
      return fail("CE102", fmt::format("which \"{}\" is not known", one_line(which)), table.place_of("which"),
                  "any, full or empty");
    POLYPOD_ASSIGN(when, table.optional_texts("when"));
    if (!when.empty()) {
      out.working = out.ending = false;
      for (const std::string& state : when) {
        if (state == "work")
          out.working = true;
        else if (state == "end")
          out.ending = true;
        else
          return fail("CE102", fmt::format("when \"{}\" is not known", one_line(state)), table.place_of("when"),
                      "work or end");
      }
    }
    POLYPOD_ASSIGN(serve, table.optional_boolean("on_serve", false));
    POLYPOD_ASSIGN(keeps, table.optional_boolean("keeps_zone", false));
    POLYPOD_ASSIGN(step, table.optional_integer("step", 0, 0, 1000));
    out.on_serve = serve;
    out.keeps_zone = keeps;
    out.step = step;
    if (out.from_conveyor >= 0) {
      POLYPOD_TRY(needs_item(table));
      const Conveyor& c = cell_.conveyors[static_cast<std::size_t>(out.from_conveyor)];
      if (c.outfeed) {
        return fail("CE107",
                    fmt::format("task {} takes items from conveyor {}, whose items leave the cell as they should: none "
                                "could be missed",
                                out.name, c.name),
                    table.place_of("from"), "let what is not taken go onto another conveyor, which is the outfeed");
      }
      POLYPOD_ASSIGN(window, span(table, "window_mm", units::kMetrePerMm, kMaybeSize_mm));
      POLYPOD_TRY(ordered(table, "window_mm", window[0], window[1]));
      if (!(window[1] - window[0] > 1e-6) || window[1] > c.length) {
        return fail("CE105",
                    fmt::format("the window of task {} is not on conveyor {}, 0 to {:g} mm", out.name, c.name,
                                units::to_mm(c.length)),
                    table.place_of("window_mm"));
      }
      for (const Camera& camera : cell_.cameras) {
        if (camera.conveyor != out.from_conveyor || camera.at - camera.field_along / 2 < window[1]) continue;
        return fail(
            "CE105",
            fmt::format("{} looks beyond the window of task {}: no item is known in time", camera.name, out.name),
            table.place_of("window_mm"), "belts run forward: the camera comes first");
      }
      if (c.sensor >= 0 && c.sensor > window[1]) {
        return fail("CE105",
                    fmt::format("the sensor of conveyor {} at {:g} mm is beyond the window: the belt would stand "
                                "with an item out of reach",
                                c.name, units::to_mm(c.sensor)),
                    table.place_of("window_mm"), "the sensor stands within the window");
      }
      POLYPOD_ASSIGN(release, optional_length(table, "release_mm",
                                              cell_.spots[static_cast<std::size_t>(to)].slots[0].z(), kPlace_mm));
      out.release = release;
      out.window_low = window[0];
      out.window_high = window[1];
      if (cell_.containers[0].diameter < cell_.items[0].diameter) {
        return fail("CE103",
                    fmt::format("{} of {:g} mm does not fit into {} of {:g} mm", cell_.items[0].name,
                                units::to_mm(cell_.items[0].diameter), cell_.containers[0].name,
                                units::to_mm(cell_.containers[0].diameter)),
                    table.place());
      }
    } else if (out.from == out.to && out.via < 0) {
      return fail("CE106",
                  fmt::format("task {} moves containers from {} to itself", out.name,
                              cell_.spots[static_cast<std::size_t>(to)].name),
                  table.place_of("to"));
    }
    POLYPOD_TRY(table.finish());
    cell_.tasks.push_back(out);
  }
  return {};
}

Status Reader::commands() {
  POLYPOD_ASSIGN(tables, some("command"));
  for (const Table& table : tables) {
    Command out;
    POLYPOD_ASSIGN(time, table.number("at_s", kSeconds));
    POLYPOD_ASSIGN(order, table.text("order"));
    out.time = time;
    if (order == "START")
      out.order = Order::start;
    else if (order == "STOP")
      out.order = Order::stop;
    else if (order == "SERVE")
      out.order = Order::serve;
    else if (order == "END")
      out.order = Order::end;
    else
      return fail("CE102", fmt::format("order \"{}\" is not known", one_line(order)), table.place_of("order"),
                  "START, STOP, SERVE or END");
    if (!cell_.commands.empty() && cell_.commands.back().time > time)
      return fail("CE105", "commands must stand in the order of their times", table.place_of("at_s"));
    POLYPOD_TRY(table.finish());
    cell_.commands.push_back(out);
  }
  return {};
}

}  // namespace polypod::cell
