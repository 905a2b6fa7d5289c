// Reading of files, at once or delayed; writing through a stream that reports a full disk.
#include "file.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/File.h>

using namespace openvdb;

namespace druse {

struct FileIn::Impl {
  io::File file;
  std::vector<std::string> names;  // unique: "surface", "surface[1]", ...
  explicit Impl(const std::string& path) : file(path) {}
};

FileIn::FileIn(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
FileIn::~FileIn() = default;
FileOut::FileOut(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
FileOut::~FileOut() = default;

namespace {

rust::Vec<MetaEntry> entries(const MetaMap& map) {
  rust::Vec<MetaEntry> out;
  for (auto it = map.beginMeta(); it != map.endMeta(); ++it) {
    MetaEntry entry;
    entry.key = rust::String::lossy(it->first);
    entry.value = rust::String::lossy(it->second->str());
    out.push_back(std::move(entry));
  }
  return out;
}

std::string text(rust::Str s) { return std::string(s.data(), s.size()); }

// In place of one of any type.
void put_tag(MetaMap& tags, rust::Str key, rust::Str value) {
  tags.removeMeta(text(key));
  tags.insertMeta(text(key), StringMetadata(text(value)));
}

// Exposes the writer for any stream: io::File::write reports success on a full disk.
struct StreamArchive : io::Archive {
  void put(std::ostream& os, const GridCPtrVec& grids, const MetaMap& metadata) const {
    write(os, grids, /*seekable=*/true, metadata);
  }
};

}  // namespace

void drop_mistyped_tags(MetaMap& tags) {
  const std::string text = StringMetadata::staticTypeName(), flag = BoolMetadata::staticTypeName();
  const std::string corner = Vec3IMetadata::staticTypeName(), count = Int64Metadata::staticTypeName();
  const std::pair<const char*, const std::string&> known[] = {
      {GridBase::META_GRID_CLASS, text},        {GridBase::META_GRID_CREATOR, text},
      {GridBase::META_GRID_NAME, text},         {GridBase::META_VECTOR_TYPE, text},
      {GridBase::META_FILE_COMPRESSION, text},  {GridBase::META_SAVE_HALF_FLOAT, flag},
      {GridBase::META_IS_LOCAL_SPACE, flag},    {GridBase::META_FILE_BBOX_MIN, corner},
      {GridBase::META_FILE_BBOX_MAX, corner},   {GridBase::META_FILE_MEM_BYTES, count},
      {GridBase::META_FILE_VOXEL_COUNT, count},
  };
  for (const auto& [name, type] : known) {
    const Metadata::ConstPtr tag = std::as_const(tags)[name];
    if (tag && tag->typeName() != type) tags.removeMeta(name);
  }
  // Sizes of the leaves in their file.
  tags.removeMeta(GridBase::META_FILE_DELAYED_LOAD);
}

std::unique_ptr<FileIn> file_open(rust::Slice<const std::uint8_t> path, bool delayed) {
  auto in = std::make_unique<FileIn::Impl>(std::string(reinterpret_cast<const char*>(path.data()), path.size()));
  // Delayed loading of a damaged file crashes, hangs or exhausts memory: only for files larger than memory.
  in->file.setCopyMaxBytes(0);  // no temporary copies of small files
  in->file.open(delayed);
  for (auto it = in->file.beginName(); it != in->file.endName(); ++it) in->names.push_back(it.gridName());
  return std::make_unique<FileIn>(std::move(in));
}

std::uint32_t FileIn::version() const { return impl->file.fileVersion(); }
rust::String FileIn::writer() const { return rust::String::lossy(impl->file.version()); }
rust::Vec<MetaEntry> FileIn::metadata() const { return entries(*impl->file.getMetadata()); }

rust::Vec<rust::String> FileIn::names() const {
  rust::Vec<rust::String> out;
  for (const auto& name : impl->names) out.push_back(rust::String::lossy(name));
  return out;
}

std::unique_ptr<Grid> file_read(FileIn& in, std::size_t index) {
  GridBase::Ptr grid = in.impl->file.readGrid(in.impl->names.at(index));
  if (!grid) throw std::runtime_error("the grid could not be read");
  drop_mistyped_tags(*grid);
  return wrap(grid);
}

std::unique_ptr<FileOut> file_new() { return std::make_unique<FileOut>(std::make_unique<FileOut::Impl>()); }

std::size_t file_add(FileOut& out, const Grid& handle, rust::Str name, double scale, bool half, const Host& host) {
  GridBase::Ptr any;
  if (scale == 1.0 || handle.impl->base->getGridClass() != GRID_LEVEL_SET) {
    // Shares the tree, which does not change until the file is written. Values of other classes have no length unit.
    any = handle.impl->base->copyGrid();
    if (scale != 1.0) any->transform().postScale(scale);
  } else {
    const FloatGrid& source = floats(handle);
    std::unique_ptr<Grid> copy;
    in_arena(host, [&] { copy = wrap(source.deepCopy()); });
    any = copy->impl->base;
    any->setTransform(source.transform().copy());
    any->transform().postScale(scale);
    grid_scale_values(*copy, static_cast<float>(scale), 0, host);
  }
  any->setName(text(name));
  any->setSaveFloatAsHalf(half);
  out.impl->grids.push_back(wrap(any));
  return out.impl->grids.size() - 1;
}

const Grid& FileOut::grid(std::size_t index) const { return *impl->grids.at(index); }

void file_tag(FileOut& out, rust::Str key, rust::Str value) {
  put_tag(out.impl->metadata, key, value);
}

void file_tag_grid(FileOut& out, std::size_t index, rust::Str key, rust::Str value) {
  put_tag(*out.impl->grids.at(index)->impl->base, key, value);
}

std::int32_t file_write(const FileOut& out, std::int32_t descriptor, std::uint32_t compression, const Host& host) {
  GridCPtrVec grids;
  for (const auto& grid : out.impl->grids) grids.push_back(grid->impl->base);
  return write_through(descriptor, host, [&](std::ostream& os) {
    StreamArchive archive;
    archive.setCompression(compression);
    in_arena(host, [&] { archive.put(os, grids, out.impl->metadata); });
  });
}

}  // namespace druse
