// Writing of NanoVDB files: each grid is one block of memory, as a GPU uses it.
#include "file.h"

#define NANOVDB_USE_BLOSC
#define NANOVDB_USE_OPENVDB
#define NANOVDB_USE_ZIP
#include <nanovdb/util/IO.h>
#include <nanovdb/util/OpenToNanoVDB.h>

using namespace openvdb;

namespace druse {

namespace {

nanovdb::GridHandle<nanovdb::HostBuffer> nano(const GridBase& base) {
  if (base.isType<FloatGrid>())
    return nanovdb::openToNanoVDB<nanovdb::HostBuffer, FloatTree>(static_cast<const FloatGrid&>(base));
  if (base.isType<Vec3SGrid>())
    return nanovdb::openToNanoVDB<nanovdb::HostBuffer, Vec3STree>(static_cast<const Vec3SGrid&>(base));
  throw std::invalid_argument("the grid \"" + base.getName() + "\" holds neither floats nor vectors");
}

}  // namespace

std::int32_t file_write_nano(const FileOut& out, std::int32_t descriptor, std::uint32_t compression,
                             const Host& host) {
  const auto codec = compression & io::COMPRESS_BLOSC ? nanovdb::io::Codec::BLOSC
                     : compression & io::COMPRESS_ZIP ? nanovdb::io::Codec::ZIP
                                                      : nanovdb::io::Codec::NONE;
  return write_through(descriptor, host, [&](std::ostream& os) {
    for (const auto& grid : out.impl->grids) {
      nanovdb::GridHandle<nanovdb::HostBuffer> handle;
      in_arena(host, [&] { handle = nano(*grid->impl->base); });
      nanovdb::io::writeGrid(os, handle, codec);
    }
  });
}

}  // namespace druse
