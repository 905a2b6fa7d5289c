// The end of the program when memory runs out: words that were set beforehand, and an exit code.
//
// Rust aborts where an allocation fails, and C++ throws where nothing may catch. The program's allocations pass through
// allocation.cc, so that both end here instead. Nothing ends until `end_on_exhaustion` is called, which the program
// does and a library never does.
#include "exhaustion.h"

#include "bridge.h"

#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>

namespace {

// Text that is written without any allocation.
struct Text {
  char bytes[2048];
  std::size_t count = 0;

  void set(rust::Str text) {
    count = std::min(text.size(), sizeof bytes);
    std::memcpy(bytes, text.data(), count);
  }

  void write(int descriptor) const {
    std::size_t done = 0;
    while (done < count) {
      const ssize_t n = ::write(descriptor, bytes + done, count - done);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return;
      done += std::size_t(n);
    }
  }
};

Text message, object;
int exit_code = 0;
std::atomic<bool> is_set{false};
std::atomic_flag is_ending = ATOMIC_FLAG_INIT;

[[noreturn]] void end() {
  // One thread writes; the others wait for the end of the process.
  while (is_ending.test_and_set()) pause();
  message.write(STDERR_FILENO);
  object.write(STDOUT_FILENO);
  _exit(exit_code);
}

// An exception that nothing catches, such as that of an allocator of its own.
void end_or_abort() {
  try {
    if (const auto error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::exception& error) {
    if (druse::is_exhaustion(error)) end();
  } catch (...) {
  }
  std::abort();
}

}  // namespace

namespace druse {

bool is_exhaustion(const std::exception& error) {
  // TBB has no type for a thread that it does not get.
  return dynamic_cast<const std::bad_alloc*>(&error) || std::strstr(error.what(), "pthread_create");
}

void end_if_failed(bool has_failed) {
  if (has_failed && is_set.load(std::memory_order_acquire)) end();
}

void end_on_exhaustion(rust::Str words, rust::Str json, std::int32_t code) {
  message.set(words);
  object.set(json);
  exit_code = code;
  is_set.store(true, std::memory_order_release);
  std::set_new_handler(end);
  std::set_terminate(end_or_abort);
  // Each thread reserves 64 MiB of addresses for its allocations, and tries again at each of them where it gets none.
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) mallopt(M_ARENA_MAX, 1);
}

}  // namespace druse
