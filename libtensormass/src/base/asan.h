/* TM_ASAN is defined in builds with AddressSanitizer. gcc and clang announce it differently. */
#ifndef TM_CHECKED_H
#define TM_CHECKED_H

#if defined(__SANITIZE_ADDRESS__)
#define TM_ASAN 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define TM_ASAN 1
#endif
#endif

#endif
