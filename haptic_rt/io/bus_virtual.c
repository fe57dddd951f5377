/* The bus between processes, without kernel CAN: a ring of frames in a mapped file. Sending and receiving are a few
 * loads and stores, no system call. Any endpoint may come, go or be killed at any time. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bus.h"
#include "bus_virtual.h"

static int virtual_send(hrt_bus *bus, const hrt_can_frame *frame) {
    hrt_virtual_bus *v = bus->shared;
    if (atomic_load(&v->off)) return -1;
    const uint64_t number = atomic_fetch_add(&v->head, 1);
    const uint64_t s = number % HRT_VIRTUAL_SLOTS;
    atomic_store(&v->slot[s].stamp, 0);
    atomic_thread_fence(memory_order_release);
    v->slot[s].writer = bus->self;
    v->slot[s].frame = *frame;
    atomic_store(&v->slot[s].stamp, number + 1);
    hrt_bus_count(bus, &bus->tx, frame);
    return 1;
}

static int virtual_receive(hrt_bus *bus, hrt_can_frame *frame) {
    hrt_virtual_bus *v = bus->shared;
    if (atomic_load(&v->off)) return -1;
    const uint64_t head = atomic_load(&v->head);
    if (head < bus->next) bus->next = head; /* the file was made anew */
    if (head - bus->next > HRT_VIRTUAL_SLOTS / 2) {
        bus->dropped += head - bus->next;
        bus->next = head;
    }
    while (bus->next < head) {
        const uint64_t s = bus->next % HRT_VIRTUAL_SLOTS;
        const uint64_t stamp = atomic_load(&v->slot[s].stamp);
        if (stamp != bus->next + 1) {
            /* Being written now; or its writer was killed in the act, then the bus goes on without it. */
            if (head - bus->next < 16) return 0;
            bus->dropped++;
            bus->next++;
            continue;
        }
        const uint64_t writer = v->slot[s].writer;
        *frame = v->slot[s].frame;
        atomic_thread_fence(memory_order_acquire);
        const bool whole = atomic_load(&v->slot[s].stamp) == stamp;
        bus->next++;
        if (!whole) bus->dropped++;
        if (!whole || writer == bus->self) continue;
        hrt_bus_count(bus, &bus->rx, frame);
        return 1;
    }
    return 0;
}

static hrt_bus_state virtual_state(hrt_bus *bus) {
    return atomic_load(&((hrt_virtual_bus *)bus->shared)->off) ? HRT_BUS_OFF : HRT_BUS_OK;
}

static void virtual_recover(hrt_bus *bus, int64_t now_us) { bus->tried_us = now_us; }

static void virtual_close(hrt_bus *bus) {
    munmap(bus->shared, sizeof(hrt_virtual_bus));
    bus->driver = NULL;
}

static const hrt_bus_driver virtual_driver = {"virtual",     virtual_send,    virtual_receive,
                                              virtual_state, virtual_recover, virtual_close};

static bool bus_file(const char *name, char *path, int path_size, char *why, int why_size) {
    const char *set = getenv("TM_BUS_DIR");
    char directory[200];
    if (name[0] == 0 || strchr(name, '/') || strlen(name) > 32) {
        snprintf(why, (size_t)why_size,
                 "a virtual bus is named by 1 to 32 characters without '/'; use for example virtual:bus0");
        return false;
    }
    if (set && *set)
        snprintf(directory, sizeof directory, "%s", set);
    else
        snprintf(directory, sizeof directory, "/dev/shm/tensormass-%u", (unsigned)getuid());
    struct stat st;
    if ((mkdir(directory, 0700) != 0 && errno != EEXIST) || stat(directory, &st) != 0 || !S_ISDIR(st.st_mode)) {
        snprintf(why, (size_t)why_size, "%s is not a directory that can be made (%s); set TM_BUS_DIR to one", directory,
                 strerror(errno));
        return false;
    }
    if (!(set && *set) && st.st_uid != getuid()) {
        snprintf(why, (size_t)why_size, "%s belongs to another user; set TM_BUS_DIR to a directory of your own",
                 directory);
        return false;
    }
    snprintf(path, (size_t)path_size, "%s/%s.bus", directory, name);
    return true;
}

bool hrt_bus_open_virtual(hrt_bus *bus, const char *name, char *why, int why_size) {
    static _Atomic uint64_t opened;
    memset(bus, 0, sizeof *bus);
    if (!bus_file(name, bus->name, (int)sizeof bus->name, why, why_size)) return false;
    const int fd = open(bus->name, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    struct stat st;
    if (fd < 0 || fstat(fd, &st) != 0 || (st.st_size == 0 && ftruncate(fd, sizeof(hrt_virtual_bus)) != 0)) {
        snprintf(why, (size_t)why_size, "cannot open %s (%s); set TM_BUS_DIR to a directory of your own", bus->name,
                 strerror(errno));
        if (fd >= 0) close(fd);
        return false;
    }
    void *memory = st.st_size == 0 || st.st_size == (off_t)sizeof(hrt_virtual_bus)
                       ? mmap(NULL, sizeof(hrt_virtual_bus), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0)
                       : MAP_FAILED;
    close(fd);
    hrt_virtual_bus *v = memory;
    uint64_t none = 0;
    if (memory == MAP_FAILED ||
        (!atomic_compare_exchange_strong(&v->magic, &none, HRT_VIRTUAL_MAGIC) && none != HRT_VIRTUAL_MAGIC)) {
        snprintf(why, (size_t)why_size, "%s is not a bus of this version; remove it", bus->name);
        if (memory != MAP_FAILED) munmap(memory, sizeof(hrt_virtual_bus));
        return false;
    }
    bus->driver = &virtual_driver;
    bus->shared = v;
    bus->next = atomic_load(&v->head);
    bus->self = ((uint64_t)getpid() << 32) | (atomic_fetch_add(&opened, 1) + 1);
    return true;
}
