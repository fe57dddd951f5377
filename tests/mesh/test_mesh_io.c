/* libtensormass_io in other programs: messages with file and line, a locale with a decimal comma, contract errors,
 * and no memory allocated after a failure. */
#include <locale.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tensormass_io.h"

static const char block[] =
    "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n0.5 0 0 0\n0 0.25 0 0\n0 0 1.5 0\n"
    "Tetrahedra\n1\n1 2 3 4 1\nEnd\n";

static tm_status parse(const char *path, const char *text, tm_mesh_file *file, tm_error *error) {
    return tm_mesh_file_parse(path, text, strlen(text), 1, file, error);
}

static void message_names_file_and_line(void **state) {
    (void)state;
    tm_mesh_file file;
    tm_error error;
    char path[700];
    assert_int_equal(
        parse("a/b.mesh", "MeshVersionFormatted 2\nDimension 3\nVertices\n2\n0 0 0 0\n1 x 0 0\n", &file, &error),
        TM_ERR_FILE);
    assert_string_equal(
        error.message, "a/b.mesh:6: has 1 of the 2 vertices that its header counts, so it is truncated; save it again");
    assert_null(file.vertex_m);
    assert_int_equal(parse("a/b.stl", "solid", &file, &error), TM_ERR_FILE);
    assert_memory_equal(error.message, "a/b.stl: .stl is a surface", 26);
    assert_int_equal(tm_mesh_file_load("/nowhere/a.vtk", 1, &file, &error), TM_ERR_FILE);
    assert_memory_equal(error.message, "/nowhere/a.vtk: cannot open: ", 29);
    assert_int_equal(tm_mesh_file_parse("b.mesh", block, sizeof block - 1, 0, &file, &error), TM_ERR_ARGUMENT);
    /* A long path is shortened to its end; the remedy stays complete. */
    memset(path, 'p', sizeof path);
    strcpy(path + sizeof path - 8, "/z.mesh");
    assert_int_equal(parse(path, "MeshVersionFormatted 2\nDimension 3\n", &file, &error), TM_ERR_FILE);
    assert_memory_equal(error.message, "...ppp", 6);
    assert_non_null(strstr(error.message, "/z.mesh:3: its Vertices cannot be read; save it again"));
    /* A flat tetrahedron is found when the mesh is built, and named by the file's own numbers. */
    tm_mesh *mesh = NULL;
    assert_int_equal(parse("flat.mesh",
                           "MeshVersionFormatted 2\nDimension 3\nVertices\n4\n0 0 0 0\n1 0 0 0\n0 1 0 0\n1 1 0 0\n"
                           "Tetrahedra\n1\n1 2 3 4 1\nEnd\n",
                           &file, &error),
                     TM_OK);
    assert_int_equal(tm_mesh_file_build(&file, &mesh, &error), TM_ERR_MESH);
    assert_memory_equal(error.message, "flat.mesh: tetrahedron 1 (vertices 1 2 3 4) is flat; ", 53);
    assert_int_equal(tm_mesh_file_defects(&file, NULL, 0), 1);
    tm_mesh_file_free(&file);
    assert_int_equal(parse("flat.mesh", block, &file, NULL), TM_OK); /* no message is requested */
    tm_mesh_file_free(&file);
    tm_mesh_file_free(&file);
    tm_mesh_file_free(NULL);
}

/* Makes a locale with a decimal comma if the machine has none. */
static void numbers_have_a_decimal_point_in_any_locale(void **state) {
    (void)state;
    char folder[] = "/tmp/tm_locale_XXXXXX", command[200];
    assert_non_null(mkdtemp(folder));
    snprintf(command, sizeof command, "localedef --no-archive -i de_DE -f UTF-8 %s/de_DE.UTF-8 2>/dev/null", folder);
    const int made = system(command);
    setenv("LOCPATH", folder, 1);
    if (made != 0 || !setlocale(LC_NUMERIC, "de_DE.UTF-8")) {
        print_message("no locale with a comma here (Debian: locales)\n");
        skip();
    }
    char number[8];
    snprintf(number, sizeof number, "%.1f", 0.5);
    assert_string_equal(number, "0,5");
    static const char *const kinds[] = {"a.mesh", "a.vtk", "a.msh"};
    tm_mesh_file file, back;
    tm_error error;
    assert_int_equal(parse("a.mesh", block, &file, &error), TM_OK);
    for (int k = 0; k < 3; k++) {
        char *text = NULL;
        size_t size = 0;
        FILE *stream = open_memstream(&text, &size);
        assert_int_equal(tm_mesh_file_write(&file, kinds[k], stream, &error), TM_OK);
        fclose(stream);
        assert_null(strchr(text, ','));
        assert_int_equal(tm_mesh_file_parse(kinds[k], text, size, 2, &back, &error), TM_OK);
        assert_true(back.vertex_m[3] == 1 && back.vertex_m[7] == 0.5 && back.vertex_m[11] == 3);
        tm_mesh_file_free(&back);
        free(text);
    }
    snprintf(number, sizeof number, "%.1f", 0.5);
    assert_string_equal(number, "0,5"); /* freed */
    tm_mesh_file_free(&file);
    setlocale(LC_NUMERIC, "C");
    snprintf(command, sizeof command, "rm -r %s", folder);
    assert_int_equal(system(command), 0);
}

static int broken;
static void count_broken(const char *function, const char *sentence, void *user) {
    (void)user;
    broken += function[0] && sentence[0];
}

static void a_null_pointer_is_a_broken_contract(void **state) {
    (void)state;
    tm_mesh_file file;
    tm_mesh *mesh;
    double fibre[3];
    tm_set_contract_handler(count_broken, NULL);
    assert_int_equal(tm_mesh_file_load(NULL, 1, &file, NULL), TM_ERR_ARGUMENT);
    assert_int_equal(tm_mesh_file_parse("a.msh", NULL, 0, 1, &file, NULL), TM_ERR_ARGUMENT);
    assert_int_equal(tm_mesh_file_build(NULL, &mesh, NULL), TM_ERR_ARGUMENT);
    assert_int_equal(tm_mesh_file_write(NULL, "a.msh", stdout, NULL), TM_ERR_ARGUMENT);
    assert_int_equal(tm_fibres_load(NULL, 1, fibre, NULL), TM_ERR_ARGUMENT);
    assert_int_equal(broken, 5);
    tm_set_contract_handler(NULL, NULL);
}

static void write_to_a_full_disk_is_an_error(void **state) {
    (void)state;
    tm_mesh_file file;
    tm_error error;
    assert_int_equal(parse("a.mesh", block, &file, &error), TM_OK);
    FILE *full = fopen("/dev/full", "w");
    if (!full) skip();
    assert_int_equal(tm_mesh_file_write(&file, "out.vtk", full, &error), TM_ERR_FILE);
    assert_memory_equal(error.message, "out.vtk: cannot be written completely; ", 39);
    fclose(full);
    assert_int_equal(tm_mesh_file_write(&file, "out.obj", stdout, &error), TM_ERR_FILE);
    assert_non_null(strstr(error.message, ".msh .vtk .mesh"));
    tm_mesh_file_free(&file);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(message_names_file_and_line),
        cmocka_unit_test(numbers_have_a_decimal_point_in_any_locale),
        cmocka_unit_test(a_null_pointer_is_a_broken_contract),
        cmocka_unit_test(write_to_a_full_disk_is_an_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
