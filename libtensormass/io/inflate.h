/* zlib's streams, as VTK's files hold them. Ours, so that the library needs nothing but the core. */
#ifndef TM_IO_INFLATE_H
#define TM_IO_INFLATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* RFC 1950 and 1951. True where `in` is one stream that gives exactly out_size bytes whose checksum is right. */
bool tm_io_inflate(const uint8_t *in, size_t in_size, uint8_t *out, size_t out_size);

#endif
