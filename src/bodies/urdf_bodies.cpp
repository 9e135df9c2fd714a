// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "urdf_bodies.hpp"

#include <fmt/format.h>

#include "../machine/urdf_chain.hpp"
#include "polypod/families/serial/frames.hpp"
#include "polypod/families/serial/kinematics.hpp"

namespace polypod::bodies {
namespace {

namespace urdf = machine::urdf;

using xml::Element;
using xml::shown;

/// The bodies of links among the elements of a file.
class BodyReader {
 public:
  BodyReader(const std::vector<Element>& elements, std::string file) : elements_(elements), file_(std::move(file)) {}

  /// Of a link by its name: the frames are in that of the link.
  Status read(const std::string& link, std::vector<UrdfBody>& out) const {
    const std::optional<int> at = element_of(link);
    if (!at) return {};
    for (const char* part : {"collision", "visual"}) {
      const std::size_t before = out.size();
      for (const int child : below(*at, part)) {
        UrdfBody body;
        body.link = link;
        body.visual = std::string_view(part) == "visual";
        POLYPOD_TRY(read_one(child, body));
        out.push_back(std::move(body));
      }
      if (out.size() > before) break;
    }
    return {};
  }

 private:
  [[nodiscard]] const Element& element(int i) const { return elements_[static_cast<std::size_t>(i)]; }
  [[nodiscard]] Place place_of(const Element& e) const { return {file_, e.line, e.column}; }
  [[nodiscard]] std::optional<int> element_of(const std::string& link) const {
    for (std::size_t i = 0; i < elements_.size(); ++i) {
      const Element& e = elements_[i];
      if (e.depth != 2 || e.name != "link") continue;
      const xml::Attribute* name = e.attribute("name");
      if (name != nullptr && name->value == link) return static_cast<int>(i);
    }
    return std::nullopt;
  }
  /// The elements of this name directly below one.
  [[nodiscard]] std::vector<int> below(int parent, std::string_view name) const {
    std::vector<int> out;
    const int depth = element(parent).depth;
    for (auto i = static_cast<std::size_t>(parent) + 1; i < elements_.size() && elements_[i].depth > depth; ++i) {
      if (elements_[i].parent == parent && (name.empty() || elements_[i].name == name))
        out.push_back(static_cast<int>(i));
    }
    return out;
  }

  [[nodiscard]] tl::unexpected<Error> bad(const Element& e, const std::string& what) const {
    return fail("MA192", what, place_of(e), "a body is a box, a cylinder, a sphere or a mesh, in m and rad");
  }

  /// Three numbers of an attribute; zeros where it is not there.
  Result<std::array<urdf::Angle, 3>> three(const Element& e, std::string_view key) const {
    const xml::Attribute* a = e.attribute(key);
    if (a == nullptr) return std::array<urdf::Angle, 3>{};
    const auto found = urdf::three_angles(a->value);
    if (!found) return bad(e, fmt::format("{}=\"{}\" is not three numbers", key, shown(a->value)));
    return *found;
  }
  Result<double> size_of(const Element& e, std::string_view key) const {
    const xml::Attribute* a = e.attribute(key);
    const std::optional<urdf::Angle> found = a == nullptr ? std::nullopt : urdf::angle_of(a->value);
    if (!found || !(found->written > 0 && found->written <= urdf::kLongest))
      return bad(e, fmt::format("<{}> without its {}", e.name, key));
    return found->written;
  }

  Status read_one(int at, UrdfBody& body) const {
    for (const int origin : below(at, "origin")) {
      POLYPOD_ASSIGN(xyz, three(element(origin), "xyz"));
      POLYPOD_ASSIGN(rpy, three(element(origin), "rpy"));
      body.X = {rotation_abc(rpy[0].value, rpy[1].value, rpy[2].value),
                Vec3(xyz[0].written, xyz[1].written, xyz[2].written)};
    }
    const std::vector<int> geometry = below(at, "geometry");
    const std::vector<int> shapes = geometry.size() == 1 ? below(geometry.front(), "") : std::vector<int>{};
    if (shapes.size() != 1) {
      return bad(element(at), fmt::format("the body of link {} has not one geometry with one shape", shown(body.link)));
    }
    const Element& shape = element(shapes.front());
    if (shape.name == "box") {
      POLYPOD_ASSIGN(size, three(shape, "size"));
      body.size = {size[0].written, size[1].written, size[2].written};
      if (!(body.size.minCoeff() > 0)) return bad(shape, "a box without edges");
      body.shape = UrdfBody::Shape::box;
    } else if (shape.name == "cylinder" || shape.name == "sphere") {
      POLYPOD_ASSIGN(radius, size_of(shape, "radius"));
      body.size.x() = radius;
      body.shape = UrdfBody::Shape::sphere;
      if (shape.name == "sphere") return {};
      POLYPOD_ASSIGN(length, size_of(shape, "length"));
      body.size.y() = length;
      body.shape = UrdfBody::Shape::cylinder;
    } else if (shape.name == "mesh") {
      const xml::Attribute* file = shape.attribute("filename");
      if (file == nullptr || file->value.empty()) return bad(shape, "a mesh without its filename");
      body.file = std::string(file->value);
      if (shape.attribute("scale") != nullptr) {
        POLYPOD_ASSIGN(scale, three(shape, "scale"));
        body.scale = {scale[0].written, scale[1].written, scale[2].written};
      }
      body.shape = UrdfBody::Shape::mesh;
    } else {
      return bad(shape, fmt::format("<{}> is no shape of a body", shown(shape.name)));
    }
    return {};
  }

  const std::vector<Element>& elements_;
  std::string file_;
};

}  // namespace

Result<std::vector<UrdfBody>> bodies_from_urdf(std::string_view text, const std::string& name) {
  const machine::UrdfName parts = machine::urdf_name(name);
  POLYPOD_ASSIGN(opened, urdf::open(text, parts));
  urdf::ChainReader reader(*opened->tree, opened->base, opened->tip);
  POLYPOD_ASSIGN(arm, reader.read());
  POLYPOD_ASSIGN(links, reader.links());
  constexpr int kDepth = 5;  // robot, link, collision, geometry, box
  POLYPOD_ASSIGN(elements, xml::scan(text, parts.file, {.depth = kDepth}));
  const BodyReader bodies(elements, parts.file);
  // The row after which a link moves is that of its last joint.
  std::vector<int> row_of{0};
  for (std::size_t row = 0; row < arm.dh.size(); ++row)
    if (!arm.dh[row].locked || arm.dh[row].coupled_back > 0) row_of.push_back(static_cast<int>(row) + 1);
  for (machine::DhRow& row : arm.dh)
    if (row.coupled_back > 0) row.locked = 0;  // a joint that follows another stands at 0 as all do
  const std::vector<Pose> frames = machine::frames_of_table(arm, machine::JointVector::Zero(arm.free_joints()));
  std::vector<UrdfBody> out;
  for (const urdf::ChainReader::Stand& stand : links) {
    const int row = row_of[static_cast<std::size_t>(stand.joints)];
    const Pose X_RL = frames[static_cast<std::size_t>(row)].inverse() * stand.X;
    const std::size_t before = out.size();
    POLYPOD_TRY(bodies.read(opened->tree->links()[static_cast<std::size_t>(stand.link)].name, out));
    for (std::size_t i = before; i < out.size(); ++i) {
      out[i].row = row;
      out[i].X = X_RL * out[i].X;
    }
  }
  return out;
}

}  // namespace polypod::bodies
