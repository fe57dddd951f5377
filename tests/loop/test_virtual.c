/* A virtual bus whose file disappears during use. The tick's thread opens and maps nothing; the monitoring thread
 * does, at the same path, and recover continues there. */
#include <dirent.h>
#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "io/bus.h"

static char directory[] = "/tmp/tm_virtual_XXXXXX";

static int open_files(void) {
    int count = 0;
    DIR *all = opendir("/proc/self/fd");
    while (all && readdir(all)) count++;
    if (all) closedir(all);
    return count;
}

static bool is_mapped(const char *path) {
    char line[600];
    bool found = false;
    FILE *maps = fopen("/proc/self/maps", "r");
    while (maps && fgets(line, sizeof line, maps)) found = found || (strstr(line, path) && !strstr(line, "(deleted)"));
    if (maps) fclose(maps);
    return found;
}

static int start(void **state) {
    (void)state;
    return !mkdtemp(directory) || setenv("TM_BUS_DIR", directory, 1);
}

static int end(void **state) {
    (void)state;
    return rmdir(directory);
}

static void open_two(hrt_bus bus[2], const char *address) {
    char why[300] = "";
    for (int i = 0; i < 2; i++) {
        if (!hrt_bus_open(&bus[i], address, why, sizeof why)) fail_msg("%s", why);
        assert_true(hrt_bus_claim(&bus[i], i ? HRT_BUS_DEVICE : HRT_BUS_CONTROLLER, 0, why, sizeof why));
    }
}

static void check_passes(hrt_bus bus[2]) {
    hrt_can_frame sent = {.id = 0x123, .length = 64, .flags = HRT_CAN_FD, .data = {7, 9, [63] = 5}}, got;
    for (int i = 0; i < 2; i++) {
        assert_int_equal(hrt_bus_send(&bus[i], &sent), 1);
        assert_int_equal(hrt_bus_receive(&bus[1 - i], &got), 1);
        assert_int_equal(got.id, 0x123);
        assert_true(got.length == 64 && got.flags == HRT_CAN_FD);
        assert_memory_equal(got.data, sent.data, 64);
    }
}

/* One end's file is deleted: checks the tick's thread alone, then with the monitoring thread's check, then after
 * unmapping. */
static void come_back(hrt_bus *bus, const char *path, int64_t *now_us) {
    for (int i = 0; i < 20; i++) {
        const int files = open_files();
        const bool mapped = is_mapped(path);
        hrt_bus_recover(bus, *now_us += 200000);
        assert_int_equal(hrt_bus_state_now(bus), HRT_BUS_DOWN);
        assert_int_equal(open_files(), files);
        assert_int_equal(is_mapped(path), mapped);
    }
    const int files = open_files();
    hrt_bus_look(bus);
    assert_int_equal(hrt_bus_state_now(bus), HRT_BUS_DOWN);
    assert_true(is_mapped(path));
    hrt_bus_recover(bus, *now_us += 200000);
    assert_int_equal(hrt_bus_state_now(bus), HRT_BUS_OK);
    assert_int_equal(open_files(), files);
    assert_string_equal(hrt_bus_look(bus), "its file exists again");
    assert_null(hrt_bus_look(bus));
    assert_int_equal(open_files(), files); /* the old one is closed */
}

static void check_removed(void) {
    hrt_bus bus[2];
    int64_t now_us = 0;
    open_two(bus, "virtual:gone");
    check_passes(bus);
    for (int round = 0; round < 3; round++) {
        unlink(bus[0].name);
        for (int i = 0; i < 2; i++) {
            const char *said = hrt_bus_look(&bus[i]);
            assert_non_null(said);
            assert_non_null(strstr(said, "removed"));
        }
        /* A tick may have used the old file when the check found it deleted: the next one maps the new file. */
        for (int i = 0; i < 2; i++) come_back(&bus[i], bus[0].name, &now_us);
        check_passes(bus);
    }
    for (int i = 0; i < 2; i++) hrt_bus_close(&bus[i]);
}

static void check_cut_short(void) {
    hrt_bus bus[2];
    int64_t now_us = 0;
    open_two(bus, "virtual:short");
    assert_int_equal(truncate(bus[0].name, 0), 0);
    hrt_can_frame frame = {.id = 1};
    for (int i = 0; i < 2; i++) hrt_bus_send(&bus[i], &frame); /* touches pages that no longer exist */
    for (int i = 0; i < 2; i++) come_back(&bus[i], bus[0].name, &now_us);
    check_passes(bus);
    for (int i = 0; i < 2; i++) hrt_bus_close(&bus[i]);
}

/* One test: each would get cmocka's own handler of SIGBUS, and the bus sets its own only once. */
static void recover_uses_the_file_mapped_by_monitoring(void **state) {
    (void)state;
    check_removed();
    check_cut_short();
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(recover_uses_the_file_mapped_by_monitoring)};
    return cmocka_run_group_tests(tests, start, end);
}
