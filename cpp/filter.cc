// Operations on the narrow band that need neighbours; each ends within the interrupter's reach.
#include "impl.h"

#include <openvdb/tools/LevelSetFilter.h>

using namespace openvdb;

namespace druse {

namespace {

using Worker = tools::LevelSetFilter<FloatGrid>;

// Sets up the filter, runs `work` on it and throws when the user asked to stop: the grid is then
// in between and must be thrown away.
template <typename Work>
void filtered(Grid& handle, const Smoothing& how, const Host& host, Work&& work) {
  ThrowingInterrupter interrupter(host);
  in_arena(host, [&] {
    Worker worker(floats(handle), &interrupter);
    worker.setSpatialScheme(how.high_order ? math::HJWENO5_BIAS : math::FIRST_BIAS);
    worker.setGrainSize(1);
    if (how.normalisations >= 0) worker.setNormCount(how.normalisations);
    work(worker);
  });
  if (host_cancelled(host)) throw std::runtime_error("interrupted");
}

}  // namespace

void grid_filter(Grid& handle, Filter kind, Smoothing how, const Host& host) {
  filtered(handle, how, host, [&](Worker& worker) {
    for (int n = 0; n < how.iterations; ++n) {
      switch (kind) {
        case Filter::Mean: worker.mean(how.width); break;
        case Filter::Gaussian: worker.gaussian(how.width); break;
        case Filter::Median: worker.median(how.width); break;
        case Filter::Laplacian: worker.laplacian(); break;
        case Filter::Curvature: worker.meanCurvature(); break;
        default: throw std::invalid_argument("unknown filter");
      }
    }
  });
}

void grid_offset(Grid& handle, double offset, Smoothing how, const Host& host) {
  filtered(handle, how, host,
           [&](Worker& worker) { worker.offset(static_cast<float>(offset)); });
}

void grid_renormalise(Grid& handle, Smoothing how, const Host& host) {
  filtered(handle, how, host, [&](Worker& worker) { worker.track(); });
}

}  // namespace druse
