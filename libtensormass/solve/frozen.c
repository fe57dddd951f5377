/* Where Newton's method finds no solution: normals and shares that jump with the shape (a thin tool between the lips of
 * a cut) may leave none. Rows as they are found at the shape of before, frozen, always have one; swept as the core
 * sweeps its own (contact_solve.c), until no row would change what its skin bears: as
 * true as a dynamic model's contact. */
#include "local_eval.h"

#include <math.h>
#include <string.h>

enum { SWEEPS = 200 };
static const double MARGIN = 0.1;   /* radii: rows so far off may be touched once others give way */
static const double SETTLED = 1e-4; /* radii: what a row's last change would have moved at most */

/* The row's forces on the slots, per newton of it: G. */
typedef struct lever {
    int32_t component[9];
    double G[9];
} lever;

static lever lever_of(const tms_local *l, const tm_contact_row *row) {
    lever of;
    for (int a = 0; a < 9; a++) {
        of.component[a] = 3 * l->slot_of[row->vertex[a / 3]] + a % 3;
        of.G[a] = row->weight[a / 3] * row->normal[a % 3];
    }
    return of;
}

/* The gap's change by the displacements du, and by a newton of the row itself. */
static double along(const lever *of, const double *du) {
    double sum = 0;
    for (int a = 0; a < 9; a++) sum += of->G[a] * du[of->component[a]];
    return sum;
}
static double diagonal(const tms_local *l, const lever *of) {
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double sum = 0;
    for (int a = 0; a < 9; a++)
        for (int b = 0; b < 9; b++) sum += of->G[a] * l->block[of->component[a] * c3 + of->component[b]] * of->G[b];
    return sum;
}

static void push(const tms_local *l, const lever *of, double lambda_N, double *f, double *du) {
    for (int a = 0; a < 9; a++) {
        if (of->G[a] == 0) continue;
        f[of->component[a]] += lambda_N * of->G[a];
        tms_local_spread(l, of->component[a], lambda_N * of->G[a], du);
    }
}

/* Returns how far the row was from what its skin bears, in radii. */
static double relax(tms_local *l, tm_contact_row *row, double *du) {
    const lever of = lever_of(l, row);
    const double radius = l->tool[row->instrument].def.radius_m, skin = l->def.skin_compliance_m_N / row->share;
    const double own = diagonal(l, &of), free_gap = row->gap_m + along(&of, du) - own * row->lambda_N,
                 change = tm_skin_reaction(skin, radius, free_gap, own, l->def.force_cap_N) - row->lambda_N;
    push(l, &of, change, l->f, du);
    row->lambda_N += change;
    return fabs(change) * (own + skin) / radius;
}

void tms_local_freeze(tms_local *l, const double *f_before) {
    double *du = l->keep; /* from the shape in which the rows are found */
    memcpy(l->f, f_before, 24 * (size_t)l->capacity);
    tms_local_shape(l);
    tms_local_look(l, &l->now, MARGIN);
    tms_local_response(l, l->use, l->use_count, l->f, true, du);
    for (int32_t i = 0; i < 3 * l->high; i++) du[i] = -du[i];
    memset(l->f, 0, 24 * (size_t)l->capacity);
    for (int32_t i = 0; i < l->now.count; i++) {
        const lever of = lever_of(l, &l->now.row[i]);
        push(l, &of, l->now.row[i].lambda_N, l->f, du);
    }
    for (int32_t sweep = 0; sweep < SWEEPS && !l->converged; sweep++) { /* there and back: no row is always last */
        double most = 0;
        for (int32_t i = 0; i < l->now.count; i++)
            most = fmax(most, relax(l, &l->now.row[sweep % 2 ? l->now.count - 1 - i : i], du));
        l->converged = most <= SETTLED;
    }
    tms_local_sum(l, &l->now);
    tms_local_shape(l);
}
