/* Keys of the laws' constants: laws that have a constant of the same name share its key. */
#ifndef TM_LAW_KEYS_H
#define TM_LAW_KEYS_H

#include "scene.h"

/* Changes law and index to those that store the constant: of the first law that has a constant of this name. */
void app_shared_constant(tm_law_kind *law, int32_t *index);
/* Returns a constant of a law; only those of the material's own law may be given. */
const app_number *app_material_constant(const app_material *m, tm_law_kind law, int32_t index);
/* Returns whether a law has a constant of this name. */
bool app_law_has_constant(tm_law_kind law, const char *name);

#endif
