/* Gives each label the volume of its voxels.
 *
 * Chords cut off convex parts, so surfaces between labels move, by about the same length everywhere between two labels.
 * Among all displacements d that supply the missing volumes, it takes the minimum of the sum over vertices of area
 * |d|^2: d = sum_l mu_l g_l / area, with g_l the gradient of label l's volume. Vertices move less where that would
 * spoil a tetrahedron; others compensate in the next round. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "mesh_builder.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

enum { ROUNDS = 200, PATIENCE = 10, TRIES = 3, MEET_MAX = 12, RELAX_EVERY = 4 };
static const double NEAR = 2e-5, AT_ONCE = 0.1, FREE_MIN = 1e-3; /* NEAR, AT_ONCE: share of volume; FREE_MIN: of a
                                                                  * vertex's freedom */

typedef struct fitting {
    const label_field *field;
    image_tets *m;
    growing mesh;
    growing_fans fans;
    growing_hold inner;       /* vertices within labels, which give way */
    double *free;             /* [vertices] share of the displacement that a vertex takes, 0 to 1 */
    double *matrix;           /* [labels*labels] */
    double mu[LABEL_MAX + 1]; /* first the missing volume, then m per unit of gradient over area */
    double wanted_m3[LABEL_MAX + 1], volume_m3[LABEL_MAX + 1];
    bool given_up[LABEL_MAX + 1]; /* the tetrahedra prevent the label's volume; it stays as it is */
    double size_m, cosine;        /* bounds: tetrahedron size, cosine of the sharpest dihedral angle */
} fitting;

/* --- bounds --- */

static const double *corner(const fitting *f, int t, int k) {
    return f->m->vertex_m + 3 * (size_t)f->m->tet[4 * (size_t)t + k];
}

/* Computes twice the area times the outward normal of the face opposite a tetrahedron's corner. */
static void side_normal(const fitting *f, int t, int opposite, double n[3]) {
    const int8_t *side = tm_face_vertex[opposite];
    double u[3], w[3];
    vsub(corner(f, t, side[1]), corner(f, t, side[0]), u);
    vsub(corner(f, t, side[2]), corner(f, t, side[0]), w);
    vcross(u, w, n);
}

static double sharpest_cosine(const fitting *f, int t) {
    double n[4][3], most = -1;
    for (int k = 0; k < 4; k++) {
        side_normal(f, t, k, n[k]);
        const double length = sqrt(vdot(n[k], n[k]));
        for (int i = 0; i < 3; i++) n[k][i] /= length;
        for (int j = 0; j < k; j++) most = fmax(most, -vdot(n[j], n[k]));
    }
    return most;
}

static double size_m(const fitting *f, int t) {
    return growing_tet_size(corner(f, t, 0), corner(f, t, 1), corner(f, t, 2), corner(f, t, 3));
}

static bool is_worse(const fitting *f, int t) { return size_m(f, t) < f->size_m || sharpest_cosine(f, t) > f->cosine; }

static bool worse_than_worst(const growing *g, int t, double longest_m, const void *context) {
    (void)g, (void)longest_m;
    return is_worse(context, t);
}

/* --- gradients --- */

typedef struct gradients {
    int count, label[MEET_MAX];
    double g[MEET_MAX][3], area_m2; /* area 0: inside a label */
} gradients;

/* Computes the gradients of the volumes of the labels around a vertex; outside has none. */
static void find_gradients(const fitting *f, int v, gradients *out) {
    double outside[3] = {0}, sum = 0;
    out->count = 0;
    for (int i = f->fans.begin[v]; i < f->fans.begin[v + 1]; i++) {
        const int t = f->fans.tet[i];
        int at = 0, own = 0;
        double n[3];
        while (at < out->count && out->label[at] != f->m->label[t]) at++;
        if (at == MEET_MAX) continue;
        if (at == out->count) {
            out->label[out->count++] = f->m->label[t];
            memset(out->g[at], 0, sizeof out->g[at]);
        }
        while (f->m->tet[4 * (size_t)t + own] != v) own++;
        side_normal(f, t, own, n);
        for (int k = 0; k < 3; k++) out->g[at][k] -= n[k] / 6, outside[k] += n[k] / 6;
    }
    for (int a = 0; a < out->count; a++) sum += sqrt(vdot(out->g[a], out->g[a]));
    out->area_m2 = 0.5 * (sum + sqrt(vdot(outside, outside)));
}

/* Returns whether a vertex is inside one label: the sum of its faces is rounding error. */
static bool is_within(const fitting *f, const gradients *g) { return g->area_m2 < 1e-9 * f->size_m * f->size_m; }

/* --- a round --- */

static void find_volumes(fitting *f) {
    memset(f->volume_m3, 0, sizeof f->volume_m3);
    for (int t = 0; t < f->m->tets; t++) {
        double n[3], e[3];
        side_normal(f, t, 0, n);
        vsub(corner(f, t, tm_face_vertex[0][0]), corner(f, t, 0), e);
        f->volume_m3[f->m->label[t]] += vdot(n, e) / 6;
    }
}

/* Fills `mu` with the missing volumes, m3, limited to those of one round. Returns the largest relative to its label. */
static double find_lacks(fitting *f, int *worst) {
    double most = 0;
    find_volumes(f);
    for (int l = 1; l <= f->field->labels; l++) {
        const double has = f->volume_m3[l], lack = has > 0 ? f->wanted_m3[l] - has : 0;
        f->mu[l] = fmax(-AT_ONCE * has, fmin(AT_ONCE * has, lack));
        if (f->given_up[l] || fabs(lack) <= most * f->wanted_m3[l]) continue;
        most = fabs(lack) / f->wanted_m3[l];
        *worst = l;
    }
    return most;
}

/* Solves with the symmetric matrix of gradients by Cholesky, in place. A label that cannot move has a zero row and
 * stays. */
static void solve(fitting *f) {
    const int n = f->field->labels;
    double *a = f->matrix, *x = f->mu + 1;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = a[i * n + j];
            for (int k = 0; k < j; k++) sum -= a[i * n + k] * a[j * n + k];
            if (j < i)
                a[i * n + j] = a[j * n + j] > 0 ? sum / a[j * n + j] : 0;
            else
                a[i * n + i] = sum > 1e-12 * a[i * n + i] ? sqrt(sum) : 0;
        }
    }
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++) x[i] -= a[i * n + k] * x[k];
        x[i] = a[i * n + i] > 0 ? x[i] / a[i * n + i] : 0;
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++) x[i] -= a[k * n + i] * x[k];
        x[i] = a[i * n + i] > 0 ? x[i] / a[i * n + i] : 0;
    }
}

/* Computes `mu` from the missing volumes. */
static void find_mu(fitting *f) {
    const int n = f->field->labels;
    memset(f->matrix, 0, (size_t)n * (size_t)n * sizeof *f->matrix);
    for (int v = 0; v < f->m->vertices; v++) {
        gradients g;
        find_gradients(f, v, &g);
        if (is_within(f, &g)) continue;
        for (int a = 0; a < g.count; a++)
            for (int b = 0; b < g.count; b++)
                f->matrix[(g.label[a] - 1) * n + g.label[b] - 1] += f->free[v] * vdot(g.g[a], g.g[b]) / g.area_m2;
    }
    solve(f);
}

/* Applies as much of a displacement as spoils no tetrahedron: all, a half, a quarter, or none. */
static double move(fitting *f, int v, const double d[3]) {
    double *p = f->m->vertex_m + 3 * (size_t)v, part = 1;
    const double keep[3] = {p[0], p[1], p[2]};
    for (int attempt = 0; attempt < TRIES; attempt++, part /= 2) {
        bool good = true;
        for (int k = 0; k < 3; k++) p[k] = keep[k] + part * d[k];
        for (int i = f->fans.begin[v]; i < f->fans.begin[v + 1] && good; i++) good = !is_worse(f, f->fans.tet[i]);
        if (good) return part;
    }
    memcpy(p, keep, sizeof keep);
    return 0;
}

static void move_all(fitting *f) {
    for (int v = 0; v < f->m->vertices; v++) {
        gradients g;
        double d[3] = {0};
        find_gradients(f, v, &g);
        if (is_within(f, &g)) continue;
        for (int a = 0; a < g.count; a++)
            for (int k = 0; k < 3; k++) d[k] += f->free[v] * f->mu[g.label[a]] * g.g[a][k] / g.area_m2;
        const double part = move(f, v, d);
        f->free[v] = part < 1 ? fmax(FREE_MIN, f->free[v] * fmax(part, 0.25)) : fmin(1, 1.5 * f->free[v]);
    }
}

/* Gives up a label whose tetrahedra prevent its volume, so that its neighbours can reach theirs. */
static double give_up(fitting *f, int label) {
    f->given_up[label] = true;
    f->wanted_m3[label] = f->volume_m3[label];
    f->mu[label] = 0;
    return HUGE_VAL;
}

/* --- complete fit --- */

static bool make_fitting(fitting *f) {
    const double *s = f->field->spacing_m;
    for (int l = 1; l <= f->field->labels; l++) f->wanted_m3[l] = (double)f->field->voxels[l] * s[0] * s[1] * s[2];
    const int n = f->field->labels;
    const size_t vertices = (size_t)f->m->vertices;
    f->mesh =
        (growing){.vertex_count = f->m->vertices, .tet_count = f->m->tets, .vertex = f->m->vertex_m, .tet = f->m->tet};
    f->free = malloc((vertices + 1) * sizeof *f->free);
    f->matrix = malloc((size_t)n * (size_t)n * sizeof *f->matrix);
    f->inner = (growing_hold){.freedom = malloc(vertices + 1),
                              .direction = calloc(3 * vertices + 1, sizeof(double)),
                              .wanted = worse_than_worst,
                              .context = f};
    if (!growing_fans_make(&f->mesh, &f->fans) || !f->free || !f->matrix || !f->inner.freedom || !f->inner.direction)
        return false;
    f->size_m = HUGE_VAL;
    f->cosine = -1;
    for (int t = 0; t < f->m->tets; t++) {
        f->size_m = fmin(f->size_m, size_m(f, t));
        f->cosine = fmax(f->cosine, sharpest_cosine(f, t));
    }
    for (int v = 0; v < f->m->vertices; v++) {
        gradients g;
        find_gradients(f, v, &g);
        f->free[v] = 1;
        f->inner.freedom[v] = is_within(f, &g) ? FREE : FIXED;
    }
    return true;
}

bool image_fit_volumes(const label_field *field, image_tets *m) {
    fitting f = {.field = field, .m = m};
    bool good = make_fitting(&f);
    double before = HUGE_VAL;
    for (int round = 0; round < ROUNDS && good; round++) {
        int worst = 0;
        const double lack = find_lacks(&f, &worst);
        if (lack < NEAR) break;
        if (round % PATIENCE == 0) before = lack > 0.5 * before ? give_up(&f, worst) : lack;
        find_mu(&f);
        move_all(&f);
        if (round % RELAX_EVERY == RELAX_EVERY - 1) growing_improve(&f.mesh, NULL, &f.inner, 2);
        good = !f.mesh.no_memory;
    }
    growing_fans_free(&f.fans);
    free(f.free);
    free(f.matrix);
    free(f.inner.freedom);
    free(f.inner.direction);
    return good;
}
