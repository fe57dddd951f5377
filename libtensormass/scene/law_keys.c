/* Finds the place of a law's constant by its name. */
#include "law_keys.h"

#include <string.h>

/* Returns the constant's index, or -1. */
static int32_t find_constant(tm_law_kind law, const char *name) {
    const tm_law_constant *c;
    for (int32_t i = 0; (c = tm_law_constant_at(law, i)); i++)
        if (!strcmp(c->name, name)) return i;
    return -1;
}

bool app_law_has_constant(tm_law_kind law, const char *name) { return find_constant(law, name) >= 0; }

void app_shared_constant(tm_law_kind *law, int32_t *index) {
    const char *name = tm_law_constant_at(*law, *index)->name;
    tm_law_kind first = TM_LAW_LINEAR;
    while (!app_law_has_constant(first, name)) first++;
    *law = first, *index = find_constant(first, name);
}

const app_number *app_material_constant(const app_material *m, tm_law_kind law, int32_t index) {
    app_shared_constant(&law, &index);
    return &m->constant[law][index];
}
