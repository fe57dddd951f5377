/* Marks in the picture: fibres that move with the tissue, supports where it is fixed, arrows seen end on, labels
 * outside the panels. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "libtensormass/numeric/random.h"
#include "view/layout.h"
#include "view/shapes.h"

/* One tetrahedron in a mesh of 9 vertices; the surface has one of its faces: vertices 7, 2, 5, in another order. */
static int32_t face[4 * 4] = {2, 5, 7, 0, 2, 5, 8, 0, 2, 7, 8, 0, 5, 7, 8, 0};
static float rest[27];
static float surface_m[9], fibre[3];
static int32_t id[3] = {7, 2, 5}, triangle[3] = {0, 1, 2};
static uint8_t kind[1], held[9];

static view_surface surface(void) {
    return (view_surface){.vertex_count = 3,
                          .triangle_count = 1,
                          .vertex_m = surface_m,
                          .vertex_id = id,
                          .triangle = triangle,
                          .kind = kind};
}

static view_marks marks(void) {
    return (view_marks){
        .vertex_count = 9, .tet_count = 1, .support_of = held, .rest_m = rest, .fibre = fibre, .face = face};
}

static void set(int32_t vertex, float x, float y, float z) {
    memcpy(rest + 3 * vertex, (float[3]){x, y, z}, sizeof(float[3]));
}

/* At rest in the plane z = 0; now rotated by a quarter turn about x and sheared along it. */
static void deform(const float at[3], float now[3]) { now[0] = at[0] + 0.5f * at[1], now[1] = -at[2], now[2] = at[1]; }

static void prepare(float fx, float fy, float fz) {
    set(7, 0, 0, 0), set(2, 3, 0.5f, 0), set(5, -1, 2, 0);
    memcpy(fibre, (float[3]){fx, fy, fz}, sizeof fibre);
    for (int c = 0; c < 3; c++) deform(rest + 3 * id[c], surface_m + 3 * c);
}

/* The long side of the ribbon, normalised. */
static float run_of(const view_shape *s, float run[3]) {
    float length = 0;
    for (int k = 0; k < 3; k++) run[k] = s->vertex[1].at_m[k] - s->vertex[0].at_m[k], length += run[k] * run[k];
    length = sqrtf(length);
    for (int k = 0; k < 3; k++) run[k] /= length;
    return length;
}

static void test_fibres_move_with_the_tissue(void **state) {
    (void)state;
    view_shape s = {0};
    view_marks m = marks();
    prepare(0.6f, 0.8f, 0);
    view_surface now = surface();
    view_shape_fibres(&s, &m, &now);
    assert_int_equal(s.count, 6);
    float run[3], wanted[3];
    float whole = run_of(&s, run);
    deform(fibre, wanted); /* linear: a direction deforms as a point does */
    float length = sqrtf(wanted[0] * wanted[0] + wanted[1] * wanted[1] + wanted[2] * wanted[2]);
    for (int k = 0; k < 3; k++) assert_float_equal(run[k], wanted[k] / length, 1e-5);
    /* Half along the normal: the component in the surface keeps its direction and is shorter by as much. */
    s.count = 0;
    prepare(0.6f * 0.5f, 0.8f * 0.5f, sqrtf(0.75f));
    view_shape_fibres(&s, &m, &now);
    assert_int_equal(s.count, 6);
    assert_float_equal(run_of(&s, run), 0.5f * whole, 1e-4f * whole);
    for (int k = 0; k < 3; k++) assert_float_equal(run[k], wanted[k] / length, 1e-5);
    /* Through the surface: no component along it. */
    s.count = 0;
    prepare(0, 0, 1);
    view_shape_fibres(&s, &m, &now);
    assert_int_equal(s.count, 0);
    /* A face of no tetrahedron, a number of no vertex: from another scene, omitted. */
    prepare(1, 0, 0);
    for (int32_t wrong = 8; wrong < 1000; wrong += 991) {
        id[1] = wrong == 8 ? 3 : wrong;
        view_shape_fibres(&s, &m, &now);
        assert_int_equal(s.count, 0);
    }
    id[1] = 2;
    view_shape_free(&s);
}

static void test_supports_are_drawn_where_tissue_is_fixed(void **state) {
    (void)state;
    view_shape s = {0};
    view_marks m = marks();
    prepare(1, 0, 0);
    view_surface now = surface();
    held[5] = 2, held[8] = 1; /* 8 is no surface vertex */
    view_shape_supports(&s, &m, &now, 0.25f);
    assert_int_equal(s.count, 24);
    for (int32_t i = 0; i < s.count; i++) {
        float away2 = 0;
        for (int k = 0; k < 3; k++) {
            float d = s.vertex[i].at_m[k] - surface_m[6 + k];
            away2 += d * d;
        }
        assert_float_equal(sqrtf(away2), 0.25f, 1e-5);
    }
    m.support_of = NULL;
    s.count = 0;
    view_shape_supports(&s, &m, &now, 0.25f);
    assert_int_equal(s.count, 0);
    view_shape_free(&s);
}

/* An arrow seen end on is flat and open, a ring; seen across it is long. */
static void test_arrow_seen_end_on_is_a_ring(void **state) {
    (void)state;
    const view_camera camera = {.eye_m = {0, 0, 1}, .up = {0, 1, 0}};
    const double from[3] = {0.01, 0, 0}, across[3] = {0.1, 0, 0}, at_eye[3] = {0, 0, 0.1}, away[3] = {0.02, 0, -0.1};
    assert_int_equal(view_camera_facing(&camera, from, across), 0);
    assert_int_equal(view_camera_facing(&camera, from, at_eye), 1);
    assert_int_equal(view_camera_facing(&camera, from, away), -1);
    const double *const along[3] = {across, at_eye, away};
    int32_t count[3];
    for (int i = 0; i < 3; i++) {
        view_shape s = {0};
        view_shape_arrow(&s, from, along[i], 0.01f, VIEW_PAINT_ARROW_0, &camera);
        float low = 1, high = -1;
        for (int32_t v = 0; v < s.count; v++) {
            float z = s.vertex[v].at_m[2];
            low = fminf(low, z), high = fmaxf(high, z);
        }
        count[i] = s.count;
        if (i) assert_true(high - low < 0.002f); /* in the plane that faces the eye */
        view_shape_free(&s);
    }
    assert_true(count[1] > 0 && count[2] > 0 && count[1] != count[2]);
}

static void test_labels_stay_outside_the_panels(void **state) {
    (void)state;
    view_layout l = {0};
    view_layout_take(&l, 10, 10, 200, 60);
    view_layout_take(&l, 300, 10, 390, 60);
    view_layout_take(&l, 10, 220, 390, 290);
    float free_already[4] = {220, 100, 260, 120}, here[4] = {190, 20, 240, 40};
    view_layout_find_space(&l, 400, 300, 3, free_already);
    assert_float_equal(free_already[0], 220, 0);
    view_layout_find_space(&l, 400, 300, 3, here);
    assert_float_equal(here[0], 203, 1e-3); /* directly outside the panel */
    assert_float_equal(here[1], 20, 1e-3);
    uint32_t seed = 1;
    for (int i = 0; i < 5000; i++) {
        float b[4];
        b[0] = (float)(num_random32(&seed) >> 8) / 16777216.0f * 340;
        b[1] = (float)(num_random32(&seed) >> 8) / 16777216.0f * 280;
        b[2] = b[0] + 60, b[3] = b[1] + 20;
        view_layout_find_space(&l, 400, 300, 3, b);
        assert_false(view_layout_taken(&l, b));
        assert_true(b[0] >= 0 && b[1] >= 0 && b[2] <= 400 && b[3] <= 300);
        assert_float_equal(b[2] - b[0], 60, 1e-3);
    }
    float large[4] = {0, 0, 399, 299}, kept[4];
    memcpy(kept, large, sizeof kept);
    view_layout_find_space(&l, 400, 300, 3, large);
    assert_memory_equal(large, kept, sizeof kept);
}

static void test_ties_are_drawn_from_end_to_end(void **state) {
    (void)state;
    float end_m[12] = {0, 0, 0, 0.3f, 0, 0.4f, 1, 1, 1, 1, 1, 1};
    view_ties ties = {.total = 3, .count = 1, .end_m = end_m};
    view_shape s = {0};
    view_shape_ties(&s, &ties, 1e-3f);
    const int32_t one = s.count;
    assert_true(one > 0);
    float nearest[2] = {1, 1};
    for (int32_t i = 0; i < s.count; i++)
        for (int e = 0; e < 2; e++) {
            float d2 = 0;
            for (int k = 0; k < 3; k++)
                d2 += (s.vertex[i].at_m[k] - end_m[3 * e + k]) * (s.vertex[i].at_m[k] - end_m[3 * e + k]);
            nearest[e] = fminf(nearest[e], sqrtf(d2));
        }
    assert_float_equal(nearest[0], 1.5e-3f, 1e-6);
    assert_float_equal(nearest[1], 1.5e-3f, 1e-6);
    s.count = 0, ties.count = 2; /* the second has no length */
    view_shape_ties(&s, &ties, 1e-3f);
    assert_int_equal(s.count, one);
    view_shape_free(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fibres_move_with_the_tissue),
        cmocka_unit_test(test_supports_are_drawn_where_tissue_is_fixed),
        cmocka_unit_test(test_ties_are_drawn_from_end_to_end),
        cmocka_unit_test(test_arrow_seen_end_on_is_a_ring),
        cmocka_unit_test(test_labels_stay_outside_the_panels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
