/* The host's port, for the reference of the emulated board. */
#include <stdio.h>
#include <stdlib.h>

#include "port.h"

enum { FILES = 8 };
static FILE *open_file[FILES];

int32_t semihost_open(const char *path, bool write) {
    for (int32_t i = 0; i < FILES; i++)
        if (!open_file[i]) return (open_file[i] = fopen(path, write ? "wb" : "rb")) ? i : -1;
    return -1;
}
bool semihost_read(int32_t file, void *to, uint32_t size) { return fread(to, 1, size, open_file[file]) == size; }
bool semihost_write(int32_t file, const void *from, uint32_t size) {
    return fwrite(from, 1, size, open_file[file]) == size;
}
void semihost_close(int32_t file) {
    if (fclose(open_file[file])) port_panic("a file cannot be written to its end");
    open_file[file] = NULL;
}
_Noreturn void semihost_exit(int32_t status) { exit(status); }

void port_start(void) {}
void port_wait_tick(void) { port_tick(); }
uint32_t port_count(void) { return 0; }
uint32_t port_since(uint32_t count) { return count; }
_Noreturn void port_finish(void) { exit(0); }
_Noreturn void port_panic(const char *why) {
    fprintf(stderr, "replay: %s\n", why);
    exit(1);
}
