/* Stage "energy": the energy account of tensormass/energy.h. Central differences have an energy identity: the force at
 * step n does its work over (u+ - u-)/2, and
 *   [v.Mv/2 + u_n.K u_(n+1)/2] at n+1/2 less the same at n-1/2 = f.(u+ - u-)/2 - dt gamma |(u+ - u-)/2dt|^2.
 * Here f are all forces besides the tissue's own, multipliers of constraints included. */
#include "contact/friction_internal.h"
#include "energy/law_memo.h"
#include "tensormass/energy.h"
#include "touch/touch_internal.h"
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* Previous positions of an instrument, for the motion of its points over two steps. */
typedef struct past {
    int32_t placings;
    tm_capsule capsule;   /* at the start of the previous step */
    tm_tool_pose pose[2]; /* at the end of the last step, and of the one before */
    tm_jaw jaw[2];
} past;

/* State that is saved at the start of a step. */
typedef struct account {
    tm_energy sum;
    double stored_J;                                 /* kinetic and elastic after the last step */
    double contact_stored_J[2], contact_stored_at_J; /* in contact compliance and grasp springs at the ends of the last
                                                two steps; when the account began */
    double touch_stored_J;                           /* in the compliance of touching tissue after the last step */
    int64_t next_step;                               /* number of the next step; negative: none yet */
    int32_t revision;                                /* revision of the surface then */
    past past[TM_MAX_INSTRUMENTS];
} account;

typedef struct energy {
    tm_pool pool;
    tm_world *world;
    account now, saved;
    double *internal_N; /* [3*vertex_count] the tissue's own force, from the stage "force" */
    double *reaction_N; /* [3*vertex_count] of the supports */
    uint8_t *fixed;     /* [3*vertex_count] */
    const void *fixed_by;
    tm_law_memo law;
} energy;

/* --- the tissue --- */

typedef struct pass {
    double before_J, kinetic_J, elastic_J, damping_J, gravity_J, outer_J, support_J, eased_J;
} pass;

static pass over_tissue(const energy *e, const tm_world *world) {
    const tm_state *s = &world->state;
    const double *g = tm_world_gravity_m_s2(world), *inner = e->internal_N, dt = s->dt_s;
    double kinetic_before = 0, kinetic = 0, elastic_before = 0, elastic = 0, drag = 0;
    pass p = {0};
    for (int32_t v = 0; v < world->tissue->mesh->vertex_count; v++) {
        const double mass = world->tissue->mass_kg[v], gamma = world->damped ? world->tissue->damping_kg_s[v] : 0;
        if (world->mobility_s2_kg[v] <= 0) continue;
        for (int32_t i = 3 * v; i < 3 * v + 3; i++) {
            const double came = s->u_m[i] - s->u_prev_m[i], goes = s->u_next_m[i] - s->u_m[i];
            const double way = 0.5 * (s->u_next_m[i] - s->u_prev_m[i]);
            kinetic_before += mass * came * came;
            kinetic += mass * goes * goes;
            elastic_before -= s->u_prev_m[i] * inner[i];
            elastic -= s->u_next_m[i] * inner[i];
            drag += gamma * way * way;
            p.outer_J += (s->force_N[i] - inner[i]) * way;
            p.gravity_J += world->tissue->physical_mass_kg[v] * g[i - 3 * v] * way;
            p.support_J += e->reaction_N[i] * way;
        }
    }
    p.before_J = 0.5 * (kinetic_before / (dt * dt) + elastic_before);
    p.kinetic_J = 0.5 * kinetic / (dt * dt);
    p.elastic_J = 0.5 * elastic;
    p.damping_J = drag / dt;
    return p;
}

/* Adds the energy of a nonlinear law, a function of the state: half of it at each end of a step, and (f' - f).(u' -
 * u)/4 of its force. Together they are what the scheme conserves for small motions. over_tissue counted the work of its
 * force as that of a load: it is removed here, as is the work of the force that corrects the energy of the step. */
static void over_law(tm_law_memo *memo, const tm_world *world, pass *p) {
    const tm_state *s = &world->state;
    const tm_nonlinear *law = world->nonlinear;
    const double *added = law->added_N ? law->added_N(law->self) : NULL;
    const int32_t all[2] = {0, world->tissue->mesh->vertex_count};
    const tm_ranges whole = {1, all}, *where = law->where ? law->where : &whole;
    const double *u[3] = {s->u_prev_m, s->u_m, s->u_next_m};
    double energy_J[3];
    for (int k = 0; k < 3; k++) {
        const double *force = tm_law_memo_get(memo, world, u[k], energy_J + k);
        for (int32_t r = 0; r < where->count; r++)
            for (int32_t i = 3 * where->end[2 * r]; i < 3 * where->end[2 * r + 1]; i++) {
                if (world->mobility_s2_kg[i / 3] <= 0) continue;
                const double came = 0.25 * force[i] * (s->u_m[i] - s->u_prev_m[i]);
                const double goes = 0.25 * force[i] * (s->u_next_m[i] - s->u_m[i]);
                const double way = 0.5 * (s->u_next_m[i] - s->u_prev_m[i]);
                if (k < 2) p->before_J += k == 1 ? came : -came;
                if (k > 0) p->elastic_J += k == 2 ? goes : -goes;
                if (k == 1) p->outer_J -= (force[i] + (added ? added[i] : 0)) * way;
            }
    }
    p->before_J += 0.5 * (energy_J[0] + energy_J[1]);
    p->elastic_J += 0.5 * (energy_J[1] + energy_J[2]);
}

static void over_part(energy *e, tm_world *world, pass *p) {
    tm_part_energy part = {0};
    world->energy_part->work(world->energy_part->self, world, &part);
    p->before_J += part.before_J;
    p->elastic_J += part.stored_J;
    p->outer_J -= part.outer_J;
    p->damping_J += part.lost_J + part.eased_J;
    p->eased_J = part.eased_J;
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) e->now.sum.contact_J[t] += part.contact_J[t];
}

/* --- the tools --- */

/* Returns whether a vertex belongs to another part than the world's tissue; that part knows its motion. */
static bool is_elsewhere(const tm_world *world, int32_t vertex) {
    return world->energy_part && world->mobility_s2_kg[vertex] <= 0;
}

/* Computes the work of a force on a vertex. Work on a prescribed component goes to the support. */
static double on_vertex(energy *e, const tm_state *s, int32_t vertex, const double force_N[3]) {
    double work = 0;
    for (int32_t i = 3 * vertex, c = 0; c < 3; i++, c++) {
        const double part = 0.5 * force_N[c] * (s->u_next_m[i] - s->u_prev_m[i]);
        work += part;
        if (e->fixed[i]) e->now.sum.support_J -= part;
    }
    return work;
}

/* Returns the energy in the row's contact compliance. */
static double row_work(energy *e, const tm_contact *contact, int32_t i) {
    const tm_contact_row *row = contact->row + i;
    const tm_state *s = &contact->world->state;
    const tm_row_energy w = tm_contact_row_energy(contact, i, &e->now.past[row->instrument].capsule);
    static const double none[3] = {0, 0, 0};
    const double *friction_N =
        contact->friction ? contact->friction->applied_N[i] : none; /* share of friction in the drag */
    double viscous_N[3], work = 0, slip;
    vsub(contact->solver[i].drag_N, friction_N, viscous_N);
    slip = -vdot(viscous_N, w.travel_m);
    for (int j = 0; j < 3; j++) {
        double share[3];
        if (is_elsewhere(contact->world, row->vertex[j])) continue;
        vscale(row->weight[j], w.force_N, share);
        work += on_vertex(e, s, row->vertex[j], share);
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * row->vertex[j] + c;
            slip += row->weight[j] * viscous_N[c] * (s->u_next_m[d] - s->u_prev_m[d]);
        }
    }
    e->now.sum.tool_work_J[row->instrument] += w.tool_work_J;
    e->now.sum.contact_J[row->instrument] += work;
    e->now.sum.drag_J -= 0.5 * slip;
    return w.compliance_J;
}

/* Returns the energy in the compliance of fading rows. */
static double fading_work(energy *e, const tm_contact *contact) {
    double contact_stored = 0;
    for (int32_t i = 0; contact->fading && i < contact->fading->count; i++) {
        const tm_fading_row *row = contact->fading->row + i;
        double here[3], there[3], way[3];
        tm_capsule_station(&contact->tool[row->instrument].capsule, row->station, here);
        tm_capsule_station(&e->now.past[row->instrument].capsule, row->station, there);
        vsub(here, there, way);
        e->now.sum.tool_work_J[row->instrument] += 0.5 * row->lambda_N * vdot(row->normal, way);
        for (int j = 0; j < 3; j++) {
            double share[3];
            vscale(row->weight[j] * row->lambda_N, row->normal, share);
            e->now.sum.contact_J[row->instrument] += on_vertex(e, &contact->world->state, row->vertex[j], share);
        }
        contact_stored += 0.5 * row->compliance_m_N * row->lambda_N * row->lambda_N;
    }
    return contact_stored;
}

/* Returns the energy in the jaw's springs. */
static double jaw_work(energy *e, const tm_contact *contact, int32_t t) {
    const tm_jaw_load load = tm_contact_load(contact, t);
    double contact_stored = 0;
    const past *was = e->now.past + t;
    for (int32_t i = 0; i < load.count; i++) {
        const double *force = load.force_N + 3 * i;
        double here[3], there[3];
        e->now.sum.grasp_J[t] += on_vertex(e, &contact->world->state, load.vertex[i], force);
        tm_jaw_to_world(load.jaw, &contact->tool[t].pose, load.offset_m + 3 * i, here);
        tm_jaw_to_world(&was->jaw[1], &was->pose[1], load.offset_m + 3 * i, there);
        for (int c = 0; c < 3; c++) e->now.sum.tool_work_J[t] += 0.5 * force[c] * (here[c] - there[c]);
        contact_stored += 0.5 * load.compliance_m_N * vdot(force, force);
    }
    return contact_stored;
}

static void remember(past *p, const tm_contact *contact, int32_t t, bool anew) {
    const tm_tool *tool = contact->tool + t;
    const tm_jaw_load load = tm_contact_load(contact, t);
    p->placings = tool->placings;
    p->capsule = tool->previous;
    p->pose[1] = anew ? tool->pose : p->pose[0];
    p->pose[0] = tool->pose;
    if (!load.jaw) return;
    p->jaw[1] = anew ? *load.jaw : p->jaw[0];
    p->jaw[0] = *load.jaw;
}

static void over_tools(energy *e, tm_world *world, bool anew) {
    const tm_contact *contact = tm_world_contact(world);
    double contact_stored = 0;
    for (int32_t t = 0; contact && t < contact->tool_count; t++)
        if (anew || e->now.past[t].placings != contact->tool[t].placings) remember(e->now.past + t, contact, t, true);
    for (int32_t i = 0; contact && i < contact->row_count; i++)
        if (contact->row[i].lambda_N > 0) contact_stored += row_work(e, contact, i);
    if (contact) contact_stored += fading_work(e, contact);
    for (int32_t t = 0; contact && t < contact->tool_count; t++) {
        contact_stored += jaw_work(e, contact, t);
        remember(e->now.past + t, contact, t, false);
    }
    if (contact && contact->friction) {
        contact_stored += tm_friction_stretched_J(contact->friction);
        e->now.sum.friction_J += contact->friction->lost_J;
    }
    account *a = &e->now;
    if (a->next_step < 0) a->contact_stored_at_J = contact_stored;
    a->contact_stored_J[0] = anew ? contact_stored : a->contact_stored_J[1];
    a->contact_stored_J[1] = contact_stored;
}

/* --- tissue on tissue --- */

static void on_tie(void *self, int32_t vertex, const double force_N[3]) {
    energy *e = self;
    e->now.sum.touch_J += on_vertex(e, &e->world->state, vertex, force_N);
}

/* Energy in the compliance at the middle of the last step is the mean of both ends'. */
static void over_touch(energy *e, tm_world *world) {
    const tm_touching *touching = tm_world_touching(world);
    account *a = &e->now;
    double contact_stored = 0;
    const tm_touching_row *row = NULL;
    const int32_t count = touching ? tm_touching_rows(touching, &row) : 0;
    for (int32_t i = 0; i < count; i++) {
        if (row[i].lambda_N == 0) continue;
        double force[3], share[3];
        vmadd(row[i].across_N, row[i].lambda_N, row[i].normal, force);
        for (int j = 0; j < 4; j++) {
            vscale(row[i].weight[j], force, share);
            a->sum.touch_J += on_vertex(e, &world->state, row[i].vertex[j], share);
        }
        contact_stored += tm_touching_stored_J(touching, i);
    }
    contact_stored += tm_ties_energy(world, e, on_tie);
    a->sum.touch_stored_J = 0.5 * (a->touch_stored_J + contact_stored);
    a->touch_stored_J = contact_stored;
}

/* --- the stage --- */

static void run(void *self, tm_world *world) {
    energy *e = self;
    account *a = &e->now;
    const size_t n = 3 * (size_t)world->tissue->mesh->vertex_count;
    const bool anew = a->next_step != world->state.step;
    if (e->fixed_by != world->support) {
        e->fixed_by = world->support;
        memset(e->fixed, 0, n);
        tm_support_mask(world, e->fixed);
    }
    memset(e->reaction_N, 0, sizeof(double) * n);
    tm_support_reaction_of_tissue(world, e->reaction_N);
    pass p = over_tissue(e, world);
    if (world->nonlinear) over_law(&e->law, world, &p);
    if (world->energy_part) over_part(e, world, &p);
    if (a->next_step < 0)
        a->sum.start_J = p.before_J;
    else if (a->revision != world->tissue->surface.revision && !anew)
        a->sum.cut_J += a->stored_J - p.before_J - p.eased_J; /* damping_J has eased_J already */
    else
        a->sum.state_change_J += p.before_J + p.eased_J - a->stored_J;
    over_tools(e, world, anew);
    if (world->touching || world->ties || a->sum.touch_stored_J > 0) over_touch(e, world);
    a->sum.gravity_J += p.gravity_J;
    a->sum.load_J += p.outer_J - p.gravity_J;
    a->sum.support_J += p.support_J;
    a->sum.damping_J += p.damping_J;
    a->sum.kinetic_J = p.kinetic_J;
    a->sum.elastic_J = p.elastic_J;
    a->sum.time_s = world->state.time_s + 0.5 * world->state.dt_s;
    a->stored_J = p.kinetic_J + p.elastic_J;
    a->revision = world->tissue->surface.revision;
    a->next_step = world->state.step + 1;
}

static void checkpoint(void *self) {
    energy *e = self;
    e->saved = e->now;
}

static void rollback(void *self, tm_world *world) {
    (void)world;
    energy *e = self;
    e->now = e->saved;
    tm_law_memo_forget(&e->law); /* another cut may have this revision next */
}

static void destroy(void *self) {
    energy *e = self;
    if (e->world->internal_N == e->internal_N) e->world->internal_N = NULL;
    tm_pool pool = e->pool;
    tm_pool_release(&pool);
}

tm_status tm_stage_energy(tm_world *world, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    tm_pool pool = {0};
    const int64_t n = 3 * (int64_t)world->tissue->mesh->vertex_count;
    energy *self = TM_ALLOC(&pool, energy, 1);
    double *internal = TM_ALLOC(&pool, double, n), *reaction = TM_ALLOC(&pool, double, n);
    uint8_t *fixed = TM_ALLOC(&pool, uint8_t, n);
    tm_law_memo memo = {0};
    if (world->nonlinear) tm_law_memo_init(&memo, &pool, world->tissue->mesh);
    if (pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "energy stage");
    }
    *self = (energy){
        .pool = pool, .world = world, .internal_N = internal, .reaction_N = reaction, .fixed = fixed, .law = memo};
    self->now.next_step = -1;
    const tm_stage stage = {.size = sizeof stage,
                            .name = "energy",
                            .phase = TM_PHASE_END,
                            .run = run,
                            .destroy = destroy,
                            .self = self,
                            .checkpoint = checkpoint,
                            .rollback = rollback};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status)
        destroy(self);
    else
        world->internal_N = internal;
    return status;
}

void tm_world_set_energy_part(tm_world *world, const tm_energy_part *part) {
    TM_REQUIRE(world && (!part || part->work), "world or part->work is null", );
    world->energy_part = part;
}

tm_status tm_world_energy(const tm_world *world, tm_energy *account_of, tm_error *error) {
    TM_REQUIRE(world && account_of, "world or energy is null", TM_ERR_ARGUMENT);
    const account *a = NULL;
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.run == run) a = &((const energy *)world->entry[i].stage.self)->now;
    if (!a) return tm_fail(error, TM_ERR_ARGUMENT, -1, "this world has no energy account; add it with tm_stage_energy");
    tm_energy *s = account_of;
    *s = a->sum;
    double tools = 0, hands = 0;
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) {
        tools += s->contact_J[t] + s->grasp_J[t];
        hands += s->tool_work_J[t];
    }
    s->contact_stored_J = 0.5 * (a->contact_stored_J[0] + a->contact_stored_J[1]);
    s->generated_J = tools + s->drag_J + s->friction_J + s->contact_stored_J - a->contact_stored_at_J - hands;
    s->residual_J = s->start_J + tools + s->touch_J + s->support_J + s->gravity_J + s->load_J + s->state_change_J -
                    s->damping_J - s->cut_J - s->kinetic_J - s->elastic_J;
    return TM_OK;
}
