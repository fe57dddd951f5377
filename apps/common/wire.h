/* Is a message whole? Generated decoders believe the lengths inside; this walks them first. */
#ifndef TM_WIRE_H
#define TM_WIRE_H

#include <stdbool.h>

/* `layout` of what follows the 8-byte fingerprint: "12." skips 12 bytes, "s" a string (length, bytes, NUL), "#" reads a
 * count,
 * "*12." skips 12 bytes for each of the last count. True if it ends exactly at `size`. */
bool app_wire_sound(const char *layout, const void *data, int size);

/* The same for a type that begins with `head` (`head_bytes` without its `strings` strings) and goes on with fields of
 * fixed size: `empty_size` is the encoded size of a message with empty strings. */
bool app_wire_sound_head(const char *head, int head_bytes, int strings, int empty_size, const void *data, int size);

#endif
