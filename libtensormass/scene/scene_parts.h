/* Converts a scene's values to the library's arrays: laws, selectors, tissue. */
#ifndef TM_SCENE_PARTS_H
#define TM_SCENE_PARTS_H

#include "scene.h"
#include "tensormass/tissue.h"
#include "tensormass_io.h"

typedef enum app_law { APP_LAW_YOUNG, APP_LAW_LAME, APP_LAW_PAPER, APP_LAW_FIVE, APP_LAW_ENGINEERING } app_law;

/* Finds the family of constants of a material. Returns TM_ERR_ARGUMENT for none, an incomplete one, or two. */
tm_status app_scene_law(const app_scene *scene, const app_material *material, app_law *law);
static inline bool app_law_fibred(app_law law) { return law >= APP_LAW_PAPER; }

/* Sets mark[vertex_count] to 1 for selected vertices and `*count` to their number. Adds a fault if there are none. */
tm_status app_select_vertices(const app_scene *scene, const app_select *select, int line, const tm_mesh_file *mesh,
                              uint8_t *mark, int32_t *count);

/* Checks what needs no mesh. app_scene_load does not call it: effects run their checks in the same pass. */
tm_status app_scene_check(const app_scene *scene);

/* Writes names for a message, "none" without one; what does not fit is left out. */
void app_list_names(const char (*name)[64], int32_t count, char list[512]);
/* Returns the index of a group of the mesh, or -1. */
int32_t app_find_group(const tm_mesh_file *mesh, const char *name);

/* Checks that nonlinear constants belong to the material's law. */
tm_status app_scene_law_check(const app_scene *scene, const app_material *material);
/* Fills out[mesh->region_count] with the scene's materials, one per region of the mesh. `default_damping_1_s` applies
 * to materials without damping. */
tm_status app_scene_materials(const app_scene *scene, const tm_mesh_file *mesh, double default_damping_1_s,
                              tm_material *out);

/* Prints docs/scene-reference.md to `out`. `effect_name[i]` and `effect_doc[i]` head the fields of effect[i]. */
#include <stdio.h>
void app_scene_reference(FILE *out, const app_schema *effect, const char *const *effect_name,
                         const char *const *effect_doc, int effect_count);

#endif
