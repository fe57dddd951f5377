/* The hybrid model: a world for the part that may be cut, the rest condensed onto their interface. */
#include <stdlib.h>
#include <string.h>

#include "solve_api.h"

#define OPTION(member) offsetof(sim_solve_options, member), 0

static const app_field fields[] = {
    {"hybrid", APP_SECTION, NULL, NULL, 0, 0, OPTION(here),
     "which part `model: hybrid` computes how; the section alone asks for nothing"},
    {"hybrid.region", APP_TEXT, NULL, NULL, 0, 0, OPTION(region), "this region is tensor/mass"},
    {"hybrid.box", APP_SECTION, NULL, NULL, 0, 0, OPTION(box),
     "tetrahedra whose centre lies in this box are tensor/mass"},
    {"hybrid.box.min", APP_VECTOR, "length", "!", 0, 0, OPTION(box_min), "lower corner"},
    {"hybrid.box.max", APP_VECTOR, "length", "!", 0, 0, OPTION(box_max), "upper corner"},
    {"hybrid.precision", APP_CHOICE, "double|single", "double", 0, 0, OPTION(precision), "of the condensed part"},
    {"hybrid.cache", APP_FLAG, NULL, "yes", 0, 0, OPTION(cache),
     "keep it on disk: $TM_CACHE_DIR, $XDG_CACHE_HOME/tensormass or ~/.cache/tensormass"},
    {"hybrid.max_vertices", APP_INTEGER, NULL, "256", 8, 4096, OPTION(max_vertices),
     "of the contact system on the condensed part"},
};

typedef struct model {
    sim_hybrid_api api;
    tm_hybrid *hybrid;
    sim_problem problem;
    uint8_t *dynamic; /* [tet_count] */
    int64_t bytes;
} model;

static void destroy(void *own) {
    model *m = own;
    if (m->hybrid) m->api.tm_hybrid_destroy_(m->hybrid);
    sim_problem_free(&m->problem);
    free(m->dynamic);
    free(m);
}

static int check(const app_scene *scene, const void *own) {
    const sim_solve_options *o = own;
    if (!o->region.line == !o->box.line)
        return app_scene_bad(
            scene, scene->model.line,
            "model: hybrid wants to know which part is tensor/mass; give 'hybrid:' either a region or a box");
    return 0;
}

static int choose_part(const sim *s, const sim_solve_options *o, uint8_t *dynamic) {
    int32_t count = 0;
    for (int32_t t = 0; t < s->mesh->tet_count; t++) {
        bool in = true;
        for (int a = 0; a < 3 && o->box.line; a++) {
            double x = 0;
            for (int k = 0; k < 4; k++) x += 0.25 * s->mesh->rest_m[3 * s->mesh->tet[4 * t + k] + a];
            in = in && x >= o->box_min.v[a] && x <= o->box_max.v[a];
        }
        if (o->region.line) in = !strcmp(s->file.region_name[s->mesh->region[t]], o->region.s);
        dynamic[t] = in;
        count += in;
    }
    int line = o->region.line ? o->region.line : o->box.line;
    if (!count)
        return app_scene_bad(
            s->scene, line,
            "no tetrahedron is in the tensor/mass part; name another region or box (tm-mesh info lists regions)");
    if (count == s->mesh->tet_count)
        return app_scene_bad(
            s->scene, line,
            "every tetrahedron is in the tensor/mass part; write 'model: dynamic', or make the part smaller");
    return 0;
}

/* The whole organ's tissue gives the condensed part, then makes way for the world's own. */
static int begin(sim *s) {
    const sim_solve_options *o = sim_options(s->scene, "hybrid");
    model *m = s->model_own = calloc(1, sizeof *m);
    char file[1024];
    tm_error error = {0};
    tm_solve_report report = {0};
    if (!m) return APP_FAILED;
    /* Effects build later; the condensed inside must feel gravity too. */
    const app_vector *g = sim_gravity(s);
    if (g) memcpy(s->gravity_m_s2, g->v, sizeof s->gravity_m_s2);
    int rc = sim_open_hybrid(s, &m->api);
    m->dynamic = calloc((size_t)s->mesh->tet_count, 1);
    if (!rc) rc = m->dynamic ? choose_part(s, o, m->dynamic) : APP_FAILED;
    if (rc) return rc;
    tm_hybrid_def def = m->api.tm_hybrid_def_default_();
    rc = sim_problem_make(s, s->tissue, &m->problem, &def.problem);
    if (rc) return rc;
    sim_solve_file(s, o, "hybrid", file, sizeof file);
    def.dynamic = m->dynamic;
    def.precision = (tm_precision)o->precision.index;
    def.file = *file ? file : NULL;
    def.contact = sim_has(s, "contact") ? sim_contact_definition(s) : NULL;
    def.patch_vertices = sim_may_send(s) == SIM_SENDS_FORCE ? 0 : 64;
    def.max_local_vertices = (int32_t)o->max_vertices.value;
    if (m->api.tm_hybrid_create_(&def, &m->hybrid, &report, &error))
        return sim_report(s->scene, s->scene->model.line, &error);
    m->bytes = m->api.tm_hybrid_bytes_(m->hybrid);
    sim_solve_told(s, "the condensed part", &report);
    tm_tissue_destroy(s->tissue);
    s->tissue = NULL;
    m->api.tm_hybrid_tissue_(m->hybrid, &s->tissue_def);
    if (tm_tissue_create(&s->tissue_def, &s->tissue, &error))
        return sim_report(s->scene, s->scene->tissue.line, &error);
    s->condensed_tets = s->mesh->tet_count - tm_tissue_alive_count(s->tissue);
    s->critical_s = m->api.tm_hybrid_critical_step_(m->hybrid, &s->critical_tet);
    return sim_make_world(s);
}

static int end(sim *s) {
    model *m = s->model_own;
    tm_error error = {0};
    if (m->api.tm_stage_hybrid_(s->world, m->hybrid, s->contact, &error))
        return sim_report(s->scene, s->scene->model.line, &error);
    int index;
    sim_effect_find("hybrid", &index);
    sim_own_stages(s, index);
    return 0;
}

static tm_status frame(sim *s, const tm_tool_pose *to, int32_t substeps) {
    model *m = s->model_own;
    tm_status status = sim_world_frame(s, to, substeps);
    if (status) return status;
    m->api.tm_hybrid_recover_(m->hybrid, s->world);
    for (int i = 0; s->contact && i < s->instrument_count; i++)
        s->reaction[i] = m->api.tm_hybrid_reaction_(m->hybrid, i);
    return status;
}

static void feel(sim *s, int i) {
    model *m = s->model_own;
    tm_patch unused, *patch = s->patch ? &s->patch[i] : &unused;
    bool made =
        m->api.tm_hybrid_patch_(m->hybrid, i, s->velocity_m_s[i], 2 * s->frame_s, s->patch_vertices,
                                s->patch_vertices > 12 ? TM_PATCH_TRIANGLES : 16, patch, s->reaction[i].stiffness_N_m);
    s->reaction[i].stiffness_kind = made;
    s->patch_valid[i] = made && s->patch && s->wants[i] == SIM_SENDS_PATCH;
}

static tm_surface_view surface(const sim *s) {
    model *m = s->model_own;
    return m->api.tm_hybrid_surface_(m->hybrid);
}

static const double *displacement(const sim *s) { return tm_world_state(s->world)->u_m; }
static double time_s(const sim *s) { return tm_world_state(s->world)->time_s; }
static uint64_t hash(const sim *s) { return tm_world_hash(s->world); }
static int64_t bytes(const sim *s) { return ((model *)s->model_own)->bytes; }

const sim_model sim_model_hybrid = {.begin = begin,
                                    .end = end,
                                    .frame = frame,
                                    .feel = feel,
                                    .surface = surface,
                                    .displacement = displacement,
                                    .time_s = time_s,
                                    .hash = hash,
                                    .bytes = bytes,
                                    .destroy = destroy};

const sim_effect sim_effect_hybrid = {
    .name = "hybrid",
    .doc = "`model: hybrid` asks for it: tensor/mass where the section says (that part may be cut), everything else "
           "condensed onto the interface, "
           "quasi-static, its inside recovered once a frame. Opens the module `solve` (CHOLMOD).",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_solve_options)},
    .model = APP_HYBRID,
    .check = check,
    .excludes = {{"breathing", "the condensed part's supports stand still; write 'model: dynamic'"}},
};
