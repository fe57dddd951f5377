/* tm-mesh refine: makes tetrahedra smaller where a scene cuts. */
#include <getopt.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "command.h"
#include "mesh_builder.h"

enum { LIMIT = 20 * 1000 * 1000 };

typedef struct options {
    const char *in, *out, *region, *fibres, *out_fibres;
    double scale, box_m[6], size_m;
    bool boxed;
} options;

static void usage(void) {
    printf("usage: tm-mesh refine --box X0,Y0,Z0,X1,Y1,Z1 | --region NAME --size SIZE [--unit UNIT] [--fibres "
           "IN.csv --write-fibres OUT.csv] IN -o OUT\n"
           "Bisects longest edges until no tetrahedron in the box or region has an edge longer than SIZE, then "
           "moves inner vertices so that\n"
           "the smallest tetrahedron, which sets the time step, grows. Old vertices keep their numbers; "
           "vertices on the surface, between\n"
           "regions and in groups keep their positions; a new vertex joins the groups that both ends of its "
           "edge share.\n"
           "\n"
           "  --box ...           two corners, e.g. -20mm,-60mm,0,20mm,-30mm,40mm\n"
           "  --region NAME       region of the file (physical volume)\n"
           "  --size SIZE         longest edge there, e.g. 3mm\n"
           "  --fibres IN.csv     read fibres of IN; --write-fibres OUT.csv writes those of OUT (each part has "
           "its parent's)\n"
           "  --unit UNIT         unit of the file's coordinates: m, cm, mm, um or inch [m]\n"
           "  --scale S           the same as metres per unit of the file: 1e-3 for millimetres\n"
           "  -o OUT              .msh, .vtk or .mesh\n");
}

static bool parse_box(const char *text, double box_m[6]) {
    char part[200], *save = NULL;
    int n = 0;
    if ((size_t)snprintf(part, sizeof part, "%s", text) >= sizeof part) part[0] = 0;
    for (char *word = strtok_r(part, ",", &save); word; word = strtok_r(NULL, ",", &save), n++)
        if (n >= 6 || !command_quantity("box", word, "length", &box_m[n])) return false;
    bool good = n == 6;
    for (int k = 0; good && k < 3; k++) good = box_m[k] < box_m[k + 3];
    if (!good) app_bad_input(NULL, 0, "tm-mesh refine: --box %s: six lengths, the lower corner first", text);
    return good;
}

static int parse(int argc, char **argv, options *o) {
    static const struct option names[] = {{"box", required_argument, NULL, 'b'},
                                          {"region", required_argument, NULL, 'r'},
                                          {"size", required_argument, NULL, 'z'},
                                          {"scale", required_argument, NULL, 's'},
                                          {"unit", required_argument, NULL, 'u'},
                                          {"fibres", required_argument, NULL, 'f'},
                                          {"write-fibres", required_argument, NULL, 'w'},
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
        case 'b': good = o->boxed = parse_box(optarg, o->box_m); break;
        case 'r': o->region = optarg; break;
        case 'z': good = command_quantity("size", optarg, "length", &o->size_m); break;
        case 's':
        case 'u': good = command_scale("refine", c, optarg, &sized, &o->scale); break;
        case 'f': o->fibres = optarg; break;
        case 'w': o->out_fibres = optarg; break;
        case 'o': o->out = optarg; break;
        case 'h': usage(); exit(APP_DONE);
        default: return command_usage("refine", "unknown option, or its value is missing: '%s'", argv[optind - 1]);
        }
        if (!good) return APP_BAD_INPUT;
    }
    if (optind + 1 != argc) return command_usage("refine", "name one mesh file");
    if (!o->out) return command_usage("refine", "no output; give -o OUT");
    if (o->boxed == (o->region != NULL)) return command_usage("refine", "give either --box or --region");
    if (!(o->size_m > 0)) return command_usage("refine", "--size must be above 0");
    if (!o->fibres != !o->out_fibres) return command_usage("refine", "--fibres and --write-fibres go together");
    o->in = argv[optind];
    return command_output(o->out);
}

/* Returns whether a tetrahedron's bounds overlap the box. One larger than the box may have no vertex in it. */
static bool reaches(const double *vertex, const int *tet, const double low_m[3], const double high_m[3]) {
    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < 4; i++) {
            double x = vertex[3 * (size_t)tet[i] + (size_t)k];
            low = fmin(low, x);
            high = fmax(high, x);
        }
        if (high < low_m[k] || low > high_m[k]) return false;
    }
    return true;
}

typedef struct target {
    double low_m[3], high_m[3], size_m;
    int region; /* -1: the box */
} target;

static bool too_large(const growing *m, int tet, double longest_m, const void *context) {
    const target *where = context;
    if (longest_m <= where->size_m) return false;
    if (where->region >= 0) return m->region[tet] == where->region;
    return reaches(m->vertex, m->tet + 4 * (size_t)tet, where->low_m, where->high_m);
}

/* Rejects a box that contains nothing, for example one in another unit than the mesh's. */
static int check_box(const options *o, const tm_mesh_file *file) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int t = 0; o->boxed && t < file->tet_count; t++)
        if (reaches(file->vertex_m, file->tet + 4 * (size_t)t, o->box_m, o->box_m + 3)) return APP_DONE;
    if (!o->boxed) return APP_DONE;
    for (int i = 0; i < 3 * file->vertex_count; i++) {
        low[i % 3] = fmin(low[i % 3], file->vertex_m[i]);
        high[i % 3] = fmax(high[i % 3], file->vertex_m[i]);
    }
    return app_bad_input(
        "--box", 0,
        "no tetrahedron is inside it, and the mesh is within %.4g,%.4g,%.4g,%.4g,%.4g,%.4g m; write units "
        "(-20mm,...), or give the mesh's --scale",
        low[0], low[1], low[2], high[0], high[1], high[2]);
}

static bool is_region_name(const tm_mesh_file *file, const char *name, int32_t *region) {
    for (*region = 0; *region < file->region_count; ++*region)
        if (strcmp(file->region_name[*region], name) == 0) return true;
    return false;
}

/* Marks the group's vertices. A new vertex is in the group if both ends of its edge are and, for a group on the
 * surface, if it is on the surface too. */
static void mark_group(const tm_mesh_file *file, const growing *m, int32_t group, const unsigned char *outer,
                       const int *midpoint, unsigned char *mark) {
    int32_t region;
    memset(mark, 0, (size_t)m->vertex_count);
    if (is_region_name(file, file->group_name[group], &region)) {
        for (int i = 0; i < 4 * m->tet_count; i++)
            if (m->region[i / 4] == region) mark[m->tet[i]] = 1;
    }
    bool skin = true;
    for (int32_t i = file->group_begin[group]; i < file->group_begin[group + 1]; i++) {
        mark[file->group_vertex[i]] = 1;
        skin = skin && outer[file->group_vertex[i]];
    }
    for (int v = file->vertex_count; v < m->vertex_count; v++) { /* ends of an edge come before its midpoint */
        const int *ends = midpoint + 2 * (v - file->vertex_count);
        if (mark[ends[0]] && mark[ends[1]] && (outer[v] || !skin)) mark[v] = 1;
    }
}

/* Limits surface vertices so that the shape stays: they slide in the plane of their triangles or along the ridge of two
 * planes. */
static void hold_surface(const growing *m, const unsigned char *outer, growing_hold *h) {
    memset(h->freedom, FREE, (size_t)m->vertex_count);
    for (int v = 0; v < m->vertex_count; v++)
        if (outer[v]) h->freedom[v] = FREE + 1; /* no triangle seen yet */
    for (int i = 0; i < 3 * m->face_count; i++) {
        int v = m->face[i];
        double n[3], *d = h->direction + 3 * (size_t)v, cross[3];
        growing_face_normal(m, m->face + i / 3 * 3, n);
        for (int k = 0; k < 3; k++) cross[k] = n[(k + 1) % 3] * d[(k + 2) % 3] - n[(k + 2) % 3] * d[(k + 1) % 3];
        double sine = sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]),
               along = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
        if (h->freedom[v] > FREE) {
            h->freedom[v] = ACROSS;
            memcpy(d, n, sizeof n);
        } else if (h->freedom[v] == ACROSS && !(sine < 1e-6 && along > 0)) {
            h->freedom[v] = sine < 1e-6 ? FIXED : ALONG;
            for (int k = 0; k < 3 && sine >= 1e-6; k++) d[k] = cross[k] / sine;
        } else if (h->freedom[v] == ALONG && fabs(along) > 1e-6)
            h->freedom[v] = FIXED;
    }
}

/* Fixes old vertices of the surface, between regions and of inner groups. */
static bool hold_vertices(const tm_mesh_file *file, const growing *m, const unsigned char *outer, const int *midpoint,
                          growing_hold *h) {
    unsigned char *mark = malloc((size_t)m->vertex_count + 1);
    int *region = malloc(((size_t)m->vertex_count + 1) * sizeof *region);
    h->freedom = malloc((size_t)m->vertex_count + 1);
    h->direction = calloc(3 * (size_t)m->vertex_count + 1, sizeof *h->direction);
    bool good = mark && region && h->freedom && h->direction;
    if (good) {
        hold_surface(m, outer, h);
        for (int v = 0; v < file->vertex_count; v++)
            if (outer[v]) h->freedom[v] = FIXED;
        for (int v = 0; v < m->vertex_count; v++) region[v] = -1;
        for (int i = 0; i < 4 * m->tet_count; i++) {
            int *r = &region[m->tet[i]];
            if (*r >= 0 && *r != m->region[i / 4]) h->freedom[m->tet[i]] = FIXED;
            *r = m->region[i / 4];
        }
        for (int32_t g = 0; g < file->group_count; g++) {
            int32_t of;
            if (is_region_name(file, file->group_name[g], &of)) continue;
            mark_group(file, m, g, outer, midpoint, mark);
            for (int v = 0; v < m->vertex_count; v++)
                if (mark[v] && !outer[v]) h->freedom[v] = FIXED;
        }
    }
    free(mark);
    free(region);
    return good;
}

static void copy_in(const tm_mesh_file *file, growing *m) {
    for (int32_t v = 0; v < file->vertex_count; v++) growing_add_vertex(m, file->vertex_m + 3 * (size_t)v);
    for (int32_t t = 0; t < file->tet_count; t++) {
        const int32_t *v = file->tet + 4 * (size_t)t;
        growing_add_tet(m, v[0], v[1], v[2], v[3]);
        if (!m->no_memory) m->region[t] = file->region[t];
    }
}

/* Makes the tm_mesh_file of the refined mesh: old numbers stay, new ones follow. */
static bool copy_out(const tm_mesh_file *file, const growing *m, const unsigned char *outer, const int *midpoint,
                     tm_mesh_file *out) {
    unsigned char *mark = malloc((size_t)m->vertex_count + 1);
    *out = *file;
    out->vertex_count = m->vertex_count;
    out->tet_count = m->tet_count;
    if (!mark || file->group_count > INT32_MAX / (m->vertex_count + 1) ||
        !tm_mesh_file_allocate(out, file->group_count * m->vertex_count)) {
        free(mark);
        *out = (tm_mesh_file){0};
        return false;
    }
    memcpy(out->vertex_m, m->vertex, 3 * (size_t)m->vertex_count * sizeof(double));
    int64_t tag = 0;
    for (int32_t v = 0; v < m->vertex_count; v++) {
        out->vertex_tag[v] = v < file->vertex_count ? file->vertex_tag[v] : tag + 1;
        if (out->vertex_tag[v] > tag) tag = out->vertex_tag[v];
    }
    tag = 0;
    for (int32_t t = 0; t < m->tet_count; t++) {
        memcpy(out->tet + 4 * (size_t)t, m->tet + 4 * (size_t)t, 4 * sizeof(int32_t));
        out->region[t] = m->region[t];
        out->tet_tag[t] = t < file->tet_count ? file->tet_tag[t] : tag + 1;
        if (out->tet_tag[t] > tag) tag = out->tet_tag[t];
    }
    memcpy(out->region_name, file->region_name, (size_t)file->region_count * sizeof *out->region_name);
    memcpy(out->group_name, file->group_name, (size_t)file->group_count * sizeof *out->group_name);
    for (int32_t g = 0, n = 0; g < file->group_count; g++) {
        mark_group(file, m, g, outer, midpoint, mark);
        for (int32_t v = 0; v < m->vertex_count; v++)
            if (mark[v]) out->group_vertex[n++] = v;
        out->group_begin[g + 1] = n;
    }
    free(mark);
    return true;
}

static double smallest_size(const growing *m) {
    double smallest = INFINITY;
    for (int t = 0; t < m->tet_count; t++) {
        const int *v = m->tet + 4 * (size_t)t;
        smallest = fmin(smallest, growing_tet_size(m->vertex + 3 * (size_t)v[0], m->vertex + 3 * (size_t)v[1],
                                                   m->vertex + 3 * (size_t)v[2], m->vertex + 3 * (size_t)v[3]));
    }
    return smallest;
}

/* Copies to each tetrahedron the fibre of its original. */
static int carry_fibres(const options *o, const tm_mesh_file *file, const growing *m, const int *parent) {
    tm_error error = {0};
    int exit = APP_DONE;
    double *old = malloc(3 * (size_t)file->tet_count * sizeof *old),
           *new = malloc(3 * (size_t)m->tet_count * sizeof *new);
    if (!old || !new)
        exit = APP_FAILED;
    else if (tm_fibres_load(o->fibres, file->tet_count, old, &error))
        exit = app_report(NULL, 0, &error);
    else {
        for (int t = 0; t < m->tet_count; t++)
            memcpy(new + 3 * (size_t)t, old + 3 * (size_t)parent[t], 3 * sizeof *new);
        if (write_fibres(new, m->tet_count, o->out_fibres, &error)) exit = app_report(NULL, 0, &error);
    }
    free(old);
    free(new);
    return exit;
}

static int write_all(const options *o, const tm_mesh_file *file, const growing *m, const unsigned char *outer,
                     const int *parent, const int *midpoint, double before_m) {
    tm_mesh_file out = {0};
    tm_error error = {0};
    tm_mesh *built = NULL;
    int exit = APP_DONE;
    if (!copy_out(file, m, outer, midpoint, &out))
        app_bad_input(o->in, 0, "no memory; choose a larger --size"), exit = APP_FAILED;
    else if (tm_mesh_file_build(&out, &built, &error))
        exit = app_report(o->in, 0, &error);
    else if (o->fibres)
        exit = carry_fibres(o, file, m, parent);
    if (exit == APP_DONE && app_mesh_write(&out, o->out, &error)) exit = app_report(NULL, 0, &error);
    if (exit == APP_DONE && !app_is_quiet())
        printf("%s: %d tetrahedra (before: %d), %d vertices (before: %d); smallest tetrahedron and critical step "
               "are about %.2f of those before\n",
               o->out, m->tet_count, file->tet_count, m->vertex_count, file->vertex_count, smallest_size(m) / before_m);
    if (exit == APP_DONE && m->tet_count == file->tet_count)
        printf("note: no edge there is longer than %g mm, so nothing was refined; choose a smaller --size\n",
               1e3 * o->size_m);
    tm_mesh_destroy(built);
    tm_mesh_file_free(&out);
    return exit;
}

static int refine(const options *o, const tm_mesh_file *file, int32_t region) {
    growing m = {0};
    int *parent = NULL, *midpoint = NULL, exit = APP_FAILED;
    unsigned char *outer = NULL;
    target where = {.size_m = o->size_m, .region = o->region ? region : -1};
    growing_hold h = {.wanted = too_large, .context = &where};
    memcpy(where.low_m, o->box_m, sizeof where.low_m);
    memcpy(where.high_m, o->box_m + 3, sizeof where.high_m);
    copy_in(file, &m);
    double before_m = m.no_memory ? 0 : smallest_size(&m);
    bool finer = !m.no_memory && growing_bisect(&m, too_large, &where, LIMIT, &parent, &midpoint);
    if (!finer && !m.no_memory) {
        exit = app_bad_input(o->in, 0, "it would have more than %d tetrahedra; choose a larger --size", LIMIT);
    } else if (finer) {
        growing_find_surface(&m);
        outer = calloc((size_t)m.vertex_count + 1, 1);
        for (int i = 0; outer && i < 3 * m.face_count; i++) outer[m.face[i]] = 1;
        if (outer && hold_vertices(file, &m, outer, midpoint, &h)) {
            growing_improve(&m, NULL, &h, 30);
            if (!m.no_memory) exit = write_all(o, file, &m, outer, parent, midpoint, before_m);
        } else
            m.no_memory = true;
    }
    if (m.no_memory) exit = command_no_memory(o->in);
    free(outer);
    free(h.freedom);
    free(h.direction);
    free(parent);
    free(midpoint);
    growing_free(&m);
    return exit;
}

int command_refine(int argc, char **argv) {
    options o;
    tm_mesh_file file;
    tm_mesh *built = NULL;
    tm_error error = {0};
    int32_t region = -1;
    int exit = parse(argc, argv, &o);
    if (exit) return exit;
    if (tm_mesh_file_load(o.in, o.scale, &file, &error)) return app_report(NULL, 0, &error);
    if (tm_mesh_file_build(&file, &built, &error))
        exit = app_report(o.in, 0, &error);
    else if (o.region && !is_region_name(&file, o.region, &region))
        exit = app_bad_input(o.in, 0, "no region '%s'; tm-mesh info lists its regions", o.region);
    else
        exit = check_box(&o, &file);
    tm_mesh_destroy(built);
    if (exit == APP_DONE) exit = refine(&o, &file, region);
    tm_mesh_file_free(&file);
    return exit;
}
