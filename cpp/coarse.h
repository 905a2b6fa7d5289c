// A coarser copy of a level set, leaf by leaf.
#pragma once

#include "impl.h"

#include <algorithm>
#include <vector>

namespace druse {

// A voxel of the copy is the mean of step^3 voxels (2, 4 or 8 along each axis). The copy has a leaf wherever the grid
// has one in reach, and one more around, so that its surface never leaves its leaves.
class CoarseCopy {
 public:
  using Coord = openvdb::Coord;
  using Mask = Leaf::NodeMaskType;

  CoarseCopy(float background, std::int32_t step);

  // Notes a leaf of the grid by its origin; all of them before the first value.
  void note_leaf(const Coord& origin);

  // Makes the leaves of the copy. `tiles_from(first)` is for the cube of 8 step voxels at `first`, and returns a function
  // of a voxel there: the value of the tile at a place that may have no leaf in the grid.
  template <typename TilesFrom>
  void make_leaves(TilesFrom&& tiles_from) {
    const auto make_unique = [](std::vector<Coord>& list) {
      std::sort(list.begin(), list.end());
      list.erase(std::unique(list.begin(), list.end()), list.end());
    };
    make_unique(origins_);
    std::vector<Coord> all;
    all.reserve(27 * origins_.size());
    for (const Coord& origin : origins_) {
      for (int n = 0; n < 27; ++n) all.push_back(origin.offsetBy(8 * (n / 9 - 1), 8 * (n / 3 % 3 - 1), 8 * (n % 3 - 1)));
    }
    make_unique(all);
    for (const Coord& origin : all) {
      auto out = std::make_unique<Leaf>(origin, grid_->background(), /*active=*/false);
      const Coord first(origin.x() * step_, origin.y() * step_, origin.z() * step_);
      const auto tile_value = tiles_from(first);
      for (int n = 0; n < step_ * step_ * step_; ++n) {
        const Coord part(n / (step_ * step_), n / step_ % step_, n % step_);
        const float value = tile_value(first.offsetBy(8 * part.x(), 8 * part.y(), 8 * part.z()));
        for_part(part, [&](openvdb::Index at, int, int, int) { out->setValueOff(at, value); });
      }
      grid_->tree().addLeaf(out.release());
    }
  }

  // The values of a leaf that was noted. Leaves in different cubes of 64 voxels may be put on different threads.
  void put(const Coord& origin, const float* values, const Mask& active);

  std::int32_t step() const { return step_; }

  // The mean of a leaf that was noted, with a step of 8, and whether any of its voxels is active.
  void put_mean(const Coord& origin, float mean, bool on);

  // The copy, in the frame of the grid.
  std::unique_ptr<Grid> finish(const openvdb::math::Transform& fine);

 private:
  openvdb::FloatGrid::Ptr grid_;
  std::int32_t step_;
  std::vector<Coord> origins_;
  Coord last_{1, 1, 1};  // no origin

  Coord leaf_of(const Coord& fine) const;

  // Calls `visit` with the numbers of the copy's voxels in a part of a leaf, and their positions in the part.
  template <typename Visit>
  void for_part(const Coord& part, Visit&& visit) const {
    const int edge = 8 / step_;
    for (int i = 0; i < edge; ++i) {
      for (int j = 0; j < edge; ++j) {
        for (int k = 0; k < edge; ++k) {
          const int x = edge * part.x() + i, y = edge * part.y() + j, z = edge * part.z() + k;
          visit(static_cast<openvdb::Index>(x << 6 | y << 3 | z), i, j, k);
        }
      }
    }
  }
};

}  // namespace druse
