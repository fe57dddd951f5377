/* Response files: used only if complete, undamaged and of the same problem. Little-endian; the header has byte_order.
 *
 * tms_file_head | kept int32[] | interface int32[] | base double[] | interface_N double[] | schur double[] | chunk
 * checksums uint64[] padding to 4096 | columns, float or double
 *
 * The head's checksum covers all bytes before the columns; each chunk's checksum covers 4 MiB of them. */
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define CHUNK ((size_t)1 << 22)
static const char MAGIC[8] = "TMRESP\r\n"; /* a text-mode copy changes the last two */
enum { FORMAT_VERSION = 1, BYTE_ORDER_MARK = 0x01020304 };

tms_layout tms_file_layout(int32_t kept, int32_t interface, tm_precision precision) {
    tms_layout l;
    const size_t k = (size_t)kept, b = (size_t)interface, columns = (k + b) * k * (precision == TM_DOUBLE ? 8 : 4);
    l.kept = sizeof(tms_file_head);
    l.interface = l.kept + 4 * k;
    l.base = (l.interface + 4 * b + 7) / 8 * 8;
    l.force = l.base + 8 * k;
    l.schur = l.force + 8 * b;
    l.checksum = l.schur + 8 * b * b;
    l.blocks = (int32_t)((columns + CHUNK - 1) / CHUNK);
    l.column = (l.checksum + 8 * (size_t)l.blocks + 4095) / 4096 * 4096;
    l.bytes = l.column + columns;
    return l;
}

/* Four independent lanes of multiply and rotate over 8-byte words: checking a file then costs no more than reading
 * it. */
uint64_t tms_checksum(const void *data, size_t bytes, uint64_t seed) {
    const unsigned char *p = data;
    uint64_t lane[4] = {seed ^ 0x9e3779b97f4a7c15ULL, seed ^ 0xc2b2ae3d27d4eb4fULL, seed ^ 0x165667b19e3779f9ULL,
                        seed ^ bytes};
    for (; bytes >= 32; bytes -= 32, p += 32)
        for (int i = 0; i < 4; i++) {
            uint64_t word;
            memcpy(&word, p + 8 * i, 8);
            lane[i] = (lane[i] ^ word) * 0xff51afd7ed558ccdULL;
            lane[i] ^= lane[i] >> 32;
        }
    return tm_hash(p, bytes, tm_hash(lane, sizeof lane, TM_HASH_SEED));
}

typedef struct chunk_job {
    const char *data;
    size_t bytes;
    uint64_t *sum;
    int32_t first, stride, count;
} chunk_job;

static void *sum_chunks(void *argument) {
    const chunk_job *job = argument;
    for (int32_t i = job->first; i < job->count; i += job->stride) {
        const size_t at = (size_t)i * CHUNK, left = job->bytes - at;
        job->sum[i] = tms_checksum(job->data + at, left < CHUNK ? left : CHUNK, (uint64_t)i);
    }
    return NULL;
}

static void checksum_columns(const char *data, size_t bytes, uint64_t *sum, int32_t count, int32_t threads) {
    pthread_t thread[threads];
    chunk_job job[threads];
    bool started[threads];
    for (int32_t i = 0; i < threads; i++) {
        job[i] = (chunk_job){data, bytes, sum, i, threads, count};
        started[i] = i > 0 && pthread_create(&thread[i], NULL, sum_chunks, &job[i]) == 0;
    }
    for (int32_t i = 0; i < threads; i++)
        if (!started[i]) sum_chunks(&job[i]);
    for (int32_t i = 1; i < threads; i++)
        if (started[i]) pthread_join(thread[i], NULL);
}

static uint64_t head_checksum(const void *map, size_t column_offset) {
    tms_file_head head;
    memcpy(&head, map, sizeof head);
    head.head_checksum = 0;
    return tms_checksum((const char *)map + sizeof head, column_offset - sizeof head,
                        tms_checksum(&head, sizeof head, 0));
}

/* --- reading --- */

static bool refuse(char why[160], const char *text) {
    snprintf(why, 160, "%s", text);
    return false;
}

static bool check_head(const tms_file_head *head, size_t size, uint64_t key, char why[160]) {
    if (size < sizeof *head || memcmp(head->magic, MAGIC, 8)) return refuse(why, "not a response file");
    if (head->byte_order != BYTE_ORDER_MARK) return refuse(why, "written on a machine of the other byte order");
    if (head->version != FORMAT_VERSION) return refuse(why, "written by another version of this library");
    if (head->key != key) return refuse(why, "made for another mesh, material, support, load or setting");
    if (head->kept_count < 0 || head->kept_count > TMS_MAX_COLUMNS || head->interface_count < 0 ||
        head->interface_count > TMS_MAX_COLUMNS || (head->precision != TM_DOUBLE && head->precision != TM_SINGLE) ||
        head->block != TMS_BLOCK)
        return refuse(why, "its header is damaged");
    const tms_layout l = tms_file_layout(head->kept_count, head->interface_count, (tm_precision)head->precision);
    if ((size_t)head->bytes != l.bytes || size != l.bytes || (size_t)head->column_offset != l.column)
        return refuse(why, "truncated, or longer than its header says");
    return true;
}

static bool check_sums(const char *map, const tms_file_head *head, int32_t threads, char why[160]) {
    const tms_layout l = tms_file_layout(head->kept_count, head->interface_count, (tm_precision)head->precision);
    if (head_checksum(map, l.column) != head->head_checksum)
        return refuse(why, "damaged: the checksum of its header differs");
    uint64_t *sum = tms_alloc(8 * (size_t)(l.blocks ? l.blocks : 1));
    if (!sum) return refuse(why, "no memory to check it");
    checksum_columns(map + l.column, l.bytes - l.column, sum, l.blocks, threads);
    const bool same = !memcmp(sum, map + l.checksum, 8 * (size_t)l.blocks);
    tms_free(sum);
    return same || refuse(why, "damaged: a checksum of its columns differs");
}

bool tms_file_open(const char *path, uint64_t key, int32_t threads, void **map, size_t *bytes, char why[160]) {
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* a FIFO of that name must not block */
    if (fd < 0) return refuse(why, errno == ENOENT ? "no file yet" : "the file cannot be opened");
    struct stat st;
    void *m = MAP_FAILED;
    if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && st.st_size > 0)
        m = mmap(NULL, (size_t)st.st_size, PROT_READ, MAP_SHARED, fd, 0);
    close(fd);
    if (m == MAP_FAILED) return refuse(why, "empty, or not a regular file");
    if (!check_head(m, (size_t)st.st_size, key, why) || !check_sums(m, m, threads, why)) {
        munmap(m, (size_t)st.st_size);
        return false;
    }
    *map = m;
    *bytes = (size_t)st.st_size;
    return true;
}

/* --- writing --- */

/* Fails and leaves the file as it is: the caller abandons it, or keeps its mapped memory. */
static tm_status file_fail(const tms_file_write *file, tm_error *error, const char *what, int number) {
    char size[32];
    tms_bytes_text((int64_t)file->bytes, size);
    return tm_fail(error, TM_ERR_FILE, -1, "%s: %s (%s): %s; %s", file->partial_file, what, size, strerror(number),
                   number == ENOSPC
                       ? "free some space, store the responses in single precision, or choose another folder"
                       : "choose a folder that can be written");
}

/* Opens the partial file; never through a link, never anything but a regular file of this user. */
static int open_part(const tms_file_write *file, tm_error *error) {
    struct stat st;
    const int fd = open(file->partial_file, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0644);
    if (fd < 0) {
        file_fail(file, error, errno == ELOOP ? "is a link; remove it" : "cannot be created", errno);
        return -1;
    }
    if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && st.st_nlink < 2) return fd;
    tm_fail(error, TM_ERR_FILE, -1, "%s: is not a regular file, or has a second name (hard link); remove it",
            file->partial_file);
    close(fd);
    return -1;
}

/* The previous holder of the lock may have renamed or removed the opened file: it is then the finished file, or
 * deleted. */
static bool is_still_partial(int fd, const tms_file_write *file) {
    struct stat mine, there;
    return fstat(fd, &mine) == 0 && lstat(file->partial_file, &there) == 0 && mine.st_dev == there.st_dev &&
           mine.st_ino == there.st_ino && mine.st_nlink == 1;
}

tm_status tms_file_lock(const tm_solve_def *def, const char *path, double wait_s, tms_file_write *file,
                        tm_error *error) {
    *file = (tms_file_write){.fd = -1, .map = MAP_FAILED};
    if (snprintf(file->path, sizeof file->path, "%s", path) >= (int)sizeof file->path)
        return tm_fail(error, TM_ERR_FILE, -1,
                       "the name of the response file is longer than %d bytes; use a shorter one",
                       (int)sizeof file->path - 1);
    snprintf(file->partial_file, sizeof file->partial_file, "%s.part", path);
    const double start = tms_clock_s();
    for (;;) {
        const int fd = open_part(file, error);
        if (fd < 0) return TM_ERR_FILE;
        const int failed = flock(fd, LOCK_EX | LOCK_NB) ? errno : 0;
        if (!failed && is_still_partial(fd, file)) {
            file->fd = fd;
            return TM_OK;
        }
        close(fd); /* not ours to remove */
        if (failed && failed != EWOULDBLOCK && failed != EINTR)
            return file_fail(file, error, "cannot be locked", failed);
        if (!tms_progress(def, "waiting for another run", 0, -1))
            return tm_fail(error, TM_ERR_CONVERGENCE, -1, "stopped by the caller");
        if (tms_clock_s() - start > wait_s)
            return tm_fail(
                error, TM_ERR_FILE, -1,
                "%s: another run is computing this file, and %.0f s of waiting did not suffice; wait until it ends, or end it",
                file->partial_file, wait_s);
        nanosleep(&(struct timespec){.tv_nsec = failed ? 20000000 : 0}, NULL);
    }
}

tm_status tms_file_reserve(tms_file_write *file, size_t bytes, tm_error *error) {
    file->bytes = bytes;
    if (ftruncate(file->fd, 0)) return file_fail(file, error, "cannot be emptied", errno);
    return tms_file_map(file, bytes, error);
}

tm_status tms_file_map(tms_file_write *file, size_t bytes, tm_error *error) {
    file->bytes = bytes;
    const int failed = posix_fallocate(file->fd, 0, (off_t)bytes);
    if (failed) return file_fail(file, error, "the disk is full", failed);
    file->map = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file->fd, 0);
    return file->map == MAP_FAILED ? file_fail(file, error, "cannot be mapped", errno) : TM_OK;
}

tm_status tms_file_commit(tms_file_write *file, uint64_t key, int32_t threads, tm_error *error) {
    tms_file_head *head = file->map;
    head->key = key;
    memcpy(head->magic, MAGIC, 8);
    head->version = FORMAT_VERSION;
    head->byte_order = BYTE_ORDER_MARK;
    head->block = TMS_BLOCK;
    const tms_layout l = tms_file_layout(head->kept_count, head->interface_count, (tm_precision)head->precision);
    head->column_offset = (int64_t)l.column;
    head->bytes = (int64_t)l.bytes;
    checksum_columns((char *)file->map + l.column, l.bytes - l.column,
                     (uint64_t *)(void *)((char *)file->map + l.checksum), l.blocks, threads);
    head->head_checksum = 0;
    head->head_checksum = head_checksum(file->map, l.column);
    /* Truncates only when the checksums are on the disk: until then the journal is still useful. */
    if (msync(file->map, file->bytes, MS_SYNC) || ftruncate(file->fd, (off_t)l.bytes) || fsync(file->fd))
        return file_fail(file, error, "cannot be flushed to disk", errno);
    if (rename(file->partial_file, file->path)) return file_fail(file, error, "cannot be renamed", errno);
    munmap(file->map, file->bytes);
    close(file->fd);
    *file = (tms_file_write){.fd = -1, .map = MAP_FAILED};
    return TM_OK;
}

void *tms_file_keep(tms_file_write *file) {
    void *map = file->map;
    file->map = MAP_FAILED;
    tms_file_abandon(file);
    return map;
}

void tms_file_abandon(tms_file_write *file) {
    if (file->map != MAP_FAILED) munmap(file->map, file->bytes);
    if (file->fd >= 0) {
        if (!file->keep_partial) unlink(file->partial_file);
        close(file->fd);
    }
    file->map = MAP_FAILED;
    file->fd = -1;
}
