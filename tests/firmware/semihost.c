/* Files of the host that emulates or debugs this machine, by Arm's semihosting calls. Only in test builds: a device
 * has no such host. */
#include "semihost.h"

enum { SYS_OPEN = 0x01, SYS_CLOSE = 0x02, SYS_WRITE = 0x05, SYS_READ = 0x06, SYS_EXIT_EXTENDED = 0x20 };
enum { ADP_STOPPED_APPLICATION_EXIT = 0x20026 };

static uint32_t call(uint32_t operation, const void *arguments) {
    register uint32_t r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = arguments;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

int32_t semihost_open(const char *path, bool write) {
    uint32_t length = 0;
    while (path[length]) length++;
    const uint32_t arguments[3] = {(uint32_t)(uintptr_t)path, write ? 5u : 1u, length}; /* "wb", "rb" */
    return (int32_t)call(SYS_OPEN, arguments);
}

bool semihost_read(int32_t file, void *to, uint32_t size) {
    const uint32_t arguments[3] = {(uint32_t)file, (uint32_t)(uintptr_t)to, size};
    return call(SYS_READ, arguments) == 0; /* the reply is the number of missing bytes */
}

bool semihost_write(int32_t file, const void *from, uint32_t size) {
    const uint32_t arguments[3] = {(uint32_t)file, (uint32_t)(uintptr_t)from, size};
    return call(SYS_WRITE, arguments) == 0;
}

void semihost_close(int32_t file) {
    const uint32_t arguments[1] = {(uint32_t)file};
    call(SYS_CLOSE, arguments);
}

_Noreturn void semihost_exit(int32_t status) {
    const uint32_t arguments[2] = {ADP_STOPPED_APPLICATION_EXIT, (uint32_t)status};
    call(SYS_EXIT_EXTENDED, arguments);
    for (;;) {
    }
}
