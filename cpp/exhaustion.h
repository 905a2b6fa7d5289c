// The end of the program when memory or threads run out, as allocations and libraries see it.
#pragma once

#include <exception>

namespace druse {

// Ends the program if an exception comes of memory or threads that the system refuses and `end_on_exhaustion` was called.
void end_if_exhausted(const std::exception& error);

// Has the program end in words if its libraries do not get their threads. To be called before they start.
void end_without_threads(bool is_json);

// Ends the program if an allocation has failed and `end_on_exhaustion` was called.
void end_if_failed(bool has_failed);

}  // namespace druse
