/* Surfaces of VTK's formats. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/contract.h"
#include "place.h"
#include "vtk_cells.h"

static tm_status read_kind(const char *path, tm_io_text *text, tm_io_vtk *v) {
    static const struct {
        const char *ending, *dataset;
    } kinds[] = {{".vtp", "PolyData"}, {".vtu", "UnstructuredGrid"}};
    const char *dot = strrchr(path, '.');
    for (int k = 0; dot && k < 2; k++)
        if (strcasecmp(dot, kinds[k].ending) == 0) return tm_io_vtk_read_xml(text, kinds[k].dataset, v);
    if (dot && strcasecmp(dot, ".vtk") == 0) return tm_io_vtk_read_legacy(text, "POLYDATA", v);
    return tm_fail(text->error, TM_ERR_FILE, -1, "no kind of surface that is read here; give .vtp, .vtu or .vtk");
}

tm_status tm_surface_load(const char *path, double **corner, int32_t *triangles, tm_error *error) {
    TM_REQUIRE(path && corner && triangles, "path, corner or triangles is null", TM_ERR_ARGUMENT);
    char *bytes = NULL;
    size_t size = 0;
    *corner = NULL;
    *triangles = 0;
    tm_status status = tm_io_read_whole(path, &bytes, &size, error);
    if (status) return tm_io_place(path, 0, status, error);
    const tm_io_locale locale = tm_io_locale_enter();
    tm_io_text text = {.at = bytes, .end = bytes + size, .error = error};
    tm_io_vtk v = {.error = error};
    status = read_kind(path, &text, &v);
    if (!status) text.line = 0;
    if (!status) status = tm_io_vtk_triangles(&v, corner, triangles);
    tm_io_vtk_free(&v);
    tm_io_locale_leave(locale);
    free(bytes);
    if (status) {
        free(*corner);
        *corner = NULL;
    }
    return tm_io_place(path, text.line, status, error);
}
