// Operations without a tool in OpenVDB 10: band widths, masked offsets and changes, blended unions, fillets.
#include "impl.h"

#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/LevelSetFilter.h>
#include <openvdb/tools/LevelSetTracker.h>
#include <openvdb/tools/Prune.h>

#include <algorithm>
#include <cmath>

using namespace openvdb;

namespace druse {

namespace {

using Tracker = tools::LevelSetTracker<FloatGrid>;

void set_up(Tracker& tracker, const Smoothing& smoothing) {
  tracker.setSpatialScheme(smoothing.high_order ? math::HJWENO5_BIAS : math::FIRST_BIAS);
  tracker.setGrainSize(1);  // a leaf is work enough for a task
  if (smoothing.normalisations >= 0) tracker.setNormCount(smoothing.normalisations);
}

// The weight of an effect at a point: 0 below the range of a grid's values, 1 above, linear between.
class MaskWeight {
 public:
  MaskWeight(const FloatGrid& grid, const Range& range)
      : access_(grid.getConstAccessor()), sampler_(access_, grid.transform()), range_(range) {}
  MaskWeight(const MaskWeight&) = delete;  // the sampler points to the accessor
  MaskWeight& operator=(const MaskWeight&) = delete;

  double operator()(const Vec3d& world) const {
    const double t = (sampler_.wsSample(world) - range_.low) / (range_.high - range_.low);
    const double weight = std::clamp(t, 0.0, 1.0);
    return range_.inverted ? 1.0 - weight : weight;
  }

 private:
  FloatGrid::ConstAccessor access_;
  tools::GridSampler<FloatGrid::ConstAccessor, tools::BoxSampler> sampler_;
  Range range_;
};

// World positions of voxels. Positions on the world's lattice are computed from the indices there, so that a part of
// a solid gets the same bits as the whole.
class VoxelPositions {
 public:
  explicit VoxelPositions(const FloatGrid& grid) : grid_(grid), h_(grid.voxelSize()[0]) {
    const Vec3d origin = grid.indexToWorld(Vec3d(0.0)) / h_;
    first_ = Vec3d(std::round(origin[0]), std::round(origin[1]), std::round(origin[2]));
    on_lattice_ = (origin - first_).length() < 1e-6;  // voxels, more than rounding
  }

  Vec3d operator()(const Coord& voxel) const {
    return on_lattice_ ? (first_ + voxel.asVec3d()) * h_ : grid_.indexToWorld(voxel);
  }

 private:
  const FloatGrid& grid_;
  double h_;
  Vec3d first_;
  bool on_lattice_;
};

}  // namespace

void grid_set_background(Grid& handle, float background, const Host& host) {
  in_arena(host, [&] { tools::changeLevelSetBackground(floats(handle).tree(), background); });
}

void grid_resize(Grid& handle, int voxels, Smoothing smoothing, const Host& host) {
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    Tracker tracker(floats(handle), &interrupter);
    set_up(tracker, smoothing);
    if (voxels > 0) tracker.dilate(voxels);
    if (voxels < 0) tracker.erode(-voxels);
    tracker.prune();
  });
}

void grid_offset_masked(Grid& handle, double offset, const Grid& mask_grid, Range range, Smoothing smoothing, const Host& host) {
  FloatGrid& grid = floats(handle);
  const FloatGrid& mask = floats(mask_grid);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    Tracker tracker(grid, &interrupter);
    set_up(tracker, smoothing);
    const double h = grid.voxelSize()[0];
    const VoxelPositions world(grid);
    // Steps of at most half a voxel, which the tracker follows.
    const int steps = std::max(1, static_cast<int>(std::ceil(std::abs(offset) / (0.5 * h))));
    const double step = offset / steps;
    for (int n = 0; n < steps; ++n) {
      tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
        const MaskWeight weight(mask, range);
        for (auto it = leaf.beginValueOn(); it; ++it) {
          it.setValue(*it + static_cast<float>(step * weight(world(it.getCoord()))));
        }
      });
      tracker.track();
    }
  });
}

void grid_restrict_change(Grid& handle, const Grid& before, const Grid& mask_grid, Range range, Smoothing smoothing, const Host& host) {
  FloatGrid& grid = floats(handle);
  const FloatGrid& old = floats(before);
  const FloatGrid& mask = floats(mask_grid);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    grid.tree().topologyUnion(old.tree());
    Tracker tracker(grid, &interrupter);
    set_up(tracker, smoothing);
    const VoxelPositions world(grid);
    tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
      const MaskWeight weight(mask, range);
      auto access = old.getConstAccessor();
      for (auto it = leaf.beginValueOn(); it; ++it) {
        const Coord voxel = it.getCoord();
        const double a = weight(world(voxel));
        it.setValue(static_cast<float>(a * *it + (1.0 - a) * access.getValue(voxel)));
      }
    });
    tracker.track();
  });
}

void grid_blend(Grid& handle, std::unique_ptr<Grid> operand, double radius, Smoothing smoothing, const Host& host) {
  FloatGrid& a = floats(handle);
  FloatGrid& b = floats(*operand);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    const FloatGrid::Ptr first = a.deepCopy(), second = b.deepCopy();
    tools::csgUnion(a, b);
    Tracker tracker(a, &interrupter);
    set_up(tracker, smoothing);
    tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
      auto one = first->getConstAccessor();
      auto two = second->getConstAccessor();
      for (auto it = leaf.beginValueOn(); it; ++it) {
        const Coord voxel = it.getCoord();
        const double u = one.getValue(voxel), v = two.getValue(voxel);
        const double overlap = std::max(radius - std::abs(u - v), 0.0);  // of a quadratic smooth minimum
        it.setValue(static_cast<float>(std::min(u, v) - overlap * overlap / (4.0 * radius)));
      }
    });
    tracker.track();
  });
}

void grid_fillet(Grid& handle, double radius, Smoothing smoothing, const Host& host) {
  FloatGrid& grid = floats(handle);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    const FloatGrid::Ptr before = grid.deepCopy();
    {
      // Closing by a ball of the radius: space that it cannot reach from outside is filled.
      tools::LevelSetFilter<FloatGrid> ball(grid, &interrupter);
      set_up(ball, smoothing);
      ball.offset(static_cast<float>(-radius));  // outwards, then inwards
      ball.offset(static_cast<float>(radius));
    }
    // A fillet only adds material: restores what tracking removed elsewhere.
    tools::csgUnion(grid, *before);
  });
}

void grid_prune(Grid& handle, const Host& host) {
  in_arena(host, [&] { tools::pruneLevelSet(floats(handle).tree()); });
}

}  // namespace druse
