// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/end_force.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "lanes.hpp"

namespace polypod::cutting {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kSectors = EndFootprint::kSectors;
constexpr double kSector = 2 * kPi / kSectors;
/// Heights are floats; what a move goes down by less than this is lost in their rounding, m.
constexpr double kLeastDown = 1e-7;
/// A sum of floats over a sector is known to this much, m.
constexpr float kLeastLength = 1e-8F;

double middle_of(int sector) {
  return (sector + 0.5) * kSector;
}

/// Sine and cosine of the middles of the sectors.
struct Directions {
  std::array<double, kSectors> sine{}, cosine{};
  Directions() {
    for (std::size_t j = 0; j < kSectors; ++j) {
      sine[j] = std::sin(middle_of(static_cast<int>(j)));
      cosine[j] = std::cos(middle_of(static_cast<int>(j)));
    }
  }
};

static_assert(Stock::kLayers == 8);  // two Quads

/// The layer of the stock between two heights, looked into along rays.
class LayerView {
 public:
  LayerView(const Stock& stock, double top, double down)
      : stock_(stock),
        inverse_cell_(1 / stock.cell()),
        low_(static_cast<float>(std::max(top - down, stock.bottom()))),
        most_(static_cast<float>(top) - low_),
        per_depth_(static_cast<float>(1 / (Stock::kLayers * down))),
        most_due_(std::min(most_, std::max(stock.due().level - low_, 0.0f))),
        looks_for_due_(stock.due().any && most_due_ < most_) {}

  /// The sum of the shares of the layer that are material at `count` places, the first at p, `step` apart.
  [[nodiscard]] float along(const Eigen::Vector2d& p, const Eigen::Vector2d& step, int count) const {
    const Quad low = all(low_), zero{}, most_of_all = all(most_), most_of_due = all(most_due_);
    Quad total{};
    double column = (p.x() - stock_.x_min()) * inverse_cell_, row = (p.y() - stock_.y_min()) * inverse_cell_;
    const double per_column = step.x() * inverse_cell_, per_row = step.y() * inverse_cell_;
    const double columns = stock_.columns(), rows = stock_.rows();
    for (int k = 0; k < count; ++k, column += per_column, row += per_row) {
      if (!(column >= 0 && row >= 0 && column < columns && row < rows)) continue;
      const int i = static_cast<int>(column), j = static_cast<int>(row);
      const float* heights = stock_.cell_layers(i, j);
      const Quad most = looks_for_due_ && is_due(i, j) ? most_of_due : most_of_all;
      for (const int half : {0, 4}) total += smaller(larger(load(heights + half) - low, zero), most);
    }
    return sum(total) * per_depth_;
  }

 private:
  /// Whether a cell is as low as what is due of the stock, though it stands yet.
  [[nodiscard]] bool is_due(int column, int row) const {
    const Stock::Due& due = stock_.due();
    const double x = stock_.x_min() + (column + 0.5) * stock_.cell() - due.x;
    const double y = stock_.y_min() + (row + 0.5) * stock_.cell() - due.y;
    return x * x + y * y <= due.inner2;
  }

  const Stock& stock_;
  double inverse_cell_;
  float low_, most_, per_depth_, most_due_;
  bool looks_for_due_;
};

}  // namespace

EndCoefficients end_as_sides(const Material& material) {
  constexpr double kUsualChip = 0.05e-3;  // m
  const double k = material.ktc * std::pow(kUsualChip, material.exponent - 1);
  return {k, 0, k, 0, 0, 0};
}

double EndFootprint::mean_length() const {
  double sum = 0;
  for (const float l : length) sum += l;
  return sum / kSectors;
}

void look_down(const Stock& stock, const Vec3& tip, double radius, const Eigen::Vector2d& feed, double down,
               EndFootprint& footprint, double inner) {
  footprint = {};
  if (!tip.allFinite() || !(radius > inner) || !(down > 0) || !(feed.squaredNorm() > 0.5)) return;
  if (!(stock.top() > tip.z() - down) || !(tip.z() > stock.bottom())) return;
  const LayerView layer(stock, tip.z(), std::max(down, kLeastDown));
  const int steps = std::max(1, static_cast<int>(std::ceil((radius - inner) / stock.cell())));
  const double step = (radius - inner) / steps;
  static const Directions direction;
  for (std::size_t j = 0; j < kSectors; ++j) {
    // phi runs from the left of the feed over the front.
    const double forward = direction.sine[j], left = direction.cosine[j];
    const Eigen::Vector2d ray(feed.x() * forward - feed.y() * left, feed.y() * forward + feed.x() * left);
    const float sum = layer.along(tip.head<2>() + (inner + 0.5 * step) * ray, step * ray, steps);
    footprint.length[j] = sum * static_cast<float>(step);
    footprint.any = footprint.any || sum > 0;
  }
  if (stock.hollow() == nullptr || !footprint.any) return;
  EndFootprint hollow;
  look_down(*stock.hollow(), tip, radius, feed, down, hollow, inner);
  footprint.any = false;
  for (std::size_t j = 0; j < kSectors; ++j) {
    const float length = footprint.length[j] - hollow.length[j];
    footprint.length[j] = length > kLeastLength ? length : 0;
    footprint.any = footprint.any || length > kLeastLength;
  }
}

EndForce::EndForce(const Cutter& cutter, const EndCoefficients& c) {
  // Integrals of cos, sin and 1 over a sector.
  const double chord = 2 * std::sin(kSector / 2), per_turn = cutter.teeth / (2 * kPi);
  const auto resolved = [&](double phi, double kt, double kr, double ka) {
    const double cosine = chord * std::cos(phi), sine = chord * std::sin(phi);
    return Vec3(per_turn * Vec3(-kt * cosine - kr * sine, kt * sine - kr * cosine, ka * kSector));
  };
  for (int j = 0; j < kSectors; ++j) {
    edge_[static_cast<std::size_t>(j)] = resolved(middle_of(j), c.kte, c.kre, c.kae);
    cut_[static_cast<std::size_t>(j)] = resolved(middle_of(j), c.ktc, c.krc, c.kac);
  }
}

Vec3 EndForce::mean_force(const EndFootprint& footprint, double axial_feed_per_tooth, Spindle spindle) const {
  if (!footprint.any || !(axial_feed_per_tooth > 0)) return Vec3::Zero();
  const bool mirrored = spindle == Spindle::counterclockwise;
  Vec3 edge = Vec3::Zero(), cut = Vec3::Zero();
  for (int j = 0; j < kSectors; ++j) {
    // phi becomes pi - phi, which is sector kSectors / 2 - 1 - j of a turn.
    const int from = mirrored ? (kSectors + kSectors / 2 - 1 - j) % kSectors : j;
    const double length = footprint.length[static_cast<std::size_t>(from)];
    edge += length * edge_[static_cast<std::size_t>(j)];
    cut += length * cut_[static_cast<std::size_t>(j)];
  }
  Vec3 force = edge + axial_feed_per_tooth * cut;
  if (mirrored) force.y() = -force.y();
  return force;
}

double side_model_slope(const Cutter& cutter, const Material& material, double depth, double feed_per_tooth,
                        double share) {
  const double side =
      mean_force(cutter, material, straight_engagement(cutter, CutSide::slot, cutter.diameter, depth), feed_per_tooth)
          .norm();
  // The thrust of the whole disc, N_z R (K_ae + K_ac h) with h = s_z sin(alpha); the sides lose little by the cosine.
  EndCoefficients end;
  if (material.end) {
    end = *material.end;
  } else {
    end.kac = material.exponent == 1 || !(feed_per_tooth > 0)
                  ? material.ktc
                  : material.ktc * std::pow(feed_per_tooth, material.exponent - 1);
  }
  const double per_chip = cutter.teeth * cutter.radius() * std::abs(end.kac) * feed_per_tooth;
  const double left = share * side - cutter.teeth * cutter.radius() * std::abs(end.kae);
  if (!(left > 0)) return 0;
  return left >= per_chip ? kPi / 2 : std::asin(left / per_chip);
}

}  // namespace polypod::cutting
