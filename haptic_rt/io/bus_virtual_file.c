/* The file of a virtual bus: location, locks, mapping, recovery, removal. */
#include "bus_virtual_file.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* Lock bytes of the file: each endpoint holds a read lock on PRESENT, and a write lock on its claimed role. */
enum { PLACES = 8, PRESENT = 64, TRIES = 50 };

static hrt_virtual_hold holds[HRT_VIRTUAL_HOLDS];

/* ---------------------------------------------------------------------------------------------- a file cut short */

static struct sigaction before;

/* Handles SIGBUS, raised by access beyond the file's new end: maps anonymous pages in its place and records the
 * problem. */
static void on_sigbus(int number, siginfo_t *info, void *context) {
    const uintptr_t at = (uintptr_t)info->si_addr;
    for (hrt_virtual_hold *hold = holds; hold < holds + HRT_VIRTUAL_HOLDS; hold++) {
        void *memory = atomic_load(&hold->memory);
        if (!memory || at < (uintptr_t)memory || at >= (uintptr_t)memory + sizeof(hrt_virtual_bus)) continue;
        const int kept = errno;
        if (mmap(memory, sizeof(hrt_virtual_bus), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1,
                 0) != memory)
            _exit(1);
        errno = kept;
        atomic_store(&hold->trouble, HRT_VIRTUAL_CUT_SHORT);
        return;
    }
    if (before.sa_flags & SA_SIGINFO)
        before.sa_sigaction(number, info, context);
    else
        sigaction(SIGBUS, &before, NULL); /* the access repeats on return and takes the default action */
}

static void catch_sigbus(void) {
    static bool caught;
    if (caught) return;
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_sigaction = on_sigbus;
    action.sa_flags = SA_SIGINFO;
    caught = sigaction(SIGBUS, &action, &before) == 0;
}

/* ---------------------------------------------------------------------------------------------- where it is */

/* Returns the user id outside a user namespace: inside, all users may have the id 0. */
static unsigned outer_uid(void) {
    const unsigned uid = (unsigned)getuid();
    unsigned inside, outside, count, found = uid;
    FILE *map = fopen("/proc/self/uid_map", "r");
    while (map && fscanf(map, "%u %u %u", &inside, &outside, &count) == 3)
        if (uid >= inside && uid - inside < count) found = outside + (uid - inside);
    if (map) fclose(map);
    return found;
}

static const char *set_folder(void) {
    const char *set = getenv("TM_BUS_DIR");
    return set && *set ? set : NULL;
}

/* Nested namespaces hide that id too: if another user owns the folder, use the namespace's own id. */
static void default_folder(char *directory, size_t size) {
    struct stat st;
    const int length = snprintf(directory, size, "/dev/shm/tensormass-%u", outer_uid());
    if (stat(directory, &st) == 0 && st.st_uid != getuid() && stat("/proc/self/ns/user", &st) == 0)
        snprintf(directory + length, size - (size_t)length, "-%llu", (unsigned long long)st.st_ino);
}

static bool folder(char *directory, size_t size, char *why, int why_size) {
    const char *set = set_folder();
    struct stat st;
    if (set)
        snprintf(directory, size, "%s", set);
    else
        default_folder(directory, size);
    if ((mkdir(directory, 0700) != 0 && errno != EEXIST) || stat(directory, &st) != 0 || !S_ISDIR(st.st_mode)) {
        snprintf(why, (size_t)why_size, "directory %s cannot be made (%s); set TM_BUS_DIR to another", directory,
                 strerror(errno));
        return false;
    }
    if (!set && st.st_uid != getuid()) {
        snprintf(why, (size_t)why_size, "%s belongs to another user; set TM_BUS_DIR to a directory of your own",
                 directory);
        return false;
    }
    return true;
}

bool hrt_virtual_path(const char *name, char *path, int path_size, char *why, int why_size) {
    char directory[200];
    if (name[0] == 0 || strchr(name, '/') || strlen(name) > 32) {
        snprintf(why, (size_t)why_size,
                 "the name of a virtual bus needs 1 to 32 characters without '/'; use for example virtual:bus0");
        return false;
    }
    if (!folder(directory, sizeof directory, why, why_size)) return false;
    snprintf(path, (size_t)path_size, "%s/%s.bus", directory, name);
    return true;
}

/* ---------------------------------------------------------------------------------------------- locks */

/* Locks a byte for the open file, not the process: two endpoints in one process are distinct. */
static bool lock(int fd, short type, int byte) {
    struct flock wanted;
    memset(&wanted, 0, sizeof wanted);
    wanted.l_type = type;
    wanted.l_whence = SEEK_SET;
    wanted.l_start = byte;
    wanted.l_len = 1;
    return fcntl(fd, F_OFD_SETLK, &wanted) == 0;
}

static bool same_file(const char *path, const struct stat *mine) {
    struct stat there;
    return stat(path, &there) == 0 && there.st_dev == mine->st_dev && there.st_ino == mine->st_ino;
}

int hrt_virtual_claim(hrt_virtual_hold *hold, int place) {
    if (!lock(hold->fd, F_WRLCK, place % PLACES) && (errno == EAGAIN || errno == EACCES)) return 0;
    hold->claimed = place % PLACES;
    return 1;
}

/* ---------------------------------------------------------------------------------------------- open, repair, close */

/* Opens the file and locks it against removal. Returns -1 on failure. */
static int enter(const char *path, struct stat *st) {
    const int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (fd < 0) return -1;
    const bool held = lock(fd, F_RDLCK, PRESENT) || (errno != EAGAIN && errno != EACCES);
    if (held && fstat(fd, st) == 0 && same_file(path, st)) return fd;
    close(fd);
    errno = EAGAIN; /* the last user was just closing it */
    return -1;
}

/* Maps the file over the mapping at `place`, null: none. grown: a shorter file was truncated, and is extended. */
static hrt_virtual_bus *map(void *place, int fd, off_t size, bool grown) {
    const off_t whole = (off_t)sizeof(hrt_virtual_bus);
    if (size != whole && (size > whole || (size > 0 && !grown) || ftruncate(fd, whole) != 0)) return NULL;
    const int flags = MAP_SHARED | MAP_POPULATE | (place ? MAP_FIXED : 0);
    void *memory = mmap(place, (size_t)whole, PROT_READ | PROT_WRITE, flags, fd, 0);
    return memory == MAP_FAILED ? NULL : memory;
}

static bool is_a_bus(hrt_virtual_bus *v) {
    uint64_t none = 0;
    return atomic_compare_exchange_strong(&v->magic, &none, HRT_VIRTUAL_MAGIC) || none == HRT_VIRTUAL_MAGIC;
}

hrt_virtual_hold *hrt_virtual_open(const char *path, char *why, int why_size) {
    hrt_virtual_hold *hold = NULL;
    for (int i = 0; i < HRT_VIRTUAL_HOLDS && !hold; i++)
        if (!atomic_load(&holds[i].memory)) hold = &holds[i];
    if (!hold) {
        snprintf(why, (size_t)why_size, "more than %d virtual buses in one program; close some", HRT_VIRTUAL_HOLDS);
        return NULL;
    }
    struct stat st = {.st_size = 0};
    int fd = -1;
    for (int i = 0; i < TRIES && (fd = enter(path, &st)) < 0 && (errno == EAGAIN || errno == ENOENT); i++) {
        char directory[200];
        nanosleep(&(const struct timespec){0, 1000000}, NULL);
        folder(directory, sizeof directory, why, why_size); /* removed with its last bus */
    }
    catch_sigbus();
    hrt_virtual_bus *memory = fd < 0 ? NULL : map(NULL, fd, st.st_size, false);
    hold->path = path;
    hold->fd = fd;
    hold->claimed = -1;
    hold->told = HRT_VIRTUAL_WELL;
    atomic_store(&hold->trouble, HRT_VIRTUAL_WELL);
    atomic_store(&hold->ready, false);
    atomic_store(&hold->memory, memory);
    if (memory && is_a_bus(memory)) return hold;
    if (fd < 0)
        snprintf(why, (size_t)why_size, "cannot open %s (%s); set TM_BUS_DIR to a directory of your own", path,
                 strerror(errno));
    else
        snprintf(why, (size_t)why_size, "%s is not a bus of this version; remove it", path);
    atomic_store(&hold->memory, NULL);
    if (memory) munmap(memory, sizeof *memory);
    if (fd >= 0) close(fd);
    return NULL;
}

/* Opens the file that replaces a removed one, and claims our role on it. */
static bool enter_anew(hrt_virtual_hold *hold, struct stat *st) {
    char directory[200], why[300];
    int fd = enter(hold->path, st);
    if (fd < 0 && errno == ENOENT && folder(directory, sizeof directory, why, sizeof why)) fd = enter(hold->path, st);
    if (fd < 0) return false;
    if (hold->claimed >= 0 && !lock(fd, F_WRLCK, hold->claimed)) {
        atomic_store(&hold->trouble, HRT_VIRTUAL_TAKEN);
        close(fd);
        return false;
    }
    close(hold->fd);
    hold->fd = fd;
    return true;
}

/* Maps the file over the old mapping. While the problem persists, the tick's thread does not access it. Its access at
 * the time has ended; only if that access found the problem itself may a frame be lost. */
static void map_anew(hrt_virtual_hold *hold) {
    hrt_virtual_bus *memory = atomic_load(&hold->memory);
    struct stat st;
    if (fstat(hold->fd, &st) != 0 || (!same_file(hold->path, &st) && !enter_anew(hold, &st))) return;
    if (map(memory, hold->fd, st.st_size, true) && is_a_bus(memory)) atomic_store(&hold->ready, true);
}

const char *hrt_virtual_look(hrt_virtual_hold *hold) {
    static const char *const text[] = {"its file exists again", "its file was truncated while in use",
                                       "its file was removed or replaced while in use",
                                       "another program uses this program's slot in the new file; end one of the two"};
    struct stat st = {.st_size = 0};
    int trouble = atomic_load(&hold->trouble);
    if (trouble == HRT_VIRTUAL_WELL) {
        const bool there = fstat(hold->fd, &st) == 0 && same_file(hold->path, &st);
        trouble = !there                                        ? HRT_VIRTUAL_REMOVED
                  : st.st_size < (off_t)sizeof(hrt_virtual_bus) ? HRT_VIRTUAL_CUT_SHORT
                                                                : HRT_VIRTUAL_WELL;
        if (trouble != HRT_VIRTUAL_WELL) atomic_store(&hold->trouble, trouble);
    } else if (!atomic_load(&hold->ready)) {
        map_anew(hold);
        if (atomic_load(&hold->trouble) == HRT_VIRTUAL_TAKEN) trouble = HRT_VIRTUAL_TAKEN;
    }
    if (trouble == hold->told) return NULL;
    hold->told = trouble;
    return text[trouble];
}

void hrt_virtual_close(hrt_virtual_hold *hold) {
    hrt_virtual_bus *memory = atomic_load(&hold->memory);
    struct stat st;
    if (fstat(hold->fd, &st) == 0 && same_file(hold->path, &st) && lock(hold->fd, F_WRLCK, PRESENT)) {
        char directory[300];
        unlink(hold->path);
        snprintf(directory, sizeof directory, "%s", hold->path);
        *strrchr(directory, '/') = 0;
        if (!set_folder()) rmdir(directory);
    }
    atomic_store(&hold->memory, NULL);
    munmap(memory, sizeof *memory);
    close(hold->fd);
}
