/* tm-mesh fill: tetrahedra inside a closed surface. */
#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"
#include "shell.h"

enum { LIMIT = 5 * 1000 * 1000 };

typedef struct options {
    const char *in, *out;
    double scale, size_m;
} options;

static void usage(void) {
    printf("usage: tm-mesh fill --size SIZE [--scale S] SURFACE.stl -o OUT.msh\n"
           "Fills a closed surface with tetrahedra whose edges are about SIZE: a lattice, cut and pulled to the "
           "surface, then smoothed so that the\n"
           "smallest tetrahedron, which sets the time step, is as large as may be. Details and ridges finer than SIZE "
           "are rounded off.\n\n"
           "  --size SIZE  longest inner edge, e.g. 5mm; half of it makes eight times as many\n"
           "  --scale S    metres per unit of the file [1]; 1e-3 for millimetres\n"
           "  -o OUT       .msh, .vtk or .mesh; one region 'tissue', its vertex group 'surface'\n");
}

static int parse(int argc, char **argv, options *o) {
    static const struct option names[] = {{"size", required_argument, NULL, 'z'},
                                          {"scale", required_argument, NULL, 's'},
                                          {"output", required_argument, NULL, 'o'},
                                          {"help", no_argument, NULL, 'h'},
                                          {0}};
    *o = (options){.scale = 1};
    optind = 1;
    opterr = 0;
    for (int c; (c = getopt_long(argc, argv, "ho:", names, NULL)) != -1;) {
        bool good = true;
        switch (c) {
        case 'z': good = command_quantity("size", optarg, "length", &o->size_m); break;
        case 's': good = command_quantity("scale", optarg, "none", &o->scale); break;
        case 'o': o->out = optarg; break;
        case 'h': usage(); exit(APP_DONE);
        default: return command_usage("fill", "bad option '%s'", argv[optind - 1]);
        }
        if (!good) return APP_BAD_INPUT;
    }
    if (optind + 1 != argc) return command_usage("fill", "name one STL file");
    if (!o->out) return command_usage("fill", "no output; give -o OUT");
    if (!(o->size_m > 0)) return command_usage("fill", "--size must be above 0");
    if (!(o->scale > 0)) return command_usage("fill", "--scale must be above 0");
    o->in = argv[optind];
    return command_output(o->out);
}

/* One region 'tissue', one group 'surface', numbers from 1. */
static bool to_app_mesh(const growing *m, app_mesh *out) {
    unsigned char *outer = calloc((size_t)m->vertex_count + 1, 1);
    int32_t members = 0;
    *out = (app_mesh){.vertex_count = m->vertex_count, .tet_count = m->tet_count, .region_count = 1, .group_count = 1};
    for (int i = 0; outer && i < 3 * m->face_count; i++) outer[m->face[i]] = 1;
    if (!outer || !app_mesh_allocate(out, m->vertex_count)) {
        free(outer);
        *out = (app_mesh){0};
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

/* A pinched surface (two parts that touch in one vertex) comes of details as fine as the lattice: a little finer a
 * lattice is tried. */
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

static int write_out(const options *o, const app_mesh *out, const shell *surface) {
    tm_mesh *built = NULL;
    tm_error error = {0};
    int exit = APP_DONE;
    if (app_mesh_build(out, &built, &error))
        exit = app_report(o->in, 0, &error);
    else if (app_mesh_write(out, o->out, &error))
        exit = app_report(NULL, 0, &error);
    else if (!app_is_quiet())
        printf("%s: %d tetrahedra, %d vertices; volume %.4g cm3, the surface's is %.4g cm3\n", o->out, out->tet_count,
               out->vertex_count, 1e6 * volume_of(built), 1e6 * shell_volume_m3(surface));
    tm_mesh_destroy(built);
    return exit;
}

int command_fill(int argc, char **argv) {
    options o;
    shell *surface = NULL;
    tm_error error = {0};
    growing m = {0};
    app_mesh out = {0};
    int exit = parse(argc, argv, &o);
    if (exit) return exit;
    if (shell_load(o.in, o.scale, &surface, &error)) return app_report(o.in, 0, &error);
    growing_solid body = shell_solid(surface);
    double expected = 12 * shell_volume_m3(surface) / (o.size_m * o.size_m * o.size_m);
    if (expected > LIMIT)
        exit = app_bad_input(
            o.in, 0, "about %.2g tetrahedra would come of it; choose a larger --size, or --scale 1e-3 for millimetres",
            expected);
    else if (expected < 20)
        exit =
            app_bad_input(o.in, 0, "fewer than 20 tetrahedra would fit; choose a smaller --size, or another --scale");
    else if (!fill_manifold(&m, &body, o.size_m) && !m.no_memory)
        exit = app_bad_input(o.in, 0,
                             "details as fine as %g mm pinch the mesh; choose a smaller --size, or smooth the surface",
                             1e3 * o.size_m);
    else {
        growing_improve(&m, &body, NULL, 40);
        exit = m.no_memory || !to_app_mesh(&m, &out) ? command_no_memory(o.in) : write_out(&o, &out, surface);
    }
    app_mesh_free(&out);
    growing_free(&m);
    shell_free(surface);
    return exit;
}
