/* From a scene's words to the library's arrays: laws, selectors, tissue. */
#ifndef TM_SCENE_PARTS_H
#define TM_SCENE_PARTS_H

#include "scene.h"
#include "tensormass/tissue.h"
#include "tensormass_io.h"

typedef enum app_law { APP_LAW_YOUNG, APP_LAW_LAME, APP_LAW_PAPER, APP_LAW_FIVE, APP_LAW_ENGINEERING } app_law;

/* Which family of constants a material has. Returns TM_ERR_ARGUMENT where it has none, half of one or two.
 */
tm_status app_scene_law(const app_scene *scene, const app_material *material, app_law *law);
static inline bool app_law_fibred(app_law law) { return law >= APP_LAW_PAPER; }

/* mark[vertex_count] := 1 where selected. Complains where nothing is. `*count` is how many. */
tm_status app_select_vertices(const app_scene *scene, const app_select *select, int line, const tm_mesh_file *mesh,
                              uint8_t *mark, int32_t *count);

/* Everything that needs no mesh. app_scene_load does not call it: effects check theirs in the same round. */
tm_status app_scene_check(const app_scene *scene);

/* Whether constants of nonlinear laws are those of the material's own. */
tm_status app_scene_law_check(const app_scene *scene, const app_material *material);
/* The scene's materials, one a region of the mesh: out[mesh->region_count]. `default_damping_1_s` where a material
 * names none. */
tm_status app_scene_materials(const app_scene *scene, const tm_mesh_file *mesh, double default_damping_1_s,
                              tm_material *out);

/* docs/scene-reference.md on `out`. `effect_name[i]` and `effect_doc[i]` head the fields of effect[i]. */
#include <stdio.h>
void app_scene_reference(FILE *out, const app_schema *effect, const char *const *effect_name,
                         const char *const *effect_doc, int effect_count);

#endif
