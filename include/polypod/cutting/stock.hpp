// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
// The stock as a height map, what a cutter removes from it, and what it meets.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "polypod/cutting/cutter.hpp"
#include "polypod/cutting/force.hpp"
#include "polypod/geometry/pose.hpp"

namespace polypod::cutting {

/// Heights of the material over a grid in the workpiece frame W. A cell holds material from the bottom up to its
/// height; cells without material hold -infinity. Positions are those of cell centres: x = x_min + (i + 1/2) cell.
///
/// A cell that the edge of a cutter crosses is cut in part. For this every cell has kLayers heights: layer k is cut
/// where the disc covers more than (k + 1/2) / kLayers of the cell, which is as if each layer were a height map of its
/// own and met a cutter of a slightly different radius (R - cell/2 to R + cell/2, R on average). So a wall is known to
/// a sixteenth of a cell, cuts of any depth and order combine exactly, and a cut that is repeated takes nothing.
class Stock {
 public:
  static constexpr int kLayers = 8;
  enum class Axis { x, y };

  Stock() = default;
  /// A block from `min` to `max` (m, in W) in square cells; sizes that are no whole number of cells are rounded, and
  /// the grid is centred. Errors: CT110 (empty block or a number that is not finite), CT111 (more than `max_cells`
  /// cells). Memory: 32 bytes a cell.
  static Result<Stock> block(const Vec3& min, const Vec3& max, double cell, std::size_t max_cells = 50'000'000);
  /// A stock from its parts: kLayers heights a cell, row by row, none above `top` (m, in W), -infinity where there is
  /// no material. Errors: CT123 (sizes that do not fit, a height that is none).
  /// `hollow`: as many heights again, up to which each layer is hollow from the bottom on (see turned), or none.
  static Result<Stock> from_layers(double x_min, double y_min, double cell, int columns, int rows, double bottom,
                                   double top, std::vector<float> layers, std::vector<float> hollow = {});

  [[nodiscard]] double cell() const { return cell_; }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] double x_min() const { return x_min_; }
  [[nodiscard]] double y_min() const { return y_min_; }
  [[nodiscard]] double bottom() const { return bottom_; }
  [[nodiscard]] double top() const { return top_; }  ///< the highest material there ever was, m
  /// Corners of the box that the grid covers, m.
  [[nodiscard]] Vec3 min() const { return {x_min_, y_min_, bottom_}; }
  [[nodiscard]] Vec3 max() const { return {x_min_ + columns_ * cell_, y_min_ + rows_ * cell_, top_}; }
  /// The mean height of a cell's layers, an empty layer counting as the bottom; -infinity if all are empty.
  [[nodiscard]] float height(int column, int row) const;
  void set_height(int column, int row, float h);
  /// Lowers every layer of a cell to at most `level` (m); at the bottom and below nothing is left. Returns the removed
  /// volume, m^3.
  double lower(int column, int row, double level);
  /// Empties a cell but for `share` (0 .. 1) of its layers: for boundaries of the stock that cross it.
  void keep_share(int column, int row, double share);
  /// The kLayers heights of a cell; those of the next column follow.
  [[nodiscard]] const float* cell_layers(int column, int row) const { return layers_.data() + index(column, row); }
  [[nodiscard]] const std::vector<float>& layers() const { return layers_; }
  [[nodiscard]] double volume() const;  ///< m^3
  /// The same material in cells half as large: each cell becomes four that hold its heights. Four times the memory.
  [[nodiscard]] Stock in_half_cells() const;
  /// The same material turned over by 180 deg about the x axis of W (y and z change their signs), or about its y axis
  /// (x and z do). What was cut from above before is open from below then: material is what lies between `hollow` and
  /// the heights. Twice the memory, and cuts take twice as long.
  [[nodiscard]] Stock turned(Axis about) const;
  /// The same material elsewhere: `by` in m, in W.
  [[nodiscard]] Stock shifted(const Vec3& by) const;
  /// Material that is not there: what this stock holds is taken out of the other from below. Nothing where all columns
  /// are solid from the bottom on.
  [[nodiscard]] const Stock* hollow() const { return hollow_.empty() ? nullptr : hollow_.data(); }

  /// Keeps only the cells for which `inside(x, y)` is true (for allowances along a contour).
  template <class F>
  void keep(F&& inside) {
    for (int j = 0; j < rows_; ++j)
      for (int i = 0; i < columns_; ++i)
        if (!inside(x_min_ + (i + 0.5) * cell_, y_min_ + (j + 0.5) * cell_)) set_height(i, j, empty());
  }
  static float empty();

  /// Removes what a flat cutter of `radius` with its tip at `tip` takes, down to tip.z (or the bottom). Returns the
  /// removed volume, m^3.
  double cut_disc(const Vec3& tip, double radius);
  /// Removes what the cutter takes on the straight way from a to b, level or sloped: each layer of a cell is lowered to
  /// the lowest place of the tip from which it is cut. One long step and many short ones remove the same. The disc at
  /// `a` is taken as already removed when `a_done` is true (less work, same result). Returns the removed volume, m^3.
  /// Parts outside the grid take nothing. Cost: about 3 ns a cell touched by a level way, more for a sloped one.
  double cut_line(const Vec3& a, const Vec3& b, double radius, bool a_done = false);

  /// As cut_line, for the steps of a way. Where a step goes down, what lies under the disc at `b` is left standing (see
  /// Due), and the next step down takes of it what leaves the disc: its work grows with the step, not with the square
  /// of the cutter. The stock is the same once it is settled; until then look_ahead and look_down see it as it is, and
  /// heights, layers and volumes must not be asked for. The returned volumes add up to the same, with that of `settle`.
  double cut_step(const Vec3& a, const Vec3& b, double radius, bool a_done = false);
  /// Takes what is due. Returns its volume, m^3.
  double settle();

  /// A disc down to `level` whose inner cells are yet to be cut.
  struct Due {
    bool any = false;
    double x = 0, y = 0, radius = 0;  ///< m, in W
    double inner2 = 0;                ///< m^2, of the distance of those cells from the axis
    float level = 0;
  };
  [[nodiscard]] const Due& due() const { return due_; }

 private:
  double sweep(const Vec3& a, const Vec3& b, double radius, bool a_done, bool later);
  double cut_way(const Vec3& a, const Vec3& b, double radius, bool a_done, bool later);
  double settle_heights();

  [[nodiscard]] std::size_t index(int column, int row) const {
    return (static_cast<std::size_t>(row) * columns_ + column) * kLayers;
  }

  double cell_ = 0, x_min_ = 0, y_min_ = 0, bottom_ = 0;
  int columns_ = 0, rows_ = 0;
  float top_ = 0;
  std::vector<float> layers_;
  std::vector<Stock> hollow_;  ///< none or one, on the same grid: every cut goes through both, and what it takes of
                               ///< this one was not there
  Due due_;
};

inline constexpr double kLargestCell = 0.025;  ///< of the cutter's diameter (SLAV 5.2.1)
inline constexpr double kUsualCell = 0.02;     ///< of the cutter's diameter, unless the job says otherwise

/// The stock that a job's table describes, in W; finishes the table. Its `kind` is
/// - "block": `min_mm`, `max_mm` (x, y, z of two corners);
/// - "allowance": material within `allowance_mm` of a contour `contour_mm = [[x, y], ...]` (the finished outline, in
/// either
///   direction) from `z_bottom_mm` to `z_top_mm`. A closed contour (`closed = true`, the default) has its allowance at
///   `side = "outside"`, with the whole part within it, or "inside", with a cutter's diameter of material behind the
///   contour; an open one (`closed = false`) to the "left" or "right" of its direction, with the same behind it.
///   `corners` are "square" (mitred, up to four allowances long; the default) or "round";
/// - "file": `file`, relative to the job, what an earlier program left (write_stock); `turned = "x"` or "y" where the
///   part was turned over by 180 deg about that axis of the earlier W, then `shift_mm` to where it lies in this one.
/// Cells of a block or an allowance are at most 0.02 D (a little less where whole numbers of them then fill the stock),
/// or `cell_mm`. Errors: those of config::Table and read_stock; CT110 empty, CT111 too many cells, CT112 cells above
/// 0.025 D, CT113 too few points, CT114 a contour that meets itself, CT115 to CT117 an unknown side, corner or kind,
/// CT124 turned about an unknown axis.
Result<Stock> stock_from(const config::Table& table, const Cutter& cutter);

/// A stock as the bytes of a file that read_stock reads.
std::string stock_bytes(const Stock& stock);
/// Writes them. Errors: FI101.
Status write_stock(const Stock& stock, const std::string& path);
/// Errors: FI100, CT120 (no stock file), CT121 (too short or too long), CT122 (another version), CT123 (damaged).
Result<Stock> read_stock(const std::string& path);

/// What a flat cutter meets at one point of a move: over `kBins` strips across the feed the depth of the material that
/// the next step forward would take. The strips have equal width 2R / kBins; strip 0 is at the left (phi = 0, u = +R),
/// the last at the right (phi = pi, u = -R), u = R cos(phi).
struct EngagementProfile {
  static constexpr int kBins = 64;
  float depth[kBins];  ///< m, axial, 0 where there is nothing to cut
  double max_depth = 0;
  bool any = false;
};

/// Looks at what the cutter would take next: in the disc moved forward by `ahead` along the unit direction `feed`
/// (horizontal, in W), but not in the disc at `tip`. Consistent with Stock::cut_line: what was cut by this very path is
/// never met again. Nothing is removed, and the disc at the tip need not have been cut.
///
/// `ahead` (m, > 0) is about two cells (below half a cell there may be too few cells to tell); it should not reach
/// beyond the end of the move, where the cutter turns away from what stands there. The depth of a strip is the material
/// that the step takes from its cells over what it would take per unit of depth, each cell counting over one cell width
/// across the feed; a strip without any cell takes the value of the nearest strip within one cell width, else 0. A tip
/// above the material, a feed of length 0 and a radius or `ahead` that is not above 0 give an empty profile. Depths
/// count from the higher of tip and bottom, and up to `height` (m) at most.
void look_ahead(const Stock& stock, const Vec3& tip, double radius, const Eigen::Vector2d& feed, double ahead,
                EngagementProfile& profile, double height = std::numeric_limits<double>::infinity());

/// The profile as spans per axial disc: entry and exit angle where the material reaches at least the middle of the
/// disc.
struct DiscEngagement {
  double z = 0;                   ///< m, middle of the disc above the tip
  std::vector<Engagement> spans;  ///< their `depth` is the thickness of the disc
};
/// round(max_depth / dz) discs, at least one (SLAV (5.12)), of equal thickness that add up to max_depth; `dz` > 0, m
/// (0.025 D in the source). Angles are those of the strips' boundaries, in rising order.
std::vector<DiscEngagement> by_disc(const EngagementProfile& profile, double dz);

/// As the other force_history, for engagements that differ from disc to disc.
ForceHistory force_history(const Cutter& cutter, const Material& material, const std::vector<DiscEngagement>& discs,
                           double feed_per_tooth, int steps = 360);

/// Mean forces of a profile with all strips' integrals tabulated once per cutter, material and feed per tooth (linear
/// in h for exponent 1: then one table serves every feed). Cost: kBins multiply-adds.
class ProfileForce {
 public:
  ProfileForce(const Cutter& cutter, const Material& material);
  /// Mean force per revolution on the tool, N, in the frame of the cut; `feed_per_tooth` in m, >= 0.
  [[nodiscard]] Vec3 mean_force(const EngagementProfile& profile, double feed_per_tooth,
                                Spindle spindle = Spindle::clockwise) const;

 private:
  std::vector<Vec3> edge_, cut_;  // per strip: N/m of depth; and per unit of (feed per tooth)^exponent
  double exponent_ = 1;
};

}  // namespace polypod::cutting
