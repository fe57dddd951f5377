/* The forms of corotated_kernel.h, and functions of the plain one for tangents and energies. */
#include <math.h>
#include <string.h>

#include "base/intrinsics.h"
#include "material/material_internal.h"

#pragma GCC diagnostic ignored "-Wpsabi" /* vectors never cross a call: every function that takes them is inlined */

#define TM_NAME(x) tm_plain_##x
#define TM_TARGET
#define TM_WIDTH 2
#include "material/corotated_kernel.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH

#ifdef TM_HAS_AVX2
#define TM_NAME(x) tm_avx2_##x
#define TM_TARGET __attribute__((target("avx2")))
#define TM_WIDTH 4
#include "material/corotated_kernel.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH

#define TM_NAME(x) tm_avx512_##x
#define TM_TARGET __attribute__((target("avx512f,avx512dq,avx512vl")))
#define TM_WIDTH 8
#include "material/corotated_kernel.h"
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#endif

tm_rotation_kernel tm_rotation_form(int form) {
#ifdef TM_HAS_AVX2
    if (form == 2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
        return tm_avx512_force;
    if (form == 1 && __builtin_cpu_supports("avx2")) return tm_avx2_force;
#endif
    return form == 0 ? tm_plain_force : NULL;
}

tm_rotation_kernel tm_rotation_choose(bool plain) {
    int form = plain ? 0 : 2;
    while (!tm_rotation_form(form)) form--;
    return tm_rotation_form(form);
}

tm_corner_force_kernel tm_corner_force_choose(bool plain) {
    const tm_rotation_kernel form = tm_rotation_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_avx512_force) return tm_avx512_pulls;
    if (form == tm_avx2_force) return tm_avx2_pulls;
#endif
    (void)form;
    return tm_plain_pulls;
}

tm_viscous_passes tm_viscous_choose(bool plain) {
    const tm_rotation_kernel form = tm_rotation_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_avx512_force) return (tm_viscous_passes){tm_avx512_strain_pass, tm_avx512_pressure_pass};
    if (form == tm_avx2_force) return (tm_viscous_passes){tm_avx2_strain_pass, tm_avx2_pressure_pass};
#endif
    (void)form;
    return (tm_viscous_passes){tm_plain_strain_pass, tm_plain_pressure_pass};
}

tm_nodal_dilatation_passes tm_nodal_dilatation_choose(bool plain) {
    const tm_rotation_kernel form = tm_rotation_choose(plain);
#ifdef TM_HAS_AVX2
    if (form == tm_avx512_force) return (tm_nodal_dilatation_passes){tm_avx512_swell, tm_avx512_press};
    if (form == tm_avx2_force) return (tm_nodal_dilatation_passes){tm_avx2_swell, tm_avx2_press};
#endif
    (void)form;
    return (tm_nodal_dilatation_passes){tm_plain_swell, tm_plain_press};
}

double tm_rotation_sum_energy(const tm_tet_batches *batches, const double *u_m) {
    double sum = 0;
    for (int32_t p = 0; p < batches->count; p++)
        for (int at = 0; at < TM_LANES; at += 2) {
            tm_plain_turned b;
            if (!tm_plain_turn(batches, p, at, u_m, true, &b)) continue;
            for (int l = 0; l < 2; l++)
                if (b.weight[l] > 0) sum += b.weight[l] * b.energy[l];
        }
    return sum;
}

double tm_tet_batches_linear_energy(const tm_tet_batches *batches, const double *u_m) {
    double sum = 0;
    for (int32_t p = 0; p < batches->count; p++)
        for (int at = 0; at < TM_LANES; at += 2) {
            tm_plain_law w;
            tm_plain_v8 H[9], E[9], T[9], energy = {0};
            tm_plain_gradient(batches, p, at, u_m, H);
            for (int i = 0; i < 9; i++) E[i] = 0.5 * (H[i] + H[i % 3 * 3 + i / 3]);
            const bool fibred = tm_plain_law_of(batches, p, at, &w);
            tm_plain_linear(&w, fibred, E, T);
            for (int i = 0; i < 9; i++) energy += 0.5 * E[i] * T[i];
            sum += energy[0] + energy[1];
        }
    return sum;
}

bool tm_rotation_lane(const tm_tet_batches *batches, int32_t tet, const double *u_m, tm_corotated_lane *lane) {
    const int64_t slot = tm_tet_slot(batches, tet);
    if (slot < 0) return false;
    const int32_t p = (int32_t)(slot / TM_LANES);
    const int at = (int)(slot % TM_LANES) / 2 * 2, l = (int)(slot % 2);
    tm_plain_turned b;
    if (!tm_plain_turn(batches, p, at, u_m, true, &b) || !(b.weight[l] > 0)) return false;
    double s = 0;
    for (int i = 0; i < 9; i++) {
        lane->H[i] = b.H[i][l], lane->R[i] = b.R[i][l];
        lane->stress[i] = b.stress[i][l];
        s += lane->H[i] * lane->H[i];
    }
    lane->trace = b.trace[l], lane->energy_J = b.energy[l];
    lane->weight = b.weight[l], lane->slope = b.slope[l];
    const double x = (s - batches->begin_1_2) / batches->width_1_2;
    lane->bend = x > 0 && x < 1 ? 60 * x * (1 - x) * (1 - 2 * x) / (batches->width_1_2 * batches->width_1_2) : 0;
    tm_rotation_lane_law(batches, tet, lane);
    return true;
}

void tm_rotation_lane_law(const tm_tet_batches *batches, int32_t tet, tm_corotated_lane *lane) {
    const int64_t slot = tm_tet_slot(batches, tet);
    const int32_t p = (int32_t)(slot / TM_LANES);
    const int k = (int)(slot % TM_LANES);
    const tm_tet_batch *batch = batches->batch + p;
    const tm_fibre_batch *f =
        batches->fibred_of && batches->fibred_of[p] >= 0 ? batches->fibred + batches->fibred_of[p] : NULL;
    lane->mu = batch->mu_J[k], lane->lambda = batch->lambda_J[k];
    lane->dlambda = f ? f->dlambda_J[k] : 0, lane->dmu = f ? f->dmu_J[k] : 0, lane->beta = f ? f->beta_J[k] : 0;
    lane->fibred = lane->dlambda != 0 || lane->dmu != 0 || lane->beta != 0;
    for (int i = 0; i < 3; i++) lane->fibre[i] = f ? f->fibre[i][k] : 0;
}
