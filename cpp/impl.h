// Shared by the translation units: the implementation of Grid, the interrupter, the task arena.
#pragma once

#include "bridge.h"
#include "druse/src/vdb/ffi.rs.h"
#include "library.h"

#include <openvdb/openvdb.h>
#include <openvdb/util/NullInterrupter.h>

#include <tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <string>

namespace druse {

using FloatTree = openvdb::FloatTree;
using Leaf = FloatTree::LeafNodeType;
using Node1 = FloatTree::RootNodeType::ChildNodeType::ChildNodeType;
using Node2 = FloatTree::RootNodeType::ChildNodeType;
static_assert(Leaf::DIM == 8 && Node1::DIM == 128 && Node2::DIM == 4096, "the 5-4-3 tree");

struct Grid::Impl {
  openvdb::GridBase::Ptr base;
  openvdb::FloatGrid::Ptr grid;  // null when the grid is of another type

  explicit Impl(openvdb::GridBase::Ptr any)
      : base(std::move(any)), grid(openvdb::gridPtrCast<openvdb::FloatGrid>(base)) {}
};

struct Block::Impl {
  std::unique_ptr<Node1> node;
  float background;
};

inline std::unique_ptr<Grid> wrap(openvdb::GridBase::Ptr any) {
  return std::make_unique<Grid>(std::make_unique<Grid::Impl>(std::move(any)));
}

inline const openvdb::FloatGrid& floats(const Grid& grid) {
  if (!grid.impl->grid) throw std::invalid_argument("the grid does not hold floats");
  return *grid.impl->grid;
}

inline openvdb::FloatGrid& floats(Grid& grid) {
  if (!grid.impl->grid) throw std::invalid_argument("the grid does not hold floats");
  return *grid.impl->grid;
}

// Whether a transform is only a uniform positive scale and a translation; in grid.cc.
bool is_plain(const openvdb::math::Transform& transform);

// Removes tags with names of OpenVDB's own and values of other types, as a damaged file may have: OpenVDB fails where
// it sets such a tag. Removes the tag of delayed loading too, which describes the leaves of one file.
void drop_mistyped_tags(openvdb::MetaMap& tags);

// Checks for cancellation in Rust, at most every 20 ms and from any thread. Cancellation is permanent.
class Interrupter : public openvdb::util::NullInterrupter {
 public:
  explicit Interrupter(const Host& host) : host_(host) {}

  bool wasInterrupted(int = -1) override { return stopped(); }

  bool stopped() {
    if (stopped_.load(std::memory_order_relaxed)) return true;
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
    auto next = next_.load(std::memory_order_relaxed);
    if (ms < next || !next_.compare_exchange_strong(next, ms + 20)) return false;
    if (host_cancelled(host_)) stopped_ = true;
    return stopped_;
  }

 private:
  const Host& host_;
  std::atomic<bool> stopped_{false};
  std::atomic<std::chrono::milliseconds::rep> next_{0};
};

// Throws on cancellation: an interrupted filter would otherwise copy and dilate the whole grid in each remaining pass.
class ThrowingInterrupter final : public Interrupter {
 public:
  using Interrupter::Interrupter;

  bool wasInterrupted(int = -1) override {
    if (stopped()) throw std::runtime_error("interrupted");
    return false;
  }
};

// Runs `work` on the host's number of threads; exceptions pass through. Each call has its own arena, so that a
// cancelled loop of OpenVDB leaves no cancelled context for the next call.
template <typename Work>
void in_arena(const Host& host, Work&& work) {
  tbb::task_arena arena(static_cast<int>(host_threads(host)));
  arena.execute(std::forward<Work>(work));
}

}  // namespace druse
