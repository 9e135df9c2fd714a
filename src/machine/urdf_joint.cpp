// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "urdf_joint.hpp"

#include <console_bridge/console.h>
#include <fmt/format.h>
#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <exception>
#include <map>
#include <mutex>

#include "polypod/core/text.hpp"

namespace polypod::machine {
namespace {

/// Keeps what urdfdom says while it lives, in place of the standard error.
class Messages : public console_bridge::OutputHandler {
 public:
  Messages() : before_(console_bridge::getOutputHandler()) { console_bridge::useOutputHandler(this); }
  ~Messages() override { console_bridge::useOutputHandler(before_); }
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;
  void log(const std::string& text, console_bridge::LogLevel level, const char*, int) override {
    if (level < console_bridge::CONSOLE_BRIDGE_LOG_ERROR || !first_.empty()) return;
    first_ = one_line(text);
  }
  [[nodiscard]] const std::string& first() const { return first_; }

 private:
  console_bridge::OutputHandler* before_;
  std::string first_;
};

bool is_plain(const std::string& value) {
  return std::all_of(value.begin(), value.end(), [](char c) {
    return c >= ' ' && c <= '~' && c != '<' && c != '>' && c != '&' && c != '"' && c != '\'';
  });
}

Vec3 vector_of(const urdf::Vector3& v) {
  return {v.x, v.y, v.z};
}

}  // namespace

Result<UrdfJoint> joint_by_urdfdom(const std::string& type, const std::vector<UrdfValue>& values, const Place& place,
                                   const std::string& name) {
  std::map<std::string, std::string> elements;
  for (const UrdfValue& v : values) {
    if (!is_plain(v.value)) {
      return fail("MA189",
                  fmt::format("joint {}: {}=\"{}\" of <{}> holds characters that no number has", name, v.attribute,
                              one_line(v.value), v.element),
                  place);
    }
    elements[v.element] += fmt::format(" {}=\"{}\"", v.attribute, v.value);
  }
  std::string text = fmt::format(
      R"(<robot name="r"><link name="a"/><link name="b"/><joint name="joint" type="{}"><parent link="a"/><child link="b"/>)",
      type);
  for (const auto& [element, attributes] : elements) text += fmt::format("<{}{}/>", element, attributes);
  text += "</joint></robot>";

  static std::mutex one_at_a_time;
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  const Messages messages;
  urdf::ModelInterfaceSharedPtr model;
  std::string why;
  try {
    model = urdf::parseURDF(text);
  } catch (const std::exception& e) {
    why = one_line(e.what());
  }
  if (!model || model->joints_.size() != 1) {
    if (why.empty()) why = messages.first();
    return fail("MA189", fmt::format("joint {}: {}", name, why.empty() ? "urdfdom does not read it" : why), place,
                "the format: http://wiki.ros.org/urdf/XML/joint");
  }
  const urdf::Joint& joint = *model->joints_.begin()->second;
  UrdfJoint out;
  out.origin = vector_of(joint.parent_to_joint_origin_transform.position);
  out.axis = vector_of(joint.axis);
  if (joint.limits) {
    out.lower = joint.limits->lower;
    out.upper = joint.limits->upper;
    out.velocity = joint.limits->velocity;
  }
  return out;
}

}  // namespace polypod::machine
