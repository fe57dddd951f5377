/* tm-mesh fill: makes tetrahedra inside closed surfaces. */
#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"
#include "surfaces.h"

enum { LIMIT = 5 * 1000 * 1000, SIDE_MAX = 1000 };

typedef struct options {
    char *const *in;
    const char *out;
    int files;
    double scale, size_m; /* 0: not given */
    bool repair;
} options;

static void usage(void) {
    printf("usage: tm-mesh fill [--size SIZE] --unit UNIT SURFACE... -o OUT.msh\n"
           "Fills closed surfaces (STL, OBJ, PLY, OFF) with tetrahedra whose edges are about SIZE. One surface: "
           "a lattice is fitted to it and\n"
           "smoothed, so that the smallest tetrahedron, which sets the time step, is as large as possible. "
           "Several surfaces, or one inside\n"
           "another: each becomes a region, named by its file; inner ones are cut out of outer ones, and faces "
           "are shared. Details and ridges\n"
           "finer than SIZE are rounded. All but a single STL needs the module 'image' (make image).\n"
           "\n"
           "  --size SIZE  longest inner edge, e.g. 5mm; half the size makes eight times as many tetrahedra [a "
           "fourteenth of the\n"
           "               longest side of the surfaces' box]\n"
           "  --unit UNIT  unit of the file's coordinates, which the formats do not store: m, cm, mm, um or "
           "inch\n"
           "  --scale S    the same as metres per unit of the file: 1e-3 for millimetres\n"
           "  --repair     close holes, stitch edges, orient triangles, remove intersecting ones; without it "
           "such defects are\n"
           "               named and refused\n"
           "  -o OUT       %s; one region 'tissue', or the files' names; vertex groups 'surface', NAME_outer\n",
           tm_mesh_file_endings(true));
}

static int parse(int argc, char **argv, options *o) {
    static const struct option names[] = {{"size", required_argument, NULL, 'z'},
                                          {"scale", required_argument, NULL, 's'},
                                          {"unit", required_argument, NULL, 'u'},
                                          {"repair", no_argument, NULL, 'm'},
                                          {"output", required_argument, NULL, 'o'},
                                          {"help", no_argument, NULL, 'h'},
                                          {0}};
    *o = (options){0};
    optind = 1;
    opterr = 0;
    for (int c; (c = getopt_long(argc, argv, "ho:", names, NULL)) != -1;) {
        bool good = true;
        if ((c == 's' || c == 'u') && o->scale > 0)
            return command_usage("fill", "--unit and --scale both set the unit; give one");
        switch (c) {
        case 'z': good = command_quantity("size", optarg, "length", &o->size_m); break;
        case 's': good = command_quantity("scale", optarg, "none", &o->scale); break;
        case 'u': good = command_unit("fill", optarg, &o->scale); break;
        case 'm': o->repair = true; break;
        case 'o': o->out = optarg; break;
        case 'h': usage(); exit(APP_DONE);
        default:
            if (!strcmp(argv[optind - 1], "--mend"))
                return command_usage("fill", "--mend is called --repair since 0.2; write --repair");
            return command_usage("fill", "unknown option, or its value is missing: '%s'", argv[optind - 1]);
        }
        if (!good) return APP_BAD_INPUT;
        if (c == 'z' && !(o->size_m > 0)) return command_usage("fill", "--size must be above 0");
        if (c == 's' && !(o->scale > 0)) return command_usage("fill", "--scale must be above 0");
    }
    o->in = argv + optind;
    o->files = argc - optind;
    if (o->files < 1 || o->files > SURFACES_FILES)
        return command_usage("fill", "name one surface, or up to %d", SURFACES_FILES);
    if (!o->out) return command_usage("fill", "no output; give -o OUT");
    const int bad = command_output(o->out);
    if (bad || o->scale > 0) return bad;
    return app_bad_input(
        o->in[0], 0, "surface files do not store the unit of their coordinates; give --unit mm (or m, cm, um, inch)");
}

/* Makes the file's mesh: one region 'tissue', one group 'surface', numbers from 1. */
static bool to_file(const growing *m, tm_mesh_file *out) {
    unsigned char *outer = calloc((size_t)m->vertex_count + 1, 1);
    int32_t members = 0;
    *out =
        (tm_mesh_file){.vertex_count = m->vertex_count, .tet_count = m->tet_count, .region_count = 1, .group_count = 1};
    for (int i = 0; outer && i < 3 * m->face_count; i++) outer[m->face[i]] = 1;
    if (!outer || !tm_mesh_file_allocate(out, m->vertex_count)) {
        free(outer);
        *out = (tm_mesh_file){0};
        return false;
    }
    memcpy(out->vertex_m, m->vertex, 3 * (size_t)m->vertex_count * sizeof(double));
    for (int v = 0; v < m->vertex_count; v++) {
        out->vertex_tag[v] = v + 1;
        if (outer[v]) out->group_vertex[members++] = v;
    }
    for (int t = 0; t < m->tet_count; t++) {
        memcpy(out->tet + 4 * (size_t)t, m->tet + 4 * (size_t)t, 4 * sizeof(int32_t));
        out->tet_tag[t] = t + 1;
    }
    out->group_begin[1] = members;
    strcpy(out->region_name[0], "tissue");
    strcpy(out->group_name[0], "surface");
    free(outer);
    return true;
}

/* Fills the body; if the result is pinched, retries with a slightly finer lattice. Pinched surfaces (two parts that
 * touch in one vertex) come from details as fine as the lattice. */
static bool fill_manifold(growing *m, const growing_solid *body, double size_m) {
    for (int attempt = 0; attempt < 8 && !m->no_memory; attempt++, size_m *= 0.97) {
        growing_free(m);
        growing_fill(m, body, size_m);
        if (m->tet_count > 0 && growing_find_surface(m)) return true;
    }
    return false;
}

static double volume_of(const tm_mesh *built) {
    double volume = 0;
    for (int32_t t = 0; t < built->tet_count; t++) volume += built->volume_m3[t];
    return volume;
}

static int write_out(const options *o, const tm_mesh_file *out, const shell *surface) {
    tm_mesh *built = NULL;
    tm_error error = {0};
    int exit = APP_DONE;
    if (tm_mesh_file_build(out, &built, &error))
        exit = app_report(o->in[0], 0, &error);
    else if (app_mesh_write(out, o->out, &error))
        exit = app_report(NULL, 0, &error);
    else if (!app_is_quiet()) {
        printf("%s: %d tetrahedra, %d vertices; volume %.4g cm3", o->out, out->tet_count, out->vertex_count,
               1e6 * volume_of(built));
        if (surface) printf(", the surface encloses %.4g cm3", 1e6 * shell_volume_m3(surface));
        printf("\n");
    }
    tm_mesh_destroy(built);
    return exit;
}

static int fill_one(const options *o, const shell *surface, tm_mesh_file *out) {
    growing m = {0};
    const growing_solid body = shell_solid(surface);
    int exit = APP_DONE;
    if (!fill_manifold(&m, &body, o->size_m) && !m.no_memory)
        exit = app_bad_input(
            o->in[0], 0,
            "the surface has details of %g mm that the mesh cannot represent; choose a smaller --size, or smooth the surface",
            1e3 * o->size_m);
    else {
        growing_improve(&m, &body, NULL, 40);
        if (m.no_memory || !to_file(&m, out)) exit = command_no_memory(o->in[0]);
    }
    growing_free(&m);
    return exit;
}

/* Returns the longest side of the box around all surfaces, m. */
static double longest_side_m(const surfaces *s) {
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (int i = 0; i < s->pieces; i++) {
        const growing_solid solid = shell_solid(s->piece[i].shell);
        for (int k = 0; k < 3; k++) {
            low[k] = fmin(low[k], solid.low[k]);
            high[k] = fmax(high[k], solid.high[k]);
        }
    }
    return fmax(high[0] - low[0], fmax(high[1] - low[1], high[2] - low[2]));
}

/* Estimates the number of tetrahedra before the work, and rejects too many. */
static int check_size(const options *o, const surfaces *s) {
    double volume_m3 = 0;
    for (int i = 0; i < s->pieces; i++)
        if (s->piece[i].parent < 0) volume_m3 += shell_volume_m3(s->piece[i].shell);
    const double expected = 12 * volume_m3 / (o->size_m * o->size_m * o->size_m);
    const double side_m = longest_side_m(s);
    if (side_m > SIDE_MAX * o->size_m)
        return app_bad_input(o->in[0], 0,
                             "its longest side, %.3g m, is more than %d times --size; choose a larger --size, or look "
                             "for a triangle far away",
                             side_m, SIDE_MAX);
    if (expected > LIMIT)
        return app_bad_input(
            o->in[0], 0, "it would have about %.2g tetrahedra; choose a larger --size, or another --unit", expected);
    if (expected < 20)
        return app_bad_input(o->in[0], 0,
                             "it would have fewer than 20 tetrahedra; choose a smaller --size, or another --unit");
    return APP_DONE;
}

int command_fill(int argc, char **argv) {
    static surfaces s;
    options o;
    tm_mesh_file out = {0};
    int exit = parse(argc, argv, &o);
    if (exit) return exit;
    exit = surfaces_load(o.in, o.files, o.scale, o.repair, &s);
    if (!exit && !(o.size_m > 0)) o.size_m = longest_side_m(&s) / 14;
    if (!exit) exit = check_size(&o, &s);
    if (!exit) exit = s.whole ? fill_one(&o, s.whole, &out) : fill_regions(o.in[0], &s, o.size_m, &out);
    if (!exit) exit = write_out(&o, &out, s.whole);
    tm_mesh_file_free(&out);
    surfaces_free(&s);
    return exit;
}
