// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include "polypod/cutting/ball_stock.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

namespace polypod::cutting {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kNothing = 1e-8;  // m: heights are kept in single precision
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kCrosses = 0.6;  // of the height of a part of a ring: half of it and a little
using Point = Eigen::Vector2d;

/// Height of the surface above the tip at the distance rho from the axis; infinite beyond the ball.
double surface(double rho2, double radius) {
  const double under = radius * radius - rho2;
  return under > 0 ? radius - std::sqrt(under) : kInfinity;
}

/// Between which heights there is material over a point.
struct Column {
  double low, high;
};
/// Between the middles of four cells: linear in x and y, or the least of them where the ball's surface is too steep for
/// that. Outside of the grid there is none.
Column column_at(const Stock& stock, double x, double y, bool least) {
  const double u = (x - stock.x_min()) / stock.cell() - 0.5, v = (y - stock.y_min()) / stock.cell() - 0.5;
  const double i0 = std::floor(u), j0 = std::floor(v);
  const double bottom = stock.bottom();
  const auto least_height = static_cast<float>(bottom);
  const auto height = [&](const Stock& s, double i, double j) {
    if (!(i >= 0 && j >= 0 && i < s.columns() && j < s.rows())) return bottom;
    const Eigen::Map<const Eigen::Array<float, Stock::kLayers, 1>> layers(
        s.cell_layers(static_cast<int>(i), static_cast<int>(j)));
    return double(layers.max(least_height).sum()) / Stock::kLayers;
  };
  const auto between = [&](const Stock& s) {
    const double a = height(s, i0, j0), b = height(s, i0 + 1, j0), c = height(s, i0, j0 + 1),
                 d = height(s, i0 + 1, j0 + 1);
    if (least) return std::min({a, b, c, d});
    const double p = u - i0, q = v - j0;
    return (1 - q) * ((1 - p) * a + p * b) + q * ((1 - p) * c + p * d);
  };
  return {stock.hollow() == nullptr ? stock.bottom() : between(*stock.hollow()), between(stock)};
}

/// A place that counts in cells, as an index, or one beyond the grid's ends.
int cell_index(double v, int count) {
  return static_cast<int>(std::clamp(v, -1.0, double(count)));
}

/// Outwards at the middle of a sector.
const Vec3& outwards_of(std::size_t sector) {
  static const std::array<Vec3, BallEngagement::kSectors> table = [] {
    std::array<Vec3, BallEngagement::kSectors> out;
    for (int j = 0; j < BallEngagement::kSectors; ++j) {
      const double phi = 2 * kPi * (j + 0.5) / BallEngagement::kSectors;  // tooth angle
      out[static_cast<std::size_t>(j)] = Vec3(std::sin(phi), std::cos(phi), 0);
    }
    return out;
  }();
  return table[sector];
}

Vec3 outwards_at(double phi) {
  return {std::sin(phi), std::cos(phi), 0};
}

/// What a part of the ball's surface, a share of a ring and of a sector, has before it.
struct Seen {
  double share = 0;   ///< of the layer that it takes, what is material
  double over = 0;    ///< m, of its middle over the material
  double height = 0;  ///< m, how high the part is; 0: it takes nothing
  double high = 0;    ///< m, of the material, in the stock
};

/// The middle of a part.
struct Part {
  double kappa, phi;
};

/// The share of a part that was seen whole. Where the top of the material crosses it, its ninths are looked at: rings
/// do not follow a top that is not level, and a part whose middle lies above it shows nothing of what lies below. Where
/// one ninth lies whole in the material, those that it crosses count by how far it reaches up them; else a layer is
/// left there, or nothing, as after a way that was run before. `look(kappa, outwards, size)` sees a part.
template <class Look>
double share_of(const Look& look, const Seen& whole, const Part& part, double ring, double sector) {
  if (!(std::abs(whole.over) < kCrosses * whole.height)) return whole.share;
  constexpr int kParts = 3;
  std::array<Seen, kParts * kParts> ninths;
  bool inside = false;
  for (int i = 0; i < kParts; ++i) {
    for (int k = 0; k < kParts; ++k) {
      constexpr double kSize = 1.0 / kParts;
      Seen& ninth =
          ninths[static_cast<std::size_t>(kParts) * static_cast<std::size_t>(i) + static_cast<std::size_t>(k)];
      ninth = look(part.kappa + (i - 1) * kSize * ring, outwards_at(part.phi + (k - 1) * kSize * sector), kSize);
      inside = inside || (ninth.height > 0 && ninth.over < -0.5 * ninth.height);
    }
  }
  double share = 0;
  for (const Seen& ninth : ninths) {
    const bool crossed = inside && ninth.height > 0 && std::abs(ninth.over) < 0.5 * ninth.height;
    share += crossed ? 0.5 - ninth.over / ninth.height : ninth.share;
  }
  return share / static_cast<double>(ninths.size());
}

}  // namespace

bool is_ball(const Cutter& cutter) {
  return std::abs(cutter.corner_radius - cutter.radius()) <= 1e-9 * cutter.diameter;
}

double cut_ball(Stock& stock, const Vec3& a, const Vec3& b, double radius) {
  if (!a.allFinite() || !b.allFinite() || !(radius > 0) || stock.columns() == 0) return 0;
  if (std::min(a.z(), b.z()) >= stock.top()) return 0;
  Point f = (b - a).head<2>();
  const double length = f.norm();
  f = length > 0 ? Point(f / length) : Point(1, 0);
  const bool steep = !(length > 1e-12);  // straight down or up: the lower end alone
  const double slope = steep ? 0 : (b.z() - a.z()) / length;
  const double from = steep ? std::min(a.z(), b.z()) : a.z(), far = steep ? 0 : length;
  const double lead = -slope / std::sqrt(1 + slope * slope);
  const double cell = stock.cell(), x0 = stock.x_min() + 0.5 * cell, y0 = stock.y_min() + 0.5 * cell;
  const int j0 = std::max(0, cell_index(std::ceil((std::min(a.y(), b.y()) - radius - y0) / cell), stock.rows()));
  const int j1 = std::min(stock.rows() - 1, cell_index((std::max(a.y(), b.y()) + radius - y0) / cell, stock.rows()));
  double removed = 0;
  for (int j = j0; j <= j1; ++j) {
    const double y = y0 + j * cell - a.y();
    // Where the row meets the band of the way.
    double low = std::min(0.0, b.x() - a.x()) - radius, high = std::max(0.0, b.x() - a.x()) + radius;
    if (std::abs(f.y()) > 1e-12) {  // |f x p| <= R
      const double middle = f.x() / f.y() * y, half = radius / std::abs(f.y());
      low = std::max(low, middle - half);
      high = std::min(high, middle + half);
    }
    const int i0 = std::max(0, cell_index(std::ceil((low + a.x() - x0) / cell), stock.columns()));
    const int i1 = std::min(stock.columns() - 1, cell_index((high + a.x() - x0) / cell, stock.columns()));
    for (int i = i0; i <= i1; ++i) {
      const double x = x0 + i * cell - a.x();
      const double s = f.x() * x + f.y() * y, n = f.x() * y - f.y() * x;
      const double q2 = radius * radius - n * n;
      if (!(q2 > 0)) continue;
      const double t = std::clamp(s + lead * std::sqrt(q2), 0.0, far);
      const double height = surface(n * n + (s - t) * (s - t), radius);
      if (height == kInfinity) continue;
      removed += stock.lower(i, j, from + slope * t + height);
    }
  }
  return removed;
}

double cut_shaft(Stock& stock, const Vec3& a, const Vec3& b, const Vec3& axis, double radius, double length) {
  const double leans = axis.head<2>().norm();
  if (!a.allFinite() || !b.allFinite() || !(radius > 0) || !(axis.z() > 0) || !(leans > 1e-9)) return 0;
  const double cell = stock.cell(), x0 = stock.x_min() + 0.5 * cell, y0 = stock.y_min() + 0.5 * cell;
  const int places = std::max(1, static_cast<int>(std::ceil((b - a).norm() / (0.5 * cell))));
  double removed = 0;
  for (int k = 0; k <= places; ++k) {
    const Vec3 middle = a + double(k) / places * (b - a) + radius * Vec3::UnitZ();
    // How far along the axis some of it is below the top of the stock.
    const double way = std::min(length, (stock.top() - (middle.z() - radius * leans)) / axis.z());
    if (!(way > 0)) continue;
    const Point from = middle.head<2>(), to = from + way * axis.head<2>();
    const int j0 = std::max(0, cell_index(std::ceil((std::min(from.y(), to.y()) - radius - y0) / cell), stock.rows()));
    const int j1 =
        std::min(stock.rows() - 1, cell_index((std::max(from.y(), to.y()) + radius - y0) / cell, stock.rows()));
    const int i0 =
        std::max(0, cell_index(std::ceil((std::min(from.x(), to.x()) - radius - x0) / cell), stock.columns()));
    const int i1 =
        std::min(stock.columns() - 1, cell_index((std::max(from.x(), to.x()) + radius - x0) / cell, stock.columns()));
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) {
        const Point w(x0 + i * cell - from.x(), y0 + j * cell - from.y());
        const double along = w.dot(axis.head<2>()), half = axis.z() * along;
        const double rest = half * half - leans * leans * (w.squaredNorm() - along * along - radius * radius);
        if (!(rest > 0)) continue;
        const double z = (half - std::sqrt(rest)) / (leans * leans), s = along + z * axis.z();
        if (!(s >= 0 && s <= length)) continue;
        removed += stock.lower(i, j, middle.z() + z);
      }
    }
  }
  return removed;
}

void look_ahead(const Stock& stock, const Vec3& tip, double radius, const Vec3& direction, double ahead,
                BallEngagement& engagement) {
  engagement = BallEngagement{};
  if (!tip.allFinite() || !(radius > 0) || !(ahead > 0) || !(direction.squaredNorm() > 0.5)) return;
  const Vec3 next = tip + ahead * direction;
  const double over = stock.top() - next.z(), now = stock.top() - tip.z();
  if (!(over > 0) || !(now > 0)) return;
  const double cell = stock.cell();
  // Rings up to where the material can reach, so that a flat top ends between two of them: those of the force at the
  // tip, those that are looked at ahead of it, where it is higher or lower.
  const auto ring_below = [&](double height) {
    return std::acos(std::clamp(1 - height / radius, 0.0, 1.0)) / BallEngagement::kRings;
  };
  engagement.ring = ring_below(now);
  const double ring = ring_below(over);
  const double sector = 2 * kPi / BallEngagement::kSectors;
  const auto look = [&](double kappa, const Vec3& out, double part) {
    const double s = std::sin(kappa), c = std::cos(kappa), rho = radius * s;
    Seen seen;
    if (!(s * direction.dot(out) - c * direction.z() > 0)) return seen;
    const double after = next.z() + radius * (1 - c);
    const Vec3 p = next + rho * out;
    const double before = tip.z() + surface((p - tip).head<2>().squaredNorm(), radius);
    if (!(before > after)) return seen;
    seen.height = part * rho * ring;
    // Heights between middles of cells lie above a curved surface by up to this.
    const bool steep = rho > radius - 1.5 * cell;
    const double bow = steep ? 0 : cell * cell / (8 * radius) * (1 / (c * c * c) + 1 / c) + kNothing;
    const Column material = column_at(stock, p.x(), p.y(), steep);
    const double high = std::min(material.high - bow, before), low = std::max(material.low, after);
    seen.share = std::clamp((high - low) / std::min(before - after, 0.5 * seen.height), 0.0, 1.0);
    seen.over = after - (material.high - bow);
    seen.high = material.high;
    return seen;
  };
  for (int r = 0; r < BallEngagement::kRings; ++r) {
    const double kappa = (r + 0.5) * ring;
    for (int j = 0; j < BallEngagement::kSectors; ++j) {
      const Seen whole = look(kappa, outwards_of(static_cast<std::size_t>(j)), 1);
      if (!(whole.height > 0)) continue;
      const bool level = whole.high > stock.top() - kNothing;  // the rings end there
      const double share = level ? whole.share : share_of(look, whole, {kappa, (j + 0.5) * sector}, ring, sector);
      if (!(share > 1e-3)) continue;
      engagement.share[static_cast<std::size_t>(r)][static_cast<std::size_t>(j)] = static_cast<float>(share);
      engagement.any = true;
      engagement.max_depth = std::max(engagement.max_depth, whole.high - next.z());
    }
  }
  if (!(over > radius)) return;
  for (int j = 0; j < BallEngagement::kSectors; ++j) {
    const Vec3& out = outwards_of(static_cast<std::size_t>(j));
    if (!(direction.dot(out) > 0)) continue;
    const Vec3 p = next + radius * out;
    const Column material = column_at(stock, p.x(), p.y(), true);
    const double side = material.high - std::max(material.low, next.z() + radius);
    if (!(side > kNothing)) continue;
    engagement.side[static_cast<std::size_t>(j)] = static_cast<float>(side);
    engagement.any = true;
    engagement.max_depth = std::max(engagement.max_depth, material.high - next.z());
  }
}

void look_ahead(const Stock& stock, const Vec3& lowest, const Mat3& R, double radius, const Vec3& direction,
                double ahead, BallEngagement& engagement) {
  engagement = BallEngagement{};
  if (!lowest.allFinite() || !R.allFinite() || !(radius > 0) || !(ahead > 0) || !(direction.squaredNorm() > 0.5))
    return;
  const Vec3 middle = lowest + radius * Vec3::UnitZ(), next = middle + ahead * direction, axis = R.col(2);
  const double over = stock.top() - (next.z() - radius), now = stock.top() - lowest.z();
  if (!(over > 0) || !(now > 0)) return;
  const double cell = stock.cell(), lean = std::acos(std::clamp(axis.z(), -1.0, 1.0));
  // Rings up to where the material can reach, as for an upright ball, and as far as the tool leans beyond.
  const double reach = std::acos(std::clamp(1 - std::max(over, now) / radius, 0.0, 1.0));
  engagement.ring = std::min(reach + lean, 0.5 * kPi) / BallEngagement::kRings;
  const double ring = engagement.ring, sector = 2 * kPi / BallEngagement::kSectors;
  const auto look = [&](double kappa, const Vec3& out, double part) {
    const double s = std::sin(kappa), c = std::cos(kappa);
    const Vec3 n = R * Vec3(s * out.x(), s * out.y(), -c);
    Seen seen;
    if (!(n.dot(direction) > 0)) return seen;
    const Vec3 p = next + radius * n;
    const double after = p.z();
    const double before = middle.z() - radius + surface((p - middle).head<2>().squaredNorm(), radius);
    if (!(before > after)) return seen;
    seen.height = part * radius *
                  (ring * std::abs((R * Vec3(c * out.x(), c * out.y(), s)).z()) +
                   sector * s * std::abs((R * Vec3(out.y(), -out.x(), 0)).z()));
    const double down = -n.z(), rho = radius * std::sqrt(std::max(0.0, 1 - down * down));
    const bool steep = down <= 0 || rho > radius - 1.5 * cell;
    const double bow = steep ? 0 : cell * cell / (8 * radius) * (1 / (down * down * down) + 1 / down) + kNothing;
    const Column material = column_at(stock, p.x(), p.y(), steep);
    const double high = std::min(material.high - bow, before), low = std::max(material.low, after);
    seen.share = std::clamp((high - low) / std::max(kNothing, std::min(before - after, 0.5 * seen.height)), 0.0, 1.0);
    seen.over = after - (material.high - bow);
    seen.high = material.high;
    return seen;
  };
  for (int r = 0; r < BallEngagement::kRings; ++r) {
    for (int j = 0; j < BallEngagement::kSectors; ++j) {
      const Part part{(r + 0.5) * ring, (j + 0.5) * sector};
      const Seen whole = look(part.kappa, outwards_of(static_cast<std::size_t>(j)), 1);
      if (!(whole.height > 0)) continue;
      const double share = share_of(look, whole, part, ring, sector);
      if (!(share > 1e-3)) continue;
      engagement.share[static_cast<std::size_t>(r)][static_cast<std::size_t>(j)] = static_cast<float>(share);
      engagement.any = true;
      engagement.max_depth = std::max(engagement.max_depth, whole.high - (next.z() - radius));
    }
  }
  const double step = std::max(cell, 0.1 * radius);
  for (int j = 0; j < BallEngagement::kSectors; ++j) {
    const Vec3& out = outwards_of(static_cast<std::size_t>(j));
    const Vec3 n = R * Vec3(out.x(), out.y(), 0);
    if (!(n.dot(direction) > 0) || !(axis.z() > 0)) continue;
    double side = 0;
    for (Vec3 p = next + radius * n + 0.5 * step * axis; p.z() < stock.top(); p += step * axis) {
      const Column material = column_at(stock, p.x(), p.y(), true);
      if (!(p.z() > material.low && p.z() < material.high - kNothing)) continue;
      side += step;
      engagement.side_reach = std::max(engagement.side_reach, (p - next).dot(axis) + 0.5 * step);
      engagement.max_depth = std::max(engagement.max_depth, p.z() - (next.z() - radius));
    }
    if (!(side > 0)) continue;
    engagement.side[static_cast<std::size_t>(j)] = static_cast<float>(side);
    engagement.any = true;
  }
}

BallForce::BallForce(const Cutter& cutter, const Material& material) : cutter_(cutter), material_(material) {}

Vec3 BallForce::mean_force(const BallEngagement& engagement, const Vec3& direction, double feed_per_tooth) const {
  Vec3 sum = Vec3::Zero();
  if (!engagement.any) return sum;
  const Material& m = material_;
  const auto chip_of = [&](double h) { return m.exponent == 1 ? h : std::pow(h, m.exponent); };
  const double width = cutter_.radius() * engagement.ring;
  std::array<double, BallEngagement::kRings> sines, cosines;
  for (int r = 0; r < BallEngagement::kRings; ++r) {
    const double kappa = (r + 0.5) * engagement.ring;
    sines[static_cast<std::size_t>(r)] = std::sin(kappa);
    cosines[static_cast<std::size_t>(r)] = std::cos(kappa);
  }
  for (std::size_t j = 0; j < BallEngagement::kSectors; ++j) {
    const Vec3& out = outwards_of(j);
    const double outwards_feed = out.dot(direction);
    double tangential = 0, outward = 0, up = 0;
    // With the normal n = s out - c z and the third direction c out + s z.
    const auto add = [&](double s, double c, double length) {
      const double chip = chip_of(feed_per_tooth * std::max(0.0, s * outwards_feed - c * direction.z()));
      const double radial = length * (m.kre + m.krc * chip), axial = length * (m.kae + m.kac * chip);
      tangential += length * (m.kte + m.ktc * chip);
      outward += axial * c - radial * s;
      up += axial * s + radial * c;
    };
    for (std::size_t r = 0; r < BallEngagement::kRings; ++r) {
      if (const float share = engagement.share[r][j]; share > 0) add(sines[r], cosines[r], share * width);
    }
    if (const float side = engagement.side[j]; side > 0) add(1, 0, side);
    sum += outward * out + Vec3(-tangential * out.y(), tangential * out.x(), up);
  }
  return cutter_.teeth / (2 * kPi) * (2 * kPi / BallEngagement::kSectors) * sum;
}

void BallForce::contacts(const Stock& stock, const Vec3& tip, double reach, std::vector<BallContact>& out) const {
  find_contacts(stock, tip, nullptr, reach, out);
}

void BallForce::contacts(const Stock& stock, const Vec3& lowest, const Mat3& R, double reach,
                         std::vector<BallContact>& out) const {
  find_contacts(stock, lowest, &R, reach, out);
}

void BallForce::find_contacts(const Stock& stock, const Vec3& tip, const Mat3* R, double reach,
                              std::vector<BallContact>& out) const {
  out.clear();
  const double radius = cutter_.radius(), over = stock.top() - tip.z();
  if (!tip.allFinite() || !(reach > 0) || !(over > 0)) return;
  constexpr int kRings = BallEngagement::kRings / 2;
  constexpr std::size_t kEvery = 2;  // of the sectors
  constexpr double kThinChip = 20e-6;
  const Material& m = material_;
  const double per_chip = m.exponent == 1 ? 1 : std::pow(kThinChip, m.exponent - 1);
  const double lean = R == nullptr ? 0 : std::acos(std::clamp((*R)(2, 2), -1.0, 1.0));
  const double ring = std::min(std::acos(std::clamp(1 - over / radius, 0.0, 1.0)) + lean, 0.5 * kPi) / kRings;
  const auto in_stock = [R](const Vec3& v) { return R == nullptr ? v : Vec3(*R * v); };
  const auto weight = static_cast<double>(kEvery) / BallEngagement::kSectors * cutter_.teeth;
  const auto add = [&](const Vec3& outwards, double s, double c, double length, double gap, double depth) {
    const Vec3 n = s * outwards - c * Vec3::UnitZ(), along = c * outwards + s * Vec3::UnitZ(),
               motion(outwards.y(), -outwards.x(), 0);
    const auto force = [&](double kt, double kr, double ka) {
      return in_stock(weight * length * (ka * along - kt * motion - kr * n));
    };
    out.push_back({in_stock(n), gap, depth, force(m.kte, m.kre, m.kae), per_chip * force(m.ktc, m.krc, m.kac)});
  };
  for (std::size_t j = 0; j < BallEngagement::kSectors; j += kEvery) {
    const Vec3 outwards = (outwards_of(j) + outwards_of(j + 1)).normalized();
    for (int r = 0; r < kRings; ++r) {
      const double kappa = (r + 0.5) * ring, s = std::sin(kappa), c = std::cos(kappa);
      const Vec3 n = in_stock(s * outwards - c * Vec3::UnitZ());
      const Vec3 here = tip + Vec3::UnitZ() * radius + radius * n, there = here + reach * n;
      const Column far = column_at(stock, there.x(), there.y(), false);
      const double over_far = there.z() - far.high;
      if (!(over_far < 0) || there.z() < far.low) continue;
      const Column near = column_at(stock, here.x(), here.y(), false);
      const double over_near = std::max(0.0, here.z() - near.high);
      add(outwards, s, c, radius * ring, reach * over_near / (over_near - over_far), far.high - tip.z());
    }
    if (!(over > radius) || R != nullptr) continue;
    const Vec3 beside = tip + (radius + 0.5 * reach) * outwards;
    const Column wall = column_at(stock, beside.x(), beside.y(), true);
    const double side = wall.high - std::max(wall.low, tip.z() + radius);
    if (side > kNothing) add(outwards, 1, 0, side, 0, wall.high - tip.z());
  }
}

}  // namespace polypod::cutting
