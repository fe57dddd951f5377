/* Limits the energy that contact of tissue generates when instruments are held back. A row that was solved loses energy
 * (docs/energy.md). But rows are solved against the forces of instruments, and when contact_passivity.c then reduces
 * these, rows that they had pressed keep their force and throw the tissue apart: in sessions with fast tools, more than
 * a tenth of the energy of the hands. So the rows' account, exact in the integrator's terms, is taken after the sweeps
 * and again after instruments were held back: the work over the two steps around the forces, and half of the energy in
 * the compliance. If rows then give more than after the sweeps, open rows lose the force that holds them open. If that
 * is not enough, all rows are reduced by one share. Without a change of the instruments no force changes.
 *
 * A row that is new where its two sides just parted fast can give energy even so, and so can one that appears deep in
 * crushed tissue. So all rows together give no more than what they took in the last 0.2 s, what their compliance
 * returns, and PUSH_J. */
#include "touch/touch_internal.h"

#include <math.h>

#include "base/vec.h"

/* Energy below which nothing is done, J. */
static const double LITTLE_J = 2e-8;
/* Energy that rows may give in RESERVE_S beyond what they took, to push out what overlaps, J. */
static const double PUSH_J = 5e-4;
/* Time after which most of what rows took or pushed is forgotten, s. */
static const double RESERVE_S = 0.2;
enum { RELEASES = 2, HALVINGS = 30 };

static void force_of(const tm_touching *t, int32_t i, double force_N[3]) {
    const tm_touch_solver *s = t->solver + i;
    for (int c = 0; c < 3; c++) force_N[c] = t->row[i].lambda_N * t->row[i].normal[c] + s->drag_N[c] + s->friction_N[c];
}

static double work_J(const tm_touching *t) {
    const tm_state *state = &t->world->state;
    double work = 0;
    for (int32_t i = 0; i < t->row_count; i++) {
        double force[3], way[3];
        if (t->row[i].lambda_N == 0) continue;
        force_of(t, i, force);
        tm_touch_slip(t->row + i, state->u_next_m, state->u_prev_m, way);
        work += 0.5 * vdot(force, way);
    }
    return work;
}

/* Returns half of the energy that the compliance stores at a share of the rows' forces, J. */
static double half_stored_J(const tm_touching *t, double share) {
    double sum = 0;
    for (int32_t i = 0; i < t->row_count; i++)
        if (t->row[i].lambda_N > 0) sum += tm_touch_stored_at_J(t, i, share * t->row[i].lambda_N);
    return 0.5 * sum;
}

/* The rows' account. */
static double account_J(const tm_touching *t) { return work_J(t) + half_stored_J(t, 1); }

static void push_all(tm_touching *t, double sign) {
    for (int32_t i = 0; i < t->row_count; i++) {
        double force[3];
        if (t->row[i].lambda_N == 0) continue;
        force_of(t, i, force);
        vscale(sign, force, force);
        tm_touch_push(t, i, force);
    }
}

/* Returns the largest share at which linear share + square share^2 and half of the stored energy are at most `may`,
 * which is not negative. By bisection: the energy of the compliance has kinks. */
static double find_share(const tm_touching *t, double linear_J, double square_J, double may_J) {
    double least = 0, most = 1;
    for (int halving = 0; halving < HALVINGS; halving++) {
        const double share = 0.5 * (least + most);
        const double gives_J = share * (linear_J + share * square_J) + half_stored_J(t, share);
        *(gives_J <= may_J ? &least : &most) = share;
    }
    return least;
}

/* Scales all forces by one share. */
static void reduce(tm_touching *t, double may_J) {
    const double work = work_J(t);
    push_all(t, -1);
    const double bare = work_J(t), share = find_share(t, bare, work - bare, may_J);
    for (int32_t i = 0; i < t->row_count; i++) {
        tm_touch_solver *s = t->solver + i;
        t->row[i].lambda_N *= share;
        vscale(share, s->drag_N, s->drag_N);
        vscale(share, s->friction_N, s->friction_N);
    }
    push_all(t, 1);
}

/* Returns what the rows may give in this substep, in the terms of account_J. */
static double allowance_J(const tm_touching *t) {
    return t->reserve_J + law_max(PUSH_J - t->pushed_J, 0) + 0.5 * t->stored_before_J[1];
}

void tm_touch_note_energy(tm_touching *t) {
    t->swept_J = 0;
    if (t->world->settling || t->row_count == 0) return;
    t->swept_J = account_J(t);
    const double may = allowance_J(t);
    if (t->swept_J <= may) return;
    reduce(t, may);
    t->swept_J = account_J(t);
}

static void book_energy(tm_touching *t) {
    const double stored = 2 * half_stored_J(t, 1), given = work_J(t) + 0.5 * (stored - t->stored_before_J[1]);
    const double kept = 1 - law_min(t->world->state.dt_s / RESERVE_S, 1), left = t->reserve_J * kept - given;
    t->reserve_J = law_max(left, 0);
    t->pushed_J = t->pushed_J * kept + law_max(-left, 0);
    t->stored_before_J[1] = t->stored_before_J[0], t->stored_before_J[0] = stored;
}

void tm_touch_remember_account(tm_touching *t) {
    book_energy(t);
    if (!(t->reserve_J > 0 || t->pushed_J > 0 || t->stored_before_J[0] > 0 || t->stored_before_J[1] > 0)) return;
    if (t->memory_count == t->def.max_rows) t->memory_count--;
    t->memory[t->memory_count++] =
        (tm_touch_memory){.edges = TM_TOUCH_MEMORY_ACCOUNT,
                          .lambda_N = t->reserve_J,
                          .drag_N = {t->stored_before_J[0], t->stored_before_J[1], t->pushed_J}};
}

bool tm_touch_limit_energy(tm_touching *t) {
    if (t->world->settling) return false;
    const double may = law_max(t->swept_J, 0) + LITTLE_J;
    for (int32_t k = 0; k < RELEASES; k++) {
        if (!(account_J(t) > may)) return k > 0;
        tm_touch_release(t, k);
    }
    if (account_J(t) > may) reduce(t, may);
    return true;
}
