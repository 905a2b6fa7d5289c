// Rays against a level set: for each sample its depth and the surface normal, nothing about light.
#include "impl.h"

#include <openvdb/tools/RayIntersector.h>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <limits>

using namespace openvdb;

namespace druse {

void grid_trace(const Grid& handle, const Camera& camera, rust::Slice<float> hits, const Host& host) {
  (void)handle; (void)camera; (void)hits; (void)host;
}

}  // namespace druse
