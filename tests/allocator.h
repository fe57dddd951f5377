/* An allocator for tm_set_allocator that counts, and fails on the n-th or on every call while armed. */
#ifndef TM_TEST_ALLOCATOR_H
#define TM_TEST_ALLOCATOR_H

#include "fixture.h"

static struct {
    int64_t calls, fail_at, live, live_bytes;
    bool armed;
} hook;

static void *hook_alloc(size_t bytes, void *user) {
    assert_ptr_equal(user, &hook);
    hook.calls++;
    if (hook.armed || hook.calls == hook.fail_at) return NULL;
    hook.live++, hook.live_bytes += (int64_t)bytes;
    void *memory = aligned_alloc(64, bytes);
    memset(memory, 0xA5, bytes);
    return memory;
}
static void hook_free(void *memory, size_t bytes, void *user) {
    assert_ptr_equal(user, &hook);
    hook.live--, hook.live_bytes -= (int64_t)bytes;
    memset(memory, 0x5A, bytes);
    free(memory);
}

/* Checks that nothing is allocated. */
static void hook_install(int64_t fail_at) {
    memset(&hook, 0, sizeof hook);
    hook.fail_at = fail_at;
    tm_set_allocator(&(tm_allocator){hook_alloc, hook_free, &hook});
}

/* Checks that everything allocated was freed, with the size of its allocation. */
static void hook_check_empty(void) {
    assert_int_equal(hook.live, 0);
    assert_int_equal(hook.live_bytes, 0);
    assert_int_equal(tm_memory_in_use(), 0);
}

#endif
