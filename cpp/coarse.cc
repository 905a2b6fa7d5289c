// Coarser copies of level sets for views: means over cubes of voxels.
#include "impl.h"

#include <set>
#include <stdexcept>

using namespace openvdb;

namespace druse {

// A voxel of the copy is the mean of step^3 voxels (2, 4 or 8 along each axis). The copy has a leaf wherever the grid
// has one in reach, and one more around, so that its surface never leaves its leaves. The values of a leaf are freed when
// they are read: the grid then has topology only.
std::unique_ptr<Grid> grid_coarse(Grid& handle, std::int32_t step) {
  if (step != 2 && step != 4 && step != 8) throw std::invalid_argument("the step of a coarse copy is 2, 4 or 8");
  FloatGrid& fine = floats(handle);
  auto coarse = FloatGrid::create(fine.background());
  coarse->setGridClass(GRID_LEVEL_SET);
  const int edge = 8 / step;  // coarse voxels along a fine leaf
  std::set<Coord> origins;
  for (auto leaf = fine.tree().cbeginLeaf(); leaf; ++leaf) {
    const Coord at = leaf->origin();
    const Coord own(at.x() >> 3, at.y() >> 3, at.z() >> 3);
    const auto floor_div = [&](int v) { return v >= 0 ? v / step : -((step - 1 - v) / step); };
    const Coord cube(floor_div(own.x()), floor_div(own.y()), floor_div(own.z()));
    origins.insert(Coord(8 * cube.x(), 8 * cube.y(), 8 * cube.z()));
  }
  std::set<Coord> all;
  for (const Coord& origin : origins) {
    for (int n = 0; n < 27; ++n) all.insert(origin.offsetBy(8 * (n / 9 - 1), 8 * (n / 3 % 3 - 1), 8 * (n % 3 - 1)));
  }
  auto accessor = fine.getAccessor();
  const float scale = 1.0f / static_cast<float>(step * step * step);
  for (const Coord& origin : all) {
    auto out = std::make_unique<Leaf>(origin, fine.background(), false);
    for (int x = 0; x < step; ++x) {
      for (int y = 0; y < step; ++y) {
        for (int z = 0; z < step; ++z) {
          const Coord first(origin.x() * step + 8 * x, origin.y() * step + 8 * y, origin.z() * step + 8 * z);
          Leaf* leaf = accessor.probeLeaf(first);
          const float tile = leaf ? 0.0f : accessor.getValue(first);
          const float* values = leaf ? leaf->buffer().data() : nullptr;
          for (int i = 0; i < edge; ++i) {
            for (int j = 0; j < edge; ++j) {
              for (int k = 0; k < edge; ++k) {
                const Coord at(origin.x() + edge * x + i, origin.y() + edge * y + j, origin.z() + edge * z + k);
                if (!leaf) {
                  out->setValueOff(at, tile);
                  continue;
                }
                float sum = 0.0f;
                bool active = false;
                for (int a = 0; a < step; ++a) {
                  for (int b = 0; b < step; ++b) {
                    for (int c = 0; c < step; ++c) {
                      const Index n = static_cast<Index>((step * i + a) << 6 | (step * j + b) << 3 | (step * k + c));
                      sum += values[n];
                      active = active || leaf->isValueOn(n);
                    }
                  }
                }
                if (active) {
                  out->setValueOn(at, sum * scale);
                } else {
                  out->setValueOff(at, sum * scale);
                }
              }
            }
          }
          if (leaf) {
            Leaf::Buffer nothing(PartialCreate(), 0.0f);
            leaf->swap(nothing);
          }
        }
      }
    }
    coarse->tree().addLeaf(out.release());
  }
  const auto transform = fine.transform().copy();
  // Voxel (0, 0, 0) of the copy is in the middle of step^3 voxels.
  transform->preScale(step);
  const Vec3d centre = fine.transform().indexToWorld(Vec3d(0.5 * (step - 1)));
  transform->postTranslate(centre - fine.transform().indexToWorld(Vec3d(0.0)));
  coarse->setTransform(transform);
  return wrap(coarse);
}

}  // namespace druse
