/* Stage "viscosity": a Prony series. Each term stores one displacement per vertex, q_i, that follows u with the term's
 * time, and the force is
 *     -K u + sum_i (shear_i D + volume_i W) q_i  =  -K (u - sum_i shear_i q_i) + W sum_i (volume_i - shear_i) q_i,
 * K = D + W, W the bulk modulus' part. The law is linear, so a history of displacements is one of stresses. Equal
 * shares need no second pass. q is updated at the end of a step, along the straight line from u to u_next. A nonlinear
 * law has terms of its own (viscosity.h). */
#include "material/bulk.h"
#include "world/viscosity.h"

#include <math.h>
#include <string.h>

typedef struct viscosity {
    tm_pool pool;
    tm_world *world;
    tm_ranges where; /* vertices of linear bodies that relax */
    int32_t n;       /* components of these, from the first to the last vertex */
    int64_t saved;   /* numbers that a term stores */
    tm_viscosity_def def;
    tm_fading fading[TM_VISCOSITY_TERMS];
    double *kept[TM_VISCOSITY_TERMS], *saved_m[TM_VISCOSITY_TERMS]; /* [saved]; saved_m: when the step began */
    double *q_m[TM_VISCOSITY_TERMS];                                /* `kept`, by the mesh's vertices */
    double *strained_m;                                             /* [n] u - sum shear_i q_i */
    double *nodal_dilatation_m;                                     /* [n] sum (volume_i - shear_i) q_i, or null: 0 */
    tm_bulk bulk;
    /* Of a nonlinear law, which computes its terms and has histories per tetrahedron instead; else null. */
    const struct tm_relaxing_law *law;
    void *law_self;
} viscosity;

/* --- the step --- */

static void strain_range(const viscosity *v, int32_t begin, int32_t end) {
    const double *TM_RESTRICT u = v->world->state.u_m;
    double *TM_RESTRICT strained = v->strained_m, *TM_RESTRICT dilatation = v->nodal_dilatation_m;
    for (int32_t t = 0; t < v->def.count; t++) {
        const double *TM_RESTRICT q = v->q_m[t], *TM_RESTRICT from = t ? strained : u;
        const double shear = v->def.term[t].shear, more = v->def.term[t].bulk - shear;
        for (int32_t i = begin; i < end; i++) strained[i] = from[i] - shear * q[i];
        for (int32_t i = begin; dilatation && i < end; i++) dilatation[i] = (t ? dilatation[i] : 0) + more * q[i];
    }
}

static void strain_part(void *context, int32_t part) {
    const viscosity *v = context;
    const double *TM_RESTRICT u = v->world->state.u_m;
    const tm_force_partition *all = &v->world->partition[part].force;
    for (int32_t i = 0, begin, end; tm_ranges_next(&v->where, &i, all->begin, all->end, &begin, &end);)
        strain_range(v, 3 * begin, 3 * end);
    /* Two passes over a partition may not run concurrently: this one uses a copy of it. */
    tm_force_partition own = v->world->partition[part].force;
    const tm_tissue *tissue = v->world->tissue;
    if (v->world->internal_N) tissue->force(&tissue->graph, &own, own.begin, own.end, u, v->world->internal_N);
}

/* Complete before "force" begins, which reads all vertices. */
static void run_strained(void *self, tm_world *world) { tm_partitions_run(world, strain_part, self); }

/* The law of the stage "force" while there is viscosity. */
static void force_range(void *self, tm_world *world, const tm_range *range) {
    const viscosity *v = self;
    const tm_tissue *tissue = world->tissue;
    tissue->force(&tissue->graph, &world->partition[range->partition].force, range->begin, range->end, v->strained_m,
                  world->state.force_N);
}

/* Adds the bulk modulus' part where shares differ; it is computed by tetrahedra, a complete partition at a time. */
static void bulk_part(void *context, int32_t number) {
    const viscosity *v = context;
    const tm_force_partition *part = &v->world->partition[number].force;
    for (int32_t i = 0, begin, end; tm_ranges_next(&v->where, &i, part->begin, part->end, &begin, &end);)
        tm_bulk_add(&v->bulk, begin, end, v->nodal_dilatation_m, v->world->state.force_N);
}

static void run_bulk(void *self, tm_world *world) { tm_partitions_run(world, bulk_part, self); }

static void follow(const viscosity *v, const tm_world *world, int32_t begin, int32_t end) {
    const double tiny = 1e-60; /* flushes tiny values to zero, as the world does */
    const double *TM_RESTRICT u = world->state.u_m, *TM_RESTRICT next = world->state.u_next_m;
    for (int32_t t = 0; t < v->def.count; t++) {
        const tm_fading f = v->fading[t];
        double *TM_RESTRICT q = v->q_m[t];
        for (int32_t i = begin; i < end; i++)
            q[i] = (f.kept_share * q[i] + f.old * u[i] + f.now * next[i] + tiny) - tiny;
    }
}

static void follow_range(void *self, tm_world *world, const tm_range *range) {
    const viscosity *v = self;
    for (int32_t i = 0, begin, end; tm_ranges_next(&v->where, &i, range->begin, range->end, &begin, &end);)
        follow(v, world, 3 * begin, 3 * end);
}

/* A nonlinear law: its own terms. */
static void run_law(void *self, tm_world *world) {
    const viscosity *v = self;
    (void)world;
    v->law->force(v->law_self);
}

/* --- callbacks --- */

/* Returns the linear bodies that relax; null: all. */
static const tm_ranges *within(const viscosity *v) {
    return tm_ranges_within(&v->where, v->world->tissue->mesh->vertex_count);
}

/* Sets the law of the stage "force": the series, or (false) elastic tissue. */
static void set_force(viscosity *v, bool relaxes) {
    if (v->law)
        v->law->set(v->law_self, v->world, relaxes);
    else
        tm_world_set_force(
            v->world, relaxes ? &(tm_force_provider){"viscosity", v, force_range, within(v), v->strained_m} : NULL);
}

static void step_changed(void *self, tm_world *world) {
    viscosity *v = self;
    tm_fading change[TM_VISCOSITY_TERMS];
    bool changed = false;
    for (int32_t t = 0; t < v->def.count; t++) {
        const double was = v->fading[t].now;
        const tm_fading f = v->fading[t] = tm_fading_of(world->state.dt_s, v->def.term[t].time_s);
        changed = changed || (was > 0 && was != f.now);
        change[t] = (tm_fading){.kept_share = 1, .old = -f.now, .now = was};
    }
    if (!v->law) return;
    v->law->set_step(v->law_self, v->fading);
    if (changed)
        v->law->evaluate(v->law_self, change); /* the present strain is in the history by its share of a step */
}

static int64_t snapshot(void *self, void *buffer) {
    const viscosity *v = self;
    const size_t bytes = sizeof(double) * (size_t)v->saved;
    if (buffer) {
        memcpy(buffer, &v->def, sizeof v->def);
        for (int32_t t = 0; t < v->def.count; t++)
            memcpy((char *)buffer + sizeof v->def + bytes * (size_t)t, v->kept[t], bytes);
    }
    return (int64_t)(sizeof v->def + bytes * (size_t)v->def.count);
}

static bool is_number(double a) { return a - a == 0; }

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    (void)world;
    viscosity *v = self;
    const size_t each = sizeof(double) * (size_t)v->saved;
    if (bytes != snapshot(self, NULL) || memcmp(buffer, &v->def, sizeof v->def)) return false;
    for (int32_t t = 0; t < v->def.count; t++) {
        const double *from = (const double *)((const char *)buffer + sizeof v->def + each * (size_t)t);
        for (int64_t i = 0; i < v->saved; i++)
            if (v->law ? !is_number(from[i]) : !tm_is_place(from[i])) return false;
        if (apply) memcpy(v->kept[t], from, each);
    }
    return true;
}

static void checkpoint(void *self) {
    const viscosity *v = self;
    for (int32_t t = 0; t < v->def.count; t++) memcpy(v->saved_m[t], v->kept[t], sizeof(double) * (size_t)v->saved);
}

static void rollback(void *self, tm_world *world) {
    (void)world;
    const viscosity *v = self;
    for (int32_t t = 0; t < v->def.count; t++) memcpy(v->kept[t], v->saved_m[t], sizeof(double) * (size_t)v->saved);
}

static void release(viscosity *v) {
    tm_pool pool = v->pool;
    tm_pool_release(&pool);
}

static void destroy(void *self) {
    viscosity *v = self;
    set_force(v, false);
    if (v->law) v->law->end(v->law_self);
    release(v);
}

bool tm_stage_is_viscosity(const tm_stage *stage) {
    return stage->range == follow_range || stage->run == run_law || stage->run == run_strained ||
           stage->run == run_bulk;
}

static viscosity *of(const tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.range == follow_range || world->entry[i].stage.run == run_law)
            return world->entry[i].stage.self;
    return NULL;
}

static void rest_here(viscosity *v) {
    tm_fading rest[TM_VISCOSITY_TERMS];
    for (int32_t t = 0; t < v->def.count; t++) rest[t] = (tm_fading){.old = 1 - v->fading[t].now};
    if (v->law) {
        v->law->evaluate(v->law_self, rest);
        return;
    }
    for (int32_t t = 0; t < v->def.count; t++)
        for (int32_t i = 0; i < v->where.count; i++)
            for (int32_t k = 3 * v->where.end[2 * i]; k < 3 * v->where.end[2 * i + 1]; k++)
                v->q_m[t][k] = v->world->state.u_m[k];
}

static bool init(viscosity *v, tm_pool *pool) {
    bool alike = true;
    const tm_material_field field = tm_tissue_field(v->world->tissue);
    if (!tm_effect_vertices(&v->where, pool, &field, TM_REGION_VISCOSITY, 0)) return false;
    const int64_t first = 3 * (int64_t)tm_ranges_first(&v->where);
    v->n = 3 * tm_ranges_length(&v->where);
    v->saved = v->law ? v->law->kept(v->law_self) : v->n;
    for (int32_t t = 0; t < v->def.count; t++) {
        v->kept[t] = TM_ALLOC(pool, double, v->saved);
        v->q_m[t] = tm_shifted(v->kept[t], sizeof(double), first);
        v->saved_m[t] = TM_ALLOC(pool, double, v->saved);
        alike = alike && v->def.term[t].bulk == v->def.term[t].shear;
    }
    if (pool->failed) return false;
    if (v->law) return v->law->begin(v->law_self, pool, v->world, &v->def, v->kept);
    v->strained_m = tm_shifted(TM_ALLOC(pool, double, v->n), sizeof(double), first);
    if (alike) return !pool->failed;
    v->nodal_dilatation_m = tm_shifted(TM_ALLOC(pool, double, v->n), sizeof(double), first);
    return tm_bulk_init(&v->bulk, pool, &field) && !pool->failed;
}

/* Adds the stage; u is the equilibrium from here on. Frees its memory on failure. */
static tm_status add(viscosity *v, int64_t bytes, tm_error *error) {
    const struct tm_relaxing_law *law = v->law;
    const tm_stage whole = {.size = sizeof whole,
                            .step_limit_s = law && law->limit_s ? law->limit_s(v->law_self) : 0,
                            .name = "viscosity",
                            .phase = law ? TM_PHASE_FORCE : TM_PHASE_END,
                            .run = law ? run_law : NULL,
                            .range = law ? NULL : follow_range,
                            .divided = !law,
                            .destroy = destroy,
                            .step_changed = step_changed,
                            .self = v,
                            .snapshot = snapshot,
                            .restore = restore,
                            .checkpoint = checkpoint,
                            .rollback = rollback,
                            .needs = {"force", law ? law->stage : NULL},
                            .runs_before = law && law->before_force ? "force" : NULL,
                            .skip_in_settle = true};
    const tm_stage strain = {.size = sizeof strain,
                             .name = "viscous strain",
                             .phase = TM_PHASE_FORCE,
                             .run = run_strained,
                             .self = v,
                             .substage_of = "viscosity",
                             .runs_before = "force",
                             .skip_in_settle = true};
    const tm_stage bulk = {.size = sizeof bulk,
                           .name = "viscous bulk",
                           .phase = TM_PHASE_FORCE,
                           .run = run_bulk,
                           .self = v,
                           .substage_of = "viscosity",
                           .skip_in_settle = true};
    tm_status status = tm_world_add_stage(v->world, &whole, bytes, error);
    if (status) {
        if (law) law->end(v->law_self);
        release(v);
        return status;
    }
    if (!law) status = tm_world_add_stage(v->world, &strain, 0, error);
    if (!law && !status && v->nodal_dilatation_m) status = tm_world_add_stage(v->world, &bulk, 0, error);
    if (!status && law) tm_world_set_divides(v->world, whole.name);
    if (!status && !law) tm_world_set_divides(v->world, strain.name);
    if (!status && !law && v->nodal_dilatation_m) tm_world_set_divides(v->world, bulk.name);
    if (status) {
        tm_world_remove_stage(v->world, "viscosity", NULL);
        return status;
    }
    set_force(v, true);
    rest_here(v);
    return TM_OK;
}

/* Whether the bodies that relax are those of the world's law (or rotation), others, or both. */
typedef enum kind { LINEAR = 1, LAW = 2, BOTH = 3 } kind;

static bool everywhere(const tm_world *world) {
    const tm_material_field field = tm_tissue_field(world->tissue);
    return tm_effect_is_everywhere(&field, TM_REGION_VISCOSITY);
}

static kind kinds_of(const tm_world *world) {
    const tm_material_field field = tm_tissue_field(world->tissue);
    int kinds = 0;
    if (!world->nonlinear || !field.effects || !(field.rotation > 0)) return world->nonlinear ? LAW : LINEAR;
    for (int32_t r = 0; r < field.mesh->region_count; r++)
        if (field.effects[r] & TM_REGION_VISCOSITY) kinds |= field.effects[r] & TM_REGION_ROTATION ? LAW : LINEAR;
    return kinds ? (kind)kinds : LINEAR;
}

tm_status tm_stage_viscosity(tm_world *world, const tm_viscosity_def *def, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    const tm_status status = tm_viscosity_check(def, error);
    if (status) return status;
    if (world->tissue->extra_mass_kg)
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "viscosity does not support a condensed part, which cannot relax; leave one of them out");
    if (world->tissue->has_single_law)
        return tm_fail(
            error, TM_ERR_EXCLUDED, -1,
            "viscosity of a nonlinear law, or with rotation, needs double precision; set precision to TM_DOUBLE");
    const kind kinds = kinds_of(world);
    if (kinds == BOTH)
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "viscosity acts in bodies with rotation and in others without, and one stage keeps one kind of "
                       "history; give rotation to all bodies with viscosity, or to none of them");
    if (kinds == LAW && !everywhere(world) && !(world->tissue->rotation > 0))
        return tm_fail(
            error, TM_ERR_EXCLUDED, -1,
            "viscosity acts in some bodies, and a nonlinear law in the tissue: that law keeps histories of all "
            "tetrahedra; give viscosity to all bodies");
    tm_pool pool = {0};
    viscosity *v = TM_ALLOC(&pool, viscosity, 1);
    if (v) {
        v->world = world;
        if (world->nonlinear && kinds != LINEAR)
            v->law = world->nonlinear->relaxing, v->law_self = world->nonlinear->self;
        v->def = tm_viscosity_def_default();
        v->def.count = def->count;
        memcpy(v->def.term, def->term, sizeof def->term[0] * (size_t)def->count);
    }
    if (!v || !init(v, &pool)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "viscosity stage");
    }
    v->pool = pool;
    return add(v, pool.bytes, error);
}

/* --- settling --- */

static void swap_tensors(tm_tissue *a, tm_tissue *b) {
    const tm_force_graph graph = a->graph;
    int32_t *const slot = a->edge_index;
    a->graph = b->graph, a->edge_index = b->edge_index;
    b->graph = graph, b->edge_index = slot;
}

tm_status tm_relaxed_begin(tm_world *world, tm_relaxed *relaxed, tm_error *error) {
    viscosity *v = of(world);
    if (!v) return TM_OK;
    tm_viscosity_relaxed(&v->def, &relaxed->shear, &relaxed->volume);
    if (!v->law || v->law->prepare_rest) {
        tm_tissue *tissue = NULL;
        const tm_status status = tm_tissue_relaxed(world->tissue, relaxed->shear, relaxed->volume, &tissue, error);
        if (status) return status;
        if (v->law && !v->law->prepare_rest(v->law_self, tissue, relaxed)) {
            tm_pool_release(&relaxed->pool);
            tm_tissue_destroy(tissue);
            return tm_fail_memory(error, "settling");
        }
        relaxed->tissue = tissue;
        swap_tensors(world->tissue, tissue);
    }
    if (v->law) v->law->rest(v->law_self, relaxed, true);
    set_force(v, false);
    relaxed->on = true;
    return TM_OK;
}

void tm_relaxed_end(tm_world *world, tm_relaxed *relaxed, bool rests) {
    if (!relaxed->on) return;
    viscosity *v = of(world);
    if (relaxed->tissue) swap_tensors(world->tissue, relaxed->tissue);
    if (v->law) v->law->rest(v->law_self, relaxed, false);
    set_force(v, true);
    tm_tissue_destroy(relaxed->tissue);
    tm_pool_release(&relaxed->pool);
    if (rests) rest_here(v);
    tm_world_changed(world);
}
