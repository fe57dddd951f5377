/* The interface of the hybrid model: a jagged one is smoothed, a smooth one stays. */
#include "../../libtensormass/solve/hybrid.h"
#include "kit.h"

enum { CELLS = 8 };
static const double SIDE_M = 0.08;

typedef struct set {
    tm_mesh *mesh;
    tm_tissue *whole;
    uint8_t *fixed, *dynamic;
} set;

/* Dynamic: tetrahedra whose centre is above a height, in cells; a centre is a quarter, half or three quarters of a
 * cell above its cell's floor. */
static set make(double above) {
    fix_random random = {5};
    set s = {.mesh = fix_block((int[]){CELLS, CELLS, CELLS}, (double[]){SIDE_M, SIDE_M, SIDE_M}, 0, &random)};
    const tm_material material = kit_material(5e3, 0.45);
    const size_t dofs = 3 * (size_t)s.mesh->vertex_count;
    s.fixed = calloc(dofs, 1);
    s.dynamic = calloc((size_t)s.mesh->tet_count, 1);
    for (size_t d = 0; d < dofs; d++) s.fixed[d] = s.mesh->rest_m[d / 3 * 3 + 2] < 1e-9;
    for (int32_t t = 0; t < s.mesh->tet_count; t++) {
        double z = 0;
        for (int i = 0; i < 4; i++) z += s.mesh->rest_m[3 * s.mesh->tet[4 * t + i] + 2] / 4;
        s.dynamic[t] = z > above * SIDE_M / CELLS;
    }
    tm_tissue_def def = tm_tissue_def_default();
    tm_error error;
    def.mesh = s.mesh, def.material_count = 1, def.material = &material;
    fix_ok(tm_tissue_create(&def, &s.whole, &error), &error);
    return s;
}

static void free_set(set *s) {
    tm_tissue_destroy(s->whole);
    tm_mesh_destroy(s->mesh);
    free(s->fixed), free(s->dynamic);
}

static tm_hybrid *hybrid_of(const set *s, bool as_marked) {
    tm_hybrid *made;
    tm_error error;
    tm_hybrid_def def = tm_hybrid_def_default();
    def.problem = kit_problem(s->whole, s->fixed);
    def.dynamic = s->dynamic;
    def.as_marked = as_marked;
    fix_ok(tm_hybrid_create(&def, &made, NULL, &error), &error);
    return made;
}

static int32_t joined(const set *s, const tm_hybrid *h) {
    int32_t count = 0;
    for (int32_t t = 0; t < s->mesh->tet_count; t++) {
        assert_true(h->alive[t] || !s->dynamic[t]); /* all requested tetrahedra stay dynamic */
        count += h->alive[t] && !s->dynamic[t];
    }
    return count;
}

static void jagged_interface_is_smoothed(void **state) {
    (void)state;
    set s = make(5.4); /* through a layer of cells: two thirds of their tetrahedra are above */
    tm_hybrid *marked = hybrid_of(&s, true), *smooth = hybrid_of(&s, false);
    assert_int_equal(joined(&s, marked), 0);
    const int32_t filled = joined(&s, smooth);
    print_message("  border of %d components, %d as marked; %d tetrahedra more\n", smooth->interface_count,
                  marked->interface_count, filled);
    assert_int_equal(smooth->interface_count, 3 * (CELLS + 1) * (CELLS + 1));
    assert_true(smooth->interface_count < 0.6 * marked->interface_count);
    assert_true(filled > 0 && filled <= 6 * CELLS * CELLS);
    tm_hybrid_destroy(marked), tm_hybrid_destroy(smooth);
    free_set(&s);
}

static void assert_stays(const set *s) {
    tm_hybrid *smooth = hybrid_of(s, false);
    assert_int_equal(joined(s, smooth), 0);
    tm_hybrid_destroy(smooth);
}

static void smooth_interface_is_unchanged(void **state) {
    (void)state;
    set s = make(5);
    assert_stays(&s);
    free_set(&s);
}

/* A few single teeth do not justify smoothing. */
static void few_teeth_are_not_smoothed(void **state) {
    (void)state;
    set s = make(5);
    int32_t taken = 0;
    for (int32_t t = 0; t < s.mesh->tet_count && taken < 3; t++) {
        const int32_t other = s.mesh->tet_neighbour[4 * t];
        if (!s.dynamic[t] && other >= 0 && s.dynamic[other]) s.dynamic[t] = 1, taken++;
    }
    assert_int_equal(taken, 3);
    assert_stays(&s);
    free_set(&s);
}

/* The last condensed tetrahedra are kept: without them there would be no interface. */
static void last_condensed_tetrahedra_are_kept(void **state) {
    (void)state;
    set s = make(0);
    const int32_t middle = s.mesh->tet_count / 2;
    s.dynamic[middle] = 0; /* of all, the only one */
    assert_true(tms_hybrid_smooth(s.mesh, s.dynamic));
    assert_int_equal(s.dynamic[middle], 0);
    free_set(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(jagged_interface_is_smoothed), cmocka_unit_test(smooth_interface_is_unchanged),
        cmocka_unit_test(few_teeth_are_not_smoothed), cmocka_unit_test(last_condensed_tetrahedra_are_kept)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
