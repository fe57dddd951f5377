/* Stage "friction": Coulomb friction between tools and tissue. Its constraint block is swept after the contact rows and
 * uses their normal forces of the same sweep. So no force is ever outside its cone.
 *
 * The unit is the station, as for the contact compliance: rows come and go while a tool slides over triangles, a
 * station stays. Its force acts at its rows in proportion to their loads, perpendicular to their common normal. */
#include "contact/friction_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "contact_law/friction.h"

tm_friction_def tm_friction_def_default(void) {
    return (tm_friction_def){.cookie = TM_COOKIE_FRICTION, .size = sizeof(tm_friction_def)};
}

bool tm_contact_has_friction(const tm_contact *contact, int32_t instrument) {
    return contact->friction && contact->friction->state[instrument];
}

const double (*tm_contact_friction_forces(const tm_contact *contact, int32_t instrument, double *at_rest,
                                          double *sliding))[3] {
    *at_rest = contact->friction->def.instrument[instrument].mu_static;
    *sliding = contact->friction->def.instrument[instrument].mu_kinetic;
    return (const double(*)[3])contact->friction->applied_N;
}

/* --- the constraint block --- */

static void push_row(tm_friction *f, int32_t i, const double force_N[3]) {
    const tm_contact *contact = f->contact;
    const tm_contact_row *row = contact->row + i;
    double *u_next = contact->world->state.u_next_m, *applied = f->applied_N[i];
    for (int j = 0; j < 3; j++)
        for (int c = 0; c < 3; c++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            if (!contact->fixed[dof])
                u_next[dof] +=
                    contact->world->mobility_s2_kg[row->vertex[j]] * row->weight[j] * (force_N[c] - applied[c]);
        }
    vset(force_N, applied);
}

/* Distributes the station's force over its rows in proportion to their loads. */
static void push(tm_friction *f, const tm_touch *touch, double load_N) {
    for (int32_t i = touch->first; i < touch->first + touch->count; i++) {
        double part[3];
        vscale(load_N > 0 ? f->contact->row[i].lambda_N / load_N : 0, touch->force_N, part);
        push_row(f, i, part);
    }
}

/* Returns the sum of the row forces, and computes the station's normal and normal force. */
static double press(const tm_friction *f, tm_touch *touch) {
    double load_N = 0, sum[3] = {0, 0, 0};
    for (int32_t i = touch->first; i < touch->first + touch->count; i++) {
        const tm_contact_row *row = f->contact->row + i;
        load_N += row->lambda_N;
        vmadd(sum, row->lambda_N, row->normal, sum);
    }
    touch->normal_force_N = vunit(sum, touch->normal);
    return load_N;
}

/* Computes the motion of the tissue under a station in this substep, and an upper bound of its change per force,
 * m/N. */
static double follow(const tm_friction *f, const tm_touch *touch, double load_N, double went_m[3]) {
    const tm_state *state = &f->contact->world->state;
    double gives = 0;
    memset(went_m, 0, 3 * sizeof(double));
    for (int32_t i = touch->first; i < touch->first + touch->count; i++) {
        const tm_contact_row *row = f->contact->row + i;
        const double share = row->lambda_N / load_N;
        gives += share * f->contact->solver[i].weight2;
        for (int j = 0; j < 3; j++)
            for (int c = 0; c < 3; c++) {
                const int32_t dof = 3 * row->vertex[j] + c;
                went_m[c] += share * row->weight[j] * (state->u_next_m[dof] - state->u_m[dof]);
            }
    }
    return gives;
}

static void sweep_friction(tm_friction *f, tm_touch *touch) {
    const double load_N = press(f, touch), compliance = f->contact->def.contact_compliance_m_N;
    const tm_friction_state *was = f->state[touch->instrument] + touch->station;
    double went[3], force[3] = {0, 0, 0};
    touch->slips = true;
    if (load_N > 0) {
        const double gives = follow(f, touch, load_N, went);
        for (int c = 0; c < 3 && compliance + gives > 0; c++)
            force[c] = (compliance * was->force_N[c] + touch->moved_m[c] - went[c] + gives * touch->force_N[c]) /
                       (compliance + gives);
        law_across(touch->normal, force);
        touch->slips = law_friction_slips(touch->coefficient * touch->normal_force_N, force);
    }
    vset(force, touch->force_N);
    push(f, touch, load_N);
}

static void find(void *self, tm_world *world) {
    (void)world;
    tm_friction *f = self;
    const tm_contact *contact = f->contact;
    f->touch_count = 0;
    f->joined = false;
    for (int32_t i = 0; i < contact->row_count; i++) {
        const tm_contact_row *row = contact->row + i;
        tm_touch *touch = f->touch + f->touch_count - 1;
        memset(f->applied_N[i], 0, sizeof f->applied_N[i]);
        if (!f->state[row->instrument]) continue;
        if (f->touch_count == 0 || touch->instrument != row->instrument || touch->station != row->station) {
            touch = f->touch + f->touch_count++;
            *touch = (tm_touch){.instrument = row->instrument, .station = row->station, .first = i};
            vset(contact->solver[i].moved_m, touch->moved_m);
        }
        touch->count++;
    }
    for (int32_t k = 0; k < f->touch_count; k++) { /* starting from the previous force */
        tm_touch *touch = f->touch + k;
        const tm_friction_coefficient *c = f->def.instrument + touch->instrument;
        touch->coefficient = law_friction_coefficient(c->mu_static, c->mu_kinetic,
                                                      f->state[touch->instrument][touch->station].stick_state);
        const double load_N = press(f, touch);
        if (!(load_N > 0)) continue;
        vset(f->state[touch->instrument][touch->station].force_N, touch->force_N);
        law_across(touch->normal, touch->force_N);
        law_friction_slips(touch->coefficient * touch->normal_force_N, touch->force_N);
        push(f, touch, load_N);
    }
}

static void sweep(void *self, tm_world *world, int32_t sweep) {
    (void)world;
    tm_friction *f = self;
    for (int32_t k = 0; k < f->touch_count; k++) sweep_friction(f, f->touch + (sweep % 2 ? f->touch_count - 1 - k : k));
}

/* Ends the substep of one station: computes its slip and the energy that took. */
static void settle(tm_friction *f, tm_touch *touch) {
    const double compliance = f->contact->def.contact_compliance_m_N, load_N = press(f, touch);
    tm_friction_state *was = f->state[touch->instrument] + touch->station;
    double slipped[3] = {0, 0, 0}, went[3];
    if (touch->slips && load_N > 0) {
        follow(f, touch, load_N, went);
        for (int c = 0; c < 3; c++)
            slipped[c] = touch->moved_m[c] - went[c] - compliance * (touch->force_N[c] - was->force_N[c]);
        law_across(touch->normal, slipped);
    }
    f->lost_J += law_max(vdot(touch->force_N, slipped), 0);
    was->stick_state =
        load_N > 0 ? law_stick_state(was->stick_state, vnorm(slipped), f->contact->world->state.dt_s) : 1;
    vset(touch->force_N, was->force_N);
}

static double stretched_J(const tm_friction *f, int32_t t) {
    double squares = 0;
    for (int32_t s = 0; f->state[t] && s < TM_MAX_STATIONS; s++)
        squares += vdot(f->state[t][s].force_N, f->state[t][s].force_N);
    return 0.5 * f->contact->def.contact_compliance_m_N * squares;
}

double tm_friction_stretched_J(const tm_friction *friction) {
    double sum = 0;
    for (int32_t t = 0; t < friction->contact->tool_count; t++) sum += stretched_J(friction, t);
    return sum;
}

double tm_friction_stretch_J(const tm_friction *f, int32_t t) {
    double squares = 0;
    for (int32_t k = 0; k < f->touch_count; k++)
        if (f->touch[k].instrument == t) squares += vdot(f->touch[k].force_N, f->touch[k].force_N);
    return 0.5 * f->contact->def.contact_compliance_m_N * squares;
}

void tm_friction_scale(tm_friction *f, int32_t t, double share) {
    for (int32_t k = 0; k < f->touch_count; k++) {
        tm_touch *touch = f->touch + k;
        if (touch->instrument != t) continue;
        vscale(share, touch->force_N, touch->force_N);
        for (int32_t i = touch->first; i < touch->first + touch->count; i++)
            vscale(share, f->applied_N[i], f->applied_N[i]);
    }
}

/* Adds the forces to the rows' drag after the sweeps: reactions and accounts read them there. A station without contact
 * goes back to the stuck state. */
static void finish(void *self, tm_world *world) {
    (void)world;
    tm_friction *f = self;
    int32_t k = 0;
    f->lost_J = 0;
    for (int32_t t = 0; t < f->contact->tool_count; t++) {
        if (!f->state[t]) continue;
        for (int32_t s = 0; s < TM_MAX_STATIONS; s++) {
            if (k < f->touch_count && f->touch[k].instrument == t && f->touch[k].station == s)
                settle(f, f->touch + k++);
            else
                f->state[t][s] = (tm_friction_state){.stick_state = 1};
        }
    }
    for (int32_t i = 0; i < f->contact->row_count; i++)
        vmadd(f->contact->solver[i].drag_N, 1, f->applied_N[i], f->contact->solver[i].drag_N);
    f->joined = true;
}

/* Nothing to add: the rows' drag includes friction. */
static void react(void *self, int32_t instrument, double force_N[3], double resultant_N[3]) {
    (void)self, (void)instrument, (void)force_N, (void)resultant_N;
}

/* --- the stage --- */

/* Resets tools that were teleported: they stick to nothing. */
static void run(void *self, tm_world *world) {
    (void)world;
    tm_friction *f = self;
    for (int32_t t = 0; t < f->contact->tool_count; t++) {
        const int32_t placings = f->contact->tool[t].placings;
        for (int32_t s = 0; f->state[t] && placings != f->placings[t] && s < TM_MAX_STATIONS; s++)
            f->state[t][s] = (tm_friction_state){.stick_state = 1};
        f->placings[t] = placings;
    }
}

static void destroy(void *self) {
    tm_friction *f = self;
    tm_contact_remove_block(f->contact, f);
    f->contact->friction = NULL;
    tm_pool pool = f->pool;
    tm_pool_release(&pool);
}

static tm_status check(const tm_contact *contact, const tm_friction_def *def, tm_error *error) {
    if (contact->friction)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "this world already has friction; remove that first");
    for (int32_t t = 0; t < contact->tool_count; t++) {
        const tm_friction_coefficient *c = def->instrument + t;
        if (!(c->mu_kinetic >= 0 && c->mu_kinetic <= c->mu_static && c->mu_static <= TM_FRICTION_MAX))
            return tm_fail(error, TM_ERR_ARGUMENT, t,
                           "friction of instrument %d: static %g, kinetic %g; give 0 <= kinetic <= static <= %g", t,
                           c->mu_static, c->mu_kinetic, TM_FRICTION_MAX);
    }
    return TM_OK;
}

static tm_friction *init(tm_pool *pool, const tm_contact *contact, const tm_friction_def *def) {
    tm_friction *f = TM_ALLOC(pool, tm_friction, 1);
    if (!f) return NULL;
    f->touch = TM_ALLOC(pool, tm_touch, contact->def.max_rows);
    f->applied_N = (double(*)[3])TM_ALLOC(pool, double, 3 * (int64_t)contact->def.max_rows);
    for (int32_t t = 0; t < contact->tool_count; t++) {
        if (!(def->instrument[t].mu_static > 0)) continue;
        f->state[t] = TM_ALLOC(pool, tm_friction_state, TM_MAX_STATIONS);
        f->saved[t] = TM_ALLOC(pool, tm_friction_state, TM_MAX_STATIONS);
        for (int32_t s = 0; f->state[t] && s < TM_MAX_STATIONS; s++) f->state[t][s].stick_state = 1;
    }
    return f;
}

tm_status tm_stage_friction(tm_world *world, tm_contact *contact, const tm_friction_def *def, tm_friction **friction,
                            tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_FRICTION, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && friction && contact && contact->world == world,
               "world or friction is null, or contact is not of this world", TM_ERR_ARGUMENT);
    tm_status status = check(contact, def, error);
    if (status) return status;
    tm_pool pool = {0};
    tm_friction *self = init(&pool, contact, def);
    if (!self || pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "friction stage");
    }
    self->pool = pool;
    self->contact = contact;
    self->def = *def;
    for (int32_t t = 0; t < contact->tool_count; t++) self->placings[t] = contact->tool[t].placings;
    const tm_stage stage = {.size = sizeof stage,
                            .name = "friction",
                            .phase = TM_PHASE_CONSTRAIN,
                            .run = run,
                            .destroy = destroy,
                            .self = self,
                            .snapshot = tm_friction_snapshot,
                            .restore = tm_friction_restore,
                            .checkpoint = tm_friction_checkpoint,
                            .rollback = tm_friction_rollback,
                            .needs = {"contact"},
                            .runs_before = TM_STAGE_CONTACT_DETECT};
    status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    tm_world_set_few(world, "friction", &tm_changes_none); /* "contact solve" makes the changes */
    contact->friction = self;
    tm_contact_add_block_behind(
        contact, &(tm_constraint_block){
                     .self = self, .owner = self, .find = find, .sweep = sweep, .finish = finish, .react = react});
    *friction = self;
    return TM_OK;
}

int32_t tm_friction_stations(const tm_friction *f, int32_t instrument, tm_friction_station *grip, int32_t most) {
    TM_REQUIRE(f && (grip || most <= 0) && instrument >= 0 && instrument < f->contact->tool_count,
               "friction or grip is null, or instrument is not one of its contact's", 0);
    int32_t count = 0;
    for (int32_t k = 0; k < f->touch_count; k++) {
        const tm_touch *touch = f->touch + k;
        if (touch->instrument != instrument || !(touch->normal_force_N > 0)) continue;
        if (count < most) {
            tm_friction_station *to = grip + count;
            *to = (tm_friction_station){.station = touch->station,
                                        .slips = touch->slips,
                                        .normal_force_N = touch->normal_force_N,
                                        .coefficient = touch->coefficient,
                                        .stick_state = f->state[instrument][touch->station].stick_state};
            vset(touch->force_N, to->force_N);
            vset(touch->normal, to->normal);
        }
        count++;
    }
    return count;
}

/* --- state between steps: for snapshots and rollback --- */

enum { NUMBERS = 4 * TM_MAX_STATIONS }; /* of an instrument with friction */

_Static_assert(sizeof(tm_friction_state) == 4 * sizeof(double), "without padding");

int64_t tm_friction_snapshot(void *self, void *buffer) {
    const tm_friction *f = self;
    int64_t bytes = 0;
    for (int32_t t = 0; t < f->contact->tool_count; t++) {
        if (!f->state[t]) continue;
        if (buffer) memcpy((char *)buffer + bytes, f->state[t], NUMBERS * sizeof(double));
        bytes += NUMBERS * (int64_t)sizeof(double);
    }
    return bytes;
}

bool tm_friction_restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    (void)world;
    tm_friction *f = self;
    if (bytes != tm_friction_snapshot(self, NULL)) return false;
    for (int64_t i = 0; i < bytes / (int64_t)sizeof(double); i++) {
        double number;
        memcpy(&number, (const char *)buffer + i * (int64_t)sizeof number, sizeof number);
        if (!isfinite(number) || (i % 4 == 3 && !(number >= 0 && number <= 1))) return false;
    }
    const char *from = buffer;
    for (int32_t t = 0; t < f->contact->tool_count && apply; t++) {
        f->placings[t] = f->contact->tool[t].placings;
        if (!f->state[t]) continue;
        memcpy(f->state[t], from, NUMBERS * sizeof(double));
        from += NUMBERS * sizeof(double);
    }
    if (apply) f->touch_count = 0;
    return true;
}

void tm_friction_checkpoint(void *self) {
    tm_friction *f = self;
    for (int32_t t = 0; t < f->contact->tool_count; t++)
        if (f->state[t]) memcpy(f->saved[t], f->state[t], NUMBERS * sizeof(double));
}

void tm_friction_rollback(void *self, tm_world *world) {
    (void)world;
    tm_friction *f = self;
    for (int32_t t = 0; t < f->contact->tool_count; t++)
        if (f->state[t]) memcpy(f->state[t], f->saved[t], NUMBERS * sizeof(double));
}
