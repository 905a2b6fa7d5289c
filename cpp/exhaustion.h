// The end of the program when memory runs out, as allocations see it.
#pragma once

#include <exception>

namespace druse {

// Whether an exception comes of memory or threads that the system refuses.
bool is_exhaustion(const std::exception& error);

// Ends the program if an allocation has failed and `end_on_exhaustion` was called.
void end_if_failed(bool has_failed);

}  // namespace druse
