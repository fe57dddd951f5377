/* Names the files of the results of the module `solve`, and passes a scene's options to it. */
#include "solve_api.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* --- cache folder --- */

static bool cache_folder(char *path, size_t size) {
    const char *own = getenv("TM_CACHE_DIR"), *xdg = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    int length;
    if (own && *own)
        length = snprintf(path, size, "%s", own);
    else if (xdg && *xdg)
        length = snprintf(path, size, "%s/tensormass", xdg);
    else if (home && *home)
        length = snprintf(path, size, "%s/.cache/tensormass", home);
    else
        return false;
    return length > 0 && (size_t)length < size;
}

static bool make_folders(char *path) {
    for (char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        *slash = 0;
        bool there = mkdir(path, 0777) == 0 || errno == EEXIST;
        *slash = '/';
        if (!there) return false;
    }
    return mkdir(path, 0777) == 0 || errno == EEXIST;
}

/* Finds the cache folder: $TM_CACHE_DIR, else $XDG_CACHE_HOME/tensormass, else ~/.cache/tensormass. Creates it if
 * missing. Returns false on failure. */
static bool app_cache_folder(char *path, size_t size) { return cache_folder(path, size) && make_folders(path); }

/* Writes the file name of the result: folder and name depend on its inputs. The library checks the contents. Returns
 * null if there is no folder. */
static const char *name_file(const sim *s, const sim_solve_options *o, const char *kind, char path[SIM_SOLVE_PATH]) {
    char folder[900];
    if (!o->cache.on || !app_cache_folder(folder, sizeof folder)) return NULL;
    /* Scenes that differ in other inputs only overwrite each other's file; they never read a wrong one. */
    uint64_t key = tm_hash(&s->file.hash, sizeof s->file.hash, TM_HASH_SEED);
    for (int32_t r = 0; r < s->mesh->region_count; r++) {
        tm_material at_rest = s->material[r];
        at_rest.damping_1_s = 0; /* has no influence */
        key = tm_hash(&at_rest, sizeof at_rest, key);
    }
    if (o->region.line) key = tm_hash(o->region.s, strlen(o->region.s), key);
    if (o->box.line) key = tm_hash(o->box_min.v, sizeof o->box_min.v, tm_hash(o->box_max.v, sizeof o->box_max.v, key));
    key = tm_hash(s->fixed_dof, sizeof *s->fixed_dof * (size_t)s->fixed_count, key);
    key = tm_hash(&o->solver.index, sizeof o->solver.index, key);
    key = tm_hash(&o->precision.index, sizeof o->precision.index, key);
    if (s->def.model.tissue.strain_smoothing)
        key = tm_hash(&s->def.model.tissue.smoothed_shear_share, sizeof s->def.model.tissue.smoothed_shear_share, key);
    if (s->fibre) key = tm_hash(s->fibre, sizeof *s->fibre * 3 * (size_t)s->mesh->tet_count, key);
    snprintf(path, SIM_SOLVE_PATH, "%s/%s-%016llx.tms", folder, kind, (unsigned long long)key);
    return path;
}

void sim_solve_set(const sim *s, const sim_solve_options *o, const char *kind, char path[SIM_SOLVE_PATH],
                   const sim_solve_members *to) {
    to->problem->solver = (tm_solver)o->solver.index;
    to->problem->progress = s->scene->host.progress;
    to->problem->user = s->scene->host.user;
    *to->precision = (tm_precision)o->precision.index;
    *to->max_vertices = (int32_t)o->max_vertices.value;
    *to->file = name_file(s, o, kind, path);
}

void sim_solve_told(const sim *s, const char *what, const tm_solve_report *r) {
    if (r->from_file) return;
    char text[400];
    snprintf(text, sizeof text, "%s computed in %.1f s (%d columns, %.1f MB; %s)", what, r->seconds, r->columns,
             (double)r->responses_bytes * 1e-6, r->why);
    app_host_tell(&s->scene->host, TM_REMARK, TM_OK, s->scene->file, 0, text);
}
