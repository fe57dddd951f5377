/* Begins a reuse interval after a full solve: sets its length, the treatment of each tool, and its frozen rows. */
#include "hybrid.h"

#include <math.h>
#include <string.h>

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

static const double NEAR = 1.25;           /* radii from the axis: vertices with mass there may be touched within an
                                            * interval */
static const double MARGIN = 0.25;         /* radii that a tool may move within an interval: the gathered margin is
                                            * larger, */
static const double MARGIN_FROZEN = 0.1;   /* if its rows are frozen, */
static const double MARGIN_AWAITED = 0.02; /* and if it may touch condensed tissue at any moment */
enum { AWAITED = 4 };                      /* maximum substeps in that case */
static const double JUMP_MAX = 1e-2;       /* of the force, at the end of an interval: shorter ones next; */
static const double JUMP_LITTLE = 0.4e-2;  /* longer ones */
static const double JUMP_OF_N = 0.02;      /* smallest force that jumps are compared with */
/* Relative to the force, per substep; smaller growth is ignored. */
static const double GROWTH_MAX = 0.5e-2, GROWTH_MIN = 1e-6;

/* Returns whether frozen rows may not include the vertex: a cut may have removed most mass of an interface vertex. */
static bool is_light(const tm_hybrid *h, int32_t vertex) {
    return h->vertex_kind[vertex] == TMS_DYNAMIC || (h->vertex_kind[vertex] == TMS_INTERFACE && h->reuse->cut);
}

/* Tissue around a tool, by what it may touch. */
typedef struct neighbourhood {
    bool rows, condensed_rows, light_rows, light_near, mass_around, condensed_around;
} neighbourhood;

static neighbourhood around(const tm_hybrid *h, int32_t t) {
    const tms_contact_solver *l = &h->solver_contact;
    const tms_tool *tool = &l->tool[t];
    const int32_t *vertex, count = tool->near ? tm_contact_search_vertices(tool->search, &vertex) : 0;
    neighbourhood c = {0};
    for (int32_t i = 0; i < l->now.count; i++) {
        if (l->now.row[i].instrument != t) continue;
        c.rows = true;
        for (int k = 0; k < 3; k++) {
            c.condensed_rows |= tms_row_is_in(h, &l->now.row[i], k, TMS_CONDENSED);
            c.light_rows |= l->now.row[i].weight[k] != 0 && is_light(h, l->now.row[i].vertex[k]);
        }
    }
    for (int32_t i = 0; i < count; i++) {
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = l->mesh->rest_m[3 * (int64_t)vertex[i] + k] + l->u_m[3 * (int64_t)vertex[i] + k];
        const bool mass = h->vertex_kind[vertex[i]] != TMS_CONDENSED;
        c.mass_around |= mass;
        c.condensed_around |= !mass;
        c.light_near |= is_light(h, vertex[i]) &&
                        vsegment(at, tool->capsule.tip_m, tool->capsule.tail_m) < NEAR * tool->def.radius_m;
    }
    return c;
}

/* Classifies a tool; returns false if tissue of both kinds carries it. */
static bool classify(tm_hybrid *h, int32_t t) {
    tms_contact_reuse *s = h->reuse;
    const tms_tool *tool = &h->solver_contact.tool[t];
    const neighbourhood c = around(h, t);
    s->kind[t] = !tms_contact_solver_can_touch(tool)  ? TMS_TOOL_NONE
                 : c.mass_around && !c.condensed_rows ? TMS_TOOL_TRACKED
                                                      : TMS_TOOL_FROZEN;
    memcpy(s->at_m[t], tool->capsule.tip_m, 24);
    memcpy(s->at_m[t] + 3, tool->capsule.tail_m, 24);
    const bool awaited = !c.rows && c.condensed_around;
    s->margin_m[t] = tool->def.radius_m * (awaited ? MARGIN_AWAITED : c.condensed_rows ? MARGIN_FROZEN : MARGIN);
    if (awaited) s->max_age = AWAITED;
    return !(c.condensed_rows && (c.light_rows || c.light_near));
}

static double offset_of(const tm_hybrid *h, const tm_contact_row *row) {
    double point[3],
        sum = row->gap_m + tms_contact_reuse_station(&h->solver_contact.tool[row->instrument].capsule, row, point);
    for (int a = 0; a < 9; a++) {
        const int32_t d = 3 * row->vertex[a / 3] + a % 3;
        const double base = h->vertex_kind[d / 3] == TMS_INTERFACE ? 0
                            : h->interface_index[d] < 0            ? h->value_m[d]
                                                                   : h->responses.base_m[h->interface_index[d]];
        if (row->weight[a / 3] != 0) sum -= row->weight[a / 3] * row->normal[a % 3] * (h->solver_contact.u_m[d] - base);
    }
    return sum;
}

void tms_contact_reuse_begin(tm_hybrid *h, bool swept) {
    tms_contact_solver *l = &h->solver_contact;
    tms_contact_reuse *s = h->reuse;
    s->cut = tm_tissue_alive_count(tm_world_tissue(h->world)) != s->whole_count;
    bool good = l->converged && !swept && l->now.count <= TMS_REUSE_ROWS;
    s->max_age = TMS_REUSE_MAX;
    for (int32_t t = 0; t < l->tool_count; t++) good = classify(h, t) && good;
    if (!good) {
        tms_contact_reuse_forget(h);
        return;
    }
    s->limit = s->length < s->max_age ? s->length : s->max_age;
    s->age = s->frozen_count = 0;
    memset(s->predicted_growth, 0, sizeof s->predicted_growth);
    for (int32_t i = 0; i < l->now.count; i++) {
        const bool frozen = s->kind[l->now.row[i].instrument] == TMS_TOOL_FROZEN;
        s->frozen[i] = frozen ? s->frozen_count++ : -1;
        s->offset_m[i] = frozen ? offset_of(h, &l->now.row[i]) : 0;
    }
    tms_contact_reuse_build(h);
}

/* --- results of the previous interval --- */

tms_reuse_past tms_reuse_past_of(const tm_hybrid *h) {
    tms_reuse_past past = {.age = h->reuse->age};
    memcpy(past.predicted_growth, h->reuse->predicted_growth, sizeof past.predicted_growth);
    memcpy(past.force_N, h->solver_contact.now.resultant_N, sizeof past.force_N);
    return past;
}

/* Predicts the force growth of a sliding tool. Its fixed rows make its force drift by an equal amount per substep, also
 * in the next interval. Uses only the part on which two intervals agree, so that equilibrium stays exact. */
static void predict(tms_contact_reuse *s, int32_t t, double drift) {
    const double before = s->last_growth[t], both = fabs(before) < fabs(drift) ? before : drift;
    s->last_growth[t] = drift;
    s->predicted_growth[t] =
        before * drift > 0 && fabs(both) > GROWTH_MIN ? fmin(fmax(both, -GROWTH_MAX), GROWTH_MAX) : 0;
}

/* Returns the largest change of a frozen tool's force, relative to the force. */
static double jump_of(const tm_hybrid *h, const tms_reuse_past *past) {
    const tms_contact_solver *l = &h->solver_contact;
    double most = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        double change[3];
        vsub(l->now.resultant_N[t], past->force_N[t], change);
        const double size = vnorm(l->now.resultant_N[t]), was = vnorm(past->force_N[t]);
        const bool frozen = h->reuse->kind[t] == TMS_TOOL_FROZEN;
        if (frozen) most = fmax(most, vnorm(change) / fmax(size, JUMP_OF_N));
        predict(h->reuse, t,
                frozen && size > JUMP_OF_N && was > JUMP_OF_N ? past->predicted_growth[t] + (size / was - 1) / past->age
                                                              : 0);
    }
    return most;
}

void tms_contact_reuse_judge(tm_hybrid *h, const tms_reuse_past *past) {
    tms_contact_reuse *s = h->reuse;
    if (s->age != 0) return;
    const double jump = jump_of(h, past);
    if (jump > JUMP_MAX && s->length > 1) s->length /= 2;
    if (jump < JUMP_LITTLE) s->length += s->length > 1 ? s->length / 2 : 1;
    if (s->length > TMS_REUSE_MAX) s->length = TMS_REUSE_MAX;
    s->limit = s->length < s->max_age ? s->length : s->max_age;
}
