/* Removes the generated organs piece by piece in 20 random orders. */
#include "../long.h"
#include "organ.h"

static void generated_organs(void **state) {
    (void)state;
    const char *root = getenv("TM_ROOT");
    char path[600];
    const bool whole = test_is_long();
    snprintf(path, sizeof path, "%s/meshes/liver_1k.msh", root ? root : ".");
    assert_true(organ_cut_down(path, ORDERS, 30, false));
    assert_true(organ_cut_down(path, whole ? ORDERS : 4, 30, true));
    snprintf(path, sizeof path, "%s/meshes/liver_10k.msh", root ? root : ".");
    assert_true(organ_cut_down(path, whole ? ORDERS : 2, whole ? 30 : 12, false));
    if (whole) assert_true(organ_cut_down(path, 4, 30, true));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(generated_organs)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
