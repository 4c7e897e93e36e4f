#pragma once

// Defined where a sanitizer watches: it replaces malloc, and everything takes ten times as long.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define HANDHOLD_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define HANDHOLD_SANITIZED 1
#endif
#endif

namespace handhold::testing {
#ifdef HANDHOLD_SANITIZED
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif
}  // namespace handhold::testing
