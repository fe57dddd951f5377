/* Warnings about input that is valid but probably a mistake: units, supports, tools that cannot touch. */
#include <math.h>

#include "effects.h"
#include "scene_parts.h"
#include "sim.h"
#include "surface_distance.h"

/* Brain, the softest organ, has about 500 Pa; bone 2e10. */
static const double softest_Pa = 50, largest_organ_m = 2, smallest_organ_m = 1e-3, longest_shaft_m = 0.5;

static void bounds(const tm_mesh *mesh, double low[3], double high[3]) {
    for (int a = 0; a < 3; a++) low[a] = INFINITY, high[a] = -INFINITY;
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        low[i % 3] = fmin(low[i % 3], mesh->rest_m[i]);
        high[i % 3] = fmax(high[i % 3], mesh->rest_m[i]);
    }
}

/* Returns the longest side of the box around vertices of the file. */
static double size_of(const tm_mesh_file *file, int32_t begin, int32_t end) {
    double size_m = 0;
    for (int a = 0; a < 3; a++) {
        double low = INFINITY, high = -INFINITY;
        for (int32_t v = begin; v < end; v++)
            low = fmin(low, file->vertex_m[3 * v + a]), high = fmax(high, file->vertex_m[3 * v + a]);
        size_m = fmax(size_m, high - low);
    }
    return size_m;
}

static tm_status warn_size_of(const sim *s, const char *what, const char *key, const app_number *scale, int mesh_line,
                              double size_m) {
    const int line = scale->line ? scale->line : mesh_line;
    if (size_m > largest_organ_m)
        return app_scene_warn(s->scene, line, "%s is %.4g m across; if its file is in millimetres, write %s: %g", what,
                              size_m, key, 1e-3 * scale->si);
    if (size_m < smallest_organ_m)
        return app_scene_warn(s->scene, line, "%s is %.4g mm across; check %s (metres per unit)", what, 1e3 * size_m,
                              key);
    return 0;
}

static tm_status warn_size(const sim *s) {
    if (!s->body_count)
        return warn_size_of(s, "the mesh", "tissue.scale", &s->scene->scale, app_mesh_line(s->scene),
                            size_of(&s->file, 0, s->file.vertex_count));
    tm_status rc = 0;
    for (int32_t i = 0; i < s->body_count && !rc; i++) {
        const app_body *body = (const app_body *)s->scene->body.item + i;
        char what[64], key[80];
        snprintf(what, sizeof what, "body '%.40s'", s->body[i].name);
        snprintf(key, sizeof key, "bodies.%.40s.scale", s->body[i].name);
        rc = warn_size_of(s, what, key, &body->scale, body->mesh.line,
                          size_of(&s->file, s->body[i].vertex_begin, s->body[i].vertex_end));
    }
    return rc;
}

static tm_status warn_materials(const sim *s) {
    bool fibred = false;
    tm_status rc = 0;
    for (int i = 0; i < s->scene->material.count && !rc; i++) {
        const app_material *m = (const app_material *)s->scene->material.item + i;
        const app_number *stiffness[] = {&m->young, &m->mu, &m->mu_T, &m->mu_L, &m->E_L, &m->E_T, &m->G_L};
        app_law law = APP_LAW_YOUNG;
        app_scene_law(s->scene, m, &law);
        fibred |= app_law_fibred(law) || tm_law_needs_fibre((tm_law_kind)m->law.index);
        for (int k = 0; k < 7 && !rc; k++)
            if (stiffness[k]->line && stiffness[k]->si < softest_Pa)
                rc = app_scene_warn(
                    s->scene, stiffness[k]->line,
                    "%g Pa is softer than any tissue, and a number without a unit is in Pa; write kPa if that is meant",
                    stiffness[k]->si);
    }
    const int index = sim_effect_find(s->scene, "anisotropy"), line = index < 0 ? 0 : sim_effect_line(s->scene, index);
    if (!rc && line && !fibred)
        rc = app_scene_warn(
            s->scene, line,
            "fibres have no effect, because every material is isotropic; give a material lambda_T mu_T lambda_L "
            "mu_L or E_L E_T nu_LT nu_TT G_L, or leave 'anisotropy:' out");
    return rc;
}

/* St. Venant-Kirchhoff's law under a uniaxial strain to the stretch s: P = a s (s^2 - 1)/2 + c lambda (s - 1), a = (1 -
 * c) lambda + 2 mu, whose size falls below s^2 = (1 - 2 c lambda/a)/3. */
static tm_status warn_collapse(const sim *s) {
    for (int32_t r = 0; r < s->file.region_count; r++) {
        const tm_material *m = s->material + r;
        const double held = m->law_constant[0] * m->lambda_Pa, rest = m->lambda_Pa - held + 2 * m->mu_Pa;
        const double square = (1 - 2 * held / rest) / 3;
        if (m->law != TM_LAW_ST_VENANT_KIRCHHOFF || square < 0.25) continue;
        return app_scene_warn(
            s->scene, sim_law_line(s->scene),
            "region '%s': law st-venant-kirchhoff with compression * lambda = %g Pa beside mu = %g Pa: its force falls "
            "when it is compressed to less than %.2g of its length; use neo-hooke, a larger 'compression:' or 'poisson:'",
            s->file.region_name[r], held, m->mu_Pa, sqrt(square));
    }
    return 0;
}

static tm_status warn_supports(const sim *s) {
    const int index = sim_effect_find(s->scene, "gravity"), touch = sim_effect_find(s->scene, "touch");
    if (s->rigid_tet && touch >= 0 && sim_effect_line(s->scene, touch)) return 0; /* it falls onto a rigid body */
    if (s->scene->support.count || index < 0 || !sim_effect_line(s->scene, index)) return 0;
    return app_scene_warn(s->scene, sim_effect_line(s->scene, index),
                          "gravity acts and nothing holds the tissue, so it falls without end; add 'supports:'");
}

static tm_status warn_instrument(const sim *s, int i) {
    const app_instrument *t = (const app_instrument *)s->scene->instrument.item + i;
    const app_vector *at = app_instrument_origin(t);
    double low[3], high[3], away = 0;
    bounds(s->mesh, low, high);
    for (int a = 0; a < 3; a++) {
        double d = fmax(fmax(low[a] - at->v[a], at->v[a] - high[a]), 0);
        away += d * d;
    }
    if (sqrt(away) > longest_shaft_m && t->mount.index == APP_FREE)
        return app_scene_warn(
            s->scene, at->line,
            "the origin of instrument %d is %.3g m from the tissue, and its device reaches less than %g m; move it, or "
            "check the units",
            i, sqrt(away), longest_shaft_m);
    if (sqrt(away) > longest_shaft_m)
        return app_scene_warn(
            s->scene, t->trocar.line,
            "the trocar of instrument %d is %.3g m from the tissue and its shaft is %g m long; move it, or check "
            "the units",
            i, sqrt(away), longest_shaft_m);
    if (sim_has(s, "contact") && sim_is_inside(s->mesh, s->pose[i].tip_m))
        return app_scene_warn(
            s->scene, t->start_here.line ? t->start_here.line : t->here.line,
            "instrument %d starts inside the tissue and makes no contact until it has come out; start it outside "
            "('above: 5 mm')",
            i);
    return 0;
}

tm_status sim_warn(const sim *s) {
    tm_status rc = warn_size(s);
    if (!rc) rc = warn_materials(s);
    if (!rc) rc = warn_collapse(s);
    if (!rc) rc = warn_supports(s);
    if (!rc && s->instrument_count && !sim_has(s, "contact"))
        rc = app_scene_warn(
            s->scene, s->scene->instrument.line,
            "instruments cannot touch the tissue: the scene does not name the effect 'contact'; add 'contact:'");
    for (int i = 0; i < s->instrument_count && !rc; i++) rc = warn_instrument(s, i);
    return rc;
}

enum { MANY_SUBSTEPS = 20000, MAX_SUBSTEPS = 10000000 }; /* per frame: slow; refused */

/* A frame has an integer number of force samples. */
static tm_status warn_rate(const sim *s) {
    const sim_haptics *haptics = sim_options(s->scene, "haptics");
    if (!haptics || haptics->rate.si == 0 || s->scene->pace == SIM_FRAMES) return 0;
    const double asked_Hz = haptics->rate.si, rate_Hz = s->samples * s->scene->frame_rate.si;
    if (fabs(rate_Hz - asked_Hz) <= 0.01 * asked_Hz) return 0;
    return app_scene_warn(
        s->scene, haptics->rate.line,
        "haptics.rate = %.4g Hz is not a multiple of time.frame_rate = %.4g Hz, so forces are sent at %.4g "
        "Hz; choose a multiple",
        asked_Hz, s->scene->frame_rate.si, rate_Hz);
}

tm_status sim_warn_timing(const sim *s) {
    const tm_timing *pace = &s->model->timing;
    const tm_status rc = warn_rate(s);
    if (rc) return rc;
    char name[SIM_TET_NAME];
    const int line = s->scene->step.line ? s->scene->step.line : s->scene->material.line;
    const double substeps = (double)s->samples * pace->substeps;
    if (substeps > MAX_SUBSTEPS) /* the model refuses as many per force sample */
        return app_scene_bad(
            s->scene, line,
            "a frame would take %.3g substeps of %.3g s because of tetrahedron %s; check its material (Young's "
            "modulus, density) and its shape (tm-mesh info)",
            substeps, pace->dt_s, sim_tet_name(s, pace->critical_tet, name));
    if (substeps <= MANY_SUBSTEPS) return 0;
    return app_scene_warn(
        s->scene, line,
        "a frame takes %.3g substeps of %.3g s because of tetrahedron %s; check its material (Young's "
        "modulus, density) and its shape (tm-mesh info)",
        substeps, pace->dt_s, sim_tet_name(s, pace->critical_tet, name));
}
