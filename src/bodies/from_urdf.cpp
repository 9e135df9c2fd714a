// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/bodies/from_urdf.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>

#include "../machine/machine_file.hpp"
#include "polypod/bodies/shape.hpp"
#include "polypod/core/text.hpp"
#include "polypod/core/toml.hpp"
#include "polypod/core/units.hpp"
#include "polypod/machine/urdf.hpp"
#include "urdf_bodies.hpp"

namespace polypod::bodies {
namespace {

namespace fs = std::filesystem;
using machine::number_toml;

/// Without what rounding leaves of zeros.
std::string origin_toml(const Pose& X) {
  constexpr double kGrains = 1e9;  // in a millimetre or degree
  const auto tidy = [](double x) { return number_toml(std::round(x * kGrains) / kGrains + 0.0); };
  const Vec3 abc = angles_abc(X.R);
  return fmt::format("origin = {{ x_mm = {}, y_mm = {}, z_mm = {}, a_deg = {}, b_deg = {}, c_deg = {} }}\n",
                     tidy(units::to_mm(X.p.x())), tidy(units::to_mm(X.p.y())), tidy(units::to_mm(X.p.z())),
                     tidy(units::to_deg(abc.x())), tidy(units::to_deg(abc.y())), tidy(units::to_deg(abc.z())));
}

std::string mm_toml(const Vec3& v) {
  return fmt::format("[{}, {}, {}]", number_toml(units::to_mm(v.x())), number_toml(units::to_mm(v.y())),
                     number_toml(units::to_mm(v.z())));
}

/// Where the file of a mesh is; nothing if it is not there.
std::optional<fs::path> found(const std::string& written, const fs::path& urdf) {
  constexpr std::string_view kPackage = "package://", kFile = "file://";
  std::error_code ec;
  const auto there = [&](const fs::path& p) { return fs::is_regular_file(p, ec); };
  const fs::path folder = fs::absolute(urdf, ec).parent_path();
  if (!written.starts_with(kPackage)) {
    const fs::path p(written.starts_with(kFile) ? written.substr(kFile.size()) : written);
    const fs::path whole = p.is_absolute() ? p : folder / p;
    return there(whole) ? std::optional(whole) : std::nullopt;
  }
  const std::string rest = written.substr(kPackage.size());
  const std::size_t slash = rest.find('/');
  if (slash == std::string::npos) return std::nullopt;
  const std::string package = rest.substr(0, slash), path = rest.substr(slash + 1);
  for (fs::path at = folder;; at = at.parent_path()) {
    if (there(at / package / path)) return at / package / path;
    if (at.filename() == package && there(at / path)) return at / path;
    if (at == at.parent_path()) return std::nullopt;
  }
}

/// The unit of a mesh of this scale; empty where it is none.
std::string unit_of(const Vec3& scale) {
  constexpr double kSame = 1e-9;
  const auto is = [&](double unit) { return (scale.array() / unit - 1).abs().maxCoeff() < kSame; };
  return is(1) ? "m" : is(units::from_mm(1)) ? "mm" : is(units::from_inch(1)) ? "inch" : "";
}

/// The keys of a mesh, or why it is left out.
Result<std::string> mesh_keys(const UrdfBody& body, const std::string& urdf, const fs::path& output) {
  const auto left_out = [](const std::string& why) { return fail("BO120", why); };
  const auto file = found(body.file, urdf);
  if (!file) return left_out(fmt::format("{} is not there", one_line(body.file)));
  std::string ending = file->extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (ending != ".stl") {
    return left_out(
        fmt::format("{} is no STL file: convert it, and name the STL file in the URDF file", one_line(body.file)));
  }
  const std::string unit = unit_of(body.scale);
  if (unit.empty()) {
    return left_out(fmt::format("{} has the scale {:g} {:g} {:g}, which is none of m, mm and inch", one_line(body.file),
                                body.scale.x(), body.scale.y(), body.scale.z()));
  }
  if (const auto mesh = read_stl(file->string(), 1); !mesh) return left_out(mesh.error().message);
  std::error_code ec;
  const fs::path beside = fs::relative(*file, fs::absolute(output, ec).parent_path(), ec);
  return fmt::format("shape = \"mesh\"\nfile = {}\nunit = \"{}\"\n",
                     quoted_toml(ec || beside.empty() ? file->string() : beside.string()), unit);
}

Result<std::string> shape_keys(const UrdfBody& body, const std::string& urdf, const fs::path& output) {
  const Vec3& s = body.size;
  switch (body.shape) {
    case UrdfBody::Shape::box:
      return fmt::format("shape = \"box\"\nmin_mm = {}\nmax_mm = {}\n", mm_toml(-0.5 * s), mm_toml(0.5 * s));
    case UrdfBody::Shape::cylinder: {
      const double half = 0.5 * s.y();
      return fmt::format("shape = \"cylinder\"\nfrom_mm = {}\nto_mm = {}\ndiameter_mm = {}\n", mm_toml({0, 0, -half}),
                         mm_toml({0, 0, half}), number_toml(units::to_mm(2 * s.x())));
    }
    case UrdfBody::Shape::sphere:
      return fmt::format("shape = \"sphere\"\ncenter_mm = [0, 0, 0]\ndiameter_mm = {}\n",
                         number_toml(units::to_mm(2 * s.x())));
    case UrdfBody::Shape::mesh:
      break;
  }
  return mesh_keys(body, urdf, output);
}

}  // namespace

Result<BodiesFile> file_from_urdf(std::string_view text, const std::string& name, const std::string& output) {
  POLYPOD_ASSIGN(all, bodies_from_urdf(text, name));
  const std::string urdf = machine::urdf_name(name).file;
  BodiesFile out;
  out.text = fmt::format("# The bodies of the links of {}, by polypod info --bodies.\n",
                         one_line(fs::path(urdf).filename().string()));
  std::map<std::string, int> named;
  for (const UrdfBody& body : all) {
    const std::string link = one_line(body.link);
    Result<std::string> keys = shape_keys(body, urdf, output);
    if (!keys) {
      out.notes.push_back(fmt::format("link {}: a body is left out: {}", link, keys.error().message));
      continue;
    }
    const int number = ++named[link];
    out.text += fmt::format("\n[[body]]\nname = {}\nframe = \"link\"\nlink = {}\n{}{}",
                            quoted_toml(number == 1 ? link : fmt::format("{} {}", link, number)), body.row,
                            origin_toml(body.X), *keys);
    if (body.visual)
      out.notes.push_back(fmt::format("link {}: its visual body, since it has none for collisions", link));
    ++out.count;
  }
  if (out.count == 0) {
    return fail("BO120",
                all.empty() ? "the links of the chain have no bodies"
                            : fmt::format("no body can be written: {}", fmt::join(out.notes, "; ")),
                Place{urdf}, "add <collision> to the links, or write the file of bodies by hand (docs/bodies.md)");
  }
  return out;
}

}  // namespace polypod::bodies
