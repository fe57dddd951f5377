/* Energy of the condensed part: stored energy, work of its rows, losses.
 *
 * With b the interface displacement and f the contact forces on the interior, x = x0 + T b + R f. The stored energy is
 * b S b / 2 + f R f / 2: T b is in equilibrium, so the energy of f is additive. The force on the interface is among the
 * world's loads. Leapfrog conserves the energy whose gradient it is (coupling.h); each recomputation loses some. The
 * interior is massless: when f becomes f', the work is f'.R (f' - f). Of it (f' - f).R (f' - f) / 2 is lost, which a
 * wave would have carried away. */
#include "hybrid.h"

#include <string.h>

/* --- contact forces --- */

static double *press_of(tms_pressed *p, int32_t vertex) {
    int32_t i = 0;
    while (i < p->count && p->vertex[i] != vertex) i++;
    if (i == p->count) {
        p->vertex[p->count++] = vertex;
        memset(p->force_N + 3 * (int64_t)i, 0, 24);
    }
    return p->force_N + 3 * (int64_t)i;
}

static void take_rows(tm_hybrid *h, const tm_contact_row *row, int32_t count) {
    tms_pressed *now = h->energy.pressed;
    now->count = 0;
    for (int32_t i = 0; i < count; i++)
        for (int j = 0; j < 3 && row[i].lambda_N > 0; j++) {
            if (!tms_row_is_in(h, row + i, j, TMS_CONDENSED)) continue;
            double *force = press_of(now, row[i].vertex[j]);
            for (int c = 0; c < 3; c++) force[c] += row[i].lambda_N * row[i].weight[j] * row[i].normal[c];
        }
}

/* Returns the displacement of an interior component by the contact forces. */
static double give_m(const tm_hybrid *h, int32_t dof, const tms_pressed *p) {
    const int32_t at = h->interface_index[dof];
    double sum = 0;
    for (int32_t i = 0; at >= 0 && i < 3 * p->count; i++) {
        const int32_t column = h->interface_index[3 * p->vertex[i / 3] + i % 3];
        if (column >= 0 && p->force_N[i] != 0) sum += p->force_N[i] * tms_response(&h->responses, column, at);
    }
    return sum;
}

static double follow_m(const tm_hybrid *h, int32_t dof, const double *went_m) {
    const int32_t at = h->interface_index[dof];
    double sum = 0;
    for (int32_t k = 0; at >= 0 && k < h->interface_count; k++)
        sum += went_m[k] * tms_response(&h->responses, h->responses.kept_count + k, at);
    return sum;
}

/* Computes the travel over two steps of each loaded vertex, and the energy of the forces. Returns their work beyond the
 * interface's travel. */
static double find_ways(tm_hybrid *h) {
    tms_hybrid_energy *e = &h->energy;
    tms_pressed *now = e->pressed;
    double work = 0;
    now->held_J = 0;
    for (int32_t i = 0; i < 3 * now->count; i++) {
        const int32_t dof = 3 * now->vertex[i / 3] + i % 3;
        const double gives = give_m(h, dof, now), gave = give_m(h, dof, e->pressed + 2);
        now->held_J += 0.5 * now->force_N[i] * gives;
        work += 0.5 * now->force_N[i] * (gives - gave);
        e->way_m[i] = gives - gave + follow_m(h, dof, e->went_m);
    }
    return work;
}

static void sum_rows(tm_hybrid *h, const tm_contact_row *row, int32_t count, tm_part_energy *to) {
    const tms_hybrid_energy *e = &h->energy;
    for (int32_t i = 0; i < count; i++)
        for (int j = 0; j < 3 && row[i].lambda_N > 0; j++) {
            if (!tms_row_is_in(h, row + i, j, TMS_CONDENSED)) continue;
            const int64_t at = press_of(h->energy.pressed, row[i].vertex[j]) - e->pressed->force_N;
            for (int c = 0; c < 3; c++)
                to->contact_J[row[i].instrument] +=
                    0.5 * row[i].lambda_N * row[i].weight[j] * row[i].normal[c] * e->way_m[at + c];
        }
}

/* --- a step --- */

static void step_on(tms_hybrid_energy *e) {
    const tms_pressed oldest = e->pressed[2];
    e->pressed[2] = e->pressed[1];
    e->pressed[1] = e->pressed[0];
    e->pressed[0] = oldest;
}

/* Restarts after unseen steps, as if the forces had been constant. */
static void begin_anew(tms_hybrid_energy *e) {
    for (int k = 1; k < 3; k++) {
        e->pressed[k].count = e->pressed->count;
        memcpy(e->pressed[k].vertex, e->pressed->vertex, 4 * (size_t)e->pressed->count);
        memcpy(e->pressed[k].force_N, e->pressed->force_N, 24 * (size_t)e->pressed->count);
    }
}

static void sum_border(tm_hybrid *h, const tm_state *s, tm_part_energy *to) {
    tms_hybrid_energy *e = &h->energy;
    to->before_J = to->stored_J = tms_coupling_steady(&h->coupling, e->steady_N);
    for (int32_t k = 0; k < h->interface_count; k++) {
        const int32_t d = h->interface[k];
        const double elastic = e->pushed_N[k] - h->coupling.prescribed_N[k];
        const double both = 0.5 * s->u_m[d] * (h->coupling.prescribed_N[k] - e->steady_N[k]);
        e->went_m[k] = s->u_next_m[d] - s->u_prev_m[d];
        to->before_J += both - 0.5 * s->u_prev_m[d] * elastic;
        to->stored_J += both - 0.5 * s->u_next_m[d] * elastic;
        to->outer_J += 0.5 * elastic * e->went_m[k];
    }
}

static void work(void *self, tm_world *world, tm_part_energy *to) {
    tm_hybrid *h = self;
    tms_hybrid_energy *e = &h->energy;
    const tm_state *s = tm_world_state(world);
    const tm_contact_row *row = NULL;
    const int32_t count = h->contact ? tm_contact_rows(h->contact, &row) : 0;
    const bool anew = e->next_step != s->step;
    sum_border(h, s, to);
    if (!anew) to->eased_J = e->border_J - to->before_J;
    e->border_J = to->stored_J;
    step_on(e);
    take_rows(h, row, count);
    if (anew) begin_anew(e);
    const double strains = find_ways(h);
    if (anew) e->pressed[1].held_J = e->pressed[2].held_J = e->pressed->held_J;
    sum_rows(h, row, count, to);
    const double was = 0.5 * (e->pressed[2].held_J + e->pressed[1].held_J),
                 is = 0.5 * (e->pressed[1].held_J + e->pressed[0].held_J);
    to->before_J += was;
    to->stored_J += is;
    to->lost_J = strains - (is - was);
    e->next_step = s->step + 1;
}

/* --- memory --- */

bool tms_hybrid_make_energy(tm_hybrid *h) {
    tms_hybrid_energy *e = &h->energy;
    const size_t n = (size_t)h->interface_count;
    *e = (tms_hybrid_energy){
        .part = {h, work}, .most = h->has_contact ? 3 * h->contact_def.max_rows : 0, .next_step = -1};
    const size_t most = (size_t)e->most;
    bool good = true;
    for (int k = 0; k < 3; k++) {
        e->pressed[k].vertex = tms_alloc_zeroed(most + 1, 4);
        e->pressed[k].force_N = tms_alloc_zeroed(3 * most + 1, 8);
        good = good && e->pressed[k].vertex && e->pressed[k].force_N;
    }
    e->pushed_N = tms_alloc_zeroed(n + 1, 8);
    e->steady_N = tms_alloc_zeroed(n + 1, 8);
    e->went_m = tms_alloc_zeroed(n + 1, 8);
    e->way_m = tms_alloc_zeroed(3 * most + 1, 8);
    return good && e->pushed_N && e->steady_N && e->went_m && e->way_m;
}

void tms_hybrid_drop_energy(tm_hybrid *h) {
    tms_hybrid_energy *e = &h->energy;
    if (h->world) tm_world_set_energy_part(h->world, NULL);
    for (int k = 0; k < 3; k++) {
        tms_free(e->pressed[k].vertex);
        tms_free(e->pressed[k].force_N);
    }
    double *arrays[] = {e->pushed_N, e->steady_N, e->went_m, e->way_m};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++) tms_free(arrays[i]);
    *e = (tms_hybrid_energy){0};
}
