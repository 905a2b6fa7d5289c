// Rays against a level set: depth, normal and shadow of each sample; nothing about colour.
#include "impl.h"

#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/RayIntersector.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

using namespace openvdb;

namespace druse {

namespace {

using Ray = math::Ray<double>;
using Tester = tools::LevelSetRayIntersector<FloatGrid>;

constexpr double kFar = std::numeric_limits<double>::max();
constexpr std::size_t kNumbers = 6;

Vec3d vec(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

// One thread's view of the scene: the tester keeps accessors and is not to be shared.
class Tracer {
 public:
  Tracer(const FloatGrid& grid, const Tester& tester, const Camera& camera)
      : grid_(grid), access_(grid.getConstAccessor()), tester_(tester), camera_(camera), light_(vec(camera.light)) {
    if (camera.cut_axis >= 0) {
      axis_ = camera.cut_axis;
      // The side of the eye is left away.
      side_ = camera.forward[axis_] < 0 ? 1 : -1;
    }
  }

  void sample(std::size_t i, std::size_t j, float* out) {
    out[0] = std::numeric_limits<float>::infinity();
    Vec3d eye, direction;
    ray(i, j, eye, direction);
    double start = 0;
    if (axis_ >= 0 && side_ * (eye[axis_] - camera_.cut) > 0) {
      if (side_ * direction[axis_] >= 0) return;  // never leaves what is left away
      start = (camera_.cut - eye[axis_]) / direction[axis_];
      if (value(eye + direction * start) < 0) {
        Vec3d normal(0);
        normal[axis_] = side_;
        return store(out, eye + direction * start, normal, start, true);
      }
    }
    const Ray beyond(eye + direction * start, direction, 1e-6 * grid_.voxelSize()[0], kFar);
    Vec3d point, normal;
    double time = 0;
    if (tester_.intersectsWS(beyond, point, normal, time)) {
      if (normal.dot(direction) > 0) normal = -normal;
      store(out, point, normal, (point - eye).dot(direction), false);
    }
  }

  // Puts a sample that was found in the light, perhaps in another grid, into this one's shadow.
  void shade(std::size_t i, std::size_t j, float* out) {
    if (!std::isfinite(out[0]) || out[5] == 0) return;
    Vec3d eye, direction;
    ray(i, j, eye, direction);
    const Vec3d normal(out[1], out[2], out[3]);
    if (!is_lit(eye + direction * double(out[0]) + normal * (1.5 * grid_.voxelSize()[0]))) out[5] = 0;
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

  float value(const Vec3d& world) { return tools::BoxSampler::sample(access_, grid_.worldToIndex(world)); }

  void store(float* out, const Vec3d& point, const Vec3d& normal, double depth, bool on_cut) {
    out[0] = static_cast<float>(depth);
    for (int a = 0; a < 3; ++a) out[1 + a] = static_cast<float>(normal[a]);
    out[4] = on_cut ? 1.0f : 0.0f;
    out[5] = normal.dot(light_) > 0 && is_lit(point + normal * (1.5 * grid_.voxelSize()[0])) ? 1.0f : 0.0f;
  }

  bool is_lit(const Vec3d& point) {
    double end = kFar;
    if (axis_ >= 0 && side_ * light_[axis_] > 0) {
      end = (camera_.cut - point[axis_]) / light_[axis_];
      if (end <= 0) return true;
    }
    return !tester_.intersectsWS(Ray(point, light_, 1e-6 * grid_.voxelSize()[0], end));
  }

  const FloatGrid& grid_;
  FloatGrid::ConstAccessor access_;
  Tester tester_;
  const Camera& camera_;
  Vec3d light_;
  int axis_ = -1;
  double side_ = 1;
};

}  // namespace

namespace {

// Calls `visit` for each sample of a view, rows in parallel, with a tracer and the sample's numbers.
template <typename Visit>
void each_sample(const FloatGrid& grid, const Camera& camera, rust::Slice<float> hits, const Host& host,
                 Visit&& visit) {
  if (hits.size() != kNumbers * camera.columns * camera.rows)
    throw std::invalid_argument("the picture's buffer has " + std::to_string(hits.size()) + " numbers");
  const Tester tester(grid);
  Interrupter interrupter(host);
  in_arena(host, [&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, camera.rows, 8), [&](const auto& rows) {
      Tracer tracer(grid, tester, camera);
      for (std::size_t j = rows.begin(); j != rows.end(); ++j) {
        if (interrupter.wasInterrupted()) return;
        for (std::size_t i = 0; i < camera.columns; ++i)
          visit(tracer, i, j, hits.data() + kNumbers * (j * camera.columns + i));
      }
    });
  });
  if (interrupter.wasInterrupted()) throw std::runtime_error("interrupted");
}

}  // namespace

void grid_trace(const Grid& handle, const Camera& camera, rust::Slice<float> hits, const Host& host) {
  const FloatGrid& grid = floats(handle);
  if (grid.empty()) {
    for (std::size_t n = 0; n < hits.size(); n += kNumbers) hits[n] = std::numeric_limits<float>::infinity();
    return;
  }
  each_sample(grid, camera, hits, host,
              [](Tracer& tracer, std::size_t i, std::size_t j, float* out) { tracer.sample(i, j, out); });
}

void grid_shade(const Grid& handle, const Camera& camera, rust::Slice<float> hits, const Host& host) {
  const FloatGrid& grid = floats(handle);
  if (grid.empty()) return;
  each_sample(grid, camera, hits, host,
              [](Tracer& tracer, std::size_t i, std::size_t j, float* out) { tracer.shade(i, j, out); });
}

}  // namespace druse
