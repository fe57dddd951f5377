/* The file of responses during its computation, PATH.part. It equals the final file except for its magic; after its end
 * it has the checksum of each finished block of columns (0: not yet). A killed run is continued, and ranks write their
 * own blocks. */
#include "internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const char MAGIC[8] = "TMPART\r\n";

static tms_file_head lay_out(tms_partial_file *part, const tms_file_head *head) {
    const tms_layout l = tms_file_layout(head->kept_count, head->interface_count, (tm_precision)head->precision);
    *part = (tms_partial_file){.block_count = (head->kept_count + head->interface_count + TMS_BLOCK - 1) / TMS_BLOCK,
                               .fd = -1,
                               .column = l.column,
                               .journal = (l.bytes + 7) / 8 * 8,
                               .block_bytes = (size_t)TMS_BLOCK * (size_t)head->kept_count *
                                              (head->precision == TM_DOUBLE ? 8 : 4)};
    tms_file_head expected = *head;
    memcpy(expected.magic, MAGIC, 8);
    expected.column_offset = (int64_t)l.column;
    expected.bytes = (int64_t)l.bytes;
    return expected;
}

static size_t part_bytes(const tms_partial_file *part) { return part->journal + 8 * (size_t)part->block_count; }

/* Returns a checksum that is never 0, the mark of an empty block. */
static uint64_t sum_of(int32_t block, const void *data, size_t bytes) {
    return tms_checksum(data, bytes, (uint64_t)block) | 1;
}

static size_t bytes_of(const tms_partial_file *part, int32_t block, size_t end) {
    const size_t at = part->column + (size_t)block * part->block_bytes;
    return end - at < part->block_bytes ? end - at : part->block_bytes;
}

/* Returns whether the file belongs to this problem and has the right size. The condensed stiffness has no checksum, so
 * such files are never continued. */
static bool can_go_on(const tms_partial_file *part, const tms_file_head *expected, int fd) {
    struct stat st;
    tms_file_head there;
    return expected->interface_count == 0 && fstat(fd, &st) == 0 && (size_t)st.st_size == part_bytes(part) &&
           pread(fd, &there, sizeof there, 0) == (ssize_t)sizeof there && !memcmp(&there, expected, sizeof there);
}

tm_status tms_partial_file_begin(tms_partial_file *part, tms_file_write *file, const tms_file_head *head,
                                 tm_error *error) {
    const tms_file_head expected = lay_out(part, head);
    const bool go_on = can_go_on(part, &expected, file->fd);
    const tm_status status =
        go_on ? tms_file_map(file, part_bytes(part), error) : tms_file_reserve(file, part_bytes(part), error);
    if (status != TM_OK) return status;
    const tms_layout l = tms_file_layout(head->kept_count, head->interface_count, (tm_precision)head->precision);
    char *map = file->map;
    memcpy(map, &expected, sizeof expected);
    part->done = (uint64_t *)(void *)(map + part->journal);
    file->keep_partial = true;
    for (int32_t b = 0; b < part->block_count; b++) {
        const char *data = map + part->column + (size_t)b * part->block_bytes;
        if (part->done[b] && part->done[b] != sum_of(b, data, bytes_of(part, b, l.bytes))) part->done[b] = 0;
        part->found += part->done[b] != 0;
    }
    return TM_OK;
}

tm_status tms_partial_file_join(tms_partial_file *part, const char *path, const tms_file_head *head, tm_error *error) {
    char name[1040];
    const tms_file_head expected = lay_out(part, head);
    const size_t bytes = 8 * (size_t)part->block_count;
    snprintf(name, sizeof name, "%s.part", path);
    errno = 0;
    part->fd = open(name, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    part->done = tms_alloc(bytes);
    if (part->fd >= 0 && part->done && can_go_on(part, &expected, part->fd) &&
        pread(part->fd, part->done, bytes, (off_t)part->journal) == (ssize_t)bytes)
        return TM_OK;
    const int number = errno;
    if (part->fd >= 0) close(part->fd);
    tms_free(part->done);
    *part = (tms_partial_file){.fd = -1};
    return tm_fail(error, TM_ERR_FILE, -1,
                   "%s: is not the file that rank 0 made (%s); put it into a folder that all ranks share", name,
                   number ? strerror(number) : "another one");
}

static bool write_all(int fd, const char *data, size_t bytes, size_t at) {
    while (bytes > 0) {
        const ssize_t done = pwrite(fd, data, bytes, (off_t)at);
        if (done < 0 && errno == EINTR) continue;
        if (done <= 0) return false;
        data += done, at += (size_t)done, bytes -= (size_t)done;
    }
    return true;
}

bool tms_partial_file_put(tms_partial_file *part, int32_t block, const void *data, size_t bytes) {
    const uint64_t sum = sum_of(block, data, bytes);
    if (part->fd < 0) { /* the block itself is already mapped; recorded after it, in case of a crash */
        __atomic_store_n(&part->done[block], sum, __ATOMIC_RELEASE);
        return true;
    }
    part->done[block] = sum;
    return write_all(part->fd, data, bytes, part->column + (size_t)block * part->block_bytes) &&
           write_all(part->fd, (const char *)&sum, 8, part->journal + 8 * (size_t)block);
}

int32_t tms_partial_file_columns(const tms_partial_file *part, int32_t columns) {
    const int64_t found = (int64_t)part->found * TMS_BLOCK;
    return found < columns ? (int32_t)found : columns;
}

void tms_partial_file_end(tms_partial_file *part) {
    if (part->fd >= 0) { /* rank above 0 */
        close(part->fd);
        tms_free(part->done);
    }
    part->done = NULL;
    part->fd = -1;
}
