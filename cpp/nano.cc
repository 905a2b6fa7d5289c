// NanoVDB files: each grid is one block of memory, as a GPU uses it.
#include "file.h"

#define NANOVDB_USE_BLOSC
#define NANOVDB_USE_OPENVDB
#define NANOVDB_USE_ZIP
#include <nanovdb/util/IO.h>
#include <nanovdb/util/NanoToOpenVDB.h>
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

// The first of the types that the grid holds, as OpenVDB's grid; null if it holds none. Converting every type that
// NanoVDB knows takes a compiler minutes.
template <typename... Values>
GridBase::Ptr open(const nanovdb::GridHandle<nanovdb::HostBuffer>& handle) {
  GridBase::Ptr found;
  const auto convert = [&](const auto* grid) {
    if (grid && !found) found = nanovdb::nanoToOpenVDB(*grid);
  };
  (convert(handle.grid<Values>()), ...);
  return found;
}

std::string name_of(rust::Slice<const std::uint8_t> path) {
  return std::string(reinterpret_cast<const char*>(path.data()), path.size());
}

}  // namespace

rust::Vec<rust::String> nano_names(rust::Slice<const std::uint8_t> path) {
  rust::Vec<rust::String> names;
  for (const auto& grid : nanovdb::io::readGridMetaData(name_of(path))) {
    names.push_back(rust::String::lossy(grid.gridName));
  }
  return names;
}

std::unique_ptr<Grid> nano_read(rust::Slice<const std::uint8_t> path, std::size_t index) {
  const auto handle = nanovdb::io::readGrid(name_of(path), index);
  using nanovdb::Fp16, nanovdb::Fp4, nanovdb::Fp8, nanovdb::FpN;
  const auto grid = open<float, double, Fp4, Fp8, Fp16, FpN, nanovdb::Vec3f>(handle);
  if (!grid) throw std::runtime_error("the grid holds neither floats nor vectors of floats");
  return wrap(grid);
}

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
