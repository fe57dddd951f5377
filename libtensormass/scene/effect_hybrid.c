/* Hybrid model: a world for the part that may be cut; the rest is condensed onto their interface. */
#include <stdlib.h>
#include <string.h>

#include "choices.h"
#include "models.h"
#include "solve_api.h"

#define OPTION(member) offsetof(sim_solve_options, member), 0

static const app_field fields[] = {
    {"hybrid", APP_SECTION, NULL, NULL, 0, 0, OPTION(here),
     "settings of `model: hybrid`: which part is dynamic; without that model the section has no effect"},
    {"hybrid.region", APP_TEXT, NULL, NULL, 0, 0, OPTION(region), "this region is dynamic"},
    {"hybrid.box", APP_SECTION, NULL, NULL, 0, 0, OPTION(box), "tetrahedra with their centre in this box are dynamic"},
    {"hybrid.box.min", APP_VECTOR, "length", "!", 0, 0, OPTION(box_min), "lower corner"},
    {"hybrid.box.max", APP_VECTOR, "length", "!", 0, 0, OPTION(box_max), "upper corner"},
    {"hybrid.smooth", APP_FLAG, NULL, "yes", 0, 0, OPTION(smooth),
     "add tetrahedra to the dynamic part where its interface is jagged, if that removes a fifth of the "
     "interface's vertices; no: use exactly the region or box"},
    {"hybrid.precision", APP_CHOICE, APP_CHOICE_WORDS(APP_PRECISIONS), "double", 0, 0, OPTION(precision),
     "precision of the condensed part's matrices"},
    {"hybrid.cache", APP_FLAG, NULL, "yes", 0, 0, OPTION(cache),
     "store the condensed part on disk: in $TM_CACHE_DIR, $XDG_CACHE_HOME/tensormass or ~/.cache/tensormass"},
    {"hybrid.max_vertices", APP_INTEGER, NULL, "256", 8, 4096, OPTION(max_vertices),
     "largest number of vertices in contact on the condensed part"},
};

static tm_status check(const app_scene *scene, const void *own) {
    const sim_solve_options *o = own;
    if (!o->region.line == !o->box.line)
        return app_scene_bad(scene, scene->model.line,
                             "model: hybrid needs a dynamic part; give 'hybrid:' either a region or a box");
    return 0;
}

static tm_status choose_part(const sim *s, const sim_solve_options *o, uint8_t *dynamic) {
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
            "no tetrahedron is in the dynamic part; name another region or box (tm-mesh info lists regions)");
    if (count == s->mesh->tet_count)
        return app_scene_bad(
            s->scene, line,
            "every tetrahedron is in the dynamic part; write 'model: dynamic', or make the part smaller");
    return 0;
}

tm_status sim_build_hybrid(sim *s) {
    const sim_solve_options *o = sim_options(s->scene, "hybrid");
    sim_solve_api api;
    char path[SIM_SOLVE_PATH];
    tm_error error = {0};
    tm_solve_report report = {0};
    if (!sim_solve_open(&s->scene->host, &api, &error)) return sim_report(s->scene, s->scene->model.line, &error);
    uint8_t *dynamic = calloc((size_t)s->mesh->tet_count, 1);
    tm_status rc =
        dynamic ? choose_part(s, o, dynamic)
                : app_scene_fail(s->scene, s->scene->model.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    if (!rc) {
        tm_hybrid_def how = api.tm_hybrid_def_default_();
        sim_solve_set(s, o, "hybrid", path,
                      &(sim_solve_members){&how.problem, &how.precision, &how.max_contact_vertices, &how.file});
        how.dynamic = dynamic;
        how.as_marked = !o->smooth.on;
        rc = sim_check_model(s, api.tm_model_hybrid_(&s->def.model, &how, &s->model, &report, &error), &error);
    }
    free(dynamic);
    if (!rc) sim_solve_told(s, "the condensed part", &report);
    return rc;
}

const sim_effect sim_effect_hybrid = {
    .name = "hybrid",
    .doc = "`model: hybrid` uses it: the named part is dynamic (tensor/mass) and can be cut; the rest is "
           "quasi-static and condensed onto the interface, its interior computed only when it is read. Opens "
           "the module `solve` (CHOLMOD).",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(sim_solve_options)},
    .model = APP_HYBRID,
    .check = check,
    .excludes = {{"breathing", "the supports of the condensed part cannot move; write 'model: dynamic'"}},
};
