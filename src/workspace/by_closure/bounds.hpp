// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The limits over boxes of any machine, from its closure and its limits alone.
#pragma once

#include <memory>
#include <optional>

#include "../linear.hpp"
#include "polypod/workspace/shape.hpp"
#include "questions.hpp"

namespace polypod::workspace {
namespace by_closure {
class Judge;
}

/// The default of every family. The unknowns u of a pose are the coordinates that follow and the joints, F(v, u) = 0
/// for the prescribed ones v. Over a box of v and a piece of u both F and the limits are taken in first order with a
/// bound on the rest, F = c + A v + B du + [-e, e]. With an inverse Y of B at the middle every solution in the piece
/// has
///   du = -Y c - Y A v + [-r, r],  r = |1 - Y B| |du| + |Y| e
/// and there is one for each v where that lies within the piece for all v (Brouwer). A limit on the solutions is
/// g - l . F for any l, and l is taken so that the unknowns fall out of its first order. So that nothing is left out,
/// the pieces together hold all unknowns that the joints' ranges and the angles allow, but for those where some
/// equation has no zero or some limit is broken for all v. They are halved where that helps, and pass from a box to its
/// octants.
class ClosureLimits {
 public:
  struct Data {};

  /// Empty where nothing is proven: a joint without limits that slides, a tool tip without end, or other than as many
  /// equations as unknowns. Errors: WS104, WS106, as for machines of legs.
  static Result<std::optional<ClosureLimits>> of(std::shared_ptr<const by_closure::Questions> questions,
                                                 const Options& options);

  [[nodiscard]] static int groups() { return 1; }
  [[nodiscard]] double lever() const;
  [[nodiscard]] static std::size_t bytes(const Data&) { return 0; }
  [[nodiscard]] static Data prepare(const Patch&) { return {}; }
  [[nodiscard]] static LimitBits ends() { return 0; }  // the box is found with the limits that are heeded
  void box(Vec3& low, Vec3& high, const Directions&) const;
  Verdict judge(int group, const Vec3& center, const Vec3& half, double radius, const Patch& patch, const Data&,
                BoundList& out) const;

 private:
  explicit ClosureLimits(std::shared_ptr<const by_closure::Judge> judge) : judge_(std::move(judge)) {}
  std::shared_ptr<const by_closure::Judge> judge_;
};

extern template Result<Volume> subdivided_volume(const ClosureLimits&, const Options&, bool);
extern template Result<bool> subdivided_holds(const ClosureLimits&, const Options&, const Shape&, std::int64_t);

}  // namespace polypod::workspace
