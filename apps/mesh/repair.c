/* tm-mesh repair and convert. */
#include <getopt.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"
#include "libtensormass/numeric/union_find.h"

typedef struct options {
    const char *in, *out, *fibres, *region;
    double scale, merge_m;
    bool largest;
} options;

static void repair_usage(void) {
    printf("usage: tm-mesh repair [--unit UNIT] [--merge DISTANCE] [--largest] IN -o OUT\n"
           "Reverses inverted tetrahedra; removes tetrahedra that are flat, double, have a vertex twice or "
           "overlap others, and unused vertices.\n"
           "Prints what it did. Numbers stay those of the file. A coordinate that is nan cannot be repaired.\n"
           "\n"
           "  --merge DISTANCE  merge vertices that are closer than this, e.g. 1um\n"
           "  --largest         keep only the largest connected piece\n"
           "  --unit UNIT       unit of the file's coordinates: m, cm, mm, um or inch [m]\n"
           "  --scale S         the same as metres per unit of the file: 1e-3 for millimetres\n"
           "  -o OUT            .msh, .vtk, .mesh or .vtu\n");
}

static void convert_usage(void) {
    printf("usage: tm-mesh convert [--unit UNIT] [--region NAME] [--fibres IN.csv] IN -o OUT\n"
           "Converts between .msh (2.2, 4.1 read; 2.2 written), .vtk, .vtu (ParaView, meshio) and .mesh. .mesh "
           "stores regions as numbers and no vertex groups; the others store both with their names.\n"
           "\n"
           "  --unit UNIT      unit of the file's coordinates: m, cm, mm, um or inch [m]\n"
           "  --scale S        the same as metres per unit of the file: 1e-3 for millimetres\n"
           "  --region NAME    keep only the tetrahedra of this region, with the groups that have vertices of it\n"
           "  --fibres IN.csv  read fibres of IN and write them into .vtk or .vtu, as 'fibre' of each cell\n"
           "  -o OUT           .msh, .vtk, .mesh or .vtu\n");
}

static int parse(const char *command, void (*usage)(void), int argc, char **argv, options *o) {
    static const struct option names[] = {{"scale", required_argument, NULL, 's'},
                                          {"unit", required_argument, NULL, 'u'},
                                          {"merge", required_argument, NULL, 'm'},
                                          {"largest", no_argument, NULL, 'l'},
                                          {"fibres", required_argument, NULL, 'f'},
                                          {"output", required_argument, NULL, 'o'},
                                          {"region", required_argument, NULL, 'r'},
                                          {"help", no_argument, NULL, 'h'},
                                          {0}};
    bool sized = false, repair = strcmp(command, "repair") == 0;
    *o = (options){.scale = 1};
    optind = 1;
    opterr = 0;
    for (int c; (c = getopt_long(argc, argv, "ho:", names, NULL)) != -1;) {
        if (c == 's' || c == 'u') {
            if (!command_scale(command, c, optarg, &sized, &o->scale)) return APP_BAD_INPUT;
        } else if (c == 'm' && repair) {
            if (!command_quantity("merge", optarg, "length", &o->merge_m)) return APP_BAD_INPUT;
        } else if (c == 'l' && repair)
            o->largest = true;
        else if (c == 'f' && !repair)
            o->fibres = optarg;
        else if (c == 'r' && !repair)
            o->region = optarg;
        else if (c == 'o')
            o->out = optarg;
        else if (c == 'h') {
            usage();
            exit(APP_DONE);
        } else
            return command_usage(command, "unknown option, or its value is missing: '%s'", argv[optind - 1]);
    }
    if (optind + 1 != argc) return command_usage(command, "name one mesh file");
    if (!o->out) return command_usage(command, "no output; give -o OUT");
    if (o->fibres && o->region)
        return command_usage(command, "--fibres are those of all regions; leave --region out, or convert twice");
    o->in = argv[optind];
    const char *dot = strrchr(o->out, '.');
    if (o->fibres && !(dot && (strcmp(dot, ".vtk") == 0 || strcmp(dot, ".vtu") == 0)))
        return command_usage(command,
                             "--fibres works only with .vtk and .vtu; for CSV use tm-mesh refine --write-fibres");
    return command_output(o->out);
}

/* Merges vertices within a distance of a previous one (in the order of x). Returns their number, -1 if memory is
 * exhausted. */
static const double *sort_points; /* qsort has no context */
static int by_x(const void *a, const void *b) {
    int32_t v = *(const int32_t *)a, w = *(const int32_t *)b;
    double x = sort_points[3 * (size_t)v], y = sort_points[3 * (size_t)w];
    return x != y ? (x < y ? -1 : 1) : (v > w) - (v < w);
}

static int32_t merge_vertices(tm_mesh_file *mesh, double distance_m) {
    size_t n = (size_t)mesh->vertex_count;
    int32_t *order = malloc((n + 1) * sizeof *order), *target = malloc((n + 1) * sizeof *target), merged = 0;
    if (!order || !target) {
        free(order);
        free(target);
        return -1;
    }
    for (int32_t v = 0; v < mesh->vertex_count; v++) order[v] = target[v] = v;
    sort_points = mesh->vertex_m;
    qsort(order, n, sizeof *order, by_x);
    for (size_t i = 0; i < n; i++) {
        const double *p = mesh->vertex_m + 3 * (size_t)order[i];
        for (size_t j = i; j-- > 0;) {
            const double *q = mesh->vertex_m + 3 * (size_t)order[j];
            double x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
            if (x > distance_m) break;
            if (target[order[j]] != order[j] || x * x + y * y + z * z > distance_m * distance_m) continue;
            target[order[i]] = order[j];
            merged++;
            break;
        }
    }
    for (size_t i = 0; i < 4 * (size_t)mesh->tet_count; i++) mesh->tet[i] = target[mesh->tet[i]];
    for (int32_t i = 0; i < mesh->group_begin[mesh->group_count]; i++)
        mesh->group_vertex[i] = target[mesh->group_vertex[i]];
    free(order);
    free(target);
    return merged;
}

/* Makes one pass: reverses or removes the tetrahedra of each defect. Returns the number of remaining defects, -1 if it
 * cannot be repaired (reported), -2 if memory is exhausted. */
static int64_t repair_pass(tm_mesh_file *mesh, const char *path, int64_t done[TM_DEFECT_KINDS]) {
    int64_t count = tm_mesh_file_defects(mesh, NULL, 0);
    tm_mesh_defect *defect = count > 0 ? malloc((size_t)count * sizeof *defect) : NULL;
    uint8_t *keep = malloc((size_t)mesh->tet_count + 1);
    if (count < 0 || (count && !defect) || !keep) return -2;
    tm_mesh_file_defects(mesh, defect, count);
    memset(keep, 1, (size_t)mesh->tet_count);
    int64_t left = count;
    for (int64_t i = 0; i < count && left > 0; i++) {
        const tm_mesh_defect *d = &defect[i];
        int32_t *v = d->tet >= 0 ? mesh->tet + 4 * (size_t)d->tet : NULL, spare;
        char text[400];
        if (d->tet >= 0 && !keep[d->tet]) continue;
        if (d->other >= 0 && !keep[d->other]) continue;
        switch (d->kind) {
        case TM_DEFECT_NOT_FINITE:
            tm_mesh_defect_text(mesh, d, text, sizeof text);
            app_bad_input(path, 0, "%s", text);
            left = -1;
            break;
        case TM_DEFECT_INVERTED:
            spare = v[2];
            v[2] = v[3];
            v[3] = spare;
            break;
        case TM_DEFECT_VERTEX_TWICE:
        case TM_DEFECT_FLAT:
        case TM_DEFECT_TET_TWICE:
        case TM_DEFECT_FACE_SHARED:
        case TM_DEFECT_OVERLAP: keep[d->tet] = 0; break;
        case TM_DEFECT_UNUSED_VERTEX:
        case TM_DEFECT_KINDS: break;
        }
        done[d->kind]++;
    }
    free(defect);
    if (left > 0 && !tm_mesh_file_subset(mesh, keep, NULL)) left = -2;
    free(keep);
    return left;
}

/* Keeps only the piece with most tetrahedra; pieces are connected through vertices here. Returns the number of removed
 * tetrahedra, -1 if memory is exhausted. */
static int32_t keep_largest(tm_mesh_file *mesh) {
    size_t n = (size_t)mesh->vertex_count;
    int32_t *parent = malloc((n + 1) * sizeof *parent), *size = calloc(n + 1, sizeof *size), best = 0,
            before = mesh->tet_count;
    uint8_t *keep = malloc((size_t)mesh->tet_count + 1);
    bool good = parent && size && keep;
    for (int32_t v = 0; good && v < mesh->vertex_count; v++) parent[v] = v;
    for (int32_t t = 0; good && t < mesh->tet_count; t++)
        for (int k = 1; k < 4; k++) law_join(parent, mesh->tet[4 * (size_t)t + (size_t)k], mesh->tet[4 * (size_t)t]);
    for (int32_t t = 0; good && t < mesh->tet_count; t++) {
        int32_t r = law_root(parent, mesh->tet[4 * (size_t)t]);
        if (++size[r] > size[best]) best = r;
    }
    for (int32_t t = 0; good && t < mesh->tet_count; t++) keep[t] = law_root(parent, mesh->tet[4 * (size_t)t]) == best;
    good = good && tm_mesh_file_subset(mesh, keep, NULL);
    free(parent);
    free(size);
    free(keep);
    return good ? before - mesh->tet_count : -1;
}

typedef struct outcome {
    int64_t done[TM_DEFECT_KINDS];
    int32_t merged, far;
} outcome;

/* Repairs a mesh in memory. Returns APP_DONE, or an exit code after an error message. */
static int repair_mesh(tm_mesh_file *mesh, const options *o, outcome *out) {
    int64_t left = 1;
    out->merged = o->merge_m > 0 ? merge_vertices(mesh, o->merge_m) : 0;
    for (int round = 0; left > 0 && round < 20; round++) left = repair_pass(mesh, o->in, out->done);
    if (left == -1) return APP_BAD_INPUT;
    if (left == 0 && o->largest) out->far = keep_largest(mesh);
    if (out->merged < 0 || left < 0 || out->far < 0)
        return app_bad_input(o->in, 0, "no memory; use a coarser mesh"), APP_FAILED;
    if (left > 0)
        return app_bad_input(o->in, 0, "%lld defects remain after 20 passes; mesh the organ again", (long long)left);
    if (mesh->tet_count == 0) return app_bad_input(o->in, 0, "no tetrahedron remains; mesh the organ again");
    return APP_DONE;
}

static void tell(const tm_mesh_file *mesh, const char *path, const outcome *out) {
    static const char *const did[TM_DEFECT_KINDS] = {"",
                                                     "tetrahedra removed: a vertex twice",
                                                     "tetrahedra removed: flat",
                                                     "tetrahedra reversed: inverted",
                                                     "tetrahedra removed: double",
                                                     "tetrahedra removed: third on a face",
                                                     "tetrahedra removed: overlapping",
                                                     "vertices removed: unused"};
    if (app_is_quiet()) return;
    printf("%s: %d tetrahedra, %d vertices\n", path, mesh->tet_count, mesh->vertex_count);
    if (out->merged) printf("  %d vertices merged\n", out->merged);
    for (int k = 1; k < TM_DEFECT_KINDS; k++)
        if (out->done[k]) printf("  %lld %s\n", (long long)out->done[k], did[k]);
    if (out->far) printf("  %d tetrahedra of smaller pieces removed\n", out->far);
}

static int take_fibres(const char *path, const tm_mesh *built, tm_mesh_file *mesh) {
    tm_error error = {0};
    mesh->fibre = malloc((3 * (size_t)mesh->tet_count + 1) * sizeof *mesh->fibre);
    if (!mesh->fibre) return command_no_memory(path);
    return tm_fibres_load_on(path, built, mesh->fibre, &error) ? app_report(NULL, 0, &error) : APP_DONE;
}

/* Drops groups without vertices. */
static void drop_empty_groups(tm_mesh_file *mesh) {
    int32_t kept = 0;
    for (int32_t g = 0; g < mesh->group_count; g++) {
        if (mesh->group_begin[g] == mesh->group_begin[g + 1]) continue;
        memmove(mesh->group_name[kept], mesh->group_name[g], sizeof *mesh->group_name);
        mesh->group_begin[++kept] = mesh->group_begin[g + 1];
    }
    mesh->group_count = kept;
}

/* Keeps one region. Returns APP_DONE, or an exit code after an error message. */
static int keep_region(tm_mesh_file *mesh, const options *o) {
    int32_t region = 0, count = 0;
    while (region < mesh->region_count && strcmp(mesh->region_name[region], o->region) != 0) region++;
    if (region == mesh->region_count)
        return app_bad_input(o->in, 0, "there is no region '%s'; tm-mesh info lists them", o->region);
    uint8_t *keep = malloc((size_t)mesh->tet_count + 1);
    if (!keep) return command_no_memory(o->in);
    for (int32_t t = 0; t < mesh->tet_count; t++) count += keep[t] = mesh->region[t] == region;
    const bool good = count > 0 && tm_mesh_file_subset(mesh, keep, NULL);
    free(keep);
    if (!count) return app_bad_input(o->in, 0, "region '%s' has no tetrahedron; name another", o->region);
    if (!good) return command_no_memory(o->in);
    if (region) memcpy(mesh->region_name[0], mesh->region_name[region], sizeof *mesh->region_name);
    mesh->region_count = 1;
    for (int32_t t = 0; t < mesh->tet_count; t++) mesh->region[t] = 0;
    drop_empty_groups(mesh);
    return APP_DONE;
}

static int load_write(const char *command, const options *o) {
    tm_mesh_file mesh;
    outcome out = {0};
    tm_error error = {0};
    tm_mesh *built = NULL;
    bool repair = strcmp(command, "repair") == 0;
    if (tm_mesh_file_load(o->in, o->scale, &mesh, &error)) return app_report(NULL, 0, &error);
    int exit = repair ? repair_mesh(&mesh, o, &out) : o->region ? keep_region(&mesh, o) : APP_DONE;
    if (exit == APP_DONE && tm_mesh_file_build(&mesh, &built, &error)) exit = app_report(NULL, 0, &error);
    if (exit == APP_DONE && o->fibres) exit = take_fibres(o->fibres, built, &mesh);
    if (exit == APP_DONE && app_mesh_write(&mesh, o->out, &error)) exit = app_report(NULL, 0, &error);
    if (exit == APP_DONE) tell(&mesh, o->out, &out);
    tm_mesh_destroy(built);
    tm_mesh_file_free(&mesh);
    return exit;
}

int command_repair(int argc, char **argv) {
    options o;
    int exit = parse("repair", repair_usage, argc, argv, &o);
    return exit ? exit : load_write("repair", &o);
}

int command_convert(int argc, char **argv) {
    options o;
    int exit = parse("convert", convert_usage, argc, argv, &o);
    return exit ? exit : load_write("convert", &o);
}
