/* Decompresses zlib streams, as in VTK's files. Written here so that the library depends only on the core. */
#ifndef TM_IO_INFLATE_H
#define TM_IO_INFLATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* RFC 1950 and 1951. Returns false unless `in` is one stream that gives exactly out_size bytes with the right
 * checksum. */
bool tm_io_inflate(const uint8_t *in, size_t in_size, uint8_t *out, size_t out_size);

#endif
