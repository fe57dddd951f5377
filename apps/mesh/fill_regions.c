/* Makes several closed surfaces into regions: the mesher of the module `image` queries the region at a point. */
#include "surfaces.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

typedef struct job {
    const char *path;
    const surfaces *s;
    double size_m, edge_m[SURFACES_MAX + 1], distance_m[SURFACES_MAX + 1];
    double volume_m3[SURFACES_MAX + 1], area_m2[SURFACES_MAX + 1];
    double *seed_m;
    int seeds, expected;
} job;

/* Finds a point deep in piece i that is in its region: below the centres of its triangles, as far from every surface as
 * possible. */
static bool find_seed(const surfaces *s, int i, double place[3]) {
    const shell *one = s->piece[i].shell;
    const int n = shell_triangles(one), step = 1 + n / 60;
    const double reach = cbrt(shell_volume_m3(one));
    double best = 0;
    for (int t = 0; t < n; t += step)
        for (int k = 0; k < 8; k++) {
            double p[3], on[3], d[3];
            for (int c = 0; c < 3; c++)
                p[c] =
                    (shell_corner_m(one, t, 0)[c] + shell_corner_m(one, t, 1)[c] + shell_corner_m(one, t, 2)[c]) / 3 -
                    reach * pow(0.5, k + 1) * shell_normal(one, t)[c];
            if (surfaces_label(s, p) != s->piece[i].region) continue;
            memcpy(on, p, sizeof on);
            surfaces_project(s, on);
            vsub(on, p, d);
            if (vdot(d, d) <= best) continue;
            best = vdot(d, d);
            memcpy(place, p, sizeof on);
        }
    return best > 0;
}

/* Estimates the volume of each region: its pieces less those inside them. Tetrahedron sizes follow as for an image (a
 * tube of radius r has V/A = r/2). */
static void measure(job *j) {
    const surfaces *s = j->s;
    for (int i = 0; i < s->pieces; i++) {
        const shell *one = s->piece[i].shell;
        const int around = s->piece[i].parent >= 0 ? s->piece[s->piece[i].parent].region : 0, own = s->piece[i].region;
        double area = 0;
        for (int t = 0; t < shell_triangles(one); t++) {
            double u[3], w[3], n[3];
            vsub(shell_corner_m(one, t, 1), shell_corner_m(one, t, 0), u);
            vsub(shell_corner_m(one, t, 2), shell_corner_m(one, t, 0), w);
            vcross(u, w, n);
            area += 0.5 * sqrt(vdot(n, n));
        }
        j->volume_m3[around] -= shell_volume_m3(one), j->area_m2[around] += area;
        if (own) j->volume_m3[own] += shell_volume_m3(one), j->area_m2[own] += area;
    }
    for (int r = 1; r <= s->regions; r++) {
        const double thick_m = j->area_m2[r] > 0 ? 2 * j->volume_m3[r] / j->area_m2[r] : j->size_m;
        j->edge_m[r] = fmin(j->size_m, fmax(thick_m, j->size_m / 3));
        j->distance_m[r] = j->edge_m[r] / 12;
    }
}

static int set_domain(job *j, image_domain *domain) {
    const surfaces *s = j->s;
    *domain = (image_domain){.label = surfaces_label, .context = s, .march_m = j->size_m};
    j->seed_m = malloc(3 * (size_t)(s->pieces + 1) * sizeof *j->seed_m);
    if (!j->seed_m) return command_no_memory(j->path);
    for (int k = 0; k < 3; k++) domain->low_m[k] = INFINITY, domain->high_m[k] = -INFINITY;
    for (int i = 0; i < s->pieces; i++) {
        const growing_solid solid = shell_solid(s->piece[i].shell);
        for (int k = 0; k < 3; k++) {
            domain->low_m[k] = fmin(domain->low_m[k], solid.low[k] - 0.05 * j->size_m);
            domain->high_m[k] = fmax(domain->high_m[k], solid.high[k] + 0.05 * j->size_m);
            domain->march_m = fmin(domain->march_m, (solid.high[k] - solid.low[k]) / 20);
        }
        if (!s->piece[i].region) continue;
        if (!find_seed(s, i, j->seed_m + 3 * (size_t)j->seeds))
            return app_bad_input(j->path, 0,
                                 "region '%s': a piece of it is completely inside the other surfaces; leave it out",
                                 s->name[s->piece[i].region]);
        j->seeds++;
    }
    domain->seeds = j->seeds;
    domain->seed_m = j->seed_m;
    return APP_DONE;
}

static bool go_on(void *context, const char *doing, int vertices) {
    const job *j = context;
    char what[80];
    snprintf(what, sizeof what, "tm-mesh fill: %s", doing);
    if (!app_is_quiet()) app_progress(what, fmin(0.99, (double)vertices / j->expected), false);
    return !app_interrupted();
}

static bool between(const void *shape, int a, int b, double p[3]) {
    (void)a, (void)b;
    surfaces_project(shape, p);
    return true;
}

static int mesh(job *j, const image_api *api, image_tets *tets) {
    image_domain domain;
    char why[IMAGE_WHY] = "";
    double volume_m3 = 0;
    int exit = set_domain(j, &domain);
    if (exit) return exit;
    for (int r = 1; r <= j->s->regions; r++) volume_m3 += fmax(0, j->volume_m3[r]);
    j->expected = 50 + (int)fmin(1e9, 3 * volume_m3 / pow(j->size_m, 3));
    const image_request request = {.labels = j->s->regions,
                                   .edge_m = j->edge_m,
                                   .surface_m = j->distance_m,
                                   .facet_angle_deg = 25,
                                   .radius_edge = 2,
                                   .exude = true,
                                   .sliver_deg = 12,
                                   .go_on = go_on,
                                   .go_on_context = j};
    const image_end end = api->mesh(&domain, &request, tets, why);
    app_progress("tm-mesh fill", 1, true);
    if (end == IMAGE_STOPPED) return app_interrupted_exit();
    if (end) {
        app_bad_input(j->path, 0, "%s", why);
        return APP_FAILED;
    }
    return image_improve(tets, j->s->regions, between, j->s) ? APP_DONE : command_no_memory(j->path);
}

/* --- the file's mesh --- */

/* Adds the group "surface", and NAME_outer with each region's part of it. */
static bool add_groups(const image_tets *m, const surfaces *s, tm_mesh_file *out) {
    uint8_t *outer = calloc((size_t)m->vertices + 1, 1), *mine = malloc((size_t)m->vertices + 1);
    int *face = NULL, members = 0;
    const int faces = image_faces(m, 0, &face);
    for (int i = 0; outer && mine && i < 3 * faces; i++) outer[face[i]] = 1;
    for (int g = 0; outer && mine && faces >= 0 && g <= s->regions; g++) {
        memset(mine, g == 0, (size_t)m->vertices);
        for (int i = 0; g && i < 4 * m->tets; i++)
            if (m->label[i / 4] == g) mine[m->tet[i]] = 1;
        for (int v = 0; v < m->vertices; v++)
            if (outer[v] && mine[v]) out->group_vertex[members++] = v;
        out->group_begin[g + 1] = members;
        if (g)
            snprintf(out->group_name[g], sizeof *out->group_name, "%.57s_outer", s->name[g]);
        else
            strcpy(out->group_name[0], "surface");
    }
    const bool good = outer && mine && faces >= 0;
    free(face);
    free(outer);
    free(mine);
    return good;
}

static bool to_file(const image_tets *m, const surfaces *s, tm_mesh_file *out) {
    *out = (tm_mesh_file){
        .vertex_count = m->vertices, .tet_count = m->tets, .region_count = s->regions, .group_count = s->regions + 1};
    if (!tm_mesh_file_allocate(out, m->vertices * (s->regions + 1))) return false;
    memcpy(out->vertex_m, m->vertex_m, 3 * (size_t)m->vertices * sizeof(double));
    memcpy(out->tet, m->tet, 4 * (size_t)m->tets * sizeof *m->tet);
    for (int v = 0; v < m->vertices; v++) out->vertex_tag[v] = v + 1;
    for (int t = 0; t < m->tets; t++) out->region[t] = m->label[t] - 1, out->tet_tag[t] = t + 1;
    for (int r = 1; r <= s->regions; r++) snprintf(out->region_name[r - 1], sizeof *out->region_name, "%s", s->name[r]);
    return add_groups(m, s, out);
}

static double tet_m3(const image_tets *m, int t) {
    double e[3][3], n[3];
    const int *v = m->tet + 4 * (size_t)t;
    for (int k = 0; k < 3; k++) vsub(m->vertex_m + 3 * (size_t)v[k + 1], m->vertex_m + 3 * (size_t)v[0], e[k]);
    vcross(e[0], e[1], n);
    return vdot(n, e[2]) / 6;
}

/* Reports the regions; rejects a mesh in which one vanished. */
static int report(const job *j, const image_tets *m) {
    int count[SURFACES_MAX + 1] = {0};
    double volume[SURFACES_MAX + 1] = {0};
    for (int t = 0; t < m->tets; t++) count[m->label[t]]++, volume[m->label[t]] += tet_m3(m, t);
    for (int r = 1; r <= j->s->regions; r++) {
        if (!count[r])
            return app_bad_input(j->path, 0, "region '%s' has no tetrahedra; choose a smaller --size, or leave it out",
                                 j->s->name[r]);
        if (!app_is_quiet())
            printf("region %-20s %8d tetrahedra, edges about %.3g mm; volume %.4g cm3\n", j->s->name[r], count[r],
                   1e3 * j->edge_m[r], 1e6 * volume[r]);
    }
    return APP_DONE;
}

int fill_regions(const char *path, const surfaces *s, double size_m, tm_mesh_file *out) {
    tm_error error = {0};
    image_tets tets = {0};
    job j = {.path = path, .s = s, .size_m = size_m};
    const image_api *api = image_open_module(&error);
    if (!api) return app_report(NULL, 0, &error);
    app_catch_signals();
    measure(&j);
    int exit = mesh(&j, api, &tets);
    if (!exit) exit = report(&j, &tets);
    if (!exit && !to_file(&tets, s, out)) exit = command_no_memory(path);
    free(tets.vertex_m);
    free(tets.tet);
    free(tets.label);
    free(j.seed_m);
    return exit;
}
