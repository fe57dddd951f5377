#include "paraview_series.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "libtensormass/io/vtu.h"

enum { HIDDEN_CELL = 32 };

/* Cells in the file's numbering. */
typedef struct cells {
    uint8_t *alive, *ghost;
    double *u_m;
} cells;

static bool fill_cells(const run_series *series, const sim *s, cells *c) {
    size_t n = (size_t)s->mesh->tet_count;
    const uint8_t *alive = tm_tissue_alive(s->model->tissue);
    *c = (cells){malloc(n), malloc(n), malloc(3 * (size_t)s->mesh->vertex_count * sizeof *c->u_m)};
    if (!c->alive || !c->ghost || !c->u_m) return false;
    tm_mesh_to_original(s->mesh, 3, sim_displacement(s), c->u_m);
    for (size_t t = 0; t < n; t++) {
        c->alive[t] = alive[t] || (series->condensed && series->condensed[t]);
        c->ghost[t] = c->alive[t] ? 0 : HIDDEN_CELL;
    }
    return true;
}

static void free_cells(cells *c) {
    free(c->alive);
    free(c->ghost);
    free(c->u_m);
}

static void write_numbers(FILE *out, const char *name, int components, int tuples, const double *value) {
    fprintf(out,
            "<DataArray type=\"Float64\" Name=\"%s\" NumberOfComponents=\"%d\" NumberOfTuples=\"%d\" format=\"ascii\">",
            name, components, tuples);
    for (int i = 0; i < components * tuples; i++) fprintf(out, "%s%.17g", i ? " " : "", value[i]);
    fputs("</DataArray>\n", out);
}

/* Writes data of the complete frame: time and instruments. */
static void write_field(FILE *out, const sim *s) {
    double time_s = sim_time_s(s), tip[3 * TM_MAX_INSTRUMENTS], force[3 * TM_MAX_INSTRUMENTS];
    for (int i = 0; i < s->instrument_count; i++) {
        memcpy(tip + 3 * i, s->pose[i].tip_m, 3 * sizeof *tip);
        memcpy(force + 3 * i, s->reaction[i].force_N, 3 * sizeof *force);
    }
    fputs("<FieldData>\n", out);
    write_numbers(out, "TimeValue", 1, 1, &time_s);
    if (s->instrument_count) write_numbers(out, "tip_m", 3, s->instrument_count, tip);
    if (s->instrument_count) write_numbers(out, "force_N", 3, s->instrument_count, force);
    fputs("</FieldData>\n", out);
}

static void write_grid(FILE *out, const sim *s, const cells *c) {
    const tm_mesh *m = s->mesh;
    const int64_t v = m->vertex_count, t = m->tet_count;
    const vtu_array displacement = {"Float64", 3, 8, v}, region = {"Int32", 1, 4, t}, state = {"UInt8", 1, 1, t},
                    fibre = {"Float64", 3, 8, t};
    int64_t at = 0;
    fputs("<?xml version=\"1.0\"?>\n", out);
    vtu_begin(out);
    write_field(out, s);
    vtu_piece(v, t, " Vectors=\"displacement_m\"", &at, out);
    vtu_declare(&displacement, "", "displacement_m", &at, out);
    vtu_cells(t, &at, out);
    vtu_declare(&region, "", "region", &at, out);
    vtu_declare(&state, "", "alive", &at, out);
    vtu_declare(&state, "", "vtkGhostType", &at, out);
    if (s->fibre) vtu_declare(&fibre, "", "fibre", &at, out);
    vtu_data(out);
    vtu_put_points(v, s->file.vertex_m, out);
    vtu_put(&displacement, c->u_m, out);
    vtu_put_cells(t, s->file.tet, out);
    vtu_put(&region, m->region, out);
    vtu_put(&state, c->alive, out);
    vtu_put(&state, c->ghost, out);
    if (s->fibre) vtu_put(&fibre, s->fibre, out);
    vtu_end(out);
}

static int write_frame(run_series *series, const sim *s) {
    char name[32], path[1024];
    app_file file = {0};
    cells c;
    snprintf(name, sizeof name, "frame_%06" PRId64 ".vtu", series->written);
    if ((size_t)snprintf(path, sizeof path, "%s/%s", series->folder, name) >= sizeof path)
        return app_bad_input("--paraview", 0, "the folder's path is too long; choose a shorter one");
    bool memory = fill_cells(series, s, &c);
    int rc = memory ? app_file_begin(&file, path) : APP_FAILED;
    if (!memory) fprintf(stderr, "%s: out of memory; use --paraview-every to write fewer, or a smaller mesh\n", path);
    if (!rc) {
        write_grid(file.stream, s, &c);
        rc = app_file_end(&file, true);
    }
    free_cells(&c);
    if (rc) return rc;
    fprintf(series->index.stream, "<DataSet timestep=\"%.9g\" file=\"%s\"/>\n", sim_time_s(s), name);
    series->written++;
    return 0;
}

int run_series_begin(run_series *series, const sim *s, const char *folder, int64_t every) {
    char path[1024];
    *series = (run_series){.folder = folder, .every = every};
    if (!folder) return 0;
    if (mkdir(folder, 0777) && errno != EEXIST)
        return app_bad_input(folder, 0, "the folder cannot be made: %s; give one in an existing folder",
                             strerror(errno));
    if ((size_t)snprintf(path, sizeof path, "%s/run.pvd", folder) >= sizeof path)
        return app_bad_input("--paraview", 0, "the folder's path is too long; choose a shorter one");
    if (s->model->condensed_tets) {
        series->condensed = malloc((size_t)s->mesh->tet_count);
        if (!series->condensed)
            return fputs("tm-sim: out of memory for --paraview; leave it out\n", stderr), APP_FAILED;
        for (int32_t t = 0; t < s->mesh->tet_count; t++) series->condensed[t] = !tm_tissue_alive(s->model->tissue)[t];
    }
    int rc = app_file_begin(&series->index, path);
    if (!rc)
        fputs("<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n"
              "<Collection>\n",
              series->index.stream);
    return rc ? rc : write_frame(series, s);
}

void run_series_add(run_series *series, const sim *s) {
    if (!series->folder || series->failed || ++series->frames % series->every) return;
    series->failed = write_frame(series, s) != 0;
}

int run_series_end(run_series *series, bool good) {
    free(series->condensed);
    series->condensed = NULL;
    if (!series->index.begun) return 0;
    fputs("</Collection>\n</VTKFile>\n", series->index.stream);
    int rc = app_file_end(&series->index, good);
    return series->failed ? APP_FAILED : rc;
}
