// Volume and area of the zero set.
#include "impl.h"

#include <openvdb/tools/LevelSetMeasure.h>

using namespace openvdb;

namespace druse {

double grid_volume(const Grid& handle, const Host& host) {
  double volume = 0;
  if (floats(handle).empty()) return volume;
  in_arena(host, [&] { volume = tools::levelSetVolume(floats(handle), /*useWorldUnits=*/true); });
  return volume;
}

double grid_area(const Grid& handle, const Host& host) {
  double area = 0;
  if (floats(handle).empty()) return area;
  in_arena(host, [&] { area = tools::levelSetArea(floats(handle), /*useWorldUnits=*/true); });
  return area;
}

}  // namespace druse
