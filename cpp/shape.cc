// Operations that OpenVDB 10 has no tool for: bands of other widths, offsets that vary, masks, blended union, fillets.
#include "impl.h"

#include <openvdb/math/Stencils.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/LevelSetRebuild.h>
#include <openvdb/tools/LevelSetTracker.h>
#include <openvdb/tools/Prune.h>

#include <tbb/parallel_reduce.h>

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
      : sampler_(grid.getConstAccessor(), grid.transform()), range_(range) {}

  double operator()(const Vec3d& world) const {
    const double t = (sampler_.wsSample(world) - range_.low) / (range_.high - range_.low);
    const double share = std::clamp(t, 0.0, 1.0);
    return range_.inverted ? 1.0 - share : share;
  }

 private:
  tools::GridSampler<FloatGrid::ConstAccessor, tools::BoxSampler> sampler_;
  Range range_;
};

}  // namespace

void grid_resize(Grid& handle, int voxels, Smoothing how, const Host& host) {
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    Tracker tracker(floats(handle), &interrupter);
    prepare(tracker, how);
    if (voxels > 0) tracker.dilate(voxels);
    if (voxels < 0) tracker.erode(-voxels);
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
    const int steps = std::max(1, static_cast<int>(std::ceil(std::abs(offset) / (0.5 * h))));
    const double step = offset / steps;
    for (int n = 0; n < steps; ++n) {
      tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
        const Share share(mask, range);
        for (auto it = leaf.beginValueOn(); it; ++it) {
          const Vec3d world = grid.indexToWorld(it.getCoord());
          it.setValue(*it + static_cast<float>(step * share(world)));
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
    tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
      const Share share(mask, range);
      auto access = old.getConstAccessor();
      for (auto it = leaf.beginValueOn(); it; ++it) {
        const Coord voxel = it.getCoord();
        const double a = share(grid.indexToWorld(voxel));
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
      Tracker tracker(grid, &interrupter);
      prepare(tracker, how);
      const double h = grid.voxelSize()[0];
      // Explicit steps of a flow by one curvature: h^2 / 2 is the limit of stability.
      const double dt = 0.25 * h * h;
      const int most = 40 + static_cast<int>(40.0 * radius * radius / (h * h));
      for (int n = 0; n < most; ++n) {
        auto& leaves = tracker.leafs();
        leaves.rebuildAuxBuffers(1);
        const auto step = [&](const tree::LeafManager<FloatTree>::LeafRange& range, double moved) {
          math::CurvatureStencil<FloatGrid, false> stencil(grid);
          for (auto leaf = range.begin(); leaf; ++leaf) {
            float* out = leaf.buffer(1).data();
            for (auto it = leaf->cbeginValueOn(); it; ++it) {
              const float phi = *it;
              out[it.pos()] = phi;
              if (std::abs(phi) > 2.0 * h) continue;
              stencil.moveTo(it);
              float mean = 0, gauss = 0;
              stencil.curvatures(mean, gauss);
              const double least = mean - std::sqrt(std::max(0.0, double(mean) * mean - gauss));
              // The grid cannot show curvatures beyond 1 / h.
              const double speed = std::min(0.0, std::max(least, -1.0 / h) + 1.0 / radius);
              out[it.pos()] = static_cast<float>(phi + dt * speed);
              if (std::abs(phi) < h) moved = std::max(moved, -dt * speed);
            }
          }
          return moved;
        };
        const double moved = tbb::parallel_reduce(leaves.leafRange(), 0.0, step,
                                                  [](double a, double b) { return std::max(a, b); });
        leaves.swapLeafBuffer(1);
        leaves.removeAuxBuffers();
        const bool done = moved < 2e-3 * h || n + 1 == most;
        if (n % 4 == 3 || done) {
          tracker.track();
          // Tracking moves the surface a little everywhere: where the flow did not, it stays as it was.
          tracker.leafs().foreach([&](Leaf& leaf, std::size_t) {
            auto old = before->getConstAccessor();
            for (auto it = leaf.beginValueOn(); it; ++it) {
              const float value = old.getValue(it.getCoord());
              if (value - *it < 0.03 * h) it.setValue(value);
            }
          });
        }
        if (done) break;
      }
    }
    // A fillet only adds.
    tools::csgUnion(grid, *before);
  });
}

void grid_prune(Grid& handle, const Host& host) {
  in_arena(host, [&] { tools::pruneLevelSet(floats(handle).tree()); });
}

std::unique_ptr<Grid> grid_isosurface(const Grid& handle, double value, float half_width, const Host& host) {
  Interrupter interrupter(host);
  FloatGrid::Ptr grid;
  in_arena(host, [&] {
    grid = tools::levelSetRebuild(floats(handle), static_cast<float>(value), half_width, half_width, nullptr,
                                  static_cast<util::NullInterrupter*>(&interrupter));
  });
  if (interrupter.wasInterrupted()) throw std::runtime_error("interrupted");
  grid->setGridClass(GRID_LEVEL_SET);
  grid->setName("surface");
  return wrap(grid);
}

}  // namespace druse
