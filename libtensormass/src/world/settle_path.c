/* Rigid motions of supports: fitted by unit quaternions (Horn, J. Opt. Soc. Am. A 4 (1987) 629), followed as screws. */
#include "world/settle_newton.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "libtensormass/numeric/elementary.h"
#include "libtensormass/numeric/union_find.h"

static const double STRAIGHT = 0.05;     /* rad: smaller rotations are treated as straight */
static const double WORTH_TURNING = 0.9; /* largest share of the travel left after rotating the component as a body */
enum { CANDIDATES = 64 };                /* maximum of groups of a component whose motion is tried for all of it */

/* Sums of Horn's fit over a set of vertices. */
typedef struct fit {
    int32_t count;
    double from[3], to[3]; /* centres */
    double S[9];           /* sum of (x - from) (y - to)^T */
} fit;

/* Eigenvalues of a symmetric 4x4 matrix on its diagonal; eigenvectors are columns of V. */
static void diagonalise4(double N[16], double V[16]) {
    for (int i = 0; i < 16; i++) V[i] = i % 5 == 0;
    for (int sweep = 0; sweep < 30; sweep++)
        for (int p = 0; p < 3; p++)
            for (int q = p + 1; q < 4; q++) {
                double c, s;
                tm_jacobi(N, 4, p, q, &c, &s);
                for (int k = 0; k < 4; k++) {
                    const double a = V[4 * k + p], b = V[4 * k + q];
                    V[4 * k + p] = c * a - s * b, V[4 * k + q] = s * a + c * b;
                }
            }
}

/* Computes the best rotation as a quaternion; of equally good ones (points on a line) the smallest. Half a turn has two
 * senses: takes the one about the axis whose largest component is positive. */
static void best_turn(const double S[9], double q[4]) {
    double N[16] = {S[0] + S[4] + S[8], S[5] - S[7],        S[6] - S[2],         S[1] - S[3],
                    S[5] - S[7],        S[0] - S[4] - S[8], S[1] + S[3],         S[6] + S[2],
                    S[6] - S[2],        S[1] + S[3],        -S[0] + S[4] - S[8], S[5] + S[7],
                    S[1] - S[3],        S[6] + S[2],        S[5] + S[7],         -S[0] - S[4] + S[8]};
    double V[16], size = 0, norm = 0;
    for (int i = 0; i < 16; i++) size = fmax(size, fabs(N[i]));
    diagonalise4(N, V);
    int best = 0;
    for (int k = 1; k < 4; k++)
        if (N[5 * k] > N[5 * best]) best = k;
    for (int i = 0; i < 4; i++) q[i] = 0;
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 4 && N[5 * k] >= N[5 * best] - 1e-9 * size; i++) q[i] += V[k] * V[4 * i + k];
    for (int i = 0; i < 4; i++) norm += q[i] * q[i];
    for (int i = 0; i < 4 && norm < 1e-12; i++) q[i] = V[4 * i + best];
    norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    int lead = 1;
    for (int i = 2; i < 4; i++)
        if (fabs(q[i]) > fabs(q[lead]) + 1e-6) lead = i;
    const double sign = fabs(q[0]) > 1e-6 * norm ? q[0] : q[lead];
    for (int i = 0; i < 4; i++) q[i] /= sign < 0 ? -norm : norm;
}

static tm_screw screw_of(const fit *f) {
    tm_screw w = {0};
    double q[4], out[3];
    vsub(f->to, f->from, w.shift_m);
    best_turn(f->S, q);
    const double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    w.angle = 2 * tm_arctangent2(sine, q[0]);
    if (!(w.angle > STRAIGHT)) {
        w.angle = 0;
        return w;
    }
    for (int i = 0; i < 3; i++) w.axis[i] = q[i + 1] / sine;
    w.slide_m = vdot(w.axis, w.shift_m);
    vcross(w.axis, w.shift_m, out);
    for (int i = 0; i < 3; i++)
        w.centre_m[i] = f->from[i] + 0.5 * (w.shift_m[i] - w.slide_m * w.axis[i]) + 0.5 * q[0] / sine * out[i];
    return w;
}

/* Moves x by the share s of the motion. */
static void move(const tm_screw *w, double s, double x[3]) {
    if (w->angle == 0) {
        for (int i = 0; i < 3; i++) x[i] += s * w->shift_m[i];
        return;
    }
    double c, sine, d[3], out[3];
    tm_sine_cosine(s * w->angle, &sine, &c);
    vsub(x, w->centre_m, d);
    vcross(w->axis, d, out);
    const double along = vdot(w->axis, d);
    for (int i = 0; i < 3; i++)
        x[i] = w->centre_m[i] + c * d[i] + sine * out[i] + ((1 - c) * along + s * w->slide_m) * w->axis[i];
}

/* --- groups of supports and connected components --- */

typedef struct plan {
    tm_settle_path *path;
    int32_t *component_of; /* [vertex_count] -1: not fixed along two axes */
    int32_t component_count;
    fit *fit;        /* [groups and components] */
    tm_screw *screw; /* [components] */
    double *u_m;
} plan;

static void places(const plan *p, int32_t v, double from[3], double to[3]) {
    for (int i = 0; i < 3; i++) {
        from[i] = p->path->mesh->rest_m[3 * v + i] + p->u_m[3 * v + i];
        to[i] = p->path->fixed[3 * v + i] ? p->path->mesh->rest_m[3 * v + i] + p->path->target_m[3 * v + i] : from[i];
    }
}

static void fit_all(const plan *p, const int32_t *set_of, int32_t count, tm_screw *screw) {
    const int32_t vertices = p->path->mesh->vertex_count;
    double x[3], y[3];
    memset(p->fit, 0, sizeof *p->fit * (size_t)count);
    for (int32_t v = 0; v < vertices; v++) {
        if (set_of[v] < 0) continue;
        fit *f = p->fit + set_of[v];
        places(p, v, x, y);
        f->count++;
        for (int i = 0; i < 3; i++) f->from[i] += x[i], f->to[i] += y[i];
    }
    for (int32_t k = 0; k < count; k++)
        for (int i = 0; i < 3; i++) p->fit[k].from[i] /= p->fit[k].count, p->fit[k].to[i] /= p->fit[k].count;
    for (int32_t v = 0; v < vertices; v++) {
        if (set_of[v] < 0) continue;
        fit *f = p->fit + set_of[v];
        places(p, v, x, y);
        for (int i = 0; i < 9; i++) f->S[i] += (x[i / 3] - f->from[i / 3]) * (y[i % 3] - f->to[i % 3]);
    }
    for (int32_t k = 0; k < count; k++) screw[k] = screw_of(p->fit + k);
}

/* Numbers the sets with vertices in `in`. Returns how many. */
static int32_t number(int32_t *parent, const uint8_t *in, int32_t vertices, int32_t *set_of) {
    int32_t count = 0;
    for (int32_t v = 0; v < vertices; v++) set_of[v] = -1;
    for (int32_t v = 0; v < vertices; v++) {
        const int32_t root = law_root(parent, v); /* the lowest of its set, which may not be in */
        if (!in[v]) continue;
        if (set_of[root] < 0) set_of[root] = count++;
        set_of[v] = set_of[root];
    }
    for (int32_t v = 0; v < vertices; v++)
        if (!in[v]) set_of[v] = -1;
    return count;
}

/* Joins corners of active tetrahedra: all, or those in `in`. */
static void join(const tm_tissue *tissue, const uint8_t *in, int32_t *parent) {
    for (int32_t v = 0; v < tissue->mesh->vertex_count; v++) parent[v] = v;
    for (int32_t t = 0; t < tissue->mesh->tet_count; t++)
        for (int k = 1; k < 4 && tissue->alive[t]; k++)
            for (int j = 0; j < k; j++) {
                const int32_t a = tissue->mesh->tet[4 * (int64_t)t + j], b = tissue->mesh->tet[4 * (int64_t)t + k];
                if (!in || (in[a] && in[b])) law_join(parent, a, b);
            }
}

/* Sums the remaining travel of a component's fixed vertices after a motion; null: none. */
static double left_m(const plan *p, int32_t piece, const tm_screw *motion) {
    double sum = 0, x[3], y[3];
    for (int32_t v = 0; v < p->path->mesh->vertex_count; v++) {
        if (p->component_of[v] != piece) continue;
        places(p, v, x, y);
        if (motion) move(motion, 1, x);
        vsub(y, x, y);
        sum += sqrt(vdot(y, y));
    }
    return sum;
}

/* Returns the motion with the least remaining travel: of all supports of a component, or of one group. Angle 0: none
 * pays. */
static tm_screw best_motion(const plan *p, int32_t piece, const tm_screw *whole) {
    tm_screw best = {0};
    double least = WORTH_TURNING * left_m(p, piece, NULL);
    int32_t tried = 0;
    for (int32_t k = -1; k < p->path->component_count && tried < CANDIDATES; k++) {
        const tm_screw *motion = k < 0 ? whole : p->path->component + k;
        bool here = k < 0;
        for (int32_t v = 0; v < p->path->mesh->vertex_count && !here && motion->angle > 0; v++)
            here = p->path->component_of[v] == k && p->component_of[v] == piece;
        if (!here || motion->angle == 0) continue;
        tried++;
        const double left = left_m(p, piece, motion);
        if (left < least) least = left, best = *motion;
    }
    return best;
}

/* Rotates components as bodies. Returns whether any was. */
static bool turn_pieces(plan *p, const tm_tissue *tissue, int32_t *parent, const uint8_t *in, int32_t *root_piece) {
    const int32_t vertices = p->path->mesh->vertex_count;
    bool turned = false;
    join(tissue, NULL, parent);
    p->component_count = number(parent, in, vertices, p->component_of);
    fit_all(p, p->component_of, p->component_count, p->screw);
    for (int32_t v = 0; v < vertices; v++) root_piece[v] = -1;
    for (int32_t v = 0; v < vertices; v++)
        if (p->component_of[v] >= 0) root_piece[law_root(parent, v)] = p->component_of[v];
    for (int32_t k = 0; k < p->component_count; k++) p->screw[k] = best_motion(p, k, p->screw + k);
    for (int32_t v = 0; v < vertices; v++) {
        const int32_t piece = root_piece[law_root(parent, v)];
        if (piece < 0 || p->screw[piece].angle == 0) continue;
        double x[3];
        for (int i = 0; i < 3; i++) x[i] = p->path->mesh->rest_m[3 * v + i] + p->u_m[3 * v + i];
        move(p->screw + piece, 1, x);
        for (int i = 0; i < 3; i++) p->u_m[3 * v + i] = x[i] - p->path->mesh->rest_m[3 * v + i];
        turned = true;
    }
    return turned;
}

bool tm_settle_path_build(tm_settle_path *path, tm_pool *pool, const tm_tissue *tissue, const uint8_t *fixed,
                          const double *target_m, double *u_m) {
    const int32_t vertices = tissue->mesh->vertex_count;
    plan p = {.path = path, .u_m = u_m};
    tm_pool scratch = {0};
    *path = (tm_settle_path){.mesh = tissue->mesh, .fixed = fixed, .target_m = target_m};
    path->first_m = TM_ALLOC(pool, double, 3 * (int64_t)vertices);
    path->component_of = TM_ALLOC(pool, int32_t, vertices);
    path->component = TM_ALLOC(pool, tm_screw, vertices);
    p.component_of = TM_ALLOC(&scratch, int32_t, vertices);
    p.fit = TM_ALLOC(&scratch, fit, vertices);
    p.screw = TM_ALLOC(&scratch, tm_screw, vertices);
    int32_t *parent = TM_ALLOC(&scratch, int32_t, vertices), *root_piece = TM_ALLOC(&scratch, int32_t, vertices);
    uint8_t *in = TM_ALLOC(&scratch, uint8_t, vertices);
    const bool good = !pool->failed && !scratch.failed;
    if (good) {
        for (int32_t v = 0; v < vertices; v++)
            in[v] = fixed[3 * v] + fixed[3 * v + 1] + fixed[3 * v + 2] >= 2 && tissue->mass_kg[v] > 0;
        join(tissue, in, parent);
        path->component_count = number(parent, in, vertices, path->component_of);
        fit_all(&p, path->component_of, path->component_count, path->component);
        path->rotation_of = turn_pieces(&p, tissue, parent, in, root_piece);
        if (path->rotation_of) fit_all(&p, path->component_of, path->component_count, path->component);
        for (int32_t k = 0; k < path->component_count; k++)
            path->largest_rotation = fmax(path->largest_rotation, path->component[k].angle);
        memcpy(path->first_m, u_m, sizeof(double) * 3 * (size_t)vertices);
    }
    tm_pool_release(&scratch);
    return good;
}

/* Places a vertex of a rotating group at s: carries the shapes of both ends there, and blends between them. */
static void turned_at(const tm_screw *part, const double *rest, const uint8_t *fixed, const double *first,
                      const double *target, double s, double *u) {
    double x[3], y[3];
    for (int i = 0; i < 3; i++) x[i] = rest[i] + first[i], y[i] = rest[i] + (fixed[i] ? target[i] : first[i]);
    move(part, s, x);
    move(part, s - 1, y);
    for (int i = 0; i < 3; i++)
        if (fixed[i]) u[i] = (1 - s) * (x[i] - rest[i]) + s * (y[i] - rest[i]);
}

void tm_settle_path_at(const tm_settle_path *path, double s, double *u_m) {
    for (int32_t v = 0; v < path->mesh->vertex_count; v++) {
        const int64_t at = 3 * (int64_t)v;
        const double *first = path->first_m + at, *target = path->target_m + at;
        const tm_screw *part = path->component_of[v] >= 0 ? path->component + path->component_of[v] : NULL;
        if (part && part->angle > 0 && s < 1) {
            turned_at(part, path->mesh->rest_m + at, path->fixed + at, first, target, s, u_m + at);
            continue;
        }
        for (int i = 0; i < 3; i++)
            if (path->fixed[at + i]) u_m[at + i] = s < 1 ? first[i] + s * (target[i] - first[i]) : target[i];
    }
}

tm_force_scale tm_force_scale_of(const tm_tissue *tissue) {
    tm_force_scale scale = {.size_m = tm_mesh_size_m(tissue->mesh)};
    double K[9];
    for (int32_t v = 0; v < tissue->mesh->vertex_count; v++) {
        tm_tissue_vertex_tensor(tissue, v, K);
        for (int i = 0; i < 3; i++) scale.stiffness_N_m = fmax(scale.stiffness_N_m, K[4 * i]);
    }
    return scale;
}

double tm_force_scale_at(const tm_force_scale *scale, const double *u_m, int32_t n) {
    double most_m = 0;
    for (int32_t i = 0; i < n; i++) most_m = fmax(most_m, fabs(u_m[i]));
    const double way = fmax(1e-4 * most_m, 1e-9 * scale->size_m);
    return fmax(scale->stiffness_N_m * way, DBL_MIN);
}
