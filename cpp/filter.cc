// Offsets and filters of OpenVDB; all can be interrupted.
#include "impl.h"

#include <openvdb/tools/LevelSetFilter.h>

using namespace openvdb;

namespace druse {

namespace {

using LevelSetFilter = tools::LevelSetFilter<FloatGrid>;

// Sets up the filter, runs `work` on it and throws on cancellation; the grid is then invalid and must be discarded.
template <typename Work>
void with_filter(Grid& handle, const Smoothing& smoothing, const Host& host, Work&& work) {
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    LevelSetFilter filter(floats(handle), &interrupter);
    filter.setSpatialScheme(smoothing.high_order ? math::HJWENO5_BIAS : math::FIRST_BIAS);
    filter.setGrainSize(1);  // a leaf is work enough for a task
    if (smoothing.normalisations >= 0) filter.setNormCount(smoothing.normalisations);
    work(filter);
  });
  if (host_cancelled(host)) throw std::runtime_error("interrupted");
}

}  // namespace

void grid_filter(Grid& handle, Filter kind, Smoothing smoothing, const Host& host) {
  with_filter(handle, smoothing, host, [&](LevelSetFilter& filter) {
    for (int n = 0; n < smoothing.iterations; ++n) {
      switch (kind) {
        case Filter::Mean: filter.mean(smoothing.width); break;
        case Filter::Gaussian: filter.gaussian(smoothing.width); break;
        case Filter::Median: filter.median(smoothing.width); break;
        case Filter::Laplacian: filter.laplacian(); break;
        case Filter::Curvature: filter.meanCurvature(); break;
        default: throw std::invalid_argument("unknown filter");
      }
    }
  });
}

void grid_offset(Grid& handle, double offset, Smoothing smoothing, const Host& host) {
  with_filter(handle, smoothing, host,
           [&](LevelSetFilter& filter) { filter.offset(static_cast<float>(offset)); });
}

void grid_renormalise(Grid& handle, Smoothing smoothing, const Host& host) {
  with_filter(handle, smoothing, host, [&](LevelSetFilter& filter) { filter.track(); });
}

}  // namespace druse
