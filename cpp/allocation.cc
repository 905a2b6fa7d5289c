// Allocations of the program: the linker puts these functions in the place of those of the C library (build.rs), for
// the executable alone. An allocation that fails ends the program with words about memory.
//
// Libraries start threads before `main`: log4cplus, on which OpenVDB stands, four of them. What runs before the libraries
// has the program end in words where it does not get them.
#include <cerrno>
#include <cstddef>
#include <cstring>

#include "exhaustion.h"

namespace {

void before_libraries(int count, char** arguments, char**) {
  bool is_json = false;
  for (int n = 1; n < count; ++n) is_json = is_json || std::strcmp(arguments[n], "--json") == 0;
  druse::end_without_threads(is_json);
}

__attribute__((section(".preinit_array"), used)) void (*const preinit)(int, char**, char**) = before_libraries;

}  // namespace

extern "C" {

void* __real_malloc(std::size_t size);
void* __real_calloc(std::size_t count, std::size_t size);
void* __real_realloc(void* old, std::size_t size);
int __real_posix_memalign(void** result, std::size_t alignment, std::size_t size);

void* __wrap_malloc(std::size_t size) {
  void* const result = __real_malloc(size);
  druse::end_if_failed(!result && size > 0);
  return result;
}

void* __wrap_calloc(std::size_t count, std::size_t size) {
  void* const result = __real_calloc(count, size);
  druse::end_if_failed(!result && count > 0 && size > 0);
  return result;
}

void* __wrap_realloc(void* old, std::size_t size) {
  void* const result = __real_realloc(old, size);
  druse::end_if_failed(!result && size > 0);
  return result;
}

int __wrap_posix_memalign(void** result, std::size_t alignment, std::size_t size) {
  const int error = __real_posix_memalign(result, alignment, size);
  druse::end_if_failed(error == ENOMEM);
  return error;
}
}
