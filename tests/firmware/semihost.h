/* Semihosting: files of the host that runs the emulator. Only the test image links it. */
#ifndef FW_SEMIHOST_H
#define FW_SEMIHOST_H

#include <stdbool.h>
#include <stdint.h>

int32_t semihost_open(const char *path, bool write);       /* a handle, or -1 */
bool semihost_read(int32_t file, void *to, uint32_t size); /* reads all bytes or returns false */
bool semihost_write(int32_t file, const void *from, uint32_t size);
void semihost_close(int32_t file);
_Noreturn void semihost_exit(int32_t status);

#endif
