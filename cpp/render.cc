// Ray casting of a level set: depth, normal and shadow of each sample.
//
// A ray advances by the distance at its position (sphere tracing), leaves tiles at their boundary, and finds the
// zero between two positions of different sign. This takes about a dozen tree accesses per ray.
#include "impl.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

using namespace openvdb;

namespace druse {

namespace {

constexpr double kFar = std::numeric_limits<double>::max();
constexpr std::size_t kRayValues = 6;

// Steps, in voxels. A step of this share of the distance does not cross the surface, even where the slope of the
// values exceeds 1. The minimum step is below the size of details that a grid can resolve.
constexpr double kStepShare = 0.9, kMinStep = 0.35;
// Greatest distance of a point from the nearest voxel centre, sqrt(3) / 2, rounded up.
constexpr double kCentreDistance = 0.87;
// Distance from the surface, voxels, at which the way to the light begins, so that it does not meet it at once.
constexpr double kShadowStart = 1.5;
// Greatest number of steps to refine a zero.
constexpr int kRootSteps = 4;

Vec3d vec(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

// A hit: the length of the ray, voxels, and the gradient there.
struct Hit {
  double time;
  Vec3d gradient;
};

// Traces rays on one thread (accessors are not shared). Lengths are in voxels, those of the camera in world units.
class Tracer {
 public:
  Tracer(const FloatGrid& grid, const CoordBBox& box, const Camera& camera)
      : grid_(grid), access_(grid.getConstAccessor()), camera_(camera), light_(vec(camera.light)) {
    voxel_ = grid.voxelSize()[0];
    per_voxel_ = 1.0 / voxel_;
    low_ = box.min().asVec3d() - Vec3d(1.0);
    high_ = box.max().asVec3d() + Vec3d(1.0);
    if (camera.cut_axis >= 0) {
      cut_axis_ = camera.cut_axis;
      // The eye's side of the cut is not shown.
      cut_side_ = camera.forward[cut_axis_] < 0 ? 1 : -1;
    }
  }

  // The six values of the hit of a sample; the depth is infinite without one.
  void sample(std::size_t i, std::size_t j, float* out) {
    out[0] = std::numeric_limits<float>::infinity();
    Vec3d eye, direction;
    ray(i, j, eye, direction);
    double start = 0;
    if (cut_axis_ >= 0 && cut_side_ * (eye[cut_axis_] - camera_.cut) > 0) {
      if (cut_side_ * direction[cut_axis_] >= 0) return;  // stays on the hidden side
      start = (camera_.cut - eye[cut_axis_]) / direction[cut_axis_];
      const Vec3d at = grid_.worldToIndex(eye + direction * start);
      if ((cell(at) ? value() : access_.getValue(base_)) < 0) {
        Vec3d normal(0);
        normal[cut_axis_] = cut_side_;
        return store(out, eye + direction * start, normal, start, /*on_cut=*/true);
      }
    }
    Hit found;
    if (march(grid_.worldToIndex(eye), direction, start * per_voxel_, kFar, found)) {
      Vec3d normal = found.gradient;
      normal.normalize();
      if (normal.dot(direction) > 0) normal = -normal;
      const double depth = found.time * voxel_;
      store(out, eye + direction * depth, normal, depth, /*on_cut=*/false);
    }
  }

  // Removes the light from a hit, of this or another grid, that lies in this grid's shadow.
  void shade(std::size_t i, std::size_t j, float* out) {
    if (!std::isfinite(out[0]) || out[5] == 0) return;
    Vec3d eye, direction;
    ray(i, j, eye, direction);
    const Vec3d normal(out[1], out[2], out[3]);
    if (!is_lit(eye + direction * double(out[0]) + normal * (kShadowStart * voxel_))) out[5] = 0;
  }

 private:
  void ray(std::size_t i, std::size_t j, Vec3d& eye, Vec3d& direction) const {
    eye = vec(camera_.corner) + vec(camera_.du) * (double(i) + 0.5) + vec(camera_.dv) * (double(j) + 0.5);
    direction = vec(camera_.forward);
    if (camera_.perspective) {
      direction = eye - vec(camera_.eye);
      direction.normalize();
      eye = vec(camera_.eye);
    }
  }

  void store(float* out, const Vec3d& point, const Vec3d& normal, double depth, bool on_cut) {
    out[0] = static_cast<float>(depth);
    for (int a = 0; a < 3; ++a) out[1 + a] = static_cast<float>(normal[a]);
    out[4] = on_cut ? 1.0f : 0.0f;
    out[5] = normal.dot(light_) > 0 && is_lit(point + normal * (kShadowStart * voxel_)) ? 1.0f : 0.0f;
  }

  bool is_lit(const Vec3d& point) {
    double end = kFar;
    if (cut_axis_ >= 0 && cut_side_ * light_[cut_axis_] > 0) {
      end = (camera_.cut - point[cut_axis_]) / light_[cut_axis_];
      if (end <= 0) return true;
    }
    Hit found;
    return !march(grid_.worldToIndex(point), light_, 0, end == kFar ? kFar : end * per_voxel_, found);
  }

  // Moves to the cell around a point; false if its least voxel is not in a leaf.
  bool cell(const Vec3d& at) {
    const Coord base = Coord::floor(at);
    fraction_ = at - base.asVec3d();
    if (base == base_ && leaf_) return true;
    base_ = base;
    corner_ = nullptr;
    if (!leaf_ || (base & ~7) != leaf_->origin()) leaf_ = access_.probeConstLeaf(base);
    return leaf_ != nullptr;
  }

  // Finds the values at the corners of the cell. Many steps do without them.
  void load_corners() {
    if (corner_) return;
    Corners& known = corners_[Leaf::coordToOffset(base_)];
    corner_ = known.value;
    if (known.base == base_) return;
    known.base = base_;
    const auto inner = [](int c) { return (c & 7) != 7; };
    if (inner(base_[0]) && inner(base_[1]) && inner(base_[2])) {
      const float* v = leaf_->buffer().data() + Leaf::coordToOffset(base_);
      const int corner[8] = {0, 1, 8, 9, 64, 65, 72, 73};
      for (int c = 0; c < 8; ++c) known.value[c] = v[corner[c]] * per_voxel_;
    } else {
      for (int c = 0; c < 8; ++c)
        known.value[c] = access_.getValue(base_.offsetBy(c >> 2, c >> 1 & 1, c & 1)) * per_voxel_;
    }
  }

  // Trilinear value at the current point of the cell.
  double value() {
    load_corners();
    double x[4];
    for (int c = 0; c < 4; ++c) x[c] = corner_[c] + (corner_[c + 4] - corner_[c]) * fraction_[0];
    const double y0 = x[0] + (x[2] - x[0]) * fraction_[1], y1 = x[1] + (x[3] - x[1]) * fraction_[1];
    return y0 + (y1 - y0) * fraction_[2];
  }

  Vec3d gradient() {
    load_corners();
    const double x = fraction_[0], y = fraction_[1], z = fraction_[2];
    const auto mix = [](double a, double b, double t) { return a + (b - a) * t; };
    const auto along = [&](int step, int u, int v, double s, double t) {
      const auto rise = [&](int c) { return corner_[c + step] - corner_[c]; };
      return mix(mix(rise(0), rise(u), s), mix(rise(v), rise(u + v), s), t);
    };
    return {along(4, 2, 1, y, z), along(2, 4, 1, x, z), along(1, 4, 2, x, y)};
  }

  // Finds the first point between two lengths of a ray at which it enters the solid from outside.
  bool march(const Vec3d& from, const Vec3d& direction, double time, double end, Hit& found) {
    for (int a = 0; a < 3; ++a) {
      if (direction[a] == 0) {
        if (from[a] < low_[a] || from[a] > high_[a]) return false;
        continue;
      }
      const double one = (low_[a] - from[a]) / direction[a], other = (high_[a] - from[a]) / direction[a];
      time = std::max(time, std::min(one, other));
      end = std::min(end, std::max(one, other));
    }
    double before = time, outside = 1;  // the last point outside, and its distance or less
    while (time <= end) {
      const Vec3d at = from + direction * time;
      if (!cell(at)) {
        time = leave_tile(at, direction, time);
        continue;
      }
      const double safe = leaf_value(at) - kCentreDistance;
      if (safe > kMinStep) {
        before = time;
        outside = safe;
        time += safe;
        continue;
      }
      const double distance = value();
      if (distance < 0) return refine_hit(from, direction, before, time, outside, distance, found);
      before = time;
      outside = distance;
      time += std::max(kStepShare * distance, kMinStep);
    }
    return false;
  }

  // The value at the voxel nearest to a point, if it is in the current leaf, else 0.
  double leaf_value(const Vec3d& at) const {
    const Coord nearest = Coord::round(at);
    if ((nearest & ~7) != leaf_->origin()) return 0;
    return leaf_->buffer().data()[Leaf::coordToOffset(nearest)] * per_voxel_;
  }

  // The length at which a ray leaves the tile that it is in.
  double leave_tile(const Vec3d& at, const Vec3d& direction, double time) {
    const int depth = access_.getValueDepth(base_);
    const Int32 edge = depth >= 2 ? 8 : depth == 1 ? 128 : 4096;
    const Vec3d low = (base_ & ~(edge - 1)).asVec3d();
    double step = kFar;
    for (int a = 0; a < 3; ++a) {
      if (direction[a] == 0) continue;
      step = std::min(step, (low[a] + (direction[a] > 0 ? edge : 0) - at[a]) / direction[a]);
    }
    // Slightly beyond the boundary, into the next node.
    return time + std::max(step, 0.0) + 1e-3;
  }

  // Refines the zero between a point outside and one inside, by false position.
  bool refine_hit(const Vec3d& from, const Vec3d& direction, double outer, double inner, double outside, double inside,
             Hit& found) {
    double time = inner;
    for (int n = 0; n < kRootSteps; ++n) {
      // Off the ends, at which a step would gain nothing.
      const double share = std::clamp(outside / (outside - inside), 0.02, 0.98);
      time = outer + (inner - outer) * share;
      if (!cell(from + direction * time)) break;
      const double distance = value();
      if (std::abs(distance) < 1e-4) break;  // voxels, far below a pixel
      if (distance < 0) {
        inner = time;
        inside = distance;
      } else {
        outer = time;
        outside = distance;
      }
    }
    if (!cell(from + direction * time)) cell(from + direction * (time = inner));
    found = {time, gradient()};
    return true;
  }

  const FloatGrid& grid_;
  FloatGrid::ConstAccessor access_;
  const Camera& camera_;
  Vec3d light_, low_, high_;
  double voxel_ = 1, per_voxel_ = 1;
  int cut_axis_ = -1;
  double cut_side_ = 1;
  // The current cell: its least voxel, the leaf of that voxel, the values at its corners once they were needed, the
  // position in the cell.
  Coord base_ = Coord::max();
  const Leaf* leaf_ = nullptr;
  const double* corner_ = nullptr;
  // The latest cells, as adjacent rays pass through the same ones; by the place of the least voxel in its leaf.
  struct Corners {
    Coord base = Coord::max();
    double value[8];
  };
  std::array<Corners, Leaf::SIZE> corners_;
  Vec3d fraction_{0.0};
};

// Calls `visit` in parallel for the given samples of a view, or for all, with a tracer and the sample's values.
template <typename Visit>
void for_each_sample(const FloatGrid& grid, const Camera& camera, rust::Slice<const std::uint32_t> samples,
                 rust::Slice<float> hits, const Host& host, Visit&& visit) {
  const std::size_t count = samples.empty() ? camera.columns * camera.rows : samples.size();
  if (hits.size() != kRayValues * count)
    throw std::invalid_argument("the picture's buffer has " + std::to_string(hits.size()) + " numbers");
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  Interrupter interrupter(host);
  in_arena(host, [&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 4096), [&](const auto& range) {
      Tracer tracer(grid, box, camera);  // large: one for 4096 samples
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        if (n % 1024 == 0 && interrupter.wasInterrupted()) return;  // a check reads the clock
        const std::size_t at = samples.empty() ? n : samples[n];
        visit(tracer, at % camera.columns, at / camera.columns, hits.data() + kRayValues * n);
      }
    });
  });
  if (interrupter.wasInterrupted()) throw std::runtime_error("interrupted");
}

}  // namespace

void grid_trace(const Grid& handle, const Camera& camera, rust::Slice<const std::uint32_t> samples,
                rust::Slice<float> hits, const Host& host) {
  const FloatGrid& grid = floats(handle);
  if (grid.empty()) {
    for (std::size_t n = 0; n < hits.size(); n += kRayValues) hits[n] = std::numeric_limits<float>::infinity();
    return;
  }
  for_each_sample(grid, camera, samples, hits, host,
              [](Tracer& tracer, std::size_t i, std::size_t j, float* out) { tracer.sample(i, j, out); });
}

void grid_shade(const Grid& handle, const Camera& camera, rust::Slice<const std::uint32_t> samples,
                rust::Slice<float> hits, const Host& host) {
  const FloatGrid& grid = floats(handle);
  if (grid.empty()) return;
  for_each_sample(grid, camera, samples, hits, host,
              [](Tracer& tracer, std::size_t i, std::size_t j, float* out) { tracer.shade(i, j, out); });
}

}  // namespace druse
