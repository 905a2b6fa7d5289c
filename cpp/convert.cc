// Level sets to meshes, to fogs and back; meshes have OpenVDB's winding, which src/vdb/mesh.rs reverses.
#include "impl.h"

#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/Morphology.h>
#include <openvdb/tools/Prune.h>
#include <openvdb/tools/VolumeToMesh.h>
#include <openvdb/tree/LeafManager.h>

#include <algorithm>
#include <cmath>
#include <vector>

using namespace openvdb;

namespace druse {

struct Surface::Impl {
  std::vector<Vec3s> points;
  std::vector<Vec4I> quads;  // a triangle repeats its last index
};

Surface::Surface(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
Surface::~Surface() = default;

rust::Slice<const float> Surface::points() const {
  static_assert(sizeof(Vec3s) == 3 * sizeof(float), "points are packed");
  return {reinterpret_cast<const float*>(impl->points.data()), 3 * impl->points.size()};
}

rust::Slice<const std::uint32_t> Surface::quads() const {
  static_assert(sizeof(Vec4I) == 4 * sizeof(std::uint32_t), "quads are packed");
  return {reinterpret_cast<const std::uint32_t*>(impl->quads.data()), 4 * impl->quads.size()};
}

namespace {

// Magnitude of values that count as zero, voxels, as in the mesher of src/mesher.rs.
constexpr double zero_magnitude = 1e-6;

// A copy in which the vertices of several cells never coincide at one voxel in 32 bits, which would make edges of more
// than two faces where a wall lies in a plane of voxels: at voxels of several crossed edges small values are raised. A
// vertex on the only crossed edge of a voxel may lie at it: a plane through voxels is met exactly. What counts as zero
// is outside; other signs do not change. The grid may be a part of a whole with coordinates up to `max_coordinate`;
// all parts are then treated alike.
FloatGrid::Ptr without_small_values(const FloatGrid& grid, double max_coordinate) {
  const FloatGrid::Ptr copy = grid.deepCopy();
  const double h = grid.voxelSize()[0];
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  constexpr Int32 edge = Leaf::DIM;
  const Coord last = (box.max() & ~(edge - 1)).offsetBy(edge);
  const Vec3d low = grid.indexToWorld(box.min() & ~(edge - 1)), high = grid.indexToWorld(last);
  for (int a = 0; a < 3 && !box.empty(); ++a) max_coordinate = std::max({max_coordinate, std::abs(low[a]), std::abs(high[a])});
  // Eight units in the last place of the greatest coordinate in 32 bits, voxels; 1e-2 hardly moves the surface.
  const double rounding = 8.0 * max_coordinate / h * std::ldexp(1.0, -23);
  const auto min_magnitude = static_cast<float>(h * std::clamp(rounding, 1e-4, 1e-2));
  const auto zero = static_cast<float>(h * zero_magnitude);
  tree::LeafManager<FloatTree> leaves(copy->tree());
  leaves.foreach([&grid, min_magnitude, zero](Leaf& leaf, std::size_t) {
    FloatGrid::ConstAccessor original = grid.getConstAccessor();
    float* values = leaf.buffer().data();
    for (Index n = 0; n < Leaf::SIZE; ++n) {
      if (std::abs(values[n]) >= min_magnitude) continue;
      const Coord voxel = leaf.offsetToGlobalCoord(n);
      const bool inside = values[n] < -zero;
      int crossed = 0;
      for (int axis = 0; axis < 3; ++axis)
        for (int step = -1; step <= 1; step += 2) {
          Coord neighbour = voxel;
          neighbour[axis] += step;
          crossed += (original.getValue(neighbour) < -zero) != inside;
        }
      if (crossed > 1)
        values[n] = inside ? -min_magnitude : min_magnitude;
      else if (!inside)
        values[n] = std::max(values[n], 0.0f);
    }
  });
  return copy;
}

}  // namespace

std::unique_ptr<Surface> grid_to_mesh(const Grid& handle, double adaptivity, double max_coordinate, const Host& host) {
  auto surface = std::make_unique<Surface::Impl>();
  // volumeToMesh takes no interrupter; cancellation is checked before and after.
  Interrupter interrupter(host);
  if (interrupter.wasInterrupted()) throw std::runtime_error("interrupted");
  in_arena(host, [&] {
    std::vector<Vec3I> triangles;
    const FloatGrid::Ptr grid = without_small_values(floats(handle), max_coordinate);
    tools::volumeToMesh(*grid, surface->points, triangles, surface->quads, /*isovalue=*/0.0, adaptivity,
                        /*relaxDisorientedTriangles=*/true);
    surface->quads.reserve(surface->quads.size() + triangles.size());
    for (const Vec3I& t : triangles) surface->quads.emplace_back(t[0], t[1], t[2], t[2]);
  });
  if (host_cancelled(host)) throw std::runtime_error("interrupted");
  return std::make_unique<Surface>(std::move(surface));
}

std::unique_ptr<Grid> grid_from_mesh(rust::Slice<const float> points, rust::Slice<const std::uint32_t> triangles,
                                     double voxel_size, float half_width, const Host& host) {
  const auto transform = math::Transform::createLinearTransform(voxel_size);
  std::vector<Vec3s> vertices(points.size() / 3);
  for (std::size_t n = 0; n < vertices.size(); ++n) {
    const Vec3d world(points[3 * n], points[3 * n + 1], points[3 * n + 2]);
    vertices[n] = Vec3s(transform->worldToIndex(world));
  }
  std::vector<Vec3I> faces(triangles.size() / 3);
  for (std::size_t n = 0; n < faces.size(); ++n) {
    faces[n] = Vec3I(triangles[3 * n], triangles[3 * n + 1], triangles[3 * n + 2]);
    for (int a = 0; a < 3; ++a)
      if (faces[n][a] >= vertices.size()) throw std::out_of_range("a triangle refers to a vertex that does not exist");
  }
  FloatGrid::Ptr grid;
  Interrupter interrupter(host);
  in_arena(host, [&] {
    const tools::QuadAndTriangleDataAdapter<Vec3s, Vec3I> mesh(vertices, faces);
    grid = tools::meshToVolume<FloatGrid>(static_cast<util::NullInterrupter&>(interrupter), mesh, *transform,
                                          half_width, half_width);
  });
  if (interrupter.wasInterrupted()) throw std::runtime_error("interrupted");
  grid->setGridClass(GRID_LEVEL_SET);
  grid->setName("surface");
  return wrap(grid);
}

std::unique_ptr<Grid> grid_fog(const Grid& handle, const Host& host) {
  FloatGrid::Ptr fog;
  in_arena(host, [&] {
    fog = floats(handle).deepCopy();
    // Only the signs of inactive values are stored in files; the fog must not depend on more.
    const float outside = fog->background();
    tree::LeafManager<FloatTree> leaves(fog->tree());
    leaves.foreach([outside](Leaf& leaf, std::size_t) {
      for (auto it = leaf.beginValueOff(); it; ++it) it.setValue(*it < 0 ? -outside : outside);
    });
    tools::pruneLevelSet(fog->tree());
    tools::sdfToFogVolume(*fog);
    fog->setName("density");
  });
  return wrap(fog);
}

std::unique_ptr<Grid> grid_unfogged(const Grid& handle, double ramp, const Host& host) {
  FloatGrid::Ptr made;
  in_arena(host, [&] {
    const FloatGrid& fog = floats(handle);
    const float outside = static_cast<float>(ramp);
    made = fog.deepCopy();
    FloatTree& tree = made->tree();
    tools::dilateActiveValues(tree, 1, tools::NN_FACE);
    auto tile = tree.beginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) tile.setValue(*tile > 0 ? -*tile * outside : outside);
    tree::LeafManager<FloatTree> leaves(tree);
    leaves.foreach([&](Leaf& leaf, std::size_t) {
      const auto densities = fog.getConstAccessor();
      for (auto it = leaf.beginValueAll(); it; ++it) {
        if (*it > 0) {
          it.setValue(-*it * outside);
          continue;
        }
        // Distances in ramps, at most one; inactive voxels get more. Along each axis the density goes on falling beyond
        // the surface, to 2 first - second; the nearest surface counts.
        float least = it.isValueOn() ? 1.0f : 2.0f;
        for (int side = 0; side < 6 && it.isValueOn(); ++side) {
          Coord step(0);
          step[side / 2] = side % 2 ? 1 : -1;
          const Coord next = it.getCoord() + step;
          const float first = densities.getValue(next), second = densities.getValue(next + step);
          if (!(first > 0)) continue;
          // In a thin wall the second voxel tells nothing; the density then falls by a voxel of the ramp.
          const float beyond = second > first ? second - 2 * first : 1 / outside - first;
          least = std::min(least, std::max(beyond, 0.0f));
        }
        it.setValue(least * outside);
      }
    });
    tree.root().setBackground(outside, /*updateChildNodes=*/false);
  });
  return wrap(made);
}

}  // namespace druse
