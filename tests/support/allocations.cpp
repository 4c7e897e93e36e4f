#include "support/allocations.h"

#include "support/sanitized.h"

#include <atomic>
#include <cerrno>

namespace {
std::atomic<long> nAllocations = 0;
}  // namespace

#ifndef HANDHOLD_SANITIZED
// The program's own malloc goes before the C library's, for new and for shared libraries as well.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  ++nAllocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++nAllocations;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  ++nAllocations;
  return __libc_realloc(memory, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  ++nAllocations;
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  ++nAllocations;
  *memory = __libc_memalign(alignment, size);
  return *memory == nullptr ? ENOMEM : 0;
}
}
#endif

namespace handhold::testing {

bool countsAllocations() {
#ifdef HANDHOLD_SANITIZED
  return false;
#else
  return true;
#endif
}

long allocations() { return nAllocations; }

}  // namespace handhold::testing
