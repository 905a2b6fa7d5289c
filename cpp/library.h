// Virtual functions that libopenvdb has compiled, since it registers these grids. Each of our files that makes a grid
// would compile them again: half of the compiler's work on those files. Other functions need not be in a library.
#pragma once

#include <openvdb/openvdb.h>

namespace openvdb {

#define DRUSE_TREE(Tree_)                                                                                              \
  extern template Tree_::~Tree();                                                                                      \
  extern template TreeBase::Ptr Tree_::copy() const;                                                                   \
  extern template std::vector<Index32> Tree_::nodeCount() const;                                                       \
  extern template Index32 Tree_::leafCount() const;                                                                    \
  extern template Index32 Tree_::unallocatedLeafCount() const;                                                         \
  extern template Index64 Tree_::activeLeafVoxelCount() const;                                                         \
  extern template Index64 Tree_::inactiveLeafVoxelCount() const;                                                       \
  extern template Index64 Tree_::activeVoxelCount() const;                                                             \
  extern template Index64 Tree_::inactiveVoxelCount() const;                                                           \
  extern template Index64 Tree_::activeTileCount() const;                                                              \
  extern template Index64 Tree_::memUsage() const;                                                                     \
  extern template bool Tree_::evalLeafBoundingBox(CoordBBox&) const;                                                   \
  extern template bool Tree_::evalActiveVoxelBoundingBox(CoordBBox&) const;                                            \
  extern template void Tree_::clipUnallocatedNodes();                                                                  \
  extern template void Tree_::readTopology(std::istream&, bool);                                                       \
  extern template void Tree_::readBuffers(std::istream&, bool);                                                        \
  extern template void Tree_::readBuffers(std::istream&, const CoordBBox&, bool);                                      \
  extern template void Tree_::readNonresidentBuffers() const;                                                          \
  extern template void Tree_::writeTopology(std::ostream&, bool) const;                                                \
  extern template void Tree_::writeBuffers(std::ostream&, bool) const;                                                 \
  extern template void Tree_::print(std::ostream&, int) const;

#define DRUSE_GRID(Grid_)                                                                                              \
  extern template GridBase::Ptr Grid_::copyGrid();                                                                     \
  extern template GridBase::ConstPtr Grid_::copyGrid() const;                                                          \
  extern template GridBase::Ptr Grid_::copyGridWithNewTree() const;                                                    \
  extern template GridBase::ConstPtr Grid_::copyGridReplacingMetadata(const MetaMap&) const;                           \
  extern template GridBase::ConstPtr Grid_::copyGridReplacingTransform(math::Transform::Ptr) const;                    \
  extern template GridBase::ConstPtr Grid_::copyGridReplacingMetadataAndTransform(                                     \
      const MetaMap&, math::Transform::Ptr) const;                                                                     \
  extern template GridBase::Ptr Grid_::deepCopyGrid() const;                                                           \
  extern template void Grid_::setTree(TreeBase::Ptr);                                                                  \
  extern template void Grid_::newTree();                                                                               \
  extern template void Grid_::clear();                                                                                 \
  extern template void Grid_::pruneGrid(float);                                                                        \
  extern template void Grid_::clip(const CoordBBox&);                                                                  \
  extern template CoordBBox Grid_::evalActiveVoxelBoundingBox() const;                                                 \
  extern template void Grid_::readTopology(std::istream&);                                                             \
  extern template void Grid_::readBuffers(std::istream&);                                                              \
  extern template void Grid_::readBuffers(std::istream&, const CoordBBox&);                                            \
  extern template void Grid_::writeTopology(std::ostream&) const;                                                      \
  extern template void Grid_::writeBuffers(std::ostream&) const;                                                       \
  extern template void Grid_::print(std::ostream&, int) const;

DRUSE_TREE(FloatTree)
DRUSE_TREE(DoubleTree)
DRUSE_TREE(Vec3STree)
DRUSE_GRID(FloatGrid)
DRUSE_GRID(DoubleGrid)
DRUSE_GRID(Vec3SGrid)

#undef DRUSE_TREE
#undef DRUSE_GRID

}  // namespace openvdb
