/* Reads closed surfaces from files, checks them, and finds their pieces and nesting. */
#include "surfaces.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "image.h"

/* --- one file --- */

static bool ends(const char *path, const char *ending) {
    const char *dot = strrchr(path, '.');
    return dot && strcasecmp(dot, ending) == 0;
}

static int from_module(const image_end end, const char *path, const char *why) {
    if (end == IMAGE_STOPPED) return app_interrupted_exit();
    if (end) app_bad_input(path, 0, "%s", why);
    return end == IMAGE_DONE ? APP_DONE : end == IMAGE_BAD_INPUT ? APP_BAD_INPUT : APP_FAILED;
}

static int read_file(const char *path, const image_api *api, image_surface *out) {
    tm_error error = {0};
    char why[IMAGE_WHY] = "";
    if (ends(path, ".stl"))
        return shell_read_stl(path, 1, &out->corner, &out->triangles, &error) ? app_report(path, 0, &error) : APP_DONE;
    if (ends(path, ".vtp") || ends(path, ".vtu") || ends(path, ".vtk"))
        return tm_surface_load(path, &out->corner, &out->triangles, &error) ? app_report(NULL, 0, &error) : APP_DONE;
    if (!ends(path, ".obj") && !ends(path, ".ply") && !ends(path, ".off"))
        return app_bad_input(path, 0, "unknown type of surface file; give .stl, .obj, .ply, .off, .vtp, .vtu or .vtk");
    if (!api && !(api = image_open_module(&error))) return app_report(path, 0, &error);
    FILE *file = fopen(path, "rb");
    if (!file) return app_bad_input(path, 0, "cannot open; check the path");
    fclose(file);
    return from_module(api->read_surface(path, out, why), path, why);
}

/* Describes defects in mm: "2 holes, the largest of 12 edges about 1 2 3; 4 pairs of triangles cut each other, about 1
 * 2 3". */
static void describe(const image_defects *d, double scale, char *text, size_t size) {
    const double mm = 1e3 * scale;
    size_t at = 0;
    text[0] = 0;
    if (d->holes)
        at += (size_t)snprintf(text, size, "%d hole%s, the largest of %d edges near %.4g %.4g %.4g mm", d->holes,
                               d->holes == 1 ? "" : "s", d->hole_edges, mm * d->hole_at[0], mm * d->hole_at[1],
                               mm * d->hole_at[2]);
    if (d->crossings && at < size)
        snprintf(text + at, size - at, "%s%d pair%s of triangles that intersect, one near %.4g %.4g %.4g mm",
                 at ? "; " : "", d->crossings, d->crossings == 1 ? "" : "s", mm * d->crossing_at[0],
                 mm * d->crossing_at[1], mm * d->crossing_at[2]);
}

static int examine(const char *path, const image_api *api, double scale, bool repair, image_surface *s) {
    image_defects found, left;
    char why[IMAGE_WHY] = "", text[400];
    const int exit = from_module(api->examine_surface(s, repair, &found, &left, why), path, why);
    if (exit) return exit;
    describe(&left, scale, text, sizeof text);
    if (left.holes || left.crossings)
        return app_bad_input(path, 0, "%s%s; %s", repair ? "cannot be repaired completely: " : "", text,
                             repair ? "repair it in MeshLab or Blender" : "give --repair, which repairs most of it");
    describe(&found, scale, text, sizeof text);
    if (found.holes || found.crossings) app_remark("%s: repaired: %s\n", path, text);
    return APP_DONE;
}

static bool whole_numbers(const char *path, double scale, image_surface *s) {
    for (size_t i = 0; i < 9 * (size_t)s->triangles; i++) s->corner[i] *= scale;
    for (size_t i = 0; i < 9 * (size_t)s->triangles; i++)
        if (!(fabs(s->corner[i]) < 1e6)) {
            app_bad_input(path, 0, "a coordinate is beyond 1000 km; check the file, --unit and --scale");
            return false;
        }
    return true;
}

/* --- pieces --- */

static double *corners_of(const shell *all, const int *piece, int which, int *triangles) {
    *triangles = 0;
    for (int t = 0; t < shell_triangles(all); t++) *triangles += piece[t] == which;
    double *corner = malloc((9 * (size_t)*triangles + 1) * sizeof *corner), *to = corner;
    for (int t = 0; corner && t < shell_triangles(all); t++)
        for (int c = 0; piece[t] == which && c < 3; c++, to += 3) memcpy(to, shell_corner_m(all, t, c), 3 * sizeof *to);
    return corner;
}

static tm_status split(const shell *all, int file, surfaces *out, tm_error *error) {
    int *piece = malloc(((size_t)shell_triangles(all) + 1) * sizeof *piece);
    const int pieces = piece ? shell_pieces(all, piece) : -1;
    tm_status status = pieces < 0 ? tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface") : TM_OK;
    if (pieces > SURFACES_MAX - out->pieces)
        status = tm_fail(error, TM_ERR_MESH, -1,
                         "it has %d pieces and %d is the limit; remove the small ones (MeshLab)", pieces, SURFACES_MAX);
    for (int i = 0; i < pieces && !status; i++) {
        int triangles;
        double *corner = corners_of(all, piece, i, &triangles);
        if (!corner) status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
        if (!status) {
            out->piece[out->pieces] = (surface_piece){.file = file, .parent = -1};
            status = shell_of_triangles(corner, triangles, true, &out->piece[out->pieces].shell, error);
            if (!status) out->pieces++;
        }
    }
    free(piece);
    return status;
}

static int by_volume(const void *a, const void *b) {
    const surface_piece *x = a, *y = b;
    const double p = shell_volume_m3(x->shell), q = shell_volume_m3(y->shell);
    return p != q ? (p < q ? -1 : 1) : x->file - y->file;
}

/* Returns whether most of a sample of inner's corners are inside outer: two surfaces of one organ may intersect
 * slightly. */
static bool holds(const shell *outer, const shell *inner) {
    const int n = shell_triangles(inner), step = 1 + n / 200;
    int in = 0, asked = 0;
    for (int t = 0; t < n; t += step, asked++) in += shell_contains(outer, shell_corner_m(inner, t, 0));
    return 2 * in > asked;
}

static void stem(const char *path, char name[64]) {
    const char *slash = strrchr(path, '/'), *from = slash ? slash + 1 : path, *dot = strrchr(from, '.');
    const int length = dot && dot > from ? (int)(dot - from) : (int)strlen(from);
    snprintf(name, 64, "%.*s", length < 50 ? length : 50, from);
    for (char *at = name; *at; at++)
        if (*at == '"' || (unsigned char)*at < ' ') *at = '_';
}

/* Names the regions. A file's outer pieces are one region; it has the file's name if there are several files. A piece
 * inside another of its file is a cavity if its orientation is opposite, as programs that make surfaces of images write
 * it; else it is another region. */
static void name_regions(char *const *path, int files, surfaces *s) {
    int of_file[SURFACES_FILES] = {0}, inner = 0;
    for (int f = 0; f < files; f++) {
        of_file[f] = ++s->regions;
        if (files == 1)
            strcpy(s->name[s->regions], "tissue");
        else
            stem(path[f], s->name[s->regions]);
        for (int g = 1; g < s->regions; g++)
            if (strcmp(s->name[g], s->name[s->regions]) == 0) snprintf(s->name[s->regions], 64, "surface_%d", f + 1);
    }
    for (int i = s->pieces - 1; i >= 0; i--) {
        surface_piece *one = &s->piece[i];
        for (int j = i + 1; j < s->pieces && one->parent < 0; j++)
            if (holds(s->piece[j].shell, one->shell)) one->parent = j;
        int own = one->parent; /* the piece of its own file around it */
        while (own >= 0 && (s->piece[own].file != one->file || s->piece[own].cavity)) own = s->piece[own].parent;
        one->cavity = own >= 0 && shell_turned(one->shell) != shell_turned(s->piece[own].shell);
        if (one->cavity)
            one->parent = own;
        else if (own < 0)
            one->region = of_file[one->file];
        else if (s->regions < SURFACES_MAX) {
            one->region = ++s->regions;
            snprintf(s->name[one->region], 64, "inside_%d", ++inner);
        }
    }
}

int surfaces_label(const void *context, const double p[3]) {
    const surfaces *s = context;
    for (int i = 0; i < s->pieces; i++) {
        if (s->piece[i].cavity || !shell_contains(s->piece[i].shell, p)) continue;
        bool hollow = false;
        for (int j = 0; j < i && !hollow; j++)
            hollow = s->piece[j].cavity && s->piece[j].parent == i && shell_contains(s->piece[j].shell, p);
        if (!hollow) return s->piece[i].region;
    }
    return 0;
}

void surfaces_project(const void *context, double p[3]) {
    const surfaces *s = context;
    double square = INFINITY, place[3] = {p[0], p[1], p[2]};
    int first = 0; /* likely the nearest, so that the others end early */
    for (int i = 1; i < s->pieces; i++)
        if (shell_box_m2(s->piece[i].shell, p) < shell_box_m2(s->piece[first].shell, p)) first = i;
    shell_nearer(s->piece[first].shell, p, &square, place);
    for (int i = 0; i < s->pieces; i++)
        if (i != first) shell_nearer(s->piece[i].shell, p, &square, place);
    memcpy(p, place, sizeof place);
}

/* --- all files --- */

static tm_status add_file(image_surface *read, int file, bool alone, surfaces *out, tm_error *error) {
    shell *all = NULL;
    double *copy = malloc((9 * (size_t)read->triangles + 1) * sizeof *copy);
    if (!copy) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the surface");
    memcpy(copy, read->corner, 9 * (size_t)read->triangles * sizeof *copy);
    tm_status status = shell_of_triangles(copy, read->triangles, true, &all, error);
    if (!status) status = split(all, file, out, error);
    if (alone && !status)
        out->whole = all;
    else
        shell_free(all);
    return status;
}

static int load_one(const char *path, int file, int files, double scale, bool repair, const image_api *api,
                    surfaces *out) {
    image_surface read = {0};
    tm_error error = {0};
    int exit = read_file(path, api, &read);
    if (!exit && api) exit = examine(path, api, scale, repair, &read);
    if (!exit && !whole_numbers(path, scale, &read)) exit = APP_BAD_INPUT;
    if (!exit && add_file(&read, file, files == 1, out, &error)) exit = app_report(path, 0, &error);
    free(read.corner);
    return exit;
}

int surfaces_load(char *const *path, int files, double scale, bool repair, surfaces *out) {
    tm_error error = {0};
    const image_api *api = image_open_module(&error);
    *out = (surfaces){0};
    if (repair && !api) return app_report(NULL, 0, &error);
    int exit = APP_DONE;
    for (int f = 0; f < files && !exit; f++) exit = load_one(path[f], f, files, scale, repair, api, out);
    if (exit) return exit;
    qsort(out->piece, (size_t)out->pieces, sizeof *out->piece, by_volume);
    name_regions(path, files, out);
    if (out->regions > 1) {
        shell_free(out->whole);
        out->whole = NULL;
    }
    return APP_DONE;
}

void surfaces_free(surfaces *s) {
    for (int i = 0; i < s->pieces; i++) shell_free(s->piece[i].shell);
    shell_free(s->whole);
    *s = (surfaces){0};
}
