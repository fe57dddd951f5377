/* Fibre directions, from a file or a rule. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "choices.h"
#include "sim.h"

#define LAW_REAL double
#include "law/vec.h"
typedef struct options {
    app_section here;
    app_text file;
    app_choice rule;
    app_vector direction, point;
} options;

typedef enum rule { CONSTANT, RADIAL, CIRCULAR, SPHERICAL } rule;
#define RULES(ROW) ROW("constant", CONSTANT) ROW("radial", RADIAL) ROW("circular", CIRCULAR) ROW("spherical", SPHERICAL)
APP_CHOICE_CHECK(RULES)

static const app_field fields[] = {
    {"anisotropy", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0, "fibres; fibred materials need it"},
    {"anisotropy.file", APP_PATH, NULL, NULL, 0, 0, offsetof(options, file), 0,
     "CSV with header `tet,ax,ay,az`, one row a tetrahedron, counted from 0 in file order; instead of a rule"},
    {"anisotropy.rule", APP_CHOICE, APP_CHOICE_WORDS(RULES), NULL, 0, 0, offsetof(options, rule), 0,
     "`constant`: along `direction`; `radial` and `circular`: away from and around the line through `point` along "
     "`direction`; `spherical`: away from `point`"},
    {"anisotropy.direction", APP_VECTOR, "none", "[0, 0, 1]", 0, 0, offsetof(options, direction), 0, "any length"},
    {"anisotropy.point", APP_VECTOR, "length", "[0, 0, 0]", 0, 0, offsetof(options, point), 0,
     "of the line, or the centre"},
};

static int check(const app_scene *scene, const void *own) {
    const options *o = own;
    if (!o->file.line == !o->rule.line)
        return app_scene_bad(scene, o->here.line, "anisotropy has either a file or a rule; give one of them");
    if (o->rule.line && o->rule.index != SPHERICAL && !(vnorm(o->direction.v) > 0))
        return app_scene_bad(scene, o->direction.line, "anisotropy.direction is zero; give a direction");
    return 0;
}

/* Any unit vector across `axis`: where a rule has no direction of its own. */
static void across(const double axis[3], double out[3]) {
    int small = fabs(axis[0]) <= fabs(axis[1]) && fabs(axis[0]) <= fabs(axis[2]) ? 0
                : fabs(axis[1]) <= fabs(axis[2])                                 ? 1
                                                                                 : 2;
    double e[3] = {small == 0, small == 1, small == 2};
    vcross(axis, e, out);
}

static void direction_at(const options *o, const double x[3], double out[3]) {
    double axis[3], length = vnorm(o->direction.v), d[3], along = 0;
    for (int a = 0; a < 3; a++) axis[a] = length > 0 ? o->direction.v[a] / length : a == 2;
    for (int a = 0; a < 3; a++) d[a] = x[a] - o->point.v[a];
    for (int a = 0; a < 3; a++) along += d[a] * axis[a];
    if (o->rule.index == CONSTANT)
        memcpy(out, axis, sizeof axis);
    else if (o->rule.index == SPHERICAL)
        memcpy(out, d, sizeof d);
    else {
        double r[3] = {d[0] - along * axis[0], d[1] - along * axis[1], d[2] - along * axis[2]};
        memcpy(out, r, sizeof r);
        if (o->rule.index == CIRCULAR) {
            out[0] = axis[1] * r[2] - axis[2] * r[1];
            out[1] = axis[2] * r[0] - axis[0] * r[2];
            out[2] = axis[0] * r[1] - axis[1] * r[0];
        }
    }
    if (!(vnorm(out) > 1e-12)) across(axis, out);
    length = vnorm(out);
    for (int a = 0; a < 3; a++) out[a] /= length;
}

static int prepare(sim *s, const void *own) {
    const options *o = own;
    int32_t n = s->mesh->tet_count;
    s->fibre = malloc(sizeof *s->fibre * 3 * (size_t)n);
    if (!s->fibre) return app_scene_bad(s->scene, o->here.line, "out of memory; use a smaller mesh");
    if (o->file.line) {
        tm_error error = {0};
        int line = 0;
        if (!app_fibres_load(o->file.s, n, s->fibre, &line, &error)) return 0;
        if (line) return sim_report_file(s->scene, o->file.line, o->file.s, line, &error);
        return app_scene_bad(s->scene, o->file.line, "anisotropy.file: %s: %s", o->file.s, error.message);
    }
    for (int32_t t = 0; t < n; t++) {
        double x[3] = {0, 0, 0};
        for (int k = 0; k < 4; k++)
            for (int a = 0; a < 3; a++) x[a] += 0.25 * s->mesh->rest_m[3 * s->mesh->tet[4 * t + k] + a];
        direction_at(o, x, &s->fibre[3 * t]);
    }
    return 0;
}

const sim_effect sim_effect_anisotropy = {
    .name = "anisotropy",
    .doc = "One fibre direction a tetrahedron. The stiffness tensors take it in when the tissue is built; a step costs "
           "the same with and without.",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .part = SIM_PART_FIBRES,
    .check = check,
    .prepare = prepare,
};
