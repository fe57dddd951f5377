/* Columns of the quasi-static compliance K^-1 for single vertices, by conjugate gradients, a few iterations at a time
 * between frames.
 *
 * The stiffness changes only with a cut, so a computed column stays valid. A new vertex starts from the column of its
 * nearest neighbour: far away both are equal, and the difference is local. After a cut the old column is the first
 * guess.
 *
 * Under a nonlinear law the stiffness is the tangent at a state. Once all requested columns are there and the tissue
 * has moved on, the tangent is recomputed, a slice of tetrahedra per call. Columns follow one by one; until then each
 * belongs to the previous tangent. */
#include "patch/patch_internal.h"
#include "tissue/tangent.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

#define MAX_ITERATIONS 400 /* a column that needs more belongs to an unconstrained component */

enum {
    TETS_PER_ITERATION = 40, /* tangents that cost as much as one iteration */
    COARSE_EVERY = 16        /* requests between two refreshes of the coarse correction */
};
static const double MOVED_ON = 0.02; /* relative to an edge, approximately */
static const double ROUGH = 5;       /* a column is used once it is within so many times the tolerance */

typedef struct column {
    int32_t vertex; /* -1: free */
    int32_t good;   /* axes that have converged: 0, 1, 2 or 3 */
    int32_t newest; /* of these, those with the present stiffness */
    int32_t fine;   /* of these, those within the complete tolerance; the others are within ROUGH times that */
    bool hopeless;
    int64_t wanted_at; /* time of the last request */
    float *u_m;        /* [3][3*vertex_count] m/N */
} column;

struct tm_columns {
    tm_world *world;
    int32_t n, capacity;
    double tolerance;
    column *column;
    uint8_t *fixed;  /* [3*vertex_count] */
    double *inverse; /* [9*vertex_count] inverse vertex tensors of the free components */
    tm_coarse *coarse;
    int64_t coarse_at;         /* time of its last refresh, -1: none */
    bool stale;                /* fixed and inverse are out of date */
    double *x, *r, *z, *p, *q; /* [3*vertex_count] of the column in progress */
    int32_t job;               /* column in progress, -1 */
    int32_t iterations;
    bool refines; /* the column in progress, to the complete tolerance */
    double rz, scale;
    int64_t now;
    const tm_nonlinear *law; /* or null */
    tm_tangent tangent;
    double *at_m;      /* [3*vertex_count] u of the tangent */
    double moved_on_m; /* motion beyond which a tangent is out of date */
    int32_t rotated;   /* tetrahedra whose tangents it contains */
    bool uncompared;   /* it has just been completed */
    double age;        /* difference of the columns from it, when it was complete */
    int32_t want[TM_MAX_INSTRUMENTS][TM_COMPLIANCE_REQUEST_MAX], want_count[TM_MAX_INSTRUMENTS];
    int32_t needed[TM_MAX_INSTRUMENTS]; /* of these, those that a patch needs now; they come first */
};

tm_columns *tm_columns_create(tm_pool *pool, tm_world *world, int32_t vertices, double tolerance) {
    int64_t n = 3 * (int64_t)world->tissue->mesh->vertex_count;
    tm_columns *c = TM_ALLOC(pool, tm_columns, 1);
    if (!c) return NULL;
    c->column = TM_ALLOC(pool, column, vertices);
    c->fixed = TM_ALLOC(pool, uint8_t, n);
    c->inverse = TM_ALLOC(pool, double, 3 * n);
    c->coarse = tm_coarse_create(pool, world->tissue->mesh);
    c->coarse_at = -1;
    double **vector[] = {&c->x, &c->r, &c->z, &c->p, &c->q};
    for (int i = 0; i < 5; i++) *vector[i] = TM_ALLOC(pool, double, n);
    c->law = world->nonlinear;
    if (c->law) {
        double volume = 0;
        c->at_m = TM_ALLOC(pool, double, n);
        c->law->take_tangent(c->law->self, &c->tangent, pool);
        for (int32_t t = 0; t < world->tissue->mesh->tet_count; t++) volume += world->tissue->mesh->volume_m3[t];
        c->moved_on_m = MOVED_ON * cbrt(6 * volume / world->tissue->mesh->tet_count);
        c->rotated = world->tissue->mesh->tet_count;
    }
    for (int32_t i = 0; i < vertices && c->column; i++) {
        c->column[i].u_m = TM_ALLOC(pool, float, 3 * n);
        c->column[i].vertex = -1;
    }
    c->world = world;
    c->n = (int32_t)n;
    c->capacity = vertices;
    c->tolerance = tolerance;
    c->stale = true;
    c->job = -1;
    return pool->failed ? NULL : c;
}

static int32_t find(const tm_columns *c, int32_t vertex) {
    for (int32_t i = 0; i < c->capacity; i++)
        if (c->column[i].vertex == vertex) return i;
    return -1;
}

bool tm_columns_good(const tm_columns *c, int32_t vertex) {
    int32_t i = find(c, vertex);
    return i >= 0 && c->column[i].good == 3;
}

bool tm_columns_block(const tm_columns *c, int32_t a, int32_t b, double C[9]) {
    int32_t i = find(c, b);
    if (i < 0 || c->column[i].good < 3) return false;
    for (int k = 0; k < 9; k++) C[k] = (double)c->column[i].u_m[(int64_t)(k % 3) * c->n + 3 * a + k / 3];
    return true;
}

void tm_columns_cut(tm_columns *c) {
    c->stale = true;
    c->job = -1;
    for (int32_t i = 0; i < c->capacity; i++) {
        c->column[i].newest = c->column[i].fine = 0;
        c->column[i].hopeless = false;
    }
}

/* --- requests --- */

/* Returns the column whose last request is the oldest. */
static int32_t oldest(const tm_columns *c) {
    int32_t best = 0;
    for (int32_t i = 1; i < c->capacity; i++) {
        const column *a = c->column + i, *b = c->column + best;
        if ((a->vertex < 0 && b->vertex >= 0) || ((a->vertex < 0) == (b->vertex < 0) && a->wanted_at < b->wanted_at))
            best = i;
    }
    return best;
}

/* Sets the first guess from a converged neighbour's column, by distance at rest; zeros without one. */
static void guess(tm_columns *c, column *fresh) {
    const double *rest = c->world->tissue->mesh->rest_m;
    const column *best = NULL;
    double nearest = INFINITY;
    for (int32_t i = 0; i < c->capacity; i++) {
        double d[3];
        if (c->column[i].vertex < 0 || c->column[i].good < 3) continue;
        vsub(rest + 3 * c->column[i].vertex, rest + 3 * fresh->vertex, d);
        if (vdot(d, d) < nearest) {
            nearest = vdot(d, d);
            best = c->column + i;
        }
    }
    if (best)
        memcpy(fresh->u_m, best->u_m, sizeof(float) * 3 * (size_t)c->n);
    else
        memset(fresh->u_m, 0, sizeof(float) * 3 * (size_t)c->n);
}

void tm_columns_want(tm_columns *c, int32_t owner, const int32_t *vertex, int32_t needed, int32_t count) {
    c->now++;
    c->want_count[owner] = count;
    c->needed[owner] = needed;
    memcpy(c->want[owner], vertex, sizeof(int32_t) * (size_t)count);
    for (int32_t k = 0; k < count; k++) {
        int32_t i = find(c, vertex[k]);
        if (i >= 0) c->column[i].wanted_at = c->now;
    }
    for (int32_t k = 0; k < count; k++) {
        if (find(c, vertex[k]) >= 0) continue;
        int32_t i = oldest(c);
        column *fresh = c->column + i;
        if (fresh->vertex >= 0 && fresh->wanted_at == c->now) break; /* all are requested: more than the capacity */
        if (c->job == i) c->job = -1;
        fresh->vertex = vertex[k];
        fresh->good = fresh->newest = fresh->fine = 0;
        fresh->hopeless = false;
        fresh->wanted_at = c->now;
        fresh->u_m[0] = NAN; /* the guess is made when its turn comes: by then a nearer neighbour may be there */
    }
}

int32_t tm_columns_pending(const tm_columns *c) {
    int32_t pending = 0;
    for (int32_t o = 0; o < TM_MAX_INSTRUMENTS; o++)
        for (int32_t k = 0; k < c->needed[o]; k++) {
            int32_t i = find(c, c->want[o][k]);
            /* Under a nonlinear law the newest tangent is never reached while the tissue moves. */
            pending += i < 0 || ((c->law ? c->column[i].good : c->column[i].fine) < 3 && !c->column[i].hopeless);
        }
    return pending;
}

/* --- conjugate gradients --- */

static void refresh(tm_columns *c) {
    const tm_tissue *tissue = c->world->tissue;
    const tm_force_graph *graph = c->law ? &c->tangent.graph : &tissue->graph;
    memset(c->fixed, 0, (size_t)c->n);
    tm_support_mask(c->world, c->fixed);
    for (int32_t v = 0; v < c->n / 3; v++) {
        if (tissue->mass_kg[v] <= 0) memset(c->fixed + 3 * v, 1, 3);
        tm_vertex_inverse(graph->vertex_tensor + 9 * (int64_t)v, c->fixed + 3 * v, c->inverse + 9 * v);
    }
    /* A refresh takes as long as some ten iterations, and cuts follow each other. */
    if (c->law || c->coarse_at < 0 || c->now - c->coarse_at >= COARSE_EVERY) {
        tm_coarse_refresh(c->coarse, graph, c->fixed);
        c->coarse_at = c->now;
    }
    c->stale = false;
}

static double dot_n(const double *a, const double *b, int32_t n) {
    double sum = 0;
    for (int32_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

typedef struct product {
    const tm_columns *c;
    const double *p;
} product;

static void multiply(void *context, int32_t part) {
    const tm_columns *c = ((product *)context)->c;
    const double *p = ((product *)context)->p;
    const tm_tissue *tissue = c->world->tissue;
    tm_force_partition *own = &c->world->partition[part].force;
    if (c->law)
        c->tangent.force(&c->tangent.graph, own, own->begin, own->end, p, c->q);
    else
        tissue->force(&tissue->graph, own, own->begin, own->end, p, c->q);
    for (int32_t i = 3 * own->begin; i < 3 * own->end; i++) c->q[i] = c->fixed[i] ? 0 : -c->q[i];
}

/* Computes q := K p on the free components, by the threads of the step; bit-identical to one thread. */
static void apply(const tm_columns *c, const double *p) { tm_partitions_run(c->world, multiply, &(product){c, p}); }

static void begin(tm_columns *c, int32_t i) {
    column *work = c->column + i;
    int32_t axis = c->refines ? work->fine : work->newest, dof = 3 * work->vertex + axis;
    if (isnan(work->u_m[0])) guess(c, work);
    /* A fixed component does not yield: its column is zero, whatever the guess. */
    for (int32_t k = 0; k < c->n; k++)
        c->x[k] = c->fixed[k] || c->fixed[dof] ? 0 : (double)work->u_m[(int64_t)axis * c->n + k];
    apply(c, c->x);
    for (int32_t k = 0; k < c->n; k++) c->r[k] = -c->q[k];
    if (!c->fixed[dof]) c->r[dof] += 1;
    tm_precondition(c->coarse, c->inverse, c->fixed, c->r, c->z);
    memcpy(c->p, c->z, sizeof(double) * (size_t)c->n);
    c->rz = dot_n(c->r, c->z, c->n);
    c->scale = c->inverse[9 * work->vertex + 4 * axis]; /* of the unit force alone */
    c->job = i;
    c->iterations = 0;
}

static void iterate(tm_columns *c) {
    apply(c, c->p);
    double stiff = dot_n(c->p, c->q, c->n), step = stiff > 0 ? c->rz / stiff : 0;
    for (int32_t k = 0; k < c->n; k++) {
        c->x[k] += step * c->p[k];
        c->r[k] -= step * c->q[k];
    }
    tm_precondition(c->coarse, c->inverse, c->fixed, c->r, c->z);
    double rz = dot_n(c->r, c->z, c->n), turn = c->rz > 0 ? rz / c->rz : 0;
    for (int32_t k = 0; k < c->n; k++) c->p[k] = c->z[k] + turn * c->p[k];
    c->rz = rz;
    c->iterations++;
}

static void finish(tm_columns *c) {
    column *work = c->column + c->job;
    const int32_t axis = c->refines ? work->fine : work->newest;
    for (int32_t k = 0; k < c->n; k++) work->u_m[(int64_t)axis * c->n + k] = (float)c->x[k];
    if (c->refines)
        work->fine++;
    else
        work->newest++;
    if (work->good < work->newest) work->good = work->newest;
    c->job = -1;
}

/* Returns what a column still needs: 0 it has no use yet, 1 it belongs to an earlier stiffness, 2 it is rough, 3
 * nothing. */
static int32_t stage_of(const column *of) {
    if (of->hopeless) return 3;
    return of->good < 3 ? 0 : of->newest < 3 ? 1 : of->fine < 3 ? 2 : 3;
}

/* Returns the requested column at the earliest stage, most urgent of each owner in turn; those that may be needed soon
 * come last, and are only made usable. -1: none. */
static int32_t next_job(const tm_columns *c) {
    int32_t best = -1, least = 4;
    for (int32_t k = 0; k < TM_COMPLIANCE_REQUEST_MAX; k++)
        for (int32_t o = 0; o < TM_MAX_INSTRUMENTS; o++) {
            const int32_t i = k < c->want_count[o] ? find(c, c->want[o][k]) : -1;
            if (i < 0) continue;
            const int32_t stage = stage_of(c->column + i), rank = k < c->needed[o] ? stage : stage == 0 ? 3 : 4;
            if (rank < least && stage < 3) best = i, least = rank;
        }
    return best;
}

/* Returns whether all columns that patches need belong to the present stiffness. */
static bool is_current(const tm_columns *c) {
    for (int32_t o = 0; o < TM_MAX_INSTRUMENTS; o++)
        for (int32_t k = 0; k < c->needed[o]; k++) {
            const int32_t i = find(c, c->want[o][k]);
            if (i >= 0 && stage_of(c->column + i) < 2) return false;
        }
    return true;
}

/* Begins a new tangent if the tissue has moved away from the state of this one. */
static void moves_on(tm_columns *c) {
    double moved = 0;
    const double *u = c->world->state.u_m;
    for (int32_t k = 0; k < c->n; k++) moved = fmax(moved, fabs(u[k] - c->at_m[k]));
    if (moved > c->moved_on_m) c->stale = true;
}

/* Continues the tangent by a slice; returns true when it is complete. */
static bool tangent_is_there(tm_columns *c, int32_t iterations) {
    const int32_t tets = c->world->tissue->mesh->tet_count;
    if (c->stale) {
        memcpy(c->at_m, c->world->state.u_m, sizeof(double) * (size_t)c->n);
        tm_tangent_begin(c->world->tissue, &c->tangent);
        for (int32_t i = 0; i < c->capacity; i++) c->column[i].newest = c->column[i].fine = 0;
        c->job = -1;
        c->rotated = 0;
        refresh(c);
    }
    if (c->rotated == tets) return true;
    const int32_t most = TETS_PER_ITERATION * iterations, end = tets - c->rotated < most ? tets : c->rotated + most;
    c->law->add_tangent(c->law->self, c->at_m, c->rotated, end, &c->tangent);
    c->rotated = end;
    if (end == tets) refresh(c), c->uncompared = true;
    return false;
}

/* Compares the columns of one requested vertex, of the previous tangent, with the newest tangent. For x = C f, the
 * compliance by K is (f.x)^2 / (x.K x), up to second order in the change. */
static void compare(tm_columns *c) {
    c->age = 0;
    for (int32_t o = 0; o < TM_MAX_INSTRUMENTS; o++) {
        const int32_t i = c->want_count[o] > 0 ? find(c, c->want[o][0]) : -1;
        if (i < 0 || c->column[i].good < 3) continue;
        for (int axis = 0; axis < 3; axis++) {
            const float *u = c->column[i].u_m + (int64_t)axis * c->n;
            for (int32_t k = 0; k < c->n; k++) c->x[k] = c->fixed[k] ? 0 : (double)u[k];
            apply(c, c->x);
            const double before = c->x[3 * c->column[i].vertex + axis], stiff = dot_n(c->x, c->q, c->n);
            if (before > 0) c->age = fmax(c->age, stiff > 0 ? fabs(before / stiff - 1) : 1);
        }
    }
}

double tm_columns_age(const tm_columns *c) {
    for (int32_t o = 0; o < TM_MAX_INSTRUMENTS; o++)
        for (int32_t k = 0; k < c->needed[o]; k++) {
            const int32_t i = find(c, c->want[o][k]);
            if (i >= 0 && c->column[i].good == 3 && c->column[i].newest < 3) return c->age;
        }
    return 0;
}

static void work(tm_columns *c, int32_t iterations) {
    while (iterations-- > 0) {
        if (c->job < 0) {
            int32_t next = next_job(c);
            if (next < 0) return;
            if (c->stale) refresh(c);
            c->refines = stage_of(c->column + next) == 2;
            begin(c, next);
        } else {
            iterate(c);
        }
        const double within = c->tolerance * (c->refines ? 1 : ROUGH);
        if (c->rz <= within * within * c->scale) {
            finish(c);
        } else if (c->iterations >= MAX_ITERATIONS || !(c->rz < INFINITY)) {
            c->column[c->job].hopeless = true;
            c->column[c->job].good = 0; /* it may be of before a cut that detached the vertex */
            c->job = -1;
        }
    }
}

void tm_columns_work(tm_columns *c, int32_t iterations) {
    if (c->law && c->job < 0 && !c->stale) {
        if (is_current(c)) moves_on(c);
        if (!c->stale && next_job(c) < 0) return;
    }
    if (c->law && !tangent_is_there(c, iterations)) return;
    c->world->evaluating = true; /* outside a step: by the world's own threads only */
    tm_partitions_begin(c->world, iterations);
    if (c->uncompared) compare(c);
    c->uncompared = false;
    work(c, iterations);
    tm_partitions_end(c->world);
    c->world->evaluating = false;
}
