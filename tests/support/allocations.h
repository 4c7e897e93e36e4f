#pragma once

#include <cstddef>

// Counts what a test program takes from the heap, by malloc, by new and by Eigen. Programs that ask link
// allocations.cpp.
namespace handhold::testing {

/// False under a sanitizer, which has a malloc of its own.
bool countsAllocations();

/// Calls by all threads since the program began.
long allocations();

}  // namespace handhold::testing
