// Operations that OpenVDB 10 has no tool for: bands of other widths, offsets that vary, masks, blended union, fillets.
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

void prepare(Tracker& tracker, const Smoothing& how) {
  tracker.setSpatialScheme(how.high_order ? math::HJWENO5_BIAS : math::FIRST_BIAS);
  tracker.setGrainSize(1);
  if (how.normalisations >= 0) tracker.setNormCount(how.normalisations);
}

// The share of an effect at a place: 0 below the range of a grid's values, 1 above, linear between.
class Share {
 public:
  Share(const FloatGrid& grid, const Range& range)
      : access_(grid.getConstAccessor()), sampler_(access_, grid.transform()), range_(range) {}
  Share(const Share&) = delete;  // the sampler points to the accessor
  Share& operator=(const Share&) = delete;

  double operator()(const Vec3d& world) const {
    const double t = (sampler_.wsSample(world) - range_.low) / (range_.high - range_.low);
    const double share = std::clamp(t, 0.0, 1.0);
    return range_.inverted ? 1.0 - share : share;
  }

 private:
  FloatGrid::ConstAccessor access_;
  tools::GridSampler<FloatGrid::ConstAccessor, tools::BoxSampler> sampler_;
  Range range_;
};

// Where voxels stand. Those on the world's lattice are asked by their number there: a part of a solid then
// finds to the last bit what the whole does.
class Places {
 public:
  explicit Places(const FloatGrid& grid) : grid_(grid), h_(grid.voxelSize()[0]) {
    const Vec3d origin = grid.indexToWorld(Vec3d(0.0)) / h_;
    first_ = Vec3d(std::round(origin[0]), std::round(origin[1]), std::round(origin[2]));
    on_lattice_ = (origin - first_).length() < 1e-6;
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

void grid_resize(Grid& handle, int voxels, Smoothing how, const Host& host) {
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    Tracker tracker(floats(handle), &interrupter);
    prepare(tracker, how);
    if (voxels > 0) tracker.dilate(voxels);
    if (voxels < 0) tracker.erode(-voxels);
    tracker.prune();
  });
}

void grid_vary(Grid& handle, double offset, const Grid& by, Range range, Smoothing how, const Host& host) {
  FloatGrid& grid = floats(handle);
  const FloatGrid& mask = floats(by);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    Tracker tracker(grid, &interrupter);
    prepare(tracker, how);
    const double h = grid.voxelSize()[0];
    const Places world(grid);
    const int steps = std::max(1, static_cast<int>(std::ceil(std::abs(offset) / (0.5 * h))));
    const double step = offset / steps;
    for (int n = 0; n < steps; ++n) {
      tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
        const Share share(mask, range);
        for (auto it = leaf.beginValueOn(); it; ++it) {
          it.setValue(*it + static_cast<float>(step * share(world(it.getCoord()))));
        }
      });
      tracker.track();
    }
  });
}

void grid_mix(Grid& handle, const Grid& before, const Grid& by, Range range, Smoothing how, const Host& host) {
  FloatGrid& grid = floats(handle);
  const FloatGrid& old = floats(before);
  const FloatGrid& mask = floats(by);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    grid.tree().topologyUnion(old.tree());
    Tracker tracker(grid, &interrupter);
    prepare(tracker, how);
    const Places world(grid);
    tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
      const Share share(mask, range);
      auto access = old.getConstAccessor();
      for (auto it = leaf.beginValueOn(); it; ++it) {
        const Coord voxel = it.getCoord();
        const double a = share(world(voxel));
        it.setValue(static_cast<float>(a * *it + (1.0 - a) * access.getValue(voxel)));
      }
    });
    tracker.track();
  });
}

void grid_blend(Grid& handle, std::unique_ptr<Grid> operand, double radius, Smoothing how, const Host& host) {
  FloatGrid& a = floats(handle);
  FloatGrid& b = floats(*operand);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    const FloatGrid::Ptr first = a.deepCopy(), second = b.deepCopy();
    tools::csgUnion(a, b);
    Tracker tracker(a, &interrupter);
    prepare(tracker, how);
    tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
      auto one = first->getConstAccessor();
      auto two = second->getConstAccessor();
      for (auto it = leaf.beginValueOn(); it; ++it) {
        const Coord voxel = it.getCoord();
        const double u = one.getValue(voxel), v = two.getValue(voxel);
        const double near = std::max(radius - std::abs(u - v), 0.0);
        it.setValue(static_cast<float>(std::min(u, v) - near * near / (4.0 * radius)));
      }
    });
    tracker.track();
  });
}

void grid_fillet(Grid& handle, double radius, Smoothing how, const Host& host) {
  FloatGrid& grid = floats(handle);
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    const FloatGrid::Ptr before = grid.deepCopy();
    {
      // A ball of the radius rolls around the outside: where it cannot reach is filled.
      tools::LevelSetFilter<FloatGrid> ball(grid, &interrupter);
      prepare(ball, how);
      ball.offset(static_cast<float>(-radius));
      ball.offset(static_cast<float>(radius));
    }
    // A fillet only adds: what tracking took elsewhere comes back.
    tools::csgUnion(grid, *before);
  });
}

void grid_prune(Grid& handle, const Host& host) {
  in_arena(host, [&] { tools::pruneLevelSet(floats(handle).tree()); });
}

}  // namespace druse
