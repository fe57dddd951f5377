/* tm-mesh info and check: report a mesh's figures and defects. */
#include "command.h"

#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "json_file.h"
#include "libtensormass/numeric/union_find.h"
#include "step.h"

/* Finds regions that a mesh file names without a tetrahedron in them. A scene that gives one a material is rejected;
 * usually a label or a volume was lost before. */

static bool has_tetrahedra(const tm_mesh_file *mesh, const char *name) {
    for (int32_t t = 0; t < mesh->tet_count; t++)
        if (!strcmp(mesh->region_name[mesh->region[t]], name)) return true;
    return false;
}

static int32_t add(const tm_mesh_file *mesh, const char *name, char found[REGIONS_WITHOUT][64], int32_t count) {
    if (!*name || count == REGIONS_WITHOUT || has_tetrahedra(mesh, name)) return count;
    for (int32_t i = 0; i < count; i++)
        if (!strcmp(found[i], name)) return count;
    snprintf(found[count], sizeof found[count], "%s", name);
    return count + 1;
}

/* Reads the names from the file's head: the reader drops names without elements. */
static int32_t read_names(const tm_mesh_file *mesh, const char *path, char found[REGIONS_WITHOUT][64], int32_t count) {
    const size_t length = strlen(path);
    if (length < 4 || strcmp(path + length - 4, ".msh") != 0) return count;
    FILE *file = fopen(path, "rb");
    char line[300], name[64];
    bool inside = false;
    while (file && fgets(line, sizeof line, file) && strncmp(line, "$Nodes", 6) && strncmp(line, "$EndPhysical", 12)) {
        int dimension, number;
        if (inside && sscanf(line, "%d %d \"%63[^\"]\"", &dimension, &number, name) == 3 && dimension == 3)
            count = add(mesh, name, found, count);
        inside = inside || !strncmp(line, "$PhysicalNames", 14);
    }
    if (file) fclose(file);
    return count;
}

int32_t find_empty_regions(const tm_mesh_file *mesh, const char *path, char name[REGIONS_WITHOUT][64]) {
    int32_t count = 0;
    for (int32_t r = 0; r < mesh->region_count; r++) count = add(mesh, mesh->region_name[r], name, count);
    return read_names(mesh, path, name, count);
}

typedef struct options {
    const char *file, *json;
    double scale, young_Pa, poisson, density_kg_m3;
} options;

/* Bounds between the histograms' bins. */
static const double aspect_bound[] = {1.5, 2, 3, 5, 10, 100}, dihedral_bound_deg[] = {2, 5, 10, 20, 30, 40};
enum { BINS = 7, LISTED = 20 };

typedef struct figures {
    double low_m[3], high_m[3], volume_m3;
    int64_t aspect[BINS], dihedral[BINS];
    double worst_aspect, min_dihedral_deg, step_s, cut_step_s, median_step_s; /* cut_step_s: of the worst element */
    int32_t worst_aspect_tet, step_tet, cut_step_tet, pieces;
    tm_numbering_stats numbering;
} figures;

static void usage(FILE *to, const char *command) {
    fprintf(to,
            "usage: tm-mesh %s [--unit UNIT] [--young E] [--poisson NU] [--density RHO] [--json FILE] MESH\n"
            "%s\n\n"
            "  --unit UNIT    unit of the file's coordinates: m, cm, mm, um or inch [m]\n"
            "  --scale S      the same as metres per unit of the file: 1e-3 for millimetres\n"
            "  --young E      Young's modulus for the critical step [5 kPa]\n"
            "  --poisson NU   Poisson's ratio for it [0.45]\n"
            "  --density RHO  density for it [1060 kg/m3]\n"
            "  --json FILE    write the figures as JSON\n"
            "  --help\n",
            command,
            strcmp(command, "info") == 0
                ? "Prints counts, size, quality, regions, groups, the worst element and the time step that it causes."
                : "Exit 0: the mesh can be simulated. Exit 2: prints each defect with the number of its tetrahedron or "
                  "vertex in the file, and what to do.");
}

static int parse(const char *command, int argc, char **argv, options *o) {
    static const struct option names[] = {
        {"scale", required_argument, NULL, 's'},   {"unit", required_argument, NULL, 'u'},
        {"young", required_argument, NULL, 'y'},   {"poisson", required_argument, NULL, 'p'},
        {"density", required_argument, NULL, 'd'}, {"json", required_argument, NULL, 'j'},
        {"help", no_argument, NULL, 'h'},          {0}};
    bool sized = false;
    *o = (options){.scale = 1, .young_Pa = 5000, .poisson = 0.45, .density_kg_m3 = 1060};
    optind = 1;
    opterr = 0;
    for (int c; (c = getopt_long(argc, argv, "h", names, NULL)) != -1;) {
        bool good = true;
        switch (c) {
        case 's':
        case 'u': good = command_scale(command, c, optarg, &sized, &o->scale); break;
        case 'y': good = command_quantity("young", optarg, "pressure", &o->young_Pa); break;
        case 'p': good = command_quantity("poisson", optarg, "none", &o->poisson); break;
        case 'd': good = command_quantity("density", optarg, "density", &o->density_kg_m3); break;
        case 'j': o->json = optarg; break;
        case 'h': usage(stdout, command); exit(APP_DONE);
        default: return command_usage(command, "unknown option, or its value is missing: '%s'", argv[optind - 1]);
        }
        if (!good) return APP_BAD_INPUT;
    }
    if (optind + 1 != argc) return command_usage(command, "name one mesh file");
    o->file = argv[optind];
    return APP_DONE;
}

/* Prints all defects, the first ones a line each. */
static int refuse(const tm_mesh_file *file, const char *path, const tm_error *error) {
    static tm_mesh_defect defect[LISTED];
    int64_t count = tm_mesh_file_defects(file, defect, LISTED);
    if (count <= 0) return app_report(NULL, 0, error);
    for (int64_t i = 0; i < count && i < LISTED; i++) {
        char text[400];
        tm_mesh_defect_text(file, &defect[i], text, sizeof text);
        app_bad_input(path, 0, "%s", text);
    }
    if (count > LISTED)
        app_bad_input(path, 0, "%lld more defects; run tm-mesh repair, or mesh the organ again",
                      (long long)count - LISTED);
    return APP_BAD_INPUT;
}

/* Counts the pieces that are connected through faces. */
static int32_t count_pieces(const tm_mesh *mesh) {
    int32_t *parent = malloc((size_t)mesh->tet_count * sizeof *parent), pieces = 0;
    if (!parent) return -1;
    for (int32_t t = 0; t < mesh->tet_count; t++) parent[t] = t;
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++)
        if (mesh->tet_neighbour[f] >= 0) law_join(parent, f / 4, mesh->tet_neighbour[f]);
    for (int32_t t = 0; t < mesh->tet_count; t++) pieces += parent[t] == t;
    free(parent);
    return pieces;
}

static int bin_of(const double *bound, double value) {
    int bin = 0;
    while (bin < BINS - 1 && value >= bound[bin]) bin++;
    return bin;
}

static void measure_shape(const tm_mesh *mesh, figures *f) {
    *f = (figures){
        .low_m = {INFINITY, INFINITY, INFINITY}, .high_m = {-INFINITY, -INFINITY, -INFINITY}, .min_dihedral_deg = 180};
    for (int64_t i = 0; i < 3 * (int64_t)mesh->vertex_count; i++) {
        f->low_m[i % 3] = fmin(f->low_m[i % 3], mesh->rest_m[i]);
        f->high_m[i % 3] = fmax(f->high_m[i % 3], mesh->rest_m[i]);
    }
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        tm_tet_quality q = tm_mesh_tet_quality(mesh, t);
        double angle = q.min_dihedral_rad * 180 / M_PI;
        f->volume_m3 += q.volume_m3;
        f->aspect[bin_of(aspect_bound, q.aspect)]++;
        f->dihedral[bin_of(dihedral_bound_deg, angle)]++;
        f->min_dihedral_deg = fmin(f->min_dihedral_deg, angle);
        if (q.aspect > f->worst_aspect) {
            f->worst_aspect = q.aspect;
            f->worst_aspect_tet = t;
        }
    }
    f->pieces = count_pieces(mesh);
}

static tm_status measure_step(const tm_mesh *mesh, const options *o, figures *f, tm_error *error) {
    step_figures step;
    tm_status status = step_measure(mesh, o->young_Pa, o->poisson, o->density_kg_m3, &step, error);
    if (status) return status;
    f->step_s = step.guaranteed_s;
    f->step_tet = step.tet;
    f->cut_step_s = step.cut_s;
    f->cut_step_tet = step.cut_tet;
    f->median_step_s = step.median_s;
    return TM_OK;
}

static void print_histogram(const char *what, const int64_t count[BINS], const double *bound) {
    printf("%s:", what);
    for (int b = 0; b < BINS; b++) {
        if (b == 0)
            printf("  <%g: ", bound[0]);
        else if (b == BINS - 1)
            printf("  >%g: ", bound[b - 1]);
        else
            printf("  %g-%g: ", bound[b - 1], bound[b]);
        printf("%lld", (long long)count[b]);
    }
    printf("\n");
}

/* Computes the volume and number of tetrahedra of each region. */
static void region_sums(const tm_mesh *mesh, int32_t region, double *volume_m3, int32_t *tets) {
    *volume_m3 = 0;
    *tets = 0;
    for (int32_t t = 0; t < mesh->tet_count; t++)
        if (mesh->region[t] == region) {
            *volume_m3 += mesh->volume_m3[t];
            ++*tets;
        }
}

static void print_tet(const tm_mesh_file *file, int32_t t) {
    const int32_t *v = file->tet + 4 * (size_t)t;
    printf("tetrahedron %lld (vertices %lld %lld %lld %lld)", (long long)file->tet_tag[t],
           (long long)file->vertex_tag[v[0]], (long long)file->vertex_tag[v[1]], (long long)file->vertex_tag[v[2]],
           (long long)file->vertex_tag[v[3]]);
}

static void print_numbering(const options *o, const tm_numbering_stats *n) {
    if (n->should_renumber)
        printf("note: large bandwidth: the numbers of an edge's two vertices differ by %.0f on average; scenes "
               "renumber internally to %.0f, which makes steps faster; for other programs use tm-mesh renumber %s "
               "-o OUT\n",
               n->distance, n->renumbered, o->file);
}

static void print_statistics(const tm_mesh_file *file, const tm_mesh *mesh, const options *o, const figures *f) {
    printf("%s\n%d tetrahedra, %d vertices, %d edges, %d outer triangles, %d piece%s\n", o->file, mesh->tet_count,
           mesh->vertex_count, mesh->edge_count, mesh->surface_count, f->pieces, f->pieces == 1 ? "" : "s");
    printf("box: %.4g %.4g %.4g to %.4g %.4g %.4g m (%.4g x %.4g x %.4g mm), volume %.4g cm3\n", f->low_m[0],
           f->low_m[1], f->low_m[2], f->high_m[0], f->high_m[1], f->high_m[2], 1e3 * (f->high_m[0] - f->low_m[0]),
           1e3 * (f->high_m[1] - f->low_m[1]), 1e3 * (f->high_m[2] - f->low_m[2]), 1e6 * f->volume_m3);
    for (int32_t r = 0; r < file->region_count; r++) {
        double volume_m3;
        int32_t tets;
        region_sums(mesh, r, &volume_m3, &tets);
        printf("region '%s': %d tetrahedra, %.4g cm3\n", file->region_name[r], tets, 1e6 * volume_m3);
    }
    char empty[REGIONS_WITHOUT][64];
    const int32_t count = find_empty_regions(file, o->file, empty);
    for (int32_t i = 0; i < count; i++)
        printf("note: region '%s' has a name and no tetrahedra, so a scene cannot give it a material\n", empty[i]);
    for (int32_t g = 0; g < file->group_count; g++)
        printf("group '%s': %d vertices\n", file->group_name[g], file->group_begin[g + 1] - file->group_begin[g]);
    print_histogram("aspect (1: regular)", f->aspect, aspect_bound);
    print_histogram("smallest dihedral angle, degrees", f->dihedral, dihedral_bound_deg);
    printf("worst shape: ");
    print_tet(file, f->worst_aspect_tet);
    printf(", aspect %.3g; smallest dihedral angle of all %.3g degrees\n", f->worst_aspect, f->min_dihedral_deg);
    printf("critical step: %.4g ms (E %g Pa, nu %g, %g kg/m3), set by ", 1e3 * f->step_s, o->young_Pa, o->poisson,
           o->density_kg_m3);
    print_tet(file, f->step_tet);
    printf("; %.0f substeps in a frame of 1/30 s\n", ceil(1 / (30 * f->step_s)));
    printf("with cutting: %.4g ms, that of the worst element, ", 1e3 * f->cut_step_s);
    print_tet(file, f->cut_step_tet);
    printf("; median element %.4g ms, ratio %.2f; %.0f substeps\n", 1e3 * f->median_step_s,
           f->cut_step_s / f->median_step_s, ceil(1 / (30 * f->cut_step_s)));
    if (fmax(fmax(f->high_m[0] - f->low_m[0], f->high_m[1] - f->low_m[1]), f->high_m[2] - f->low_m[2]) > 2)
        printf("note: larger than 2 m; if it is in millimetres, give --unit mm\n");
    print_numbering(o, &f->numbering);
    if (f->pieces > 1) printf("note: %d connected pieces that share no face; each needs its own support\n", f->pieces);
}

static void add_three(cJSON *to, const char *name, const double v[3]) {
    cJSON_AddItemToObject(to, name, cJSON_CreateDoubleArray(v, 3));
}

static cJSON *histogram_json(const int64_t count[BINS], const double *bound) {
    cJSON *all = cJSON_CreateObject(), *counts = cJSON_AddArrayToObject(all, "count");
    cJSON_AddItemToObject(all, "bound", cJSON_CreateDoubleArray(bound, BINS - 1));
    for (int b = 0; b < BINS; b++) cJSON_AddItemToArray(counts, cJSON_CreateNumber((double)count[b]));
    return all;
}

static cJSON *statistics_json(const tm_mesh_file *file, const tm_mesh *mesh, const options *o, const figures *f) {
    cJSON *root = cJSON_CreateObject();
    cJSON_AddStringToObject(root, "file", o->file);
    cJSON_AddNumberToObject(root, "scale", o->scale);
    cJSON_AddNumberToObject(root, "tets", mesh->tet_count);
    cJSON_AddNumberToObject(root, "vertices", mesh->vertex_count);
    cJSON_AddNumberToObject(root, "edges", mesh->edge_count);
    cJSON_AddNumberToObject(root, "surface_triangles", mesh->surface_count);
    cJSON_AddNumberToObject(root, "pieces", f->pieces);
    cJSON *numbering = cJSON_AddObjectToObject(root, "numbering");
    cJSON_AddNumberToObject(numbering, "distance", f->numbering.distance);
    cJSON_AddNumberToObject(numbering, "renumbered", f->numbering.renumbered);
    cJSON_AddBoolToObject(numbering, "poor", f->numbering.should_renumber);
    add_three(root, "low_m", f->low_m);
    add_three(root, "high_m", f->high_m);
    cJSON_AddNumberToObject(root, "volume_m3", f->volume_m3);
    cJSON *regions = cJSON_AddArrayToObject(root, "regions"), *groups = cJSON_AddArrayToObject(root, "groups");
    for (int32_t r = 0; r < file->region_count; r++) {
        double volume_m3;
        int32_t tets;
        region_sums(mesh, r, &volume_m3, &tets);
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "name", file->region_name[r]);
        cJSON_AddNumberToObject(one, "tets", tets);
        cJSON_AddNumberToObject(one, "volume_m3", volume_m3);
        cJSON_AddItemToArray(regions, one);
    }
    char empty[REGIONS_WITHOUT][64];
    const int32_t count = find_empty_regions(file, o->file, empty);
    cJSON *without = cJSON_AddArrayToObject(root, "regions_without_tetrahedra");
    for (int32_t i = 0; i < count; i++) cJSON_AddItemToArray(without, cJSON_CreateString(empty[i]));
    for (int32_t g = 0; g < file->group_count; g++) {
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "name", file->group_name[g]);
        cJSON_AddNumberToObject(one, "vertices", file->group_begin[g + 1] - file->group_begin[g]);
        cJSON_AddItemToArray(groups, one);
    }
    cJSON_AddItemToObject(root, "aspect", histogram_json(f->aspect, aspect_bound));
    cJSON_AddItemToObject(root, "min_dihedral_deg", histogram_json(f->dihedral, dihedral_bound_deg));
    cJSON_AddNumberToObject(root, "worst_aspect", f->worst_aspect);
    cJSON_AddNumberToObject(root, "worst_aspect_tet", (double)file->tet_tag[f->worst_aspect_tet]);
    cJSON_AddNumberToObject(root, "smallest_dihedral_deg", f->min_dihedral_deg);
    cJSON *step = cJSON_AddObjectToObject(root, "critical_step");
    cJSON_AddNumberToObject(step, "young_Pa", o->young_Pa);
    cJSON_AddNumberToObject(step, "poisson", o->poisson);
    cJSON_AddNumberToObject(step, "density_kg_m3", o->density_kg_m3);
    cJSON_AddNumberToObject(step, "guaranteed_s", f->step_s);
    cJSON_AddNumberToObject(step, "tet", (double)file->tet_tag[f->step_tet]);
    cJSON_AddNumberToObject(step, "cut_s", f->cut_step_s);
    cJSON_AddNumberToObject(step, "cut_tet", (double)file->tet_tag[f->cut_step_tet]);
    cJSON_AddNumberToObject(step, "median_s", f->median_step_s);
    cJSON_AddNumberToObject(step, "worst_over_median", f->cut_step_s / f->median_step_s);
    return root;
}

static int run(const char *command, int argc, char **argv) {
    options o;
    tm_mesh_file file = {0};
    tm_mesh *mesh = NULL;
    tm_error error = {0};
    figures f;
    int exit = parse(command, argc, argv, &o);
    if (exit != APP_DONE) return exit;
    if (tm_mesh_file_load(o.file, o.scale, &file, &error)) return app_report(NULL, 0, &error);
    if (tm_mesh_file_build(&file, &mesh, &error)) {
        exit = error.status == TM_ERR_MESH ? refuse(&file, o.file, &error) : app_report(NULL, 0, &error);
        tm_mesh_file_free(&file);
        return exit;
    }
    measure_shape(mesh, &f);
    if (!tm_mesh_numbering_measure(mesh, &f.numbering))
        exit = command_no_memory(o.file);
    else if (measure_step(mesh, &o, &f, &error))
        exit = app_report("tm-mesh", 0, &error);
    else {
        cJSON *root = o.json ? statistics_json(&file, mesh, &o, &f) : NULL;
        if (root && app_json_write(o.json, root, &error)) exit = app_report(NULL, 0, &error);
        cJSON_Delete(root);
    }
    if (exit == APP_DONE && strcmp(command, "info") == 0)
        print_statistics(&file, mesh, &o, &f);
    else if (exit == APP_DONE && !app_is_quiet()) {
        printf("%s: no defects: %d tetrahedra, %d vertices, critical step %.4g ms\n", o.file, mesh->tet_count,
               mesh->vertex_count, 1e3 * f.step_s);
        print_numbering(&o, &f.numbering);
    }
    tm_mesh_destroy(mesh);
    tm_mesh_file_free(&file);
    return exit;
}

int command_info(int argc, char **argv) { return run("info", argc, argv); }
int command_check(int argc, char **argv) { return run("check", argc, argv); }
