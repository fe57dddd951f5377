/* Plans the runs: the scene as it is, and one change of it at a time. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/program_host.h"
#include "scene/effects.h"
#include "scene/law_keys.h"
#include "sim/stream.h"
#include "study.h"

/* Hashes files that a setting names by their contents. */
void study_make_key(const study *t, study_run *r) {
    uint64_t hash = sim_hash_bytes(t->files, tm_version(), strlen(tm_version()));
    /* As written: 41 frames of 40 ms are 1.6400000000000001 s, of which a study's file keeps 1.64. */
    char duration[32];
    hash = sim_hash_bytes(hash, duration, (size_t)snprintf(duration, sizeof duration, "%.9g", t->duration_s));
    for (int i = 0; i < r->set_count; i++) {
        const char *value = strchr(r->set[i], '=');
        const bool file = value && value[1] == '/';
        hash = sim_hash_bytes(hash, r->set[i], file ? (size_t)(value - r->set[i]) : strlen(r->set[i]) + 1);
        if (file) hash = sim_hash_file(hash, value + 1);
    }
    snprintf(r->key, sizeof r->key, "%016llx", (unsigned long long)hash);
}

static uint64_t files_hash(const study *t, const sim *own) {
    uint64_t hash = own->body_count ? t->scene_hash : sim_hash_file(t->scene_hash, own->scene->mesh.s);
    for (int32_t i = 0; i < own->body_count; i++)
        hash = sim_hash_file(hash, ((const app_body *)own->scene->body.item)[i].mesh.s);
    return own->fibre ? sim_hash_bytes(hash, own->fibre, 3 * sizeof *own->fibre * (size_t)own->mesh->tet_count) : hash;
}

/* --- meshes, each with and without strain smoothing --- */

static void toggle_strain_smoothing(study_run *r, bool named) {
    r->form = STUDY_OTHER_VOLUME;
    study_set(r, named ? "strain_smoothing" : "strain_smoothing.shear_share=0.4");
}

static void plan_meshes(study *t, const sim *own) {
    const bool named = sim_has(own, "strain_smoothing");
    char name[100];
    for (int m = 0; m < t->mesh_count; m++)
        for (int form = 0; form < 2; form++) {
            if (m == 0 && form == 0) continue; /* as it is */
            snprintf(name, sizeof name, "%.60s%s", t->mesh[m].name,
                     !form   ? ""
                     : named ? ", no strain_smoothing"
                             : ", strain_smoothing");
            study_run *r = study_add(t, m ? "mesh" : "strain_smoothing", name);
            r->mesh = m;
            if (m) study_set(r, "tissue.mesh=%s", t->mesh[m].path);
            r->foreign = t->mesh[m].foreign;
            if (own->scene->step.line && t->mesh[m].step > 0) /* the scene's step is too long for it */
                study_set(r, "time.step=%.9g", own->dt_s * fmin(1, t->mesh[m].step));
            if (t->mesh[m].made) study_set(r, "tissue.scale=1"), study_set_carried(r, own);
            if (m && *t->mesh[m].fibres) {
                study_set(r, "anisotropy");
                study_set(r, "anisotropy.file=%s", t->mesh[m].fibres);
            }
            if (form) toggle_strain_smoothing(r, named);
        }
}

/* --- numbers --- */

static void plan_numbers(study *t, const sim *own) {
    static const char *const model[] = {"dynamic", "precomputed", "hybrid"};
    const app_scene *scene = own->scene;
    study_run *r = study_add(t, "step", "half the step");
    if (scene->step.line)
        study_set(r, "time.step=%.9g", own->dt_s / 2);
    else
        study_set(r, "time.step_fraction=%.9g", scene->step_fraction.si / 2);
    if (!scene->step.line && scene->step_fraction.si < 1)
        study_set(study_add(t, "step", "the whole critical step"), "time.step_fraction=1");
    const bool single = scene->precision.index == TM_SINGLE;
    study_set(study_add(t, "precision", single ? "double" : "single"), "tissue.precision=%s",
              single ? "double" : "single");
    for (int m = 0; m < 3; m++) {
        const int section = sim_effect_find(scene, "hybrid");
        if (m == scene->model.index || (t->quick && m == APP_PRECOMPUTED)) continue;
        if (m == APP_HYBRID && !((const app_section *)scene->effect[section])->line) continue; /* it is absent */
        study_set(study_add(t, "model", model[m]), "model=%s", model[m]);
    }
    for (int k = 0; k < 3; k++) {
        static const double factor[] = {0.5, 2, 4};
        char name[40];
        const double rate = scene->frame_rate.si * factor[k];
        snprintf(name, sizeof name, "%g Hz", rate);
        if (rate >= 0.5 && rate <= 2000) study_set(study_add(t, "frame", name), "time.frame_rate=%.9g", rate);
    }
}

/* Plans longer steps by mass scaling. The scene's bound `time.mass_scaling_max` stays; a run beyond it fails with that
 * message. */
static void plan_mass(study *t, const sim *own) {
    static const double factor[] = {1.2, 1.5, 2};
    if (own->scene->model.index != APP_DYNAMIC || sim_has(own, "strain_smoothing")) return;
    if (own->scene->mass_scaling.on) {
        study_run *r = study_add(t, "mass", "its own mass");
        study_set(r, "time.mass_scaling=no");
        if (own->scene->mass_scaling_max.line) study_set(r, "time.mass_scaling_max");
        study_set(r, "time.step");
        return;
    }
    for (int k = 0; k < (t->quick ? 1 : 3); k++) {
        char name[60];
        snprintf(name, sizeof name, "heavier for %.3g times the step", factor[k]);
        study_run *r = study_add(t, "mass", name);
        study_set(r, "time.step=%.9g", own->dt_s * factor[k]);
        study_set(r, "time.mass_scaling=yes");
    }
}

/* Returns among how many threads the scene's step is divided if this many are requested. */
static int parts_of(const study *t, const char *asked) {
    char why[400], *set[STUDY_SETS];
    memcpy(set, t->set, sizeof *set * (size_t)t->set_count);
    set[t->set_count] = (char *)(uintptr_t)asked;
    sim *s = study_build(t->file, set, t->set_count + 1, why, sizeof why);
    const int parts = s ? study_threads(s) : 0;
    sim_destroy(s);
    return parts;
}

/* Plans as many of this machine's processors as the tissue is worth. A scene with several threads is also run with one,
 * which waits for no other. The forces are bit-identical. */
static void plan_threads(study *t, const sim *own) {
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    char name[40], asked[40];
    if (study_threads(own) > 1) study_set(study_add(t, "threads", "1 thread"), "threads=1");
    if (!own->model->world || own->scene->threads.value > 1) return;
    for (int n = 2; n <= cores && n <= 8; n *= 2) {
        snprintf(name, sizeof name, "%d threads", n);
        snprintf(asked, sizeof asked, "threads=%d", n);
        if (parts_of(t, asked) < n) return;
        study_set(study_add(t, "threads", name), "%s", asked);
    }
}

/* --- effects --- */

/* Makes fibred tissue isotropic with its transverse constants. */
static void without_fibres(study_run *r, const app_scene *scene) {
    for (int i = 0; i < scene->material.count && r->set_count + 2 < STUDY_SETS; i++) {
        const app_material *m = (const app_material *)scene->material.item + i;
        app_law law;
        if (app_scene_law(scene, m, &law) || !app_law_fibred(law)) continue;
        if (law == APP_LAW_ENGINEERING)
            study_set(r, "tissue.materials.%s={young: %.9g, poisson: %.9g, density: %.9g}", m->region.s, m->E_T.si,
                      m->nu_TT.si, m->density.si);
        else
            study_set(r, "tissue.materials.%s={lambda: %.9g, mu: %.9g, density: %.9g}", m->region.s, m->lambda_T.si,
                      m->mu_T.si, m->density.si);
    }
}

static void plan_effects(study *t, const sim *own) {
    for (int e = 0; e < sim_effect_count; e++) {
        const sim_effect *effect = sim_effects[e];
        if (!sim_effect_line(own->scene, e) || effect->model || effect->trial >= SIM_TRIAL_KEEP) continue;
        study_run *r = study_add(t, "drop", effect->name);
        study_set(r, "%s", effect->name);
        if (!strcmp(effect->name, "anisotropy")) without_fibres(r, own->scene);
    }
    for (int e = 0; e < sim_effect_count && !t->quick; e++)
        if (sim_effects[e]->trial == SIM_TRIAL_DROP_OR_ADD && !sim_effect_line(own->scene, e))
            study_set(study_add(t, "add", sim_effects[e]->name), "%s=", sim_effects[e]->name);
}

/* --- laws of large strains --- */

/* Leaves out what excludes a nonlinear law. */
static void allow_law(study_run *r, const sim *own) {
    const app_scene *scene = own->scene;
    const int smoothing = sim_effect_find(scene, "strain_smoothing");
    if (sim_has(own, "rotation")) study_set(r, "rotation");
    if (scene->precision.index == TM_SINGLE) study_set(r, "tissue.precision=double");
    if (sim_effect_line(scene, smoothing)) study_set(r, "strain_smoothing.shear_share=0");
}

static void forget_key(study_run *r, const app_material *m, const char *key) {
    if (r->set_count < STUDY_SETS) study_set(r, "tissue.materials.%s.%s", m->region.s, key);
}

/* Leaves out a material's keys of its nonlinear law. */
static void forget_law(study_run *r, const app_material *m) {
    study_set(r, "tissue.materials.%s.law=linear", m->region.s);
    for (int32_t law = 0; law < APP_LAWS; law++) {
        const tm_law_constant *c;
        for (int32_t i = 0; (c = tm_law_constant_at((tm_law_kind)law, i)); i++)
            if (app_material_constant(m, (tm_law_kind)law, i)->line) forget_key(r, m, c->name);
    }
    if (m->stretch.line) forget_key(r, m, "stretch");
}

/* Plans what another law of large strains changes: for linear tissue the nonlinear one that needs no further constant,
 * neo-hooke or, with fibres, st-venant-kirchhoff; for nonlinear tissue the linear law. */
static void plan_laws(study *t, const sim *own) {
    const app_scene *scene = own->scene;
    const app_material *all = scene->material.item;
    bool nonlinear = false, fibred = false;
    for (int i = 0; i < scene->material.count; i++) {
        app_law law;
        nonlinear |= all[i].law.index != TM_LAW_LINEAR;
        fibred |= !app_scene_law(scene, all + i, &law) && app_law_fibred(law);
    }
    if (scene->model.index != APP_DYNAMIC || scene->material.count > STUDY_SETS / 2 - 4) return;
    const char *other = fibred ? "st-venant-kirchhoff" : "neo-hooke";
    study_run *r = study_add(t, "law", nonlinear ? "linear" : other);
    if (!nonlinear) allow_law(r, own);
    if (nonlinear && scene->adaptive.line) study_set(r, "time.adaptive");
    for (int i = 0; i < scene->material.count && r->set_count < STUDY_SETS; i++)
        if (!nonlinear)
            study_set(r, "tissue.materials.%s.law=%s", all[i].region.s, other);
        else if (all[i].law.index != TM_LAW_LINEAR)
            forget_law(r, all + i);
}

/* --- uncertain constants --- */

#define STIFF(name)                                                                                                    \
    { #name, offsetof(app_material, name) }
static const struct {
    const char *name;
    size_t offset;
} stiff[] = {STIFF(young), STIFF(lambda), STIFF(mu),  STIFF(lambda_T), STIFF(mu_T), STIFF(lambda_L),
             STIFF(mu_L),  STIFF(beta),   STIFF(E_L), STIFF(E_T),      STIFF(G_L)},
  ratio[] = {STIFF(poisson), STIFF(nu_LT), STIFF(nu_TT)};

static const app_number *constant(const app_material *m, size_t offset) {
    return (const app_number *)(const void *)((const char *)m + offset);
}

static void plan_constants(study *t, const sim *own) {
    const app_scene *scene = own->scene;
    char name[60], path[1024];
    for (int way = -1; way <= 1; way += 2) {
        study_run *stiffness = NULL, *poisson = NULL;
        for (int i = 0; i < scene->material.count; i++) {
            const app_material *m = (const app_material *)scene->material.item + i;
            for (size_t c = 0; c < sizeof stiff / sizeof *stiff; c++) {
                const app_number *n = constant(m, stiff[c].offset);
                snprintf(name, sizeof name, "stiffness %+d %%", 20 * way);
                if (!n->line) continue;
                if (!stiffness) stiffness = study_add(t, "constant", name);
                if (stiffness->set_count < STUDY_SETS)
                    study_set(stiffness, "tissue.materials.%s.%s=%.9g", m->region.s, stiff[c].name,
                              n->si * (1 + 0.2 * way));
            }
            for (size_t c = 0; c < sizeof ratio / sizeof *ratio; c++) {
                const app_number *n = constant(m, ratio[c].offset);
                const double value = fmin(n->si * (1 + 0.2 * way), fmax(0.495, n->si));
                snprintf(name, sizeof name, "Poisson's ratio %+.3g %%", 100 * (value / n->si - 1));
                if (!n->line || n->si == 0) continue;
                if (!poisson) poisson = study_add(t, "constant", name);
                if (poisson->set_count < STUDY_SETS)
                    study_set(poisson, "tissue.materials.%s.%s=%.9g", m->region.s, ratio[c].name, value);
            }
        }
        /* A fifth of the maximum possible fibre error, 90 degrees. */
        if (own->fibre && study_turn_fibres(t, own, way * 18 * 3.14159265358979 / 180, path)) {
            snprintf(name, sizeof name, "fibres turned by %+d deg", 18 * way);
            study_run *r = study_add(t, "constant", name);
            study_set(r, "anisotropy");
            study_set(r, "anisotropy.file=%s", path);
        }
    }
}

/* --- all --- */

static void quiet_sections(study *t) {
    app_scene *scene = NULL;
    if (sim_scene_load(t->file, t->set, t->set_count, app_program_host(), &scene)) return;
    for (int e = 0; e < sim_effect_count; e++)
        if (sim_effects[e]->trial == SIM_TRIAL_LEAVE_OUT && sim_effect_line(scene, e) && t->set_count < STUDY_SETS / 2)
            t->set[t->set_count++] = (char *)(uintptr_t)sim_effects[e]->name;
    const sim_haptics *haptics = scene->effect[sim_effect_find(scene, "haptics")];
    t->feels = sim_effect_line(scene, sim_effect_find(scene, "haptics")) != 0;
    t->sends = t->feels && haptics->sends.line ? haptics->sends.index : -1;
    scene->pace = SIM_LOCKSTEP;
    t->own_law = t->feels ? haptics->extrapolator.index : -1;
    t->own_times = t->feels ? sim_stream_per_frame(scene) : -1;
    app_scene_free(scene);
}

int study_plan_own(study *t) {
    char why[400] = "";
    app_scene *scene = NULL;
    int rc = app_exit_code(
        sim_scene_load(t->file, t->set, t->set_count, app_program_host(), &scene)); /* prints tm-sim's messages */
    if (rc) return rc;
    if (!scene->instrument.count || !scene->hand.count)
        rc = app_bad_input(t->file, 0, "the hand's path is the load of the study, and the scene has no %s; add it",
                           scene->instrument.count ? "'hand:'" : "'instruments:'");
    if (t->duration_s < 0) t->duration_s = scene->duration.si;
    t->asked_s = t->duration_s;
    t->duration_s = study_old_span_s(t, t->asked_s);
    app_scene_free(scene);
    if (rc) return rc;
    if (t->frame_Hz > 0) {
        if (t->set_count == STUDY_SETS / 2) return app_bad_input("--frame", 0, "too many --set; leave some out");
        if (asprintf(&t->set[t->set_count++], "time.frame_rate=%.9g", t->frame_Hz) < 0) abort();
    }
    quiet_sections(t);
    sim *own = study_build(t->file, t->set, t->set_count, why, sizeof why);
    if (!own) {
        fprintf(stderr, "%s\n", why);
        return APP_BAD_INPUT;
    }
    t->scene_hash = sim_hash_file(0, t->file);
    t->own_vertices = own->mesh->vertex_count;
    t->files = files_hash(t, own);
    study_make_key(t, study_add(t, "own", "as it is"));
    sim_destroy(own);
    return 0;
}

int study_plan(study *t) {
    char why[400];
    sim *own = study_build(t->file, t->set, t->set_count, why, sizeof why);
    if (!own) return APP_FAILED;
    const int rc = study_make_meshes(t, own);
    if (!rc) {
        plan_meshes(t, own);
        plan_numbers(t, own);
        plan_mass(t, own);
        plan_threads(t, own);
        plan_effects(t, own);
        plan_laws(t, own);
        plan_constants(t, own);
        study_plan_felt(t, own);
        for (int i = 1; i < t->run_count; i++) study_make_key(t, &t->run[i]);
    }
    sim_destroy(own);
    return rc;
}
