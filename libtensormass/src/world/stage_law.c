/* Stage "law": nonlinear laws of materials, in every world whose tissue has one. Each thread first computes the
 * stresses of a share of the batches. Then the stage "force" gathers the corner forces on its vertices, ascending, so
 * that results are bit-identical to those of one thread. */
#include <math.h>
#include <string.h>

#include "material/hyperelastic_single.h"
#include "tissue/tangent.h"
#include "world/law_blocks.h"
#include "world/viscosity.h"

typedef struct law_stage {
    tm_pool pool;
    tm_world *world;
    tm_hyperelastic hyper;
    tm_hyper_force force;
    tm_single_law single; /* in single precision, else empty */
    tm_single_force single_force;
    float *single_N; /* [12*TM_LANES*packs.count] its corner forces */
    tm_nodal_dilatation averages;
    tm_hyper_strain strain;
    tm_viscous work; /* corner_N; with averaged dilatation stress_J; with viscosity the terms */
    bool relaxes;    /* the terms act, by the stage "viscosity" */
    /* Limits and moduli of averaged dilatation: the law's, and the long-term ones while the world settles. */
    const double *sudden_Pa[3];
    double *long_term_Pa[3];
    double limit_s; /* step that the terms allow */
    tm_law_blocks blocks;
    int32_t *place;   /* [4*tet_count] in corner_N, in the order of mesh->vertex_tet */
    int32_t *beyond;  /* [partition_count] tetrahedra that continue linearly */
    tm_nonlinear law; /* the interface to other components */
} law_stage;

#define STAGE "law"
/* What histories may add to the law's bound. Steps of the default share 0.9 stay below the limit 1/sqrt(1.15) = 0.93,
 * and an adaptive step below its margin, with room for other stages. */
static const double HISTORY_SHARE = 0.15, HISTORY_ADAPTIVE = 0.05;

/* --- the step --- */

static int32_t batches_before(const law_stage *l, int32_t part) {
    return tm_tet_batches_before(l->hyper.packs.count, part, l->world->partition_count);
}

static int32_t stress(const void *self, int32_t begin, int32_t end, void *corner_N, int32_t slot) {
    const law_stage *l = self;
    const double *u_m = l->world->state.u_m;
    const int64_t at = 12 * TM_LANES * (int64_t)slot;
    return l->single_N ? l->single_force(&l->single, begin, end, u_m, (float *)corner_N + at)
                       : l->force(&l->hyper, begin, end, u_m, (double *)corner_N + at);
}

static void stress_part(void *context, int32_t part) {
    const law_stage *l = context;
    const int32_t begin = batches_before(l, part), end = batches_before(l, part + 1);
    l->beyond[part] = stress(l, begin, end, l->single_N ? (void *)l->single_N : l->work.corner_N, begin);
}

static bool is_averaged(const law_stage *l) { return tm_nodal_dilatation_is_on(&l->averages); }

static void strain_part(void *context, int32_t part) {
    const law_stage *l = context;
    tm_viscous v = l->work;
    if (!l->relaxes) v.terms = 0;
    l->beyond[part] = l->strain(&l->hyper, &v, &l->averages, batches_before(l, part), batches_before(l, part + 1),
                                l->world->state.u_m);
}

static void average_part(void *context, int32_t part) {
    const law_stage *l = context;
    const int32_t *begin = tm_nodal_dilatation_domains_of(&l->averages)->begin;
    const tm_force_partition *own = &l->world->partition[part].force;
    tm_nodal_dilatation_average(&l->averages, l->relaxes ? &l->work : NULL, begin[own->begin], begin[own->end]);
}

static void pressure_part(void *context, int32_t part) {
    const law_stage *l = context;
    tm_viscous_choose(l->world->tissue->plain)
        .pressure(&l->hyper.packs, &l->work, &l->averages, batches_before(l, part), batches_before(l, part + 1));
}

static void compute(law_stage *l) {
    if (!is_averaged(l) && !l->hyper.bulk_J) {
        tm_partitions_run(l->world, stress_part, l);
        return;
    }
    tm_partitions_run(l->world, strain_part, l);
    if (!is_averaged(l)) return;
    tm_partitions_run(l->world, average_part, l);
    tm_partitions_run(l->world, pressure_part, l);
}

/* Without averages and histories the stage "force" computes the stresses too. */
static bool is_in_blocks(const law_stage *l) { return l->blocks.on && !is_averaged(l) && !l->hyper.bulk_J; }

static void run(void *self, tm_world *world) {
    law_stage *l = self;
    if (is_in_blocks(l))
        tm_law_blocks_begin(&l->blocks, world->partition_count);
    else if (!l->relaxes)
        compute(l);
}

/* The law of the stage "force"; energy accounting reads the tensors' part separately. */
static void force_range(void *self, tm_world *world, const tm_range *range) {
    law_stage *l = self;
    const tm_tissue *tissue = world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    double *force_N = world->state.force_N;
    void (*sum)(const tm_mesh *, const void *, const int32_t *, int32_t, int32_t, double *) =
        l->single_N ? tm_law_sum_single : tm_law_sum;
    if (world->internal_N)
        tissue->force(&tissue->graph, &world->partition[range->partition].force, range->begin, range->end,
                      world->state.u_m, world->internal_N);
    if (!is_in_blocks(l)) {
        sum(mesh, l->single_N ? (const void *)l->single_N : l->work.corner_N, l->place, range->begin, range->end,
            force_N);
        return;
    }
    const bool timed = world->timing && range->partition % world->partition_count == 0;
    const int32_t stage = world->profiled;
    for (int32_t begin = range->begin, end; begin < range->end; begin = end) {
        end = begin + TM_LAW_BLOCK < range->end ? begin + TM_LAW_BLOCK : range->end;
        if (timed) tm_profile_enter(world, tm_world_stage_index(world, l));
        const void *ring = tm_law_blocks_compute(&l->blocks, world, range, begin, end, stress, l);
        if (timed) tm_profile_enter(world, stage);
        sum(mesh, ring, l->blocks.place, begin, end, force_N);
    }
}

/* --- interface to other components: the law minus the tensors, which are its own for small strains --- */

static double energy(const void *self, const double *u_m) {
    const law_stage *l = self;
    double law_J = tm_hyperelastic_energy(&l->hyper, u_m);
    if (is_averaged(l)) {
        tm_hyperelastic_evaluate(&l->hyper, &l->work, &l->averages, l->world->tissue->plain, u_m);
        law_J += tm_nodal_dilatation_stored(&l->averages);
    }
    return law_J - tm_tissue_energy(l->world->tissue, u_m);
}

/* Overwrites the corner forces of the step; every pass recomputes them. */
static void force(const void *self, const double *u_m, double *force_N) {
    const law_stage *l = self;
    double *tensors_N = l->law.scratch_N + 3 * (int64_t)l->hyper.packs.mesh->vertex_count;
    tm_hyperelastic_corners(&l->hyper, &l->work, &l->averages, l->world->tissue->plain, u_m);
    tm_law_sum(l->hyper.packs.mesh, l->work.corner_N, l->place, 0, l->hyper.packs.mesh->vertex_count, force_N);
    tm_tissue_force(l->world->tissue, u_m, tensors_N);
    for (int32_t i = 0; i < 3 * l->hyper.packs.mesh->vertex_count; i++) force_N[i] -= tensors_N[i];
}

static bool take_tangent(const void *self, tm_tangent *tangent, tm_pool *pool) {
    const law_stage *l = self;
    return tm_tangent_take_averaged(tangent, pool, l->world->tissue, &l->averages);
}

static void add_tangent(const void *self, const double *u_m, int32_t begin, int32_t end, tm_tangent *tangent) {
    const law_stage *l = self;
    const tm_tissue *tissue = l->world->tissue;
    if (is_averaged(l)) {
        if (begin == 0) tm_hyperelastic_evaluate(&l->hyper, &l->work, &tangent->nodal_dilatation, tissue->plain, u_m);
        tm_tangent_add_domains(tissue, begin, end, tangent);
    }
    for (int32_t t = begin; t < end; t++) {
        double A[81], linear[81];
        tm_corotated_lane lane;
        if (!l->hyper.packs.alive[t]) continue;
        tm_hyperelastic_hessian(&l->hyper, t, u_m, A);
        if (is_averaged(l)) tm_hyperelastic_add_bend(&l->hyper, &tangent->nodal_dilatation, t, u_m, A);
        tm_rotation_lane_law(&l->hyper.packs, t, &lane);
        tm_rotation_linear(&lane, linear);
        for (int i = 0; i < 81; i++) A[i] -= linear[i];
        tm_tangent_add_tet(tissue, t, A, tangent);
    }
}

/* --- what the stage "viscosity" asks (hyperelastic_terms.h) --- */

static int64_t kept(const void *self) {
    const law_stage *l = self;
    const int64_t lanes = TM_LANES * (int64_t)l->hyper.packs.count;
    return 6 * lanes + (is_averaged(l) ? tm_nodal_dilatation_domains(&l->averages) : lanes);
}

/* Computes what histories of a material may store. */
static tm_history_limits limits_of(const law_stage *l, const tm_material *m, double stiffest_Pa,
                                   const tm_viscosity_def *def) {
    const bool adaptive = l->world->adaptive;
    double shear, bulk;
    tm_viscosity_relaxed(def, &shear, &bulk);
    if (m->law == TM_LAW_LINEAR) return (tm_history_limits){HUGE_VAL, {-HUGE_VAL, HUGE_VAL}, 0};
    const double room_Pa = adaptive ? HISTORY_ADAPTIVE * tm_law_stiffest_within_Pa(m, is_averaged(l), TM_STRAIN_REST)
                                    : HISTORY_SHARE * stiffest_Pa;
    return tm_law_history_limits(m, is_averaged(l), room_Pa, adaptive, 1 - shear, 1 - bulk);
}

/* Sets what histories may store, and the step that they allow: no tetrahedron's tangent grows by more than that ratio.
 */
static bool limit_histories(law_stage *l, tm_pool *pool, const tm_viscosity_def *def) {
    const tm_material_field field = tm_tissue_field(l->world->tissue);
    const int64_t lanes = TM_LANES * (int64_t)l->hyper.packs.count;
    tm_history_limits *limits = TM_ALLOC(pool, tm_history_limits, field.material_count);
    double *stress_J = TM_ALLOC(pool, double, 3 * lanes);
    double *domain_Pa = TM_ALLOC(pool, double, 2 * (int64_t)field.mesh->region_count), ratio = 1;
    if (pool->failed) return false;
    for (int32_t m = 0; m < field.material_count; m++) {
        limits[m] = limits_of(l, field.material + m, field.stiffest_Pa[m], def);
        ratio = fmax(ratio, 1 + limits[m].more_Pa / field.stiffest_Pa[m]);
    }
    for (int64_t t = 0; t < lanes; t++) {
        const bool there = t < field.mesh->tet_count;
        const tm_history_limits *own = limits + (there ? field.region_material[field.mesh->region[t]] : 0);
        const double volume = there ? field.mesh->volume_m3[t] : 1;
        stress_J[t] = volume * own->stress_Pa;
        for (int side = 0; side < 2; side++) stress_J[(1 + side) * lanes + t] = volume * own->pressure_Pa[side];
    }
    for (int32_t r = 0; r < 2 * field.mesh->region_count; r++)
        domain_Pa[r] = limits[field.region_material[r / 2]].pressure_Pa[r % 2];
    l->hyper.history_stress_J = stress_J, l->work.history_Pa = domain_Pa;
    for (int side = 0; side < 2; side++) l->hyper.history_pressure_J[side] = stress_J + (1 + side) * lanes;
    l->limit_s = l->world->guaranteed_step_s / sqrt(ratio);
    return true;
}

static double limit_s(const void *self) { return ((const law_stage *)self)->limit_s; }

static bool begin_terms(void *self, tm_pool *pool, tm_world *world, const tm_viscosity_def *def,
                        double *const *histories) {
    law_stage *l = self;
    const tm_material_field field = tm_tissue_field(world->tissue);
    const int64_t lanes = TM_LANES * (int64_t)l->hyper.packs.count;
    double *bulk_J = TM_ALLOC(pool, double, lanes);
    for (int i = 0; i < 3 && is_averaged(l); i++)
        l->long_term_Pa[i] = TM_ALLOC(pool, double, world->tissue->mesh->region_count);
    if (pool->failed) return false;
    for (int32_t t = 0; !is_averaged(l) && t < field.mesh->tet_count; t++)
        bulk_J[t] = field.mesh->volume_m3[t] * tm_material_bulk_Pa(tm_field_material(&field, t));
    if (!limit_histories(l, pool, def)) return false;
    l->hyper.bulk_J = bulk_J;
    l->work.terms = def->count;
    for (int32_t t = 0; t < def->count; t++) {
        l->work.shear[t] = def->term[t].shear, l->work.volume[t] = def->term[t].bulk;
        l->work.history[t] = histories[t], l->work.swelling[t] = histories[t] + 6 * lanes;
    }
    return true;
}

static void end_terms(void *self) {
    law_stage *l = self;
    l->hyper.bulk_J = NULL;
    l->work.terms = 0;
}

static void set_terms(void *self, tm_world *world, bool relaxes) {
    law_stage *l = self;
    l->relaxes = relaxes;
    tm_world_set_force(world,
                       &(tm_force_provider){.stage = relaxes ? "viscosity" : STAGE, .self = l, .range = force_range});
}

static void set_step(void *self, const tm_fading *fading) {
    tm_viscous *v = &((law_stage *)self)->work;
    for (int32_t t = 0; t < v->terms; t++)
        v->history_kept[t] = fading[t].kept_share, v->old[t] = fading[t].old, v->now[t] = fading[t].now;
}

static void terms_force(void *self) {
    law_stage *l = self;
    l->work.history_frozen = l->world->evaluating;
    compute(l);
}

static void evaluate_terms(void *self, const tm_fading *fading) {
    law_stage *l = self;
    tm_viscous once = l->work;
    once.history_frozen = false;
    for (int32_t t = 0; t < once.terms; t++)
        once.history_kept[t] = fading[t].kept_share, once.old[t] = fading[t].old, once.now[t] = fading[t].now;
    l->strain(&l->hyper, &once, &l->averages, 0, l->hyper.packs.count, l->world->state.u_m);
    if (is_averaged(l)) tm_nodal_dilatation_average(&l->averages, &once, 0, tm_nodal_dilatation_domains(&l->averages));
}

static void rest(void *self, tm_relaxed *relaxed, bool begins) {
    law_stage *l = self;
    const double **at[3] = {&l->averages.bulk_Pa, &l->averages.max_Pa, &l->averages.min_Pa};
    l->hyper.shear = begins ? relaxed->shear : 1, l->hyper.volume = begins ? relaxed->volume : 1;
    for (int i = 0; i < 3 && is_averaged(l); i++) {
        if (begins) l->sudden_Pa[i] = *at[i];
        for (int32_t r = 0; r < l->world->tissue->mesh->region_count; r++)
            l->long_term_Pa[i][r] = l->hyper.volume * l->sudden_Pa[i][r];
        *at[i] = begins ? l->long_term_Pa[i] : l->sudden_Pa[i];
    }
}

static const struct tm_relaxing_law relaxing_law = {.stage = STAGE,
                                                    .before_force = true,
                                                    .kept = kept,
                                                    .begin = begin_terms,
                                                    .limit_s = limit_s,
                                                    .end = end_terms,
                                                    .set = set_terms,
                                                    .set_step = set_step,
                                                    .force = terms_force,
                                                    .evaluate = evaluate_terms,
                                                    .rest = rest};

/* --- creation --- */

static void destroy(void *self) {
    law_stage *l = self;
    tm_world_set_force(l->world, NULL);
    l->world->nonlinear = NULL;
    tm_pool pool = l->pool;
    tm_pool_release(&pool);
}

static bool take_single(law_stage *l, tm_pool *pool) {
    l->single_force = tm_single_force_choose(l->world->tissue->plain);
    l->single_N = TM_ALLOC(pool, float, 12 * TM_LANES * (int64_t)l->hyper.packs.count);
    return l->single_N && tm_single_law_init(&l->single, pool, &l->hyper);
}

static bool take(law_stage *l, tm_pool *pool) {
    const tm_tissue *tissue = l->world->tissue;
    const tm_material_field field = tm_tissue_field(tissue);
    if (!tm_hyperelastic_take(&l->hyper, pool, &field)) return false;
    if (!tm_nodal_dilatation_init(&l->averages, pool, &field, l->hyper.packs.count)) return false;
    l->force = tm_hyper_force_choose(tissue->plain);
    l->strain = tm_hyper_strain_choose(tissue->plain);
    if (tissue->has_single_law && !take_single(l, pool)) return false;
    l->work.corner_N = TM_ALLOC(pool, double, 12 * TM_LANES * (int64_t)l->hyper.packs.count);
    if (is_averaged(l)) l->work.stress_J = TM_ALLOC(pool, double, 9 * TM_LANES * (int64_t)l->hyper.packs.count);
    l->place = TM_ALLOC(pool, int32_t, 4 * (int64_t)tissue->mesh->tet_count);
    l->beyond = TM_ALLOC(pool, int32_t, l->world->partition_count);
    l->law = (tm_nonlinear){.self = l,
                            .energy = energy,
                            .force = force,
                            .take_tangent = take_tangent,
                            .add_tangent = add_tangent,
                            .relaxing = &relaxing_law,
                            .scratch_N = TM_ALLOC(pool, double, 6 * (int64_t)tissue->mesh->vertex_count)};
    if (pool->failed) return false;
    tm_packs_corners(&l->hyper.packs, l->place);
    return tm_law_blocks_init(&l->blocks, pool, &l->hyper.packs, l->place, l->world->partition_count,
                              l->single_N != NULL);
}

tm_status tm_stage_law(tm_world *world, tm_error *error) {
    tm_pool pool = {0};
    law_stage *l = TM_ALLOC(&pool, law_stage, 1);
    if (l) l->world = world;
    if (!l || !take(l, &pool)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "nonlinear law");
    }
    l->pool = pool;
    const tm_stage stage = {.size = sizeof stage,
                            .name = STAGE,
                            .phase = TM_PHASE_FORCE,
                            .run = run,
                            .destroy = destroy,
                            .self = l,
                            .runs_before = "force"};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    tm_world_set_force(world, &(tm_force_provider){.stage = STAGE, .self = l, .range = force_range});
    tm_world_set_divides(world, STAGE);
    world->nonlinear = &l->law;
    return TM_OK;
}

const tm_hyperelastic *tm_world_hyperelastic(const tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.run == run) return &((const law_stage *)world->entry[i].stage.self)->hyper;
    return NULL;
}

int32_t tm_world_limited_tets(const tm_world *world) {
    TM_REQUIRE(world, "world is null", 0);
    int32_t count = 0;
    for (int32_t i = 0; i < world->stage_count; i++) {
        if (world->entry[i].stage.run != run) continue;
        const law_stage *l = world->entry[i].stage.self;
        if (is_in_blocks(l)) return tm_law_blocks_beyond(&l->blocks, world->partition_count);
        for (int32_t p = 0; p < world->partition_count; p++) count += l->beyond[p];
    }
    return count;
}
