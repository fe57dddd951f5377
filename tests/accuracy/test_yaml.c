/* study_write_yaml: a recommended scene is the scene's text with some values changed. Blocks and braces, list items,
 * missing and removed keys; comments and multi-byte characters stay. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "studies/accuracy/study.h"

static const char SCENE[] = "title: \"l\xc3\xa9"
                            "ger\" # un b\xc3\xa2ton\n"
                            "time: {frame_rate: 25 Hz, duration: 1 s} # both\n"
                            "tissue:\n"
                            "  # of liver\n"
                            "  mesh: liver.msh # 10k\n"
                            "  materials:\n"
                            "    liver: {young: 5 kPa}\n"
                            "strain_smoothing:\n"
                            "supports:\n"
                            "  - {name: a, vertex: [1,\n"
                            "      2]}\n"
                            "  - name: b # second\n"
                            "    vertex: [3]\n"
                            "    axes: z\n"
                            "damping: {rate: 60 /s}\n";

static char folder[] = "/tmp/tm-yaml-XXXXXX";

/* Returns the scene's text after the edits, without the comment on the evidence. */
static char *after(const char *const *edit, int count) {
    static char text[4000];
    static study s;
    char from[64], to[64];
    snprintf(from, sizeof from, "%s/scene.yaml", folder), snprintf(to, sizeof to, "%s/out.yaml", folder);
    FILE *file = fopen(from, "w");
    assert_non_null(file);
    fputs(SCENE, file), fclose(file);
    s.file = from;
    assert_int_equal(study_write_yaml(&s, to, (char *const *)(uintptr_t)edit, count, "# why\n"), 0);
    file = fopen(to, "r");
    assert_non_null(file);
    text[fread(text, 1, sizeof text - 1, file)] = 0;
    fclose(file), unlink(from), unlink(to);
    assert_memory_equal(text, "# why\n", 6);
    return text + 6;
}

/* Checks that `was`, which the scene contains once, became `is`, and that nothing else changed. */
static void changes(const char *edit, const char *was, const char *is) {
    char wanted[4000];
    const char *at = strstr(SCENE, was);
    assert_non_null(at);
    snprintf(wanted, sizeof wanted, "%.*s%s%s", (int)(at - SCENE), SCENE, is, at + strlen(was));
    assert_string_equal(after(&edit, 1), wanted);
}

static void a_value_is_replaced(void **state) {
    (void)state;
    changes("time.frame_rate=50", "25 Hz", "50");
    changes("tissue.mesh=b.msh", "liver.msh", "b.msh");
    changes("title=x",
            "\"l\xc3\xa9"
            "ger\"",
            "x");
    changes("tissue.materials.liver.young=6 kPa", "5 kPa", "6 kPa");
    changes("supports[1].axes=x", "axes: z", "axes: x");
}

static void missing_keys_are_added(void **state) {
    (void)state;
    changes("time.step=1e-4", "{frame", "{step: 1e-4, frame");
    changes("tissue.scale=1", "mesh: l", "scale: 1\n  mesh: l");
    changes("strain_smoothing.shear_share=0.4", "strain_smoothing:", "strain_smoothing: {shear_share: 0.4}");
    changes("hybrid.box.min=0", "60 /s}\n", "60 /s}\nhybrid: {box: {min: 0}}\n");
    changes("threads=2", "60 /s}\n", "60 /s}\nthreads: 2\n");
    changes("supports[0].group=g", "{name: a", "{group: g, name: a");
    changes("supports[1].group=g", "name: b", "group: g\n    name: b");
}

static void unset_keys_are_removed(void **state) {
    (void)state;
    changes("supports[0].vertex", ", vertex: [1,\n      2]", "");
    changes("supports[1].vertex", "vertex: [3]\n    ", "");
    changes("supports[1].axes", "\n    axes: z", "");
    changes("time.frame_rate", "frame_rate: 25 Hz, ", "");
    changes("damping", "damping", "# left out: damping");
    changes("tissue", "tissue:\n  # of liver\n  mesh: liver.msh # 10k\n  materials:\n    liver",
            "# left out: tissue:\n# left out:   # of liver\n# left out:   mesh: liver.msh # 10k\n"
            "# left out:   materials:\n# left out:     liver");
    changes("anisotropy", "time", "time");
}

static void several_edits_apply_in_order(void **state) {
    (void)state;
    static const char *const edits[] = {"strain_smoothing", "strain_smoothing.shear_share=0.4", "supports[0].vertex",
                                        "supports[0].group=g"};
    const char *text = after(edits, 4);
    assert_non_null(strstr(text, "# left out: strain_smoothing:\n"));
    assert_non_null(strstr(text, "\nstrain_smoothing: {shear_share: 0.4}\n"));
    assert_non_null(strstr(text, "- {group: g, name: a}\n"));
}

static int make_folder(void **state) {
    (void)state;
    return mkdtemp(folder) ? 0 : -1;
}

static int drop_folder(void **state) {
    (void)state;
    return rmdir(folder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_value_is_replaced),
        cmocka_unit_test(missing_keys_are_added),
        cmocka_unit_test(unset_keys_are_removed),
        cmocka_unit_test(several_edits_apply_in_order),
    };
    return cmocka_run_group_tests(tests, make_folder, drop_folder);
}
