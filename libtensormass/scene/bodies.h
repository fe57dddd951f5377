/* Bodies of a scene: several meshes in one tissue. */
#ifndef TM_SCENE_BODIES_H
#define TM_SCENE_BODIES_H

#include "sim.h"

/* Checks what needs no mesh: names, and that a scene has either one mesh or bodies. */
tm_status sim_check_bodies(const app_scene *scene);
/* Loads a mesh that the scene names under `key`, with faults at its line. */
tm_status sim_load_mesh_file(const app_scene *scene, const char *key, const app_text *path, double scale,
                             tm_mesh_file *file);
/* Loads all bodies and merges them into s->file; fills s->body. */
tm_status sim_load_bodies(sim *s);

/* body_part.c: keeps only the parts of the mesh that the body's `part` names. */
tm_status sim_take_part(const app_scene *scene, const app_body *body, tm_mesh_file *file);

/* Lists the tetrahedra of rigid bodies in s->rigid_tet; adds the stage that leads them along their paths, if any. */
tm_status sim_mark_rigid(sim *s);
tm_status sim_build_paths(sim *s);

/* body_effects.c: checks the effects that bodies name, and makes them effects of the scene. */
tm_status sim_merge_body_effects(app_scene *scene);
/* Sets tm_tissue_def.region_effects, if bodies differ in an effect. */
tm_status sim_set_region_effects(sim *s);

/* Returns the body with this name, or null. */
const sim_body *sim_body_find(const sim *s, const char *name);
/* Returns the index of each tetrahedron's body, [tet_count], 0 without bodies; null without memory. tm_release it. */
int32_t *sim_bodies_of_tets(const sim *s);

/* body_overlap.c: warns if surface vertices of a body are inside another one, deeper than the tolerance, in a pair that
 * touches; pair: [body_count*body_count]. */
tm_status sim_warn_overlaps(const sim *s, const int32_t *tet_body, const uint8_t *pair, double tolerance_m);

#endif
