/* tm-mesh renumber: gives neighbours close numbers, which reduces the bandwidth. */
#include <getopt.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"

typedef struct options {
    const char *in, *out, *fibres, *out_fibres, *out_numbers;
    double scale;
} options;

static void usage(void) {
    printf("usage: tm-mesh renumber [--unit UNIT] [--fibres IN.csv --write-fibres OUT.csv] [--write-numbers "
           "OUT.csv] IN -o OUT\n"
           "Renumbers vertices by the reverse Cuthill-McKee order, and tetrahedra after them, from 1. "
           "Neighbours then have close numbers, and a\n"
           "step waits less for memory. Positions, regions and groups do not change.\n"
           "\n"
           "  --fibres IN.csv     read fibres of IN, a row a tetrahedron or vertex; --write-fibres OUT.csv "
           "writes those of OUT\n"
           "  --write-numbers OUT.csv  write 'vertex,was': index of each vertex of OUT in IN, both from 0, as "
           "in scenes\n"
           "  --unit UNIT         unit of the file's coordinates: m, cm, mm, um or inch [m]\n"
           "  --scale S           the same as metres per unit of the file: 1e-3 for millimetres\n"
           "  -o OUT              .msh, .vtk, .vtu or .mesh\n");
}

static int parse(int argc, char **argv, options *o) {
    static const struct option names[] = {{"scale", required_argument, NULL, 's'},
                                          {"unit", required_argument, NULL, 'u'},
                                          {"fibres", required_argument, NULL, 'f'},
                                          {"write-fibres", required_argument, NULL, 'w'},
                                          {"write-numbers", required_argument, NULL, 'n'},
                                          {"output", required_argument, NULL, 'o'},
                                          {"help", no_argument, NULL, 'h'},
                                          {0}};
    bool sized = false;
    *o = (options){.scale = 1};
    optind = 1;
    opterr = 0;
    for (int c; (c = getopt_long(argc, argv, "ho:", names, NULL)) != -1;) {
        bool good = true;
        switch (c) {
        case 's':
        case 'u': good = command_scale("renumber", c, optarg, &sized, &o->scale); break;
        case 'f': o->fibres = optarg; break;
        case 'w': o->out_fibres = optarg; break;
        case 'n': o->out_numbers = optarg; break;
        case 'o': o->out = optarg; break;
        case 'h': usage(); exit(APP_DONE);
        default: return command_usage("renumber", "unknown option, or its value is missing: '%s'", argv[optind - 1]);
        }
        if (!good) return APP_BAD_INPUT;
    }
    if (optind + 1 != argc) return command_usage("renumber", "name one mesh file");
    if (!o->out) return command_usage("renumber", "no output; give -o OUT");
    if (!o->fibres != !o->out_fibres) return command_usage("renumber", "--fibres and --write-fibres go together");
    o->in = argv[optind];
    int exit = command_output(o->out);
    if (!exit && o->out_fibres) exit = app_output_check(o->out_fibres);
    if (!exit && o->out_numbers) exit = app_output_check(o->out_numbers);
    return exit;
}

typedef struct numbers {
    int32_t *vertex, *tet; /* old number of each new one */
} numbers;

/* Makes the renumbered mesh. If memory is exhausted, `out`, zero before, stays zero. */
static bool reorder(const tm_mesh_file *file, const numbers *was, tm_mesh_file *out) {
    const int32_t members = file->group_begin[file->group_count];
    uint8_t *mark = calloc((size_t)file->vertex_count, 1);
    int32_t *now = malloc((size_t)file->vertex_count * sizeof *now);
    *out = *file;
    const bool good = tm_mesh_file_allocate(out, members) && mark && now;
    for (int32_t v = 0; good && v < file->vertex_count; v++) {
        now[was->vertex[v]] = v;
        memcpy(out->vertex_m + 3 * (int64_t)v, file->vertex_m + 3 * (int64_t)was->vertex[v], 3 * sizeof(double));
        out->vertex_tag[v] = v + 1;
    }
    for (int32_t t = 0; good && t < file->tet_count; t++) {
        const int32_t old = was->tet[t];
        for (int k = 0; k < 4; k++) out->tet[4 * (int64_t)t + k] = now[file->tet[4 * (int64_t)old + k]];
        out->region[t] = file->region[old];
        out->tet_tag[t] = t + 1;
    }
    if (good) {
        memcpy(out->region_name, file->region_name, (size_t)file->region_count * sizeof *out->region_name);
        memcpy(out->group_name, file->group_name, (size_t)file->group_count * sizeof *out->group_name);
    }
    for (int32_t g = 0, n = 0; good && g < file->group_count; g++) {
        for (int32_t i = file->group_begin[g]; i < file->group_begin[g + 1]; i++) mark[now[file->group_vertex[i]]] = 1;
        for (int32_t v = 0; v < file->vertex_count; v++) {
            if (mark[v]) out->group_vertex[n++] = v;
            mark[v] = 0;
        }
        out->group_begin[g + 1] = n;
    }
    free(mark);
    free(now);
    if (!good) tm_mesh_file_free(out);
    return good;
}

static int carry_fibres(const options *o, const tm_mesh *mesh, const numbers *was) {
    const size_t bytes = 3 * (size_t)mesh->tet_count * sizeof(double);
    double *old = malloc(bytes), *new = malloc(bytes);
    tm_error error = {0};
    int exit = APP_DONE;
    if (!old || !new)
        exit = command_no_memory(o->in);
    else if (tm_fibres_load_on(o->fibres, mesh, old, &error))
        exit = app_report(NULL, 0, &error);
    else {
        for (int32_t t = 0; t < mesh->tet_count; t++)
            memcpy(new + 3 * (int64_t)t, old + 3 * (int64_t)was->tet[t], 3 * sizeof *new);
        if (write_fibres(new, mesh->tet_count, o->out_fibres, &error)) exit = app_report(NULL, 0, &error);
    }
    free(old);
    free(new);
    return exit;
}

static int write_numbers(const int32_t *was, int32_t count, const char *path) {
    app_output output;
    tm_error error = {0};
    if (!app_output_begin(&output, path, &error)) return app_report(NULL, 0, &error);
    FILE *file = app_output_stream(&output);
    if (file) fprintf(file, "vertex,was\n");
    for (int32_t v = 0; file && v < count; v++) fprintf(file, "%d,%d\n", v, was[v]);
    return app_output_end(&output, file, &error) ? APP_DONE : app_report(NULL, 0, &error);
}

static int write_all(const options *o, const tm_mesh *mesh, const numbers *was, const tm_mesh_file *out) {
    tm_numbering_stats f;
    tm_error error = {0};
    if (!tm_mesh_numbering_measure(mesh, &f)) return command_no_memory(o->in);
    int exit = o->fibres ? carry_fibres(o, mesh, was) : APP_DONE;
    if (exit == APP_DONE && o->out_numbers) exit = write_numbers(was->vertex, mesh->vertex_count, o->out_numbers);
    if (exit == APP_DONE && app_mesh_write(out, o->out, &error)) exit = app_report(NULL, 0, &error);
    if (exit == APP_DONE && !app_is_quiet())
        printf(
            "%s: %d tetrahedra, %d vertices; the numbers of an edge's two vertices differ by %.0f on average (before: %.0f)\n",
            o->out, out->tet_count, out->vertex_count, f.renumbered, f.distance);
    return exit;
}

int command_renumber(int argc, char **argv) {
    options o;
    tm_mesh_file file, out = {0};
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    int exit = parse(argc, argv, &o);
    if (exit) return exit;
    if (tm_mesh_file_load(o.in, o.scale, &file, &error)) return app_report(NULL, 0, &error);
    if (tm_mesh_file_build(&file, &mesh, &error)) {
        tm_mesh_file_free(&file);
        return app_report(NULL, 0, &error);
    }
    numbers was = {.vertex = malloc((size_t)mesh->vertex_count * sizeof *was.vertex),
                   .tet = malloc((size_t)mesh->tet_count * sizeof *was.tet)};
    if (was.vertex && was.tet && tm_mesh_numbering(mesh, was.vertex) &&
        tm_mesh_numbering_tets(mesh, was.vertex, was.tet) && reorder(&file, &was, &out))
        exit = write_all(&o, mesh, &was, &out);
    else
        exit = command_no_memory(o.in);
    free(was.vertex);
    free(was.tet);
    tm_mesh_destroy(mesh);
    tm_mesh_file_free(&out);
    tm_mesh_file_free(&file);
    return exit;
}
