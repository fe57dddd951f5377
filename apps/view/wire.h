/* Is a message whole? Generated decoders believe the lengths inside; this walks them first. */
#ifndef VIEW_WIRE_H
#define VIEW_WIRE_H

#include <stdbool.h>

/* `layout` of what follows the 8-byte fingerprint: "12." skips 12 bytes, "s" a string (length, bytes, NUL), "#" reads a count,
 * "*12." skips 12 bytes for each of the last count. True if it ends exactly at `size`. */
bool view_wire_sound(const char *layout, const void *data, int size);

#endif
