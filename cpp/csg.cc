// Boolean operations; each consumes its operand.
#include "impl.h"

#include <openvdb/tools/Composite.h>

using namespace openvdb;

namespace druse {

void grid_csg(Grid& handle, std::unique_ptr<Grid> operand, Csg kind, const Host& host) {
  FloatGrid& a = floats(handle);
  FloatGrid& b = floats(*operand);
  in_arena(host, [&] {
    switch (kind) {
      case Csg::Union: tools::csgUnion(a, b); break;
      case Csg::Intersection: tools::csgIntersection(a, b); break;
      case Csg::Difference: tools::csgDifference(a, b); break;
      default: throw std::invalid_argument("unknown operation");
    }
  });
}

}  // namespace druse
