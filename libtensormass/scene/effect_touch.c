/* Effect `touch`: contact of bodies with each other and with themselves. */
#include <string.h>

#include "bodies.h"

typedef struct touch_pair {
    app_section here;
    app_text body, other;
} touch_pair;

typedef struct options {
    app_section here;
    app_number thickness, compliance;
    app_section friction;
    app_number at_rest, sliding;
    app_list pairs; /* touch_pair */
} options;

static const app_field fields[] = {
    {"touch", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "bodies touch each other and themselves ([bodies](bodies.md))"},
    {"touch.thickness", APP_NUMBER, "length", "0.5 mm", 1e-6, 0.1, offsetof(options, thickness), 0,
     "gap at which surfaces begin to touch; less where they are closer at rest"},
    {"touch.compliance", APP_NUMBER, "compliance", "0.5 mm/N", 0, 1, offsetof(options, compliance), 0,
     "compliance of each vertex in contact; 20 times stiffer beyond a depth of 0.3 thicknesses, 400 times beyond 0.8"},
    {"touch.friction", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, friction), 0, "friction of tissue on tissue"},
    {"touch.friction.static", APP_NUMBER, "none", "0.1", 0, TM_FRICTION_MAX, offsetof(options, at_rest), 0,
     "coefficient until surfaces slip; 0: none"},
    {"touch.friction.kinetic", APP_NUMBER, "none", "0.1", 0, TM_FRICTION_MAX, offsetof(options, sliding), 0,
     "coefficient while they slide, at most `static`"},
    {"touch.pairs", APP_LIST, NULL, NULL, 0, 0, offsetof(options, pairs), sizeof(touch_pair),
     "pairs of bodies that can touch; left out: all, and each body itself"},
    {"touch.pairs[].body", APP_TEXT, NULL, "!", 0, 0, offsetof(touch_pair, body), 0, "a body of `bodies`"},
    {"touch.pairs[].other", APP_TEXT, NULL, "!", 0, 0, offsetof(touch_pair, other), 0, "another body, or `self`"},
};

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    if (o->sliding.si > o->at_rest.si)
        return app_scene_bad(
            scene, o->sliding.line ? o->sliding.line : o->at_rest.line,
            "touch.friction: kinetic %g is above static %g; give a kinetic coefficient of at most that", o->sliding.si,
            o->at_rest.si);
    if (o->pairs.count && !scene->body.count)
        return app_scene_bad(scene, o->pairs.line,
                             "touch.pairs names bodies, and the scene has none; add 'bodies:', or leave the pairs out: "
                             "the tissue then touches itself");
    if (o->pairs.line && !o->pairs.count)
        return app_scene_bad(scene, o->pairs.line,
                             "touch.pairs is empty; name two bodies, or leave it out: all bodies then touch");
    return 0;
}

/* Returns the index of the body that a text names, -1 after adding a fault. */
static int32_t index_of(const sim *s, const app_text *name) {
    const sim_body *body = sim_body_find(s, name->s);
    if (body) return (int32_t)(body - s->body);
    app_scene_bad(s->scene, name->line, "there is no body '%.60s'; name one of 'bodies:'", name->s);
    return -1;
}

static bool are_rigid(const sim *s, int32_t a, int32_t b) {
    return s->body_count > 0 && s->body[a].rigid && s->body[b].rigid;
}

static tm_status warn_of_rigid(const sim *s, const touch_pair *p, int32_t a, int32_t b) {
    if (!are_rigid(s, a, b)) return 0;
    if (a == b)
        return app_scene_warn(s->scene, p->here.line, "body '%s' is rigid and never touches itself; remove this pair",
                              s->body[a].name);
    return app_scene_warn(s->scene, p->here.line,
                          "bodies '%s' and '%s' are both rigid and pass through each other; remove this pair",
                          s->body[a].name, s->body[b].name);
}

/* Rigid bodies do not touch each other: rows could move neither, and would only add forces to their supports. */
static tm_status mark_pairs(const sim *s, const options *o, int32_t count, uint8_t *pair) {
    for (int32_t a = 0; a < count; a++)
        for (int32_t b = 0; b < count; b++) pair[a * count + b] = o->pairs.count == 0 && !are_rigid(s, a, b);
    for (int i = 0; i < o->pairs.count; i++) {
        const touch_pair *p = (const touch_pair *)o->pairs.item + i;
        const int32_t a = index_of(s, &p->body);
        const int32_t b = a < 0 || !strcmp(p->other.s, "self") ? a : index_of(s, &p->other);
        if (a < 0 || b < 0) return TM_ERR_ARGUMENT;
        if (warn_of_rigid(s, p, a, b)) return TM_ERR_ARGUMENT;
        pair[a * count + b] = pair[b * count + a] = !are_rigid(s, a, b);
    }
    return 0;
}

/* Depth of an overlap at rest that gives no warning, of the thickness. */
static const double TOLERATED = 0.5;

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    uint8_t pair[SIM_MAX_BODIES * SIM_MAX_BODIES];
    const int32_t count = s->body_count > 1 ? s->body_count : 1;
    tm_error error = {0};
    tm_touching *touching;
    tm_touching_def def = tm_touching_def_default();
    int32_t *body = sim_bodies_of_tets(s);
    if (!body) return app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    def.body_count = count;
    def.tet_body = body;
    def.pair = pair;
    def.thickness_m = o->thickness.si;
    def.compliance_m_N = o->compliance.si;
    def.mu_static = o->at_rest.si;
    def.mu_kinetic = o->sliding.si;
    tm_status rc = mark_pairs(s, o, count, pair);
    if (!rc && s->body_count > 1) rc = sim_warn_overlaps(s, body, pair, TOLERATED * o->thickness.si);
    if (!rc && tm_stage_touch(s->model->world, &def, &touching, &error))
        rc = sim_report(s->scene, o->here.line, &error);
    tm_release(body, sizeof *body * (size_t)s->mesh->tet_count);
    return rc;
}

const sim_effect sim_effect_touch = {
    .name = "touch",
    .doc =
        "Bodies touch each other and themselves, lips of a cut too: vertices against faces, edges against edges, with "
        "the contact law of instruments, in the same sweeps (docs/bodies.md).",
    .example = "{thickness: 0.5 mm}",
    .trial = SIM_TRIAL_DROP,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed",
                  "its responses are computed without contact of tissue; write 'model: dynamic', or remove 'touch:'"},
                 {"hybrid",
                  "its condensed part has no vertices that a step could push; write 'model: dynamic', or remove "
                  "'touch:'"}},
    .check = check,
    .build = build,
};
