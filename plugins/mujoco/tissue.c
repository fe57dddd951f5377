/* MuJoCo engine plugin "tensormass.tissue": a scene's tissue among MuJoCo's bodies. Each instrument of the scene is
 * a site. The tool's tip follows the site, and the tissue's force on it is a passive force on the site's body. One
 * step of MuJoCo is one frame of the scene.
 *
 *     <extension><plugin plugin="tensormass.tissue"><instance name="liver">
 *       <config key="scene" value="liver-press.yaml"/> <config key="sites" value="tip"/>
 *       <config key="set" value="gravity=yes"/>
 *     </instance></plugin></extension>
 *
 * plugin_state holds the force on each tip, N, world, 3 numbers per instrument. It does not hold the tissue: the
 * copy of mj_copyData begins with tissue at rest, and a warning says so. */
#include <mujoco/mujoco.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tensormass_scene.h"

enum { MAX_SETS = 32 };

typedef struct tissue {
    tm_scene *scene;
    tm_tool_pose pose[TM_MAX_INSTRUMENTS];
    int site[TM_MAX_INSTRUMENTS];
    int instrument_count;
} tissue;

static const char *const attributes[] = {"scene", "sites", "set", "color"};

static tissue *tissue_of(const mjData *d, int instance) { return (tissue *)d->plugin_data[instance]; }

/* Finds the sites of the attribute "sites", names separated by spaces. Returns -1 if a site is missing. */
static int sites_of(const mjModel *m, int instance, int site[TM_MAX_INSTRUMENTS]) {
    char names[512], *rest = names;
    const char *value = mj_getPluginConfig(m, instance, "sites");
    int count = 0;
    snprintf(names, sizeof names, "%s", value ? value : "");
    for (char *name = strtok_r(rest, " ", &rest); name && count < TM_MAX_INSTRUMENTS;
         name = strtok_r(NULL, " ", &rest)) {
        site[count] = mj_name2id(m, mjOBJ_SITE, name);
        if (site[count++] < 0) {
            mju_warning(
                "tensormass.tissue: sites: no site '%s'; name sites of the model, one an instrument of the scene",
                name);
            return -1;
        }
    }
    return count;
}

static int state_count(const mjModel *m, int instance) {
    int site[TM_MAX_INSTRUMENTS];
    int count = sites_of(m, instance, site);
    return count > 0 ? 3 * count : 0;
}

static void warn(void *user, const tm_diagnostic *d) {
    char text[2000];
    (void)user;
    tm_diagnostic_format(d, text, sizeof text);
    if (d->severity == TM_FAULT) mju_warning("tensormass.tissue: %s", text);
}

/* Opens the scene with a frame as long as MuJoCo's step, and the values of the attribute "set": PATH=VALUE, separated
 * by ';'. */
static tm_scene *opened(const mjModel *m, int instance) {
    char rate[64], sets[1024];
    const char *set[MAX_SETS] = {rate}, *file = mj_getPluginConfig(m, instance, "scene"),
               *more = mj_getPluginConfig(m, instance, "set");
    int32_t count = 1;
    tm_scene *scene = NULL;
    snprintf(rate, sizeof rate, "time.frame_rate=%.17g Hz", 1 / m->opt.timestep);
    snprintf(sets, sizeof sets, "%s", more ? more : "");
    for (char *rest = sets, *one = strtok_r(rest, ";", &rest); one && count < MAX_SETS;
         one = strtok_r(NULL, ";", &rest))
        set[count++] = one;
    if (!file || !*file)
        mju_warning("tensormass.tissue: no scene; add <config key=\"scene\" value=\"FILE.yaml\"/>");
    else {
        tm_diagnostics told = {.on_diagnostic = warn};
        tm_scene_def def = tm_scene_def_default();
        def.file = file;
        def.set = set;
        def.set_count = count;
        def.diagnostics = &told;
        tm_scene_open(&def, &scene);
        tm_diagnostics_clear(&told);
    }
    return scene;
}

static void lay_poses(tissue *t, const mjData *d) {
    for (int i = 0; i < t->instrument_count; i++)
        memcpy(t->pose[i].tip_m, d->site_xpos + 3 * t->site[i], sizeof t->pose[i].tip_m);
}

static void destroy(mjData *d, int instance) {
    tissue *t = tissue_of(d, instance);
    if (t) tm_scene_close(t->scene);
    free(t);
    d->plugin_data[instance] = 0;
}

static int begin(const mjModel *m, mjData *d, int instance) {
    tissue *t = calloc(1, sizeof *t);
    d->plugin_data[instance] = (uintptr_t)t;
    if (!t || !(t->scene = opened(m, instance))) return destroy(d, instance), -1;
    t->instrument_count = sites_of(m, instance, t->site);
    int32_t wanted = tm_scene_get_info(t->scene).instrument_count;
    if (t->instrument_count != wanted) {
        mju_warning("tensormass.tissue: %d sites for %d instruments of the scene; name one each", t->instrument_count,
                    (int)wanted);
        return destroy(d, instance), -1;
    }
    for (int i = 0; i < t->instrument_count; i++) t->pose[i] = tm_scene_pose(t->scene, i);
    return 0;
}

/* Resets the tissue to rest by reading the scene again. */
static void reset(const mjModel *m, mjtNum *state, void *data, int instance) {
    tissue *t = data;
    if (!t) return;
    mju_zero(state, 3 * t->instrument_count);
    if (tm_scene_get_info(t->scene).frames == 0) return;
    tm_scene *scene = opened(m, instance);
    if (!scene) return; /* already reported */
    tm_scene_close(t->scene);
    t->scene = scene;
    for (int i = 0; i < t->instrument_count; i++) t->pose[i] = tm_scene_pose(t->scene, i);
}

static void copy(mjData *to, const mjModel *m, const mjData *from, int instance) {
    (void)m;
    if (tissue_of(from, instance) && tm_scene_get_info(tissue_of(from, instance)->scene).frames &&
        tissue_of(to, instance))
        mju_warning("tensormass.tissue: the tissue of a copied model starts undeformed");
}

/* Applies the last frame's tip forces to the bodies. */
static void compute(const mjModel *m, mjData *d, int instance, int capability) {
    tissue *t = tissue_of(d, instance);
    const mjtNum *force = d->plugin_state + m->plugin_stateadr[instance], none[3] = {0, 0, 0};
    (void)capability;
    for (int i = 0; i < t->instrument_count; i++)
        mj_applyFT(m, d, force + 3 * i, none, d->site_xpos + 3 * t->site[i], m->site_bodyid[t->site[i]],
                   d->qfrc_passive);
}

static void advance(const mjModel *m, mjData *d, int instance) {
    tissue *t = tissue_of(d, instance);
    mjtNum *force = d->plugin_state + m->plugin_stateadr[instance];
    lay_poses(t, d);
    const tm_status status = tm_scene_step(t->scene, t->pose);
    if (status) mju_warning("tensormass.tissue: %s", tm_status_name(status));
    for (int i = 0; i < t->instrument_count; i++) {
        tm_tool_reaction r = tm_scene_reaction(t->scene, i);
        for (int a = 0; a < 3; a++) force[3 * i + a] = r.flags & TM_REACTION_UNSTABLE ? 0 : r.force_N[a];
    }
}

/* Draws a triangle. MuJoCo's is (0,0) (sx,0) (0,sy) in its frame, so the frame consists of two edges and the normal. */
static void draw(mjvScene *scn, const double corner[3][3], const float rgba[4]) {
    if (scn->ngeom >= scn->maxgeom) return;
    double edge[2][3], normal[3], mat[9], size[3] = {1, 1, 0};
    for (int e = 0; e < 2; e++) mju_sub3(edge[e], corner[e + 1], corner[0]);
    mju_cross(normal, edge[0], edge[1]);
    mju_normalize3(normal);
    for (int a = 0; a < 3; a++) {
        mat[3 * a] = edge[0][a];
        mat[3 * a + 1] = edge[1][a];
        mat[3 * a + 2] = normal[a];
    }
    mjv_initGeom(&scn->geoms[scn->ngeom++], mjGEOM_TRIANGLE, size, corner[0], mat, rgba);
}

static void show(const mjModel *m, mjData *d, const mjvOption *opt, mjvScene *scn, int instance) {
    tissue *t = tissue_of(d, instance);
    float rgba[4] = {0.7f, 0.3f, 0.25f, 1};
    const char *color = mj_getPluginConfig(m, instance, "color");
    (void)opt;
    if (color) sscanf(color, "%f %f %f %f", rgba, rgba + 1, rgba + 2, rgba + 3);
    tm_surface_view surface = tm_scene_surface(t->scene);
    const double *rest = tm_scene_mesh(t->scene)->rest_m, *u = tm_scene_displacement(t->scene);
    for (int32_t f = 0; f < surface.count; f++) {
        double corner[3][3];
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++)
                corner[k][a] = rest[3 * surface.triangle[3 * f + k] + a] + u[3 * surface.triangle[3 * f + k] + a];
        draw(scn, corner, rgba);
    }
}

mjPLUGIN_LIB_INIT(tensormass) {
    mjpPlugin plugin;
    mjp_defaultPlugin(&plugin);
    plugin.name = "tensormass.tissue";
    plugin.capabilityflags |= mjPLUGIN_PASSIVE;
    plugin.nattribute = sizeof attributes / sizeof *attributes;
    plugin.attributes = attributes;
    plugin.nstate = state_count;
    plugin.init = begin;
    plugin.destroy = destroy;
    plugin.copy = copy;
    plugin.reset = reset;
    plugin.compute = compute;
    plugin.advance = advance;
    plugin.visualize = show;
    mjp_registerPlugin(&plugin);
}
