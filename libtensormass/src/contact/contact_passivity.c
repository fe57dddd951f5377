/* Limits the energy that contact generates, in every substep. Contact can give the tissue energy that no hand supplied.
 * Rows come and go while tissue moves, start from depths of other rows, and push out tissue that is too deep. Above
 * all, their normals are blended over facets, which is the gradient of no potential. So each tool has an energy account
 * (passivity observer and controller, Hannaford and Ryu 2002), exact in the integrator's terms: the energy that its
 * rows give the tissue and store in their compliance, minus tool work and concurrent damping. In any window up to
 * LAW_WINDOW_S it may not exceed WINDOW_SHARE of the stored energy. In total it may not exceed what contact took
 * before, plus a credit. If it would, the forces of all rows of the tool are reduced. In equilibrium no energy is given
 * and no force changes. */
#include "base/vec.h"
#include "contact/friction_internal.h"
#include "contact_law/compliance.h"

/* Limit of the energy that a tool's rows generate in a window: this share of the energy stored under the tool (for a
 * cautery that cuts: in all tissue); and the amount below which nothing is done, J. */
static const double WINDOW_SHARE = 1.1e-2, LITTLE_J = 2e-8;
/* Energy that contact takes goes to a reserve, at most the stored energy. All that contact generates is taken from it.
 * It may be overdrawn by this share of the stored energy, and again only after that is paid back: the static force
 * along blended normals depends on the path. A tool that climbs onto a vertex needs up to 0.16, and gives it back
 * beyond: a slow tool has more, one that rests most. */
static const double CREDIT_SHARE = 0.06, CREDIT_SHARE_AT_REST = 0.25;
/* Below this speed a tool may take this share of reaction times travel from the reserve (sliding_J). */
static const double SLOW_M_S = 0.05, SLIDING_SHARE = 0.5;
/* Minimum share of its debt that a tool pays back in a substep. */
static const double DEBT_SHARE = 0.125;
/* Share of the window's limit from which the estimate of the stored energy is checked. */
static const double LOOKED_AT = 0.25;
/* Travel below this comes from rounding, on a path between equal poses. */
static const double LITTLE_M = 1e-12;
enum { ITERATIONS = 4, HALVINGS = 30 };

static double compliance_J(const tm_contact *contact, const tm_contact_row *row, double share) {
    const double compliance = contact->def.contact_compliance_m_N / row->share;
    if (!(compliance > 0)) return 0;
    return law_compliance_energy(compliance, LAW_COMPLIANCE_TRAVEL * contact->tool[row->instrument].def.radius_m,
                                 share * row->lambda_N);
}

tm_row_energy tm_contact_row_energy(const tm_contact *contact, int32_t i, const tm_capsule *earlier) {
    const tm_contact_row *row = contact->row + i;
    const tm_tool *tool = contact->tool + row->instrument;
    tm_row_energy w = {.compliance_J = compliance_J(contact, row, 1)};
    double here[3], there[3];
    tm_capsule_station(&tool->capsule, row->station, here);
    tm_capsule_station(earlier, row->station, there);
    for (int c = 0; c < 3; c++) {
        w.force_N[c] = row->lambda_N * row->normal[c] + contact->solver[i].drag_N[c];
        w.travel_m[c] = here[c] - there[c];
        w.tool_work_J += 0.5 * w.force_N[c] * w.travel_m[c];
    }
    return w;
}

/* Computes the work of one row. Friction is added to the drag only after the sweeps; until then it is added here. */
static tm_row_energy row_work(const tm_contact *contact, int32_t i) {
    tm_row_energy w = tm_contact_row_energy(contact, i, &contact->tool[contact->row[i].instrument].earlier);
    if (!contact->friction || contact->friction->joined) return w;
    const double *friction_N = contact->friction->applied_N[i];
    vmadd(w.force_N, 1, friction_N, w.force_N);
    w.tool_work_J += 0.5 * vdot(friction_N, w.travel_m);
    return w;
}

/* Rows of one tool, which are consecutive in the list. */
typedef struct span {
    int32_t first, end;
} span;

static span rows_of(const tm_contact *contact, int32_t t, int32_t first) {
    span s = {first, first};
    while (s.end < contact->row_count && contact->row[s.end].instrument == t) s.end++;
    return s;
}

/* Work of all rows of a tool over the two steps around their force, as in the scheme. */
typedef struct row_sum {
    double tissue_J, tool_work_J;
    /* Half of the forces times the displacements under them: the energy stored in tissue that only they load. */
    double strain_J;
} row_sum;

static row_sum sum_work(const tm_contact *contact, span s) {
    const tm_state *state = &contact->world->state;
    row_sum sum = {0};
    for (int32_t i = s.first; i < s.end; i++) {
        const tm_contact_row *row = contact->row + i;
        if (!(row->lambda_N > 0)) continue;
        const tm_row_energy w = row_work(contact, i);
        sum.tool_work_J += w.tool_work_J;
        for (int j = 0; j < 3; j++)
            for (int c = 0; c < 3; c++) {
                const int32_t dof = 3 * row->vertex[j] + c;
                const double half = 0.5 * w.force_N[c] * row->weight[j];
                sum.tissue_J += half * (state->u_next_m[dof] - state->u_prev_m[dof]);
                sum.strain_J += half * state->u_m[dof];
            }
    }
    return sum;
}

/* Returns the energy in the tool's contact compliance, normal and tangential, with all forces scaled by `share`. */
static double contact_stored_J(const tm_contact *contact, int32_t t, span s, double share) {
    double sum = contact->friction ? share * share * tm_friction_stretch_J(contact->friction, t) : 0;
    for (int32_t i = s.first; i < s.end; i++)
        if (contact->row[i].lambda_N > 0) sum += compliance_J(contact, contact->row + i, share);
    return sum;
}

/* Returns the energy given to tissue and compliance beyond the tool work, over two steps: tm_energy.generated_J without
 * drag and friction. */
static double gain_J(const tm_tool *tool, const row_sum *sum, double contact_stored) {
    return sum->tissue_J - sum->tool_work_J + 0.5 * (contact_stored - tool->contact_stored_J[1]);
}

/* --- the limit --- */

/* Returns whether the tool is a cautery that cuts. It meets freshly exposed walls, under which nothing is stored yet:
 * to press them it may generate a share of the energy in all tissue. */
static bool cuts(const tm_contact *contact, const tm_tool *tool) {
    return tool->def.mode == TM_TOOL_CAUTERY && tool->pose.active && contact->world->tissue->cuttable;
}

/* Returns the travel of the tool's tip in this substep. */
static double tip_travel_m(const tm_tool *tool) {
    double here[3], there[3], way[3];
    tm_capsule_station(&tool->capsule, 0, here);
    tm_capsule_station(&tool->previous, 0, there);
    vsub(here, there, way);
    return vnorm(way);
}

/* Returns 1 for a travel of 0 in a substep, 0 from SLOW_M_S on. */
static double slowness(double way_m, double dt_s) { return law_max(1 - way_m / (SLOW_M_S * dt_s), 0); }

/* Returns the part of a travel in a substep that counts as slow. */
static double slow_m(const tm_contact *contact, double way_m) {
    return way_m * slowness(way_m, contact->world->state.dt_s);
}

/* Returns the share of the stored energy by which a tool may overdraw its reserve. */
static double credit_share(const tm_contact *contact, const tm_tool *tool) {
    if (cuts(contact, tool)) return CREDIT_SHARE; /* of the energy in all tissue */
    const double slow = slowness(tip_travel_m(tool), contact->world->state.dt_s);
    return CREDIT_SHARE + (CREDIT_SHARE_AT_REST - CREDIT_SHARE) * slow;
}

/* Returns what is left of the reserve and the other allowances. */
static double available_J(const tm_contact *contact, const tm_tool *tool) {
    const double credit_J = credit_share(contact, tool) * tool->stored_J;
    return law_max(tool->reserve_J + credit_J + law_max(LITTLE_J, tool->placed_J), 0);
}

/* Returns the limit in a window. */
static double window_J(const tm_tool *tool) {
    return WINDOW_SHARE * tool->stored_J + law_max(LITTLE_J, tool->placed_J);
}

static double recent_generated_J(const tm_tool *tool) {
    return law_ledger_recent(tool->generated_J, tool->min_generated_J);
}

/* Returns the energy that may be generated in this substep, of what is available. */
static double allowed_J(const tm_tool *tool, double available) {
    return law_max(law_min(window_J(tool) - recent_generated_J(tool), available), 0);
}

/* Returns the allowance of a tool that slides slowly. Depths are measured to triangles, but normals are blended as if
 * the surface were smooth. So a tool is held back up to the middle of a triangle and pushed on from there. Without the
 * allowance its force would lag behind the static one. */
static double sliding_J(const tm_contact *contact, span s, double available) {
    double sum = 0;
    for (int32_t i = s.first; i < s.end; i++)
        sum += contact->row[i].lambda_N * slow_m(contact, vnorm(contact->solver[i].moved_m));
    return law_min(SLIDING_SHARE * sum, available);
}

double tm_contact_spare_J(const tm_contact *contact, int32_t t, double way_m) {
    const tm_tool *tool = contact->tool + t;
    const double available = available_J(contact, tool),
                 sliding = SLIDING_SHARE * tool->load_N * slow_m(contact, way_m);
    return allowed_J(tool, available) + law_min(sliding, available);
}

static void push(tm_contact *contact, span s, double share) {
    for (int32_t i = s.first; i < s.end; i++) {
        const tm_contact_row *row = contact->row + i;
        if (!(row->lambda_N > 0)) continue;
        const tm_row_energy w = row_work(contact, i);
        for (int j = 0; j < 3; j++) {
            double part[3];
            vscale(share * row->weight[j], w.force_N, part);
            tm_contact_push_vertex(contact, row->vertex[j], part);
        }
    }
}

/* Energy that a tool's rows give, as a function of `share`, with the forces of all tools of the set scaled by it: work
 * is (share) bare + (share^2) own, and 0 at share 0. */
typedef struct bound {
    span rows;
    double bare_J, own_J, tool_work_J, may_J;
} bound;

typedef struct set {
    int32_t first, end; /* tools */
    bound bound[TM_MAX_INSTRUMENTS];
} set;

static bool keeps(const tm_contact *contact, int32_t t, const bound *b, double share) {
    const double gives = share * (b->bare_J - b->tool_work_J) + share * share * b->own_J;
    return gives + 0.5 * (contact_stored_J(contact, t, b->rows, share) - contact->tool[t].contact_stored_J[1]) <=
           b->may_J;
}

/* Returns the largest share at which no tool of the set gives more than allowed. By bisection: the energy of the
 * compliance has a kink. */
static double find_share(const tm_contact *contact, const set *of) {
    double least = 0, most = 1;
    for (int halving = 0; halving < HALVINGS; halving++) {
        const double share = 0.5 * (least + most);
        bool keep = true;
        for (int32_t t = of->first; t < of->end; t++) keep = keep && keeps(contact, t, of->bound + t, share);
        *(keep ? &least : &most) = share;
    }
    return least;
}

static void reduce(tm_contact *contact, set *of) {
    for (int32_t t = of->first; t < of->end; t++) {
        const row_sum sum = sum_work(contact, of->bound[t].rows);
        of->bound[t].tool_work_J = sum.tool_work_J, of->bound[t].own_J = sum.tissue_J;
    }
    for (int32_t t = of->first; t < of->end; t++) push(contact, of->bound[t].rows, -1);
    for (int32_t t = of->first; t < of->end; t++) {
        of->bound[t].bare_J = sum_work(contact, of->bound[t].rows).tissue_J;
        of->bound[t].own_J -= of->bound[t].bare_J;
    }
    const double share = find_share(contact, of);
    for (int32_t t = of->first; t < of->end; t++) {
        const span s = of->bound[t].rows;
        push(contact, s, share);
        for (int32_t i = s.first; i < s.end; i++) {
            contact->row[i].lambda_N *= share;
            vscale(share, contact->solver[i].drag_N, contact->solver[i].drag_N);
        }
        if (contact->friction) tm_friction_scale(contact->friction, t, share);
    }
}

/* Returns kinetic and elastic energy of the tissue, without contact compliance. */
static double held_by_tissue_J(const tm_world *world) {
    const tm_state *s = &world->state;
    const double *g = tm_world_gravity_m_s2(world);
    double moving = 0, strained = 0;
    for (int32_t v = 0; v < world->tissue->mesh->vertex_count; v++)
        for (int32_t i = 3 * v, c = 0; c < 3; i++, c++) {
            const double went = s->u_m[i] - s->u_prev_m[i];
            moving += world->tissue->mass_kg[v] * went * went;
            strained += s->u_m[i] * (world->tissue->physical_mass_kg[v] * g[c] - s->force_N[i]);
        }
    return 0.5 * (moving / (s->dt_s * s->dt_s) + law_max(strained, 0));
}

/* Limits the estimates of stored energy to the total energy, once much of their allowance is used. Costs a pass over
 * the vertices. A nonlinear law's force gives no energy: the estimate then stays. */
static void bound_estimates(tm_contact *contact) {
    if (contact->all_stored_J >= 0 || contact->world->nonlinear) return;
    double estimated = 0, stored = contact->all_stored_J = held_by_tissue_J(contact->world);
    for (int32_t t = 0; t < contact->tool_count; t++) {
        estimated += contact->tool[t].stored_J;
        stored += contact->tool[t].contact_stored_J[0];
    }
    for (int32_t t = 0; t < contact->tool_count && estimated > stored; t++)
        contact->tool[t].stored_J *= stored / estimated;
}

/* Computes the allowance of this substep. Returns whether the tool exceeds it. */
static bool gives_too_much(tm_contact *contact, int32_t t, span s, double *may_J) {
    tm_tool *tool = contact->tool + t;
    const row_sum sum = sum_work(contact, s);
    const double gain = gain_J(tool, &sum, contact_stored_J(contact, t, s, 1));
    if (gain > 1e-3 * LITTLE_J && recent_generated_J(tool) + gain > LOOKED_AT * window_J(tool))
        bound_estimates(contact);
    const double available = available_J(contact, tool);
    tool->sliding_J = sliding_J(contact, s, available);
    *may_J = allowed_J(tool, available) + tool->sliding_J - DEBT_SHARE * tool->debt_J;
    return gain > law_max(*may_J, 0) + 1e-3 * LITTLE_J;
}

/* Reduces the forces of a tool that exceeds its allowance; returns whether it did. */
static bool hold_tool(tm_contact *contact, int32_t t, span s) {
    set alone = {.first = t, .end = t + 1};
    alone.bound[t].rows = s;
    if (s.first == s.end || !gives_too_much(contact, t, s, &alone.bound[t].may_J)) return false;
    reduce(contact, &alone);
    return true;
}

/* Reduces tools on the same tissue that still exceed their allowances after their turns, all by one share. */
static void hold_together(tm_contact *contact) {
    set all = {.end = contact->tool_count};
    bool fixed = false;
    span s = {0, 0};
    for (int32_t t = 0; t < contact->tool_count; t++) {
        all.bound[t].rows = s = rows_of(contact, t, s.end);
        fixed |= gives_too_much(contact, t, s, &all.bound[t].may_J);
        all.bound[t].may_J = law_max(all.bound[t].may_J, 0);
    }
    if (fixed) reduce(contact, &all);
}

void tm_contact_limit_energy(tm_contact *contact) {
    bool fixed = !contact->world->settling;
    if (!fixed) return;
    contact->all_stored_J = -1;
    for (int round = 0; fixed && round < ITERATIONS; round++) { /* tools on the same tissue: in turn */
        span s = {0, 0};
        fixed = false;
        for (int32_t t = 0; t < contact->tool_count; t++) {
            s = rows_of(contact, t, s.end);
            fixed |= hold_tool(contact, t, s);
            fixed |= tm_contact_hold_back_blocks(contact, t);
        }
    }
    if (!fixed) return;
    hold_together(contact);
    for (int32_t t = 0; t < contact->tool_count; t++) tm_contact_hold_back_blocks(contact, t);
}

/* --- the energy account --- */

/* Returns the energy that tissue damping takes in this substep: it pays for what contact generates concurrently. Costs
 * a pass over the vertices, so it is called only if energy was generated. */
static double damped_J(const tm_world *world) {
    const tm_state *s = &world->state;
    double sum = 0;
    for (int32_t v = 0; world->damped && v < world->tissue->mesh->vertex_count; v++) {
        double squares = 0;
        for (int32_t i = 3 * v; i < 3 * v + 3; i++)
            squares += (s->u_next_m[i] - s->u_prev_m[i]) * (s->u_next_m[i] - s->u_prev_m[i]);
        sum += world->tissue->damping_kg_s[v] * squares;
    }
    return 0.25 * sum / s->dt_s;
}

/* Returns the energy stored in all tissue: half its force times displacement, and its gain of potential energy. */
static double all_stored_J(const tm_world *world) {
    const tm_state *s = &world->state;
    double sum = 0;
    for (int32_t i = 0; i < 3 * world->tissue->mesh->vertex_count; i++) sum -= s->u_m[i] * s->force_N[i];
    return law_max(0.5 * sum, 0);
}

/* Returns the stored energy that other tools have a share of. */
static double stored_by_others_J(const tm_contact *contact, int32_t t) {
    double sum = 0;
    for (int32_t i = 0; i < contact->tool_count; i++)
        if (i != t) sum += contact->tool[i].stored_J;
    return sum;
}

/* Adds generated energy. What exceeds the allowance is a debt until less was generated. Two tools on the same tissue
 * cause it: reducing one changes what the other generates. */
static void add_generated(const tm_contact *contact, tm_tool *tool, double generated_J) {
    const double allowed = allowed_J(tool, available_J(contact, tool));
    tool->debt_J = allowed > 0 ? law_max(generated_J - allowed, 0) : law_max(tool->debt_J + generated_J, 0);
    tool->generated_J += generated_J;
}

/* Pays for recently generated energy with damping, not into the reserve: contact that shakes tissue must end. */
static void pay(tm_tool *tool, double paid_J) { tool->generated_J -= law_min(paid_J, recent_generated_J(tool)); }

void tm_contact_observe(tm_contact *contact) {
    if (contact->others.solve) return; /* another solver's rows cannot be reduced here */
    span s = {0, 0};
    double taken = -1;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        s = rows_of(contact, t, s.end);
        const row_sum sum = sum_work(contact, s);
        const double contact_stored = contact_stored_J(contact, t, s, 1), gain = gain_J(tool, &sum, contact_stored);
        if (tip_travel_m(tool) > LITTLE_M) tool->placed_J = 0;
        tool->earlier = tool->previous;
        tool->contact_stored_J[1] = contact->world->settling ? contact_stored : tool->contact_stored_J[0];
        tool->contact_stored_J[0] = contact_stored;
        if (contact->world->settling) continue;
        add_generated(contact, tool, gain > 0 && s.first < s.end ? gain - law_min(gain, tool->sliding_J) : gain);
        tool->reserve_J -= gain;
        tool->throughput_J += sum.tissue_J;
        if (tool->load_N > 0 && recent_generated_J(tool) > 0) {
            if (taken < 0) taken = damped_J(contact->world) + tm_contact_lost_J(contact);
            pay(tool, taken / contact->tool_count);
        }
        double stored = contact_stored + law_max(law_min(sum.strain_J, tool->throughput_J), 0);
        if (cuts(contact, tool))
            stored = law_max(stored, all_stored_J(contact->world) - stored_by_others_J(contact, t));
        tool->stored_J = stored;
        tool->reserve_J = law_min(tool->reserve_J, stored);
        law_ledger_advance(tool->generated_J, tool->min_generated_J, &tool->ledger_s, contact->world->state.dt_s);
    }
}
