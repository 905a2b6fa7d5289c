// Coarser copies of level sets for views: means over cubes of voxels.
#include "coarse.h"

#include <stdexcept>

using namespace openvdb;

namespace druse {

CoarseCopy::CoarseCopy(float background, std::int32_t step) : grid_(FloatGrid::create(background)), step_(step) {
  if (step != 2 && step != 4 && step != 8) throw std::invalid_argument("the step of a coarse copy is 2, 4 or 8");
  grid_->setGridClass(GRID_LEVEL_SET);
}

Coord CoarseCopy::leaf_of(const Coord& fine) const {
  // A leaf of the copy covers step^3 leaves; quotients are rounded down, below 0 too.
  const auto divided = [&](int v) { return v >= 0 ? v / step_ : -((step_ - 1 - v) / step_); };
  return Coord(8 * divided(fine.x() >> 3), 8 * divided(fine.y() >> 3), 8 * divided(fine.z() >> 3));
}

void CoarseCopy::note_leaf(const Coord& origin) {
  const Coord own = leaf_of(origin);
  if (own != last_) origins_.push_back(own);
  last_ = own;
}

void CoarseCopy::put(const Coord& origin, const float* values, const Mask& active) {
  const Coord own = leaf_of(origin);
  Leaf* leaf = grid_->tree().probeLeaf(own);
  if (!leaf) throw std::runtime_error("a leaf without topology");
  const Coord first = origin - Coord(own.x() * step_, own.y() * step_, own.z() * step_);
  const float scale = 1.0f / static_cast<float>(step_ * step_ * step_);
  for_part(Coord(first.x() >> 3, first.y() >> 3, first.z() >> 3), [&](Index at, int i, int j, int k) {
    float sums[8] = {};  // in turns, so that one sum does not wait for the other
    std::uint64_t on = 0;
    for (int a = 0; a < step_; ++a) {
      const int x = step_ * i + a;
      const std::uint64_t word = active.template getWord<std::uint64_t>(static_cast<Index>(x));  // 8 y + z
      for (int b = 0; b < step_; ++b) {
        const int row = 8 * (step_ * j + b) + step_ * k;
        for (int c = 0; c < step_; ++c) sums[c] += values[64 * x + row + c];
        on |= word >> row & ((1u << step_) - 1);
      }
    }
    float sum = 0.0f;
    for (const float part : sums) sum += part;
    leaf->setValueOnly(at, sum * scale);
    leaf->setActiveState(at, on != 0);
  });
}

void CoarseCopy::put_mean(const Coord& origin, float mean, bool on) {
  Leaf* leaf = grid_->tree().probeLeaf(leaf_of(origin));
  if (!leaf) throw std::runtime_error("a leaf without topology");
  const Coord voxel(origin.x() >> 3, origin.y() >> 3, origin.z() >> 3);
  leaf->setValueOnly(voxel, mean);
  leaf->setActiveState(voxel, on);
}

std::unique_ptr<Grid> CoarseCopy::finish(const math::Transform& fine) {
  const auto transform = fine.copy();
  // Voxel (0, 0, 0) of the copy is in the middle of step^3 voxels.
  transform->preScale(step_);
  const Vec3d centre = fine.indexToWorld(Vec3d(0.5 * (step_ - 1)));
  transform->postTranslate(centre - fine.indexToWorld(Vec3d(0.0)));
  grid_->setTransform(transform);
  return wrap(grid_);
}

// The values of a leaf are freed when they are read: the grid then has topology only.
std::unique_ptr<Grid> grid_coarse(Grid& handle, std::int32_t step) {
  FloatGrid& fine = floats(handle);
  CoarseCopy copy(fine.background(), step);
  for (auto leaf = fine.tree().cbeginLeaf(); leaf; ++leaf) copy.note_leaf(leaf->origin());
  auto accessor = fine.getConstAccessor();
  // Where a leaf is, the value does not matter: its own follow.
  copy.make_leaves([&](const Coord&) {
    return [&](const Coord& at) { return accessor.probeConstLeaf(at) ? fine.background() : accessor.getValue(at); };
  });
  for (auto leaf = fine.tree().beginLeaf(); leaf; ++leaf) {
    copy.put(leaf->origin(), leaf->buffer().data(), leaf->valueMask());
    Leaf::Buffer nothing(PartialCreate(), 0.0f);
    leaf->swap(nothing);
  }
  return copy.finish(fine.transform());
}

}  // namespace druse
