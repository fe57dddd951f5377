/* Checks that a table of fields cannot express: which keys are valid together. No check here needs a mesh. */
#include "scene_parts.h"

#include <math.h>
#include <string.h>

#include "law_keys.h"

typedef struct family {
    const char *name;
    uint32_t members; /* bits of the constants below */
} family;

enum {
    YOUNG = 1,
    POISSON = 2,
    LAMBDA = 4,
    MU = 8,
    LAMBDA_T = 16,
    MU_T = 32,
    LAMBDA_L = 64,
    MU_L = 128,
    BETA = 256,
    E_L = 512,
    E_T = 1024,
    NU_LT = 2048,
    NU_TT = 4096,
    G_L = 8192
};

static const family families[] = {
    [APP_LAW_YOUNG] = {"young poisson", YOUNG | POISSON},
    [APP_LAW_LAME] = {"lambda mu", LAMBDA | MU},
    [APP_LAW_PAPER] = {"lambda_T mu_T lambda_L mu_L", LAMBDA_T | MU_T | LAMBDA_L | MU_L},
    [APP_LAW_FIVE] = {"lambda_T mu_T lambda_L mu_L beta", LAMBDA_T | MU_T | LAMBDA_L | MU_L | BETA},
    [APP_LAW_ENGINEERING] = {"E_L E_T nu_LT nu_TT G_L", E_L | E_T | NU_LT | NU_TT | G_L},
};

static uint32_t given(const app_material *m, int *last_line) {
    const app_number *all[] = {&m->young, &m->poisson, &m->lambda, &m->mu,  &m->lambda_T, &m->mu_T,  &m->lambda_L,
                               &m->mu_L,  &m->beta,    &m->E_L,    &m->E_T, &m->nu_LT,    &m->nu_TT, &m->G_L};
    uint32_t bits = 0;
    for (int i = 0; i < (int)(sizeof all / sizeof all[0]); i++)
        if (all[i]->line) {
            bits |= 1u << i;
            if (all[i]->line > *last_line || all[i]->line < 0) *last_line = all[i]->line;
        }
    return bits;
}

tm_status app_scene_law(const app_scene *scene, const app_material *m, app_law *law) {
    int line = m->region.line;
    uint32_t bits = given(m, &line);
    for (int i = 0; i < (int)(sizeof families / sizeof families[0]); i++)
        if (bits == families[i].members) {
            *law = (app_law)i;
            return 0;
        }
    for (int i = 0; i < (int)(sizeof families / sizeof families[0]); i++)
        if (bits && !(bits & ~families[i].members))
            return app_scene_bad(scene, line, "material '%s' lacks some of its constants; give all of: %s", m->region.s,
                                 families[i].name);
    if (!bits)
        return app_scene_bad(
            scene, m->region.line,
            "material '%s' has no constants; give 'young' and 'poisson', or another family (docs/scene-reference.md)",
            m->region.s);
    return app_scene_bad(scene, line,
                         "material '%s' mixes families of constants; give one of: young poisson | lambda mu | lambda_T "
                         "mu_T lambda_L mu_L [beta] | E_L E_T nu_LT nu_TT G_L",
                         m->region.s);
}

/* Checks one constant of a law: given only with a law that has it, and given if it has no default. */
static tm_status check_constant(const app_scene *scene, const app_material *m, tm_law_kind law, int32_t i) {
    const tm_law_kind own = (tm_law_kind)m->law.index;
    const tm_law_constant *c = tm_law_constant_at(law, i);
    const int line = app_material_constant(m, law, i)->line;
    if (line && !app_law_has_constant(own, c->name))
        return app_scene_bad(
            scene, line,
            "material '%s': '%s' belongs to the law '%s', and its law is '%s'; give 'law: %s', or remove it",
            m->region.s, c->name, tm_law_name(law), tm_law_name(own), tm_law_name(law));
    if (!line && law == own && !c->fallback)
        return app_scene_bad(scene, m->law.line, "material '%s' has the law '%s', which needs '%s'; add it",
                             m->region.s, tm_law_name(law), c->name);
    return 0;
}

tm_status app_scene_law_check(const app_scene *scene, const app_material *m) {
    tm_status rc = 0;
    for (int32_t law = 0; law < APP_LAWS; law++)
        for (int32_t i = 0; !rc && tm_law_constant_at((tm_law_kind)law, i); i++)
            rc = check_constant(scene, m, (tm_law_kind)law, i);
    return rc;
}

/* Checks that there is exactly one valid selector. `what` begins the fault: "this support". */
static tm_status app_select_check(const app_scene *scene, const app_select *select, int line, const char *what) {
    int count =
        (select->group.line != 0) + (select->box.line != 0) + (select->plane.line != 0) + (select->vertex.line != 0);
    if (!count)
        return app_scene_bad(scene, line, "%s selects no vertices; add one of: group, box, plane, vertex", what);
    if (count > 1)
        return app_scene_bad(scene, line, "%s has %d selectors; keep one of: group, box, plane, vertex", what, count);
    if (select->box.line)
        for (int a = 0; a < 3; a++)
            if (select->box_min.v[a] > select->box_max.v[a])
                return app_scene_bad(scene, select->box_max.line, "box.max lies below box.min along %c; exchange them",
                                     "xyz"[a]);
    const double *n = select->plane_normal.v;
    if (select->plane.line && !(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] > 0))
        return app_scene_bad(scene, select->plane_normal.line, "plane.normal is zero; give a direction");
    return 0;
}

static tm_status check_supports(const app_scene *scene) {
    for (int i = 0; i < scene->support.count; i++) {
        const app_support *s = (const app_support *)scene->support.item + i;
        tm_status rc = app_select_check(scene, &s->select, s->here.line, "this support");
        if (rc) return rc;
        if (!*s->axes.s || strspn(s->axes.s, "xyz") != strlen(s->axes.s) || strlen(s->axes.s) > 3)
            return app_scene_bad(scene, s->axes.line,
                                 "axes '%s' may contain only x, y and z, each once; write for example xyz", s->axes.s);
        for (int a = 0; a < 3; a++)
            if (s->displace.v[a] != 0 && !strchr(s->axes.s, "xyz"[a]))
                return app_scene_bad(
                    scene, s->displace.line,
                    "the support has a displacement along %c, which is not in its axes '%s'; add %c to axes", "xyz"[a],
                    s -> axes.s, "xyz"[a]);
    }
    return 0;
}

static tm_status check_loads(const app_scene *scene) {
    for (int i = 0; i < scene->load.count; i++) {
        const app_load *l = (const app_load *)scene->load.item + i;
        tm_status rc = app_select_check(scene, &l->select, l->here.line, "this load");
        if (rc) return rc;
        if (!l->force.line + !l->total.line + !l->traction.line + !l->pressure.line != 3)
            return app_scene_bad(scene, l->here.line,
                                 "a load needs either a force, a total, a traction or a pressure; give one of them");
        if (l->pressure.line && scene->model.index != APP_DYNAMIC)
            return app_scene_bad(scene, l->pressure.line,
                                 "a pressure follows the surface, and this model's loads are constant; give a traction "
                                 "or take 'model: dynamic'");
    }
    return 0;
}

static tm_status check_pose(const app_scene *scene, const app_pose *pose, const app_instrument *t) {
    const bool is_free = t->mount.index == APP_FREE;
    const double *from = app_instrument_origin(t)->v;
    if (pose->above.line && pose->insertion.line)
        return app_scene_bad(scene, pose->above.line, "a pose has both insertion and above; leave one out");
    int joint = pose->pitch.line ? pose->pitch.line : pose->yaw.line ? pose->yaw.line : pose->insertion.line;
    if (!pose->tip.line) return 0;
    if (is_free && pose->insertion.line)
        return app_scene_bad(scene, pose->insertion.line, "a pose has tip as well as insertion; leave one out");
    if (is_free) joint = 0;
    if (joint) return app_scene_bad(scene, joint, "a pose has tip as well as pitch, yaw or insertion; leave one out");
    double d = 0;
    for (int a = 0; a < 3; a++) d += (pose->tip.v[a] - from[a]) * (pose->tip.v[a] - from[a]);
    if (is_free && !(d <= 0.25))
        return app_scene_bad(scene, pose->tip.line, "the tip is %.3g m from the origin; keep it within 0.5 m", sqrt(d));
    if (is_free) return 0;
    if (!(d > 1e-6) || d > 0.25)
        return app_scene_bad(scene, pose->tip.line, "the tip is %.3g m from the trocar; keep it between 1 mm and 0.5 m",
                             sqrt(d));
    return 0;
}

/* Checks the mount and the point that goes with it. */
static tm_status check_mount(const app_scene *scene, int i, const app_instrument *t) {
    const bool is_free = t->mount.index == APP_FREE;
    const app_vector *wrong = is_free ? &t->trocar : &t->origin, *at = app_instrument_origin(t);
    if (wrong->line && is_free)
        return app_scene_bad(scene, wrong->line,
                             "instrument %d is free and has a trocar; leave it out, or take 'mount: trocar'", i);
    if (wrong->line)
        return app_scene_bad(scene, wrong->line,
                             "origin is of a free instrument, and instrument %d has a trocar; leave it out, or take "
                             "'mount: free'",
                             i);
    if (at->line) return 0;
    if (is_free)
        return app_scene_bad(scene, t->mount.line,
                             "instruments[%d]: key 'origin' is missing; add the point where the device's positions are "
                             "zero",
                             i);
    return app_scene_bad(scene, t->here.line,
                         "instruments[%d]: key 'trocar' is missing; add the pivot of the instrument, or 'mount: free'",
                         i);
}

enum { FARTHEST_M = 1000 }; /* no coordinate in millimetres is larger */

static tm_status check_instruments(const app_scene *scene) {
    if (scene->instrument.count > 2)
        return app_scene_bad(scene, scene->instrument.line, "the scene has %d instruments; give one or two",
                             scene->instrument.count);
    for (int i = 0; i < scene->instrument.count; i++) {
        const app_instrument *t = (const app_instrument *)scene->instrument.item + i;
        const double *a = t->axis.v, *u = t->up.v;
        double c[3] = {a[1] * u[2] - a[2] * u[1], a[2] * u[0] - a[0] * u[2], a[0] * u[1] - a[1] * u[0]};
        const app_vector *at = app_instrument_origin(t);
        tm_status rc = check_mount(scene, i, t);
        if (rc) return rc;
        for (int k = 0; k < 3; k++)
            if (!(fabs(at->v[k]) <= FARTHEST_M))
                return app_scene_bad(scene, at->line, "the %s is %.3g m from the origin; keep it within %g m",
                                     t->mount.index == APP_FREE ? "origin of the device" : "trocar", at->v[k],
                                     (double)FARTHEST_M);
        if (!(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] > 0))
            return app_scene_bad(scene, t->axis.line, "axis is zero; give the direction in which the shaft points");
        if (!(u[0] * u[0] + u[1] * u[1] + u[2] * u[2] > 0))
            return app_scene_bad(scene, t->up.line, "up is zero; give a direction across the axis");
        double aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2], uu = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
        if (!(c[0] * c[0] + c[1] * c[1] + c[2] * c[2] > 1e-6 * aa * uu))
            return app_scene_bad(scene, t->axis.line ? t->axis.line : t->up.line,
                                 "axis and up are parallel; give 'up' another direction");
        rc = check_pose(scene, &t->start, t);
        if (rc) return rc;
    }
    return 0;
}

static tm_status check_hand(const app_scene *scene) {
    for (int i = 0; i < scene->hand.count; i++) {
        const app_hand *h = (const app_hand *)scene->hand.item + i;
        if (h->instrument.value >= scene->instrument.count)
            return app_scene_bad(
                scene, h->instrument.line ? h->instrument.line : h->here.line,
                "hand is for instrument %d, and the scene has %d; add an instrument, or correct the number",
                (int)h->instrument.value, scene->instrument.count);
        for (int j = 0; j < i; j++)
            if (((const app_hand *)scene->hand.item)[j].instrument.value == h->instrument.value)
                return app_scene_bad(scene, h->here.line, "instrument %d has a second hand; keep one",
                                     (int)h->instrument.value);
        if (!h->path.count) return app_scene_bad(scene, h->path.line, "the path is empty; give at least one waypoint");
        const app_instrument *t = (const app_instrument *)scene->instrument.item + h->instrument.value;
        const app_waypoint *w = h->path.item;
        for (int j = 0; j < h->path.count; j++) {
            if (j && !(w[j].time.si > w[j - 1].time.si))
                return app_scene_bad(scene, w[j].time.line,
                                     "waypoint %d is not later than the previous one; order them by time", j);
            tm_status rc = check_pose(scene, &w[j].pose, t);
            if (rc) return rc;
        }
    }
    return 0;
}

static tm_status check_time(const app_scene *scene) {
    if (scene->mass_scaling_max.line && !scene->mass_scaling.on)
        return app_scene_bad(scene, scene->mass_scaling_max.line,
                             "time.mass_scaling_max needs mass scaling, which is off; write mass_scaling: yes");
    if (scene->adaptive.on && scene->model.index != APP_DYNAMIC)
        return app_scene_bad(scene, scene->adaptive.line,
                             "time.adaptive and a quasi-static part exclude each other: it has no step; leave one out");
    if (!scene->mass_scaling.on) return 0;
    if (!scene->step.line)
        return app_scene_bad(scene, scene->mass_scaling.line,
                             "time.mass_scaling needs time.step, which is missing; give the step to reach");
    if (scene->model.index != APP_DYNAMIC)
        return app_scene_bad(
            scene, scene->mass_scaling.line,
            "time.mass_scaling applies only to the dynamic model, as a condensed part has no step; leave it out");
    return 0;
}

tm_status app_scene_check(const app_scene *scene) {
    tm_status rc = 0;
    if (!scene->material.count)
        rc = app_scene_bad(scene, scene->material.line, "tissue has no materials; name each region, or \"*\" for all");
    for (int i = 0; i < scene->material.count && !rc; i++) {
        app_law law;
        rc = app_scene_law(scene, (const app_material *)scene->material.item + i, &law);
    }
    if (!rc) rc = check_supports(scene);
    if (!rc) rc = check_loads(scene);
    if (!rc) rc = check_instruments(scene);
    if (!rc) rc = check_hand(scene);
    if (!rc) rc = check_time(scene);
    return rc;
}
