/* Measures of the tissue's deformation, and a check of its linear range. */
#include <math.h>
#include <stdio.h>

#include "base/vec.h"
#include "material/effect_range.h"
#include "tissue/tissue_internal.h"

/* H[3*i+j] = d u_i / d x_j. */
static void gradient(const tm_mesh *mesh, int32_t tet, const double *u_m, double H[9]) {
    for (int i = 0; i < 9; i++) H[i] = 0;
    for (int k = 0; k < 4; k++) {
        const double *u = u_m + 3 * (int64_t)mesh->tet[4 * (int64_t)tet + k];
        const double *shape = mesh->shape_1_m + 12 * (int64_t)tet + 3 * k;
        for (int i = 0; i < 9; i++) H[i] += u[i / 3] * shape[i % 3];
    }
}

static double determinant(const double H[9]) {
    const double F[9] = {1 + H[0], H[1], H[2], H[3], 1 + H[4], H[5], H[6], H[7], 1 + H[8]};
    double minor[3];
    vcross(F + 3, F + 6, minor);
    return vdot(F, minor);
}

/* The neglected part of Green's strain: |H^T H| / 2, Frobenius. */
static double left_out(const double H[9]) {
    double sum = 0;
    for (int i = 0; i < 9; i++) {
        double dot = 0;
        for (int k = 0; k < 3; k++) dot += H[3 * k + i / 3] * H[3 * k + i % 3];
        sum += dot * dot;
    }
    return 0.5 * sqrt(sum);
}

/* Returns whether rotation acts in some bodies, not in all. */
static bool turns_partly(const tm_tissue *tissue) {
    const tm_material_field field = tm_tissue_field(tissue);
    return tissue->rotation > 0 && !tm_effect_is_everywhere(&field, TM_REGION_ROTATION);
}

/* Returns whether some materials, not all, have a nonlinear law. */
static bool is_mixed(const tm_tissue *tissue) {
    bool linear = false;
    for (int32_t i = 0; i < tissue->material_count; i++) linear |= tissue->material[i].law == TM_LAW_LINEAR;
    return tissue->stiffest_Pa && linear;
}

tm_deformation tm_tissue_deformation(const tm_tissue *tissue, const double *u_m) {
    tm_deformation d = {.min_det = 1, .min_det_tet = -1, .nonlinear_tet = -1};
    TM_REQUIRE(tissue && u_m, "tissue or u_m is null", d);
    const tm_mesh *mesh = tissue->mesh;
    double volume = 0, beyond = 0, H[9];
    const bool mixed = is_mixed(tissue); /* where the share is that of the linear materials */
    const bool partly = turns_partly(tissue);
    const tm_material_field field = tm_tissue_field(tissue);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        if (!tissue->alive[t]) continue;
        gradient(mesh, t, u_m, H);
        const double det = determinant(H), strain = left_out(H);
        if (d.min_det_tet < 0 || det < d.min_det) d.min_det = det, d.min_det_tet = t;
        if (d.nonlinear_tet < 0 || strain > d.nonlinear_strain) d.nonlinear_strain = strain, d.nonlinear_tet = t;
        d.inverted += !(det > 0);
        volume += mesh->volume_m3[t];
        if (mixed && tm_tissue_tet_material(tissue, t)->law != TM_LAW_LINEAR) continue;
        if (partly && tm_field_has(&field, t, TM_REGION_ROTATION)) continue;
        if (strain > TM_LINEAR_STRAIN_MAX) beyond += mesh->volume_m3[t];
    }
    d.nonlinear_share = volume > 0 ? beyond / volume : 0;
    return d;
}

/* Share of linear tissue outside its range above which a warning follows; a tool's tip alone is below it. */
static const double DOUBTFUL_SHARE = 0.01;

bool tm_tissue_check_deformation(const tm_tissue *tissue, const tm_deformation *deformation,
                                 char sentence[TM_ERROR_MESSAGE_MAX]) {
    TM_REQUIRE(tissue && deformation && sentence, "tissue, deformation or sentence is null", false);
    const tm_deformation *d = deformation;
    const bool mixed = is_mixed(tissue), partly = turns_partly(tissue);
    const bool turns = (tissue->rotation > 0 && !partly) || (tissue->stiffest_Pa && !mixed);
    const char *linear = turns    ? ""
                         : partly ? "; give that body 'rotation' too"
                         : mixed ? "; give that material a nonlinear 'law:' too, st-venant-kirchhoff if it only rotates"
                                 : "; add 'rotation': without it tissue must not rotate or bend far";
    sentence[0] = 0;
    if (d->inverted > 0)
        snprintf(sentence, TM_ERROR_MESSAGE_MAX,
                 "%d tetrahedra are inverted (smallest det F %.3g, tetrahedron %d), so this shape is not valid%s",
                 (int)d->inverted, d->min_det, (int)d->min_det_tet,
                 turns ? "; move supports and tools less, or refine the mesh there" : linear);
    else if (!turns && d->nonlinear_share > DOUBTFUL_SHARE)
        snprintf(sentence, TM_ERROR_MESSAGE_MAX,
                 "linear tissue far outside its range: in %.0f %% of its volume the law neglects more than %.0f %% of "
                 "strain (at most %.3g %%, tetrahedron %d)%s",
                 100 * d->nonlinear_share, 100 * TM_LINEAR_STRAIN_MAX, 100 * d->nonlinear_strain, (int)d->nonlinear_tet,
                 linear);
    return sentence[0] != 0;
}
