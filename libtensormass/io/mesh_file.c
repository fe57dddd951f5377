/* Reads and writes meshes: one reader per format (mesh_format.h), then common code. */
#include "base/contract.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <sys/types.h>

#include "mesh_raw.h"
#include "place.h"
#include "vtk_cells.h"

static const tm_io_format *const formats[] = {
#define ROW(name) &tm_io_format_##name,
    TM_IO_FORMATS(ROW)
#undef ROW
};
enum { FORMATS = sizeof formats / sizeof *formats };

/* --- formats --- */

const char *tm_mesh_file_endings(bool written) {
    static char text[2][160];
    size_t used = 0;
    text[written][0] = 0;
    for (int f = 0; f < FORMATS; f++)
        if (written ? formats[f]->write != NULL : formats[f]->read != NULL)
            used += (size_t)snprintf(text[written] + used, sizeof text[written] - used, "%s%s", used ? " " : "",
                                     formats[f]->ending);
    return text[written];
}

static const tm_io_format *format_of(const char *path) {
    const char *dot = strrchr(path, '.');
    for (int f = 0; dot && f < FORMATS; f++)
        if (strcmp(dot, formats[f]->ending) == 0) return formats[f];
    return NULL;
}

static tm_status refuse_ending(const char *path, tm_error *error) {
    static const char *const surface[] = {".stl", ".obj", ".ply", ".off", ".vtp"};
    const char *dot = strrchr(path, '.');
    for (size_t i = 0; dot && i < sizeof surface / sizeof *surface; i++)
        if (strcasecmp(dot, surface[i]) == 0)
            return tm_fail(error, TM_ERR_FILE, -1,
                           "%s is a surface, not a volume; fill it with tetrahedra: tm-mesh fill --size 5mm "
                           "SURFACE.stl -o ORGAN.msh",
                           surface[i]);
    if (dot && strcasecmp(dot, ".vtu") == 0)
        return tm_fail(error, TM_ERR_FILE, -1, ".vtu is not read; save it as .vtk (ParaView: legacy VTK)");
    return tm_fail(error, TM_ERR_FILE, -1, "unknown type of mesh file; use one of these: %s",
                   tm_mesh_file_endings(false));
}

static tm_status read_format(const char *path, tm_io_text *text, tm_io_raw *raw) {
    const tm_io_format *format = format_of(path);
    if (!format || !format->read) return refuse_ending(path, text->error);
    if (strncmp(text->at + strspn(text->at, " \t\r\n"), format->start, strlen(format->start)) != 0)
        return tm_fail(
            text->error, TM_ERR_FILE, -1,
            "does not begin with '%s', so it is not a %s file; save it again, or correct its file name extension",
            format->start, format->ending);
    return format->read(text, raw);
}

/* --- reading --- */

/* Reads the complete file and a NUL, malloced. */
static tm_status tm_io_read_whole(const char *path, char **bytes, size_t *size, tm_error *error) {
    struct stat info;
    FILE *file = fopen(path, "rb");
    if (!file || fstat(fileno(file), &info) != 0) {
        int why = errno;
        if (file) fclose(file);
        return tm_fail(error, TM_ERR_FILE, -1, "cannot open: %s; check the path", strerror(why));
    }
    tm_status status = TM_OK;
    *size = (size_t)info.st_size;
    *bytes = S_ISREG(info.st_mode) ? malloc(*size + 1) : NULL;
    if (!S_ISREG(info.st_mode))
        status = tm_fail(error, TM_ERR_FILE, -1, "not a regular file; give a file of one of these types: %s",
                         tm_mesh_file_endings(false));
    else if (!*bytes)
        status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for its %zu bytes; use a coarser mesh", *size);
    else if (fread(*bytes, 1, *size, file) != *size)
        status = tm_fail(error, TM_ERR_FILE, -1, "cannot read: %s; check the disk", strerror(errno));
    else if (*size == 0)
        status = tm_fail(error, TM_ERR_FILE, -1, "the file is empty; save the mesh again");
    fclose(file);
    if (status) {
        free(*bytes);
        *bytes = NULL;
    } else
        (*bytes)[*size] = 0;
    return status;
}

static bool allocate_shape(tm_mesh_file *mesh) {
    size_t v = (size_t)mesh->vertex_count, t = (size_t)mesh->tet_count;
    mesh->vertex_m = calloc(3 * v + 1, sizeof(double));
    mesh->vertex_tag = calloc(v + 1, sizeof(int64_t));
    mesh->tet_tag = calloc(t + 1, sizeof(int64_t));
    mesh->tet = calloc(4 * t + 1, sizeof(int32_t));
    mesh->region = calloc(t + 1, sizeof(int32_t));
    return mesh->vertex_m && mesh->vertex_tag && mesh->tet_tag && mesh->tet && mesh->region;
}

bool tm_mesh_file_allocate(tm_mesh_file *mesh, int32_t group_vertex_count) {
    mesh->path = NULL;
    mesh->fibre = NULL;
    mesh->group_begin = calloc((size_t)mesh->group_count + 1, sizeof(int32_t));
    mesh->group_vertex = calloc((size_t)group_vertex_count + 1, sizeof(int32_t));
    mesh->region_name = calloc((size_t)mesh->region_count + 1, sizeof *mesh->region_name);
    mesh->group_name = calloc((size_t)mesh->group_count + 1, sizeof *mesh->group_name);
    if (allocate_shape(mesh) && mesh->group_begin && mesh->group_vertex && mesh->region_name && mesh->group_name)
        return true;
    tm_mesh_file_free(mesh);
    return false;
}

void tm_mesh_file_free(tm_mesh_file *mesh) {
    if (!mesh) return;
    free(mesh->vertex_m);
    free(mesh->vertex_tag);
    free(mesh->tet_tag);
    free(mesh->tet);
    free(mesh->region);
    free(mesh->group_begin);
    free(mesh->group_vertex);
    free(mesh->region_name);
    free(mesh->group_name);
    free(mesh->path);
    free(mesh->fibre);
    memset(mesh, 0, sizeof *mesh);
}

static tm_status assemble(const tm_io_raw *raw, double scale, tm_mesh_file *mesh, tm_error *error) {
    mesh->vertex_count = (int32_t)raw->vertices;
    mesh->tet_count = (int32_t)raw->tets;
    if (!allocate_shape(mesh)) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the mesh; use a coarser one");
    for (int64_t v = 0; v < raw->vertices; v++) {
        mesh->vertex_tag[v] = raw->vertex[v].tag;
        for (int i = 0; i < 3; i++) mesh->vertex_m[3 * v + i] = scale * raw->vertex[v].p[i];
    }
    for (int64_t e = 0, t = 0; e < raw->elements; e++) {
        if (raw->element[e].dim != 3) continue;
        memcpy(mesh->tet + 4 * t, raw->element[e].corner, 4 * sizeof(int32_t));
        mesh->tet_tag[t++] = raw->element[e].tag;
    }
    return tm_io_raw_groups(raw, mesh, error);
}

static tm_status parse(const char *path, tm_io_text *text, double scale, tm_mesh_file *file) {
    tm_io_raw raw = {0};
    const char *const bytes = text->at;
    tm_status status = read_format(path, text, &raw);
    if (!status) text->line = 0;
    if (!status) status = tm_io_raw_sort(&raw, text->error);
    if (!status) status = assemble(&raw, scale, file, text->error);
    tm_io_raw_free(&raw);
    if (!status && !(file->path = malloc(strlen(path) + 1)))
        status = tm_fail(text->error, TM_ERR_MEMORY, -1, "no memory for the mesh; use a coarser one");
    if (status) {
        tm_mesh_file_free(file);
        return status;
    }
    strcpy(file->path, path);
    const char *dot = strrchr(path, '.');
    file->hash = tm_hash(bytes, (size_t)(text->end - bytes), TM_HASH_SEED);
    file->hash = tm_hash(dot, strlen(dot), tm_hash(&scale, sizeof scale, file->hash));
    return TM_OK;
}

static tm_status begin(const char *path, double scale, tm_mesh_file *file, tm_error *error) {
    memset(file, 0, sizeof *file);
    if (scale > 0 && isfinite(scale)) return TM_OK;
    return tm_io_place(path, 0, tm_fail(error, TM_ERR_ARGUMENT, -1, "the scale is %g; give a value above 0", scale),
                       error);
}

tm_status tm_mesh_file_load(const char *path, double scale, tm_mesh_file *file, tm_error *error) {
    TM_REQUIRE(path && file, "path or file is null", TM_ERR_ARGUMENT);
    char *bytes = NULL;
    size_t size = 0;
    tm_status status = begin(path, scale, file, error);
    if (status) return status;
    status = tm_io_read_whole(path, &bytes, &size, error);
    if (status)
        tm_io_place(path, 0, status, error);
    else
        status = tm_mesh_file_parse(path, bytes, size, scale, file, error);
    free(bytes);
    return status;
}

tm_status tm_mesh_file_parse(const char *path, const char *bytes, size_t size, double scale, tm_mesh_file *file,
                             tm_error *error) {
    TM_REQUIRE(path && bytes && file, "path, bytes or file is null", TM_ERR_ARGUMENT);
    tm_io_text text = {.at = bytes, .end = bytes + size, .error = error};
    tm_status status = begin(path, scale, file, error);
    if (status) return status;
    const tm_io_locale locale = tm_io_locale_enter();
    status = parse(path, &text, scale, file);
    tm_io_locale_leave(locale);
    return tm_io_place(path, text.line, status, error);
}

/* --- writing --- */

tm_status tm_mesh_file_write(const tm_mesh_file *file, const char *path, FILE *stream, tm_error *error) {
    TM_REQUIRE(file && path && stream, "file, path or stream is null", TM_ERR_ARGUMENT);
    const tm_io_format *format = format_of(path);
    if (!format || !format->write)
        return tm_fail(error, TM_ERR_FILE, -1, "%s: unknown type of mesh file; use one of these: %s", path,
                       tm_mesh_file_endings(true));
    const tm_io_locale locale = tm_io_locale_enter();
    format->write(file, stream);
    tm_io_locale_leave(locale);
    if (fflush(stream) == 0 && !ferror(stream)) return TM_OK;
    return tm_fail(error, TM_ERR_FILE, -1,
                   "%s: cannot be written completely; free some space, or choose another folder", path);
}

/* --- surfaces of VTK's formats --- */

static tm_status read_kind(const char *path, tm_io_text *text, tm_io_vtk *v) {
    static const struct {
        const char *ending, *dataset;
    } kinds[] = {{".vtp", "PolyData"}, {".vtu", "UnstructuredGrid"}};
    const char *dot = strrchr(path, '.');
    for (int k = 0; dot && k < 2; k++)
        if (strcasecmp(dot, kinds[k].ending) == 0) return tm_io_vtk_read_xml(text, kinds[k].dataset, v);
    if (dot && strcasecmp(dot, ".vtk") == 0) return tm_io_vtk_read_legacy(text, "POLYDATA", v);
    return tm_fail(text->error, TM_ERR_FILE, -1, "unknown type of surface file; give .vtp, .vtu or .vtk");
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
