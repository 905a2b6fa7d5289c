// The process: its fork, and its end when memory or threads run out, with words that were set beforehand and an exit
// code.
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
#include <string_view>
#include <system_error>

namespace {

// Text that is written without any allocation; its end is cut where it is too long.
struct Text {
  char bytes[2048];
  std::size_t count = 0;

  void set(std::string_view text) {
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

// What the system refuses.
enum class Cause { None, Memory, Threads };

struct Ending {
  Text message, object;
  int exit_code = 0;
  // Not 0 where another process has the words: the exit code without them.
  std::atomic<int> silent_code{0};
};

Ending of_memory, of_threads;
std::atomic<bool> is_set{false};
std::atomic_flag is_ending = ATOMIC_FLAG_INIT;

[[noreturn]] void end(const Ending& ending) {
  // One thread writes; the others wait for the end of the process.
  while (is_ending.test_and_set()) pause();
  if (const int code = ending.silent_code) _exit(code);
  ending.message.write(STDERR_FILENO);
  ending.object.write(STDOUT_FILENO);
  _exit(ending.exit_code);
}

[[noreturn]] void end_without_memory() { end(of_memory); }

Cause cause_of(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error)) return Cause::Memory;
  const auto system = dynamic_cast<const std::system_error*>(&error);
  const bool is_refused = system && system->code() == std::errc::resource_unavailable_try_again;
  // TBB has no type for a thread that it does not get.
  return is_refused || std::strstr(error.what(), "pthread_create") ? Cause::Threads : Cause::None;
}

void end_of(Cause cause) {
  if (cause == Cause::Memory) end(of_memory);
  if (cause == Cause::Threads) end(of_threads);
}

// An exception that nothing catches, such as that of an allocator of its own.
void end_or_abort() {
  try {
    if (const auto error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::exception& error) {
    end_of(cause_of(error));
  } catch (...) {
  }
  std::abort();
}

}  // namespace

namespace druse {

void end_if_exhausted(const std::exception& error) {
  if (is_set.load(std::memory_order_acquire)) end_of(cause_of(error));
}

void end_if_failed(bool has_failed) {
  if (has_failed && is_set.load(std::memory_order_acquire)) end(of_memory);
}

void end_without_threads(bool is_json) {
  of_threads.message.set(
      "error: not enough threads: the system grants the program no more\n"
      "  hint: a higher limit of processes and threads (ulimit -u)\n");
  if (is_json) {
    of_threads.object.set(
        "{\"code\":74,\"message\":\"not enough threads: the system grants the program no more\",\"file\":null,"
        "\"line\":null,\"element\":null,\"hint\":\"a higher limit of processes and threads (ulimit -u)\"}\n");
  }
  of_threads.exit_code = 74;  // EXIT_NO_THREADS of src/vdb/limits.rs
  std::set_terminate(end_or_abort);
}

void end_on_exhaustion(bool is_of_threads, rust::Str words, rust::Str json, std::int32_t code) {
  Ending& ending = is_of_threads ? of_threads : of_memory;
  ending.message.set({words.data(), words.size()});
  ending.object.set({json.data(), json.size()});
  ending.exit_code = code;
  is_set.store(true, std::memory_order_release);
  std::set_new_handler(end_without_memory);
  std::set_terminate(end_or_abort);
  // Each thread reserves 64 MiB of addresses for its allocations, and tries again at each of them where it gets none.
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) mallopt(M_ARENA_MAX, 1);
}

void end_silently(std::int32_t memory_code, std::int32_t threads_code) {
  of_memory.silent_code = memory_code;
  of_threads.silent_code = threads_code;
}

std::int32_t fork_process() {
  const pid_t child = ::fork();
  return child < 0 ? -errno : child;
}

}  // namespace druse
