/* A SocketCAN interface that disappears during use. The tick's thread only sends and receives; the monitoring thread
 * opens another socket, and recover takes it over. The kernel's calls are replaced, as the machine may have no CAN. */
#include <errno.h>
#include <linux/can.h>
#include <net/if.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cmocka.h>

#include "io/bus.h"

static bool there = true; /* the interface */
static int cable = -1;    /* the far end of the socket opened last */
static int opened, closed, calls;

unsigned if_nametoindex(const char *name) {
    (void)name;
    calls++;
    if (!there) errno = ENODEV;
    return there ? 3 : 0;
}

int socket(int family, int type, int protocol) {
    (void)family, (void)type, (void)protocol;
    int pair[2];
    calls++;
    if (socketpair(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0, pair) != 0) return -1;
    if (cable >= 0) close(cable), closed--;
    cable = pair[1];
    opened++;
    return pair[0];
}

int setsockopt(int fd, int level, int name, const void *value, socklen_t size) {
    (void)fd, (void)level, (void)name, (void)value, (void)size;
    calls++;
    return 0;
}

int bind(int fd, const struct sockaddr *address, socklen_t size) {
    (void)fd, (void)address, (void)size;
    calls++;
    return 0;
}

int close(int fd) {
    calls++, closed++;
    return (int)syscall(SYS_close, fd);
}

ssize_t recv(int fd, void *into, size_t size, int flags) {
    if (!there) {
        errno = ENETDOWN;
        return -1;
    }
    return recvfrom(fd, into, size, flags, NULL, NULL);
}

static void check_receives(hrt_bus *bus, uint8_t value) {
    const struct can_frame out = {.can_id = 0x123, .can_dlc = 1, .data = {value}};
    hrt_can_frame got;
    assert_int_equal(send(cable, &out, sizeof out, 0), sizeof out);
    assert_int_equal(hrt_bus_receive(bus, &got), 1);
    assert_int_equal(got.data[0], value);
}

/* A tick of the controller, which makes no other call; returns whether the bus works then. */
static bool tick(hrt_bus *bus, int64_t now_us) {
    hrt_can_frame frame;
    const int before = calls;
    while (hrt_bus_receive(bus, &frame) > 0) {
    }
    if (hrt_bus_state_now(bus) >= HRT_BUS_OFF) hrt_bus_recover(bus, now_us);
    assert_int_equal(calls, before);
    return hrt_bus_state_now(bus) < HRT_BUS_OFF;
}

static void recover_uses_the_socket_opened_by_monitoring(void **state) {
    (void)state;
    hrt_bus bus;
    char why[300];
    int64_t now_us = 0;
    assert_true(hrt_bus_open(&bus, "socketcan:can0", why, sizeof why));
    check_receives(&bus, 7);
    for (int round = 0; round < 3; round++) {
        assert_null(hrt_bus_look(&bus));
        assert_int_equal(opened, round + 1); /* nothing is opened while all is well */
        there = false;
        for (int i = 0; i < 200; i++) assert_false(tick(&bus, now_us += 2000));
        hrt_bus_look(&bus); /* not there yet */
        assert_false(tick(&bus, now_us += 2000));
        there = true;
        assert_false(tick(&bus, now_us += 2000));
        hrt_bus_look(&bus);
        hrt_bus_look(&bus);
        assert_int_equal(opened, round + 2);
        assert_true(tick(&bus, now_us += 2000));
        check_receives(&bus, (uint8_t)(20 + round));
        assert_int_equal(closed, round); /* the old one waits */
        hrt_bus_look(&bus);
        assert_int_equal(closed, round + 1);
    }
    hrt_bus_close(&bus);
    assert_int_equal(closed, opened);
}

/* The bus is closed before the tick took over the opened socket. */
static void unused_sockets_are_closed(void **state) {
    (void)state;
    hrt_bus bus;
    char why[300];
    opened = closed = 0;
    assert_true(hrt_bus_open(&bus, "socketcan:can0", why, sizeof why));
    there = false;
    assert_false(tick(&bus, 2000));
    there = true;
    hrt_bus_look(&bus);
    assert_int_equal(opened, 2);
    hrt_bus_close(&bus);
    assert_int_equal(closed, 2);
}

/* A CAN-FD frame leaves by its own size, with its bit rate switch, and arrives as one; a classical one beside it stays
 * one. */
static void fd_frames_pass_with_all_their_bytes(void **state) {
    (void)state;
    hrt_bus bus;
    char why[300];
    assert_true(hrt_bus_open(&bus, "socketcan:can0", why, sizeof why));
    hrt_can_frame frame = {.id = 0x8001, .length = 48, .flags = HRT_CAN_EXTENDED | HRT_CAN_FD}, got;
    for (int i = 0; i < 64; i++) frame.data[i] = (uint8_t)(3 * i + 1);
    const hrt_can_frame classical = {.id = 5, .length = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}};
    struct canfd_frame out;
    assert_int_equal(hrt_bus_send(&bus, &frame), 1);
    assert_int_equal(recvfrom(cable, &out, sizeof out, 0, NULL, NULL), CANFD_MTU);
    assert_true(out.len == 48 && (out.flags & CANFD_BRS) && out.can_id == (0x8001 | CAN_EFF_FLAG));
    assert_memory_equal(out.data, frame.data, 48);
    assert_int_equal(send(cable, &out, CANFD_MTU, 0), CANFD_MTU);
    assert_int_equal(hrt_bus_receive(&bus, &got), 1);
    assert_true(got.flags == frame.flags && got.length == 48);
    assert_memory_equal(got.data, frame.data, 48);
    assert_int_equal(hrt_bus_send(&bus, &classical), 1);
    assert_int_equal(recvfrom(cable, &out, sizeof out, 0, NULL, NULL), CAN_MTU);
    assert_int_equal(send(cable, &out, CAN_MTU, 0), CAN_MTU);
    assert_int_equal(hrt_bus_receive(&bus, &got), 1);
    assert_true(got.flags == 0 && got.length == 8);
    assert_memory_equal(got.data, classical.data, 8);
    hrt_bus_close(&bus);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(recover_uses_the_socket_opened_by_monitoring),
        cmocka_unit_test(unused_sockets_are_closed),
        cmocka_unit_test(fd_frames_pass_with_all_their_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
