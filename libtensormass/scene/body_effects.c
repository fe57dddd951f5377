/* Effects of single bodies: `bodies.NAME.effects`. They become effects of the scene, and each region knows which of
 * them act in it (tm_tissue_def.region_effects). What a scene says at the top level applies to all bodies. */
#include "bodies.h"

#include <stdlib.h>
#include <string.h>

/* --- equal options --- */

static bool is_unset(const app_field *field, int line) { return !field->fallback && !line; }

static bool same_items(const app_schema *schema, const app_field *list, const app_list *a, const app_list *b);

/* Returns whether two structs of options have equal values, wherever they were written. */
static bool same_value(const app_schema *schema, const app_field *field, const char *a, const char *b) {
    a += field->offset, b += field->offset;
    switch (field->kind) {
    case APP_NUMBER: {
        const app_number *x = (const app_number *)a, *y = (const app_number *)b;
        return x->si == y->si && is_unset(field, x->line) == is_unset(field, y->line);
    }
    case APP_INTEGER: return ((const app_integer *)a)->value == ((const app_integer *)b)->value;
    case APP_FLAG: return ((const app_flag *)a)->on == ((const app_flag *)b)->on;
    case APP_CHOICE: return ((const app_choice *)a)->index == ((const app_choice *)b)->index;
    case APP_LIST: return same_items(schema, field, (const app_list *)a, (const app_list *)b);
    case APP_SECTION: return true;
    case APP_VECTOR:
    case APP_TEXT:
    case APP_PATH:
    case APP_INTEGERS:
    case APP_TABLE:
    case APP_EFFECTS: break;
    }
    return false; /* no effect of bodies has them */
}

static bool same_items(const app_schema *schema, const app_field *list, const app_list *a, const app_list *b) {
    char prefix[96];
    const size_t length = (size_t)snprintf(prefix, sizeof prefix, "%s[].", list->path);
    bool same = a->count == b->count;
    for (int i = 0; i < a->count && same; i++)
        for (const app_field *f = schema->field; f < schema->field + schema->count; f++)
            if (!strncmp(f->path, prefix, length))
                same = same && same_value(schema, f, (const char *)a->item + list->size * (size_t)i,
                                          (const char *)b->item + list->size * (size_t)i);
    return same;
}

static bool same_options(const app_schema *schema, const void *a, const void *b) {
    bool same = true;
    for (const app_field *f = schema->field; f < schema->field + schema->count; f++)
        if (!strstr(f->path, "[]")) same = same && same_value(schema, f, a, b);
    return same;
}

/* --- from bodies to the scene --- */

static int line_in(const app_body *body, int effect) {
    return body->effects.options ? ((const app_section *)body->effects.options[effect])->line : 0;
}

/* Checks one effect of one body; `first`: the body that named it before, or null. */
static tm_status check_one(const app_scene *scene, const app_body *body, int index, const app_body *first) {
    const sim_effect *e = sim_effects[index];
    const int line = line_in(body, index), top = scene->of_bodies >> index & 1 ? 0 : sim_effect_line(scene, index);
    char where[600];
    if (!e->region)
        return app_scene_bad(scene, line,
                             "%s cannot differ between bodies, as rotation, strain_smoothing and viscosity can; write "
                             "'%s:' at the top level, where it applies to all of them",
                             e->name, e->name);
    if (body->rigid.on)
        return app_scene_bad(scene, line,
                             "body '%s' is rigid, so that %s has nothing to act on; remove it, or remove 'rigid: yes'",
                             body->name.s, e->name);
    if (top) {
        app_scene_where(scene, top, where, sizeof where);
        return app_scene_bad(scene, line,
                             "%s already applies to all bodies, as the top level names it (%s); remove one of the two",
                             e->name, where);
    }
    if (!first || same_options(&e->schema, first->effects.options[index], body->effects.options[index])) return 0;
    app_scene_where(scene, line_in(first, index), where, sizeof where);
    return app_scene_bad(scene, line,
                         "%s has other values in body '%s' (%s), and one stage with one set of values computes it in "
                         "all bodies that name it; write the same values",
                         e->name, first->name.s, where);
}

tm_status sim_merge_body_effects(app_scene *scene) {
    const app_body *body = scene->body.item, *first[SIM_MAX_EFFECTS] = {0};
    for (int b = 0; b < scene->body.count; b++)
        for (int i = 0; i < sim_effect_count; i++) {
            if (!line_in(body + b, i)) continue;
            const tm_status rc = check_one(scene, body + b, i, first[i]);
            if (rc) return rc;
            if (!first[i]) memcpy(scene->effect[i], body[b].effects.options[i], sim_effects[i]->schema.size);
            if (!first[i]) first[i] = body + b;
            scene->of_bodies |= UINT32_C(1) << i;
        }
    return 0;
}

tm_status sim_set_region_effects(sim *s) {
    const app_scene *scene = s->scene;
    const int regions = s->mesh->region_count;
    if (!scene->of_bodies) return 0;
    s->region_effects = calloc((size_t)regions, 1);
    if (!s->region_effects)
        return app_scene_fail(scene, scene->body.line, TM_ERR_MEMORY, "out of memory; close other programs");
    for (int b = 0; b < s->body_count; b++) {
        uint8_t flags = 0;
        for (int i = 0; i < sim_effect_count; i++)
            if (!sim_effect_line(scene, i) || sim_effect_everywhere(scene, i) || sim_body_has_effect(scene, b, i))
                flags |= (uint8_t)sim_effects[i]->region;
        for (int32_t t = s->body[b].tet_begin; t < s->body[b].tet_end; t++)
            s->region_effects[s->mesh->region[t]] = flags;
    }
    s->def.model.tissue.region_effects = s->region_effects;
    return 0;
}
