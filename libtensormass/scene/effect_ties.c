/* Effect `ties`: springs between surfaces of bodies. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bodies.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

typedef struct tie_group {
    app_section here;
    app_text name, from, to;
    app_number stiffness, rest, breaks, within, spacing;
} tie_group;

typedef struct options {
    app_section here;
    app_list between; /* tie_group */
} options;

#define TIE(member) offsetof(tie_group, member), 0
static const app_field fields[] = {
    {"ties", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "ligaments and fat between bodies: springs that pull, and that a cautery cuts ([bodies](bodies.md#ties))"},
    {"ties.between", APP_LIST, NULL, "!", 0, 0, offsetof(options, between), sizeof(tie_group),
     "each item ties vertices of one surface to the nearest points of another"},
    {"ties.between[].name", APP_TEXT, NULL, NULL, 0, 0, TIE(name), "name in reports"},
    {"ties.between[].from", APP_TEXT, NULL, "!", 0, 0, TIE(from),
     "group of vertices, such as `gallbladder.bed` or `gallbladder`; a tie begins at each that is on the surface"},
    {"ties.between[].to", APP_TEXT, NULL, "!", 0, 0, TIE(to),
     "group of vertices; ties end on the surface triangles whose three vertices are in it"},
    {"ties.between[].stiffness", APP_NUMBER, "stiffness", "!", 1e-6, 1e9, TIE(stiffness),
     "force per stretch of each tie"},
    {"ties.between[].rest", APP_NUMBER, "length", NULL, 0, 10, TIE(rest),
     "length up to which a tie is slack; left out, the distance of its ends at rest"},
    {"ties.between[].break", APP_NUMBER, "force", "0 N", 0, 1e9, TIE(breaks), "breaking load of each tie; 0: none"},
    {"ties.between[].within", APP_NUMBER, "length", "10 mm", 0, 10, TIE(within),
     "distance at rest beyond which a vertex is not tied"},
    {"ties.between[].spacing", APP_NUMBER, "length", "0 mm", 0, 10, TIE(spacing),
     "smallest distance between the starting points of two ties; 0: each vertex has one"},
};

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    if (o->between.count) return 0;
    return app_scene_bad(scene, o->between.line, "ties.between is empty; name two surfaces, or remove 'ties:'");
}

typedef struct work {
    uint8_t *from, *to;
    int32_t *triangle, triangles;
    tm_tie *tie;
    int32_t count, capacity;
} work;

static tm_status mark_group(const sim *s, const app_text *group, uint8_t *mark) {
    int32_t count;
    const app_select select = {.group = *group};
    return sim_select(s, &select, group->line, mark, &count);
}

/* Keeps surface vertices in `from`, and lists the triangles of `to`. */
static void take_surface(const sim *s, work *w) {
    w->triangles = 0;
    uint8_t *outside = w->from; /* 1: selected; 2: selected and on the surface */
    for (int32_t i = 0; i < s->mesh->surface_count; i++) {
        const int32_t *v = s->mesh->surface + 3 * i;
        for (int j = 0; j < 3; j++)
            if (outside[v[j]]) outside[v[j]] = 2;
        if (w->to[v[0]] && w->to[v[1]] && w->to[v[2]]) memcpy(w->triangle + 3 * w->triangles++, v, 3 * sizeof *v);
    }
}

static tm_status warn_of_shared(const sim *s, const tie_group *g, const work *w) {
    int32_t shared = 0;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) shared += w->from[v] == 2 && w->to[v];
    if (!shared) return 0;
    return app_scene_warn(s->scene, g->here.line,
                          "'%s' and '%s' have %d surface vertices in common, whose ties hold a surface to itself; name "
                          "two surfaces apart",
                          g->from.s, g->to.s, shared);
}

/* Returns whether rigid bodies have all vertices of a group. */
static bool is_all_rigid(const sim *s, const uint8_t *mark) {
    for (int32_t t = 0; t < s->mesh->tet_count; t++)
        for (int j = 0; j < 4 && !s->rigid_tet[t]; j++)
            if (mark[s->mesh->tet[4 * (int64_t)t + j]]) return false;
    return true;
}

static tm_status warn_of_rigid(const sim *s, const tie_group *g, const work *w) {
    if (!s->rigid_tet || !is_all_rigid(s, w->from) || !is_all_rigid(s, w->to)) return 0;
    return app_scene_warn(s->scene, g->here.line,
                          "'%s' and '%s' are both of rigid bodies, which ties cannot move; name tissue, or remove it",
                          g->from.s, g->to.s);
}

static bool is_apart(const sim *s, const work *w, int32_t first, int32_t vertex, double spacing_m) {
    for (int32_t i = first; i < w->count && spacing_m > 0; i++) {
        double d[3];
        vsub(s->mesh->rest_m + 3 * vertex, s->mesh->rest_m + 3 * w->tie[i].vertex, d);
        if (vnorm(d) < spacing_m) return false;
    }
    return true;
}

static tm_status add(const sim *s, const tie_group *g, work *w) {
    const int32_t first = w->count;
    tm_status rc = mark_group(s, &g->from, w->from);
    if (!rc) rc = mark_group(s, &g->to, w->to);
    if (rc) return rc;
    take_surface(s, w);
    if ((rc = warn_of_shared(s, g, w)) || (rc = warn_of_rigid(s, g, w))) return rc;
    bool spaced = false;
    for (int32_t v = 0; v < s->mesh->vertex_count && w->count < w->capacity; v++) {
        tm_tie tie = {.stiffness_N_m = g->stiffness.si, .break_N = g->breaks.si};
        if (w->from[v] != 2 || !tm_tie_lead(s->mesh, v, w->triangle, w->triangles, &tie)) continue;
        if (tie.rest_m > g->within.si) continue;
        if (!is_apart(s, w, first, v, g->spacing.si)) {
            spaced = true;
            continue;
        }
        if (g->rest.line) tie.rest_m = g->rest.si;
        w->tie[w->count++] = tie;
    }
    if (w->count > first && g->spacing.si > 0 && !spaced)
        return app_scene_warn(s->scene, g->spacing.line,
                              "a spacing of %g mm leaves out no vertex of '%s': each has a tie, %d in all; enlarge "
                              "'spacing:', or remove it",
                              1e3 * g->spacing.si, g->from.s, w->count - first);
    if (w->count > first) return 0;
    return app_scene_bad(
        s->scene, g->here.line,
        "no vertex of '%s' on the surface is within %g mm of the surface of '%s'; enlarge 'within:', or "
        "name other groups",
        g->from.s, 1e3 * g->within.si, g->to.s);
}

static tm_status build(sim *s, const void *own) {
    const options *o = own;
    const size_t n = (size_t)s->mesh->vertex_count, all = n * (size_t)o->between.count;
    work w = {.from = malloc(n),
              .to = malloc(n),
              .triangle = malloc(sizeof(int32_t) * 3 * (size_t)(s->mesh->surface_count + 1)),
              .tie = malloc(sizeof(tm_tie) * all),
              .capacity = all < 100000 ? (int32_t)all : 100000};
    tm_status rc = w.from && w.to && w.triangle && w.tie
                       ? 0
                       : app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    for (int i = 0; i < o->between.count && !rc; i++) rc = add(s, (const tie_group *)o->between.item + i, &w);
    tm_ties_def def = tm_ties_def_default();
    tm_error error = {0};
    tm_ties *ties;
    def.count = w.count;
    def.tie = w.tie;
    if (!rc && tm_stage_ties(s->model->world, &def, &ties, &error)) rc = sim_report(s->scene, o->here.line, &error);
    free(w.from);
    free(w.to);
    free(w.triangle);
    free(w.tie);
    return rc;
}

/* Notes the ties that went in this frame. */
static void frame(sim *s) {
    tm_ties *ties = tm_world_ties(s->model->world);
    s->ties_cut.count = tm_ties_fetch_cut(ties, s->ties_cut.tie, s->ties_cut.why, SIM_TIES_TOLD);
    s->ties_cut.total += s->ties_cut.count;
    for (int32_t i = 0; i < s->ties_cut.count; i++) s->ties_cut.broke += s->ties_cut.why[i] == TM_TIE_BROKE;
}

const sim_effect sim_effect_ties = {
    .name = "ties",
    .doc =
        "Springs between named surfaces, which pull and never push: ligaments, fat, peritoneum. A tie breaks at its "
        "load, an active cautery cuts those that it touches, and removed ties are reported as cuts are (docs/bodies.md).",
    .trial = SIM_TRIAL_DROP,
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .excludes = {{"precomputed", "its responses are computed without ties; write 'model: dynamic', or remove 'ties:'"},
                 {"hybrid",
                  "its condensed part has no vertices that a step could pull; write 'model: dynamic', or remove "
                  "'ties:'"}},
    .check = check,
    .build = build,
    .frame = frame,
};
