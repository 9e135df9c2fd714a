// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// What `dexterity`, `errors` and `tolerances` share: where to look, statistics as JSON and text.
#pragma once

#include "polypod/quality/survey.hpp"
#include "workspace_options.hpp"

namespace polypod::app {

struct SurveyArguments {
  std::string pose, box;
  int resolution = 24;
  WorkspaceOptions workspace;

  void declare(Arguments& arguments);
  /// The same without --pose.
  void declare_region(Arguments& arguments);
  /// Errors: AP107 where --pose is given beside an option that says where or how far to look.
  [[nodiscard]] Status refuse_at_pose(const Context& context) const;
  [[nodiscard]] Result<quality::SurveyOptions> options(const machine::AnyMachine& m, const Context& context) const;
};

/// {min, mean, max, stddev, min_at_mm, max_at_mm}; a number that is not finite is null. `scale` makes the unit. Of a
/// task without x, y, z min_at and max_at, its coordinates in mm and deg.
Json statistics_json(const quality::Survey& survey, const quality::Statistics& s, double scale = 1);
/// How large what was surveyed is, mm^3 or in the coordinates of a task without x, y, z; bounds are no numbers where
/// points were counted and nothing is proven.
Region size_of(const quality::Survey& survey);
/// volume_mm3 and its bounds; of a task without x, y, z the measure of its region as `workspace` gives it.
Json size_json(const quality::Survey& survey);
/// The same of one value.
Json constant_json(double value);
/// A number, or null where it is not finite.
Json number_json(double value);
/// "KEY=value" as key and number. Errors: AP160.
Result<std::vector<std::pair<std::string, double>>> keyed_numbers(const std::vector<std::string>& texts,
                                                                  const char* option);

/// The elements of --error or --tolerance, whichever was given. Errors: AP160, AP163, and those of quality::sized.
Result<std::vector<quality::Sized>> sizes_argument(const machine::AnyMachine& m, const std::vector<std::string>& errors,
                                                   const std::vector<std::string>& tolerances);
/// "box" or "sphere". Error: AP164.
Result<quality::Region> region_argument(const std::string& text);

/// What JSON calls a least or largest value: "seen", the least or largest of the poses that were looked at, or "bound",
/// proven not to be passed.
inline constexpr const char* kSeen = "seen";
inline constexpr const char* kBound = "bound";
/// {points, beyond}.
Json beyond_json(const workspace::BeyondSingular& beyond);
/// A note: how many of what was looked at ("points drawn from it") lie beyond singular poses, which figures include
/// them ("The volume includes"), and the key of a limit that leaves them out; empty where none do.
std::string beyond_text(const machine::AnyMachine& m, const workspace::BeyondSingular& beyond, const char* looked_at,
                        const char* include);
/// The statistics of several rows as a table; each row with the unit behind it, in figures of its own scale.
struct StatisticsRow {
  std::string name;
  quality::Statistics of;
  double scale = 1;
  int decimals = 4;
  std::string unit;
};
/// Whether the largest of these is more than a hundred times the mean, as beside a singular pose: other points see
/// other values, and only its size says something.
bool beside_singular(const quality::Statistics& s);
void print_statistics(const quality::Survey& survey, const std::vector<StatisticsRow>& rows);
/// How much of a given box the survey reached, and what of it lies beyond singular poses; nothing of what is as asked.
void print_where(const machine::AnyMachine& m, const quality::Survey& survey);
/// The coordinates of a point of a workspace, in mm and deg.
Json point_json(const machine::Task& task, const Vec3& p);
/// Three coordinates in mm; of a task without x, y, z each with its name and unit.
std::string place_text(const Vec3& p, const machine::Task& task = machine::Task::pose);

/// The pose and its joints, or the reason why it has none.
struct PoseJoints {
  Pose X_MT;
  machine::JointVector joints;
  bool reachable = false;
  std::string reason;
};
Result<PoseJoints> pose_joints(const machine::AnyMachine& m, const std::string& text);

/// What a command says first of a pose that is singular or close to it (quality::singularity, threshold
/// kSingularThreshold): `singular` in the document, or a line of text. Where the drives do not hold the tool
/// (type 2, below kRankLost) its `figures` have no meaning: they are null, and the exit status "no" comes back.
std::optional<int> said_of_singular_pose(const machine::AnyMachine& m, const PoseJoints& here, const Context& context,
                                         Json& document, const std::vector<std::string>& figures);

}  // namespace polypod::app
