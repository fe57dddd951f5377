/* The block of bytes that the cache holds: what is not whole and sound is refused, and nothing leaks. */
#include "../fixture.h"
#include "common/mesh_parts.h"

static app_mesh two_tets(void) {
    app_mesh m = {
        .vertex_count = 5, .tet_count = 2, .region_count = 2, .group_count = 2, .hash = 0x1234567890abcdefULL};
    static const double p[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1};
    static const int32_t tet[8] = {0, 1, 2, 3, 1, 2, 3, 4}, group[4] = {0, 1, 3, 4};
    assert_true(app_mesh_allocate(&m, 4));
    memcpy(m.vertex_m, p, sizeof p);
    memcpy(m.tet, tet, sizeof tet);
    memcpy(m.group_vertex, group, sizeof group);
    m.group_begin[1] = 1;
    m.group_begin[2] = 4;
    m.region[1] = 1;
    strcpy(m.region_name[0], "left");
    strcpy(m.region_name[1], "right");
    strcpy(m.group_name[0], "patch");
    strcpy(m.group_name[1], "other");
    for (int i = 0; i < 5; i++) m.vertex_tag[i] = 10 + i;
    for (int i = 0; i < 2; i++) m.tet_tag[i] = 100 + i;
    return m;
}

static void test_round_trip(void **state) {
    (void)state;
    app_mesh m = two_tets(), back;
    size_t size;
    void *block = app_mesh_encode(&m, &size);
    assert_non_null(block);
    assert_int_equal(app_mesh_decode(block, size, m.hash, &back, NULL), TM_OK);
    assert_memory_equal(m.vertex_m, back.vertex_m, 15 * sizeof(double));
    assert_memory_equal(m.tet, back.tet, 8 * sizeof(int32_t));
    assert_memory_equal(m.region, back.region, 2 * sizeof(int32_t));
    assert_memory_equal(m.vertex_tag, back.vertex_tag, 5 * sizeof(int64_t));
    assert_memory_equal(m.tet_tag, back.tet_tag, 2 * sizeof(int64_t));
    assert_memory_equal(m.group_begin, back.group_begin, 3 * sizeof(int32_t));
    assert_memory_equal(m.group_vertex, back.group_vertex, 4 * sizeof(int32_t));
    assert_string_equal(back.region_name[1], "right");
    assert_string_equal(back.group_name[0], "patch");
    assert_true(back.hash == m.hash);
    app_mesh_free(&back);
    app_mesh_free(&m);
    free(block);
}

/* Exactly as long as given, so that a sanitizer sees a read beyond. */
static tm_status decode_copy(const void *block, size_t size, uint64_t hash) {
    app_mesh back;
    void *copy = malloc(size + !size);
    memcpy(copy, block, size);
    tm_status status = app_mesh_decode(copy, size, hash, &back, NULL);
    if (status == TM_OK)
        app_mesh_free(&back);
    else
        assert_null(back.vertex_m);
    free(copy);
    return status;
}

static void test_every_truncation_is_refused(void **state) {
    (void)state;
    app_mesh m = two_tets();
    size_t size;
    char *block = app_mesh_encode(&m, &size);
    for (size_t length = 0; length < size; length++) assert_int_equal(decode_copy(block, length, m.hash), TM_ERR_FILE);
    char *longer = malloc(size + 1);
    memcpy(longer, block, size);
    longer[size] = 0;
    assert_int_equal(decode_copy(longer, size + 1, m.hash), TM_ERR_FILE);
    assert_int_equal(decode_copy(block, size, m.hash + 1), TM_ERR_FILE);
    free(longer);
    free(block);
    app_mesh_free(&m);
}

static void test_every_flipped_bit_is_refused(void **state) {
    (void)state;
    app_mesh m = two_tets();
    size_t size;
    unsigned char *block = app_mesh_encode(&m, &size);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        block[bit / 8] ^= (unsigned char)(1u << bit % 8);
        if (decode_copy(block, size, m.hash) != TM_ERR_FILE)
            fail_msg("bit %zu of byte %zu was accepted", bit % 8, bit / 8);
        block[bit / 8] ^= (unsigned char)(1u << bit % 8);
    }
    free(block);
    app_mesh_free(&m);
}

/* A right checksum over wrong contents: each index is checked. */
static void test_wrong_contents_with_right_checksum(void **state) {
    (void)state;
    for (int kind = 0; kind < 6; kind++) {
        app_mesh m = two_tets();
        size_t size;
        if (kind == 0) m.tet[3] = 5;
        if (kind == 1) m.tet[0] = -1;
        if (kind == 2) m.region[0] = 2;
        if (kind == 3) m.group_vertex[2] = 5;
        if (kind == 4) memset(m.group_name[1], 'x', sizeof m.group_name[1]);
        if (kind == 5) m.group_begin[1] = 5; /* the next bound is lower */
        void *block = app_mesh_encode(&m, &size);
        assert_int_equal(decode_copy(block, size, m.hash), TM_ERR_FILE);
        free(block);
        app_mesh_free(&m);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_every_truncation_is_refused),
        cmocka_unit_test(test_every_flipped_bit_is_refused),
        cmocka_unit_test(test_wrong_contents_with_right_checksum),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
