/* Derivatives of a settled trial by its adjoint (tm_world_static_response).
 *
 * For each quantity J one solution x with the tangent at rest; then the change of J between two settings is x . (f(u;
 * first) - f(u; second)), f the static force of a scene with these settings at the unchanged u. */
#include <cjson/cJSON.h>
#include <stdlib.h>
#include <string.h>

#include "trials.h"

static const double TOLERANCE = 1e-10; /* of the solutions, relative residual */

void trial_shifts_free(trial_shifts *shifts) {
    for (int i = 0; i < TRIAL_SHIFTS; i++) {
        if (shifts->scene[i]) sim_destroy(shifts->scene[i]);
        free(shifts->key[i]);
    }
    *shifts = (trial_shifts){0};
}

/* --- scenes with shifted constants --- */

static char *join(const run_options *o, const cJSON *sets, char **set, int *count) {
    size_t length = 1;
    const cJSON *one;
    *count = 0;
    for (; *count < o->set_count; ++*count) set[*count] = o->set[*count];
    cJSON_ArrayForEach(one, sets) {
        if (!cJSON_IsString(one) || *count >= RUN_MAX_SETS) return NULL;
        set[(*count)++] = one->valuestring;
        length += strlen(one->valuestring) + 1;
    }
    char *key = malloc(length), *to = key;
    if (!key) return NULL;
    *to = 0;
    cJSON_ArrayForEach(one, sets) {
        const size_t n = strlen(one->valuestring);
        memcpy(to, one->valuestring, n);
        to[n] = '\n', to[n + 1] = 0;
        to += n + 1;
    }
    return key;
}

static sim *open_shift(const run_options *o, const app_host *host, char **set, int count) {
    app_scene *scene;
    sim *s;
    if (sim_scene_load(o->scene, set, count, host, &scene)) return NULL;
    scene->strict = o->strict;
    scene->pace = SIM_FRAMES;
    return sim_create(scene, &s) ? NULL : s;
}

/* Returns the scene with these settings, or null. */
static sim *find_shift(trial_shifts *shifts, const run_options *o, const app_host *host, const cJSON *sets) {
    char *set[RUN_MAX_SETS];
    int count;
    char *key = join(o, sets, set, &count);
    if (!key) return NULL;
    for (int i = 0; i < TRIAL_SHIFTS; i++)
        if (shifts->key[i] && !strcmp(shifts->key[i], key)) {
            free(key);
            return shifts->scene[i];
        }
    sim *made = open_shift(o, host, set, count);
    if (!made) {
        free(key);
        return NULL;
    }
    const int i = shifts->next;
    shifts->next = (i + 1) % TRIAL_SHIFTS;
    if (shifts->scene[i]) sim_destroy(shifts->scene[i]);
    free(shifts->key[i]);
    shifts->key[i] = key;
    return shifts->scene[i] = made;
}

/* Returns whether both have the same mesh and supports: then a displacement means the same in both. */
static bool is_alike(const sim *a, const sim *b) {
    const size_t vertices = (size_t)a->mesh->vertex_count, fixed = (size_t)a->fixed_count;
    return a->model->world && b->model->world && a->mesh->vertex_count == b->mesh->vertex_count &&
           a->mesh->tet_count == b->mesh->tet_count && a->fixed_count == b->fixed_count &&
           !memcmp(a->mesh->rest_m, b->mesh->rest_m, 3 * vertices * sizeof *a->mesh->rest_m) &&
           (!fixed || !memcmp(a->fixed_dof, b->fixed_dof, fixed * sizeof *a->fixed_dof));
}

static bool moves_supports(const sim *a, const sim *b) {
    for (int32_t i = 0; i < a->fixed_count; i++)
        if (a->fixed_m[i] != b->fixed_m[i]) return true;
    return false;
}

/* --- quantities --- */

/* Sets x and b of a quantity, as [KIND, NAME or NUMBER, AXIS]. Returns what is wrong, or null. */
static const char *read_quantity(const sim *s, const trial_point *at, int count, const cJSON *what, double *x,
                                 double *b) {
    const cJSON *kind = cJSON_GetArrayItem(what, 0), *name = cJSON_GetArrayItem(what, 1);
    const cJSON *number = cJSON_GetArrayItem(what, 2);
    const int axis = cJSON_IsNumber(number) ? number->valueint : -1;
    const size_t bytes = 3 * (size_t)s->mesh->vertex_count * sizeof *x;
    memset(x, 0, bytes);
    memset(b, 0, bytes);
    if (!cJSON_IsString(kind) || axis < 0 || axis > 2)
        return "a quantity is not [\"support\", NAME, AXIS] or [\"point\", NUMBER, AXIS]";
    if (!strcmp(kind->valuestring, "point") && cJSON_IsNumber(name) && name->valueint >= 0 && name->valueint < count) {
        const trial_point *p = at + name->valueint;
        for (int k = 0; k < 4; k++) b[3 * (int64_t)s->mesh->tet[4 * (int64_t)p->tet + k] + axis] += p->weight[k];
        return NULL;
    }
    for (int i = 0; i < s->scene->support.count && !strcmp(kind->valuestring, "support") && cJSON_IsString(name); i++) {
        const app_support *support = (const app_support *)s->scene->support.item + i;
        if (strcmp(support->name.s, name->valuestring)) continue;
        for (int32_t k = 0; k < s->fixed_count; k++)
            if (s->fixed_by[k] == i + 1 && s->fixed_dof[k] % 3 == axis) x[s->fixed_dof[k]] = -1;
        return NULL;
    }
    return "a quantity is neither a support nor a point of the request";
}

typedef struct slopes {
    trial_shifts *shifts;
    const run_options *o;
    const app_host *host;
    sim *s;
    double *x, *b, *change, *second; /* [3*vertices] */
    tm_error error;
} slopes;

/* change := f(u; first) - f(u; second). Returns what is wrong, or null. */
static const char *find_change(slopes *l, const cJSON *pair, const double *u) {
    sim *one[2];
    double *force[2] = {l->change, l->second};
    for (int k = 0; k < 2; k++) {
        one[k] = find_shift(l->shifts, l->o, l->host, cJSON_GetArrayItem(pair, k));
        if (!one[k]) return "a scene with a shifted constant cannot be built";
        if (!is_alike(l->s, one[k])) return "a constant changes mesh or supports";
        if (tm_world_static_force(one[k]->model->world, u, force[k], &l->error)) return l->error.message;
    }
    if (moves_supports(one[0], one[1])) return "a constant moves a support";
    for (int32_t i = 0; i < 3 * l->s->mesh->vertex_count; i++) l->change[i] -= l->second[i];
    return NULL;
}

/* Fills table [quantities][pairs]; change of every pair in turn. */
static const char *fill(slopes *l, const trial_point *at, int count, const cJSON *asked, double *table) {
    const cJSON *of = cJSON_GetObjectItem(asked, "of"), *by = cJSON_GetObjectItem(asked, "by");
    const int quantities = cJSON_GetArraySize(of), pairs = cJSON_GetArraySize(by);
    const size_t n = 3 * (size_t)l->s->mesh->vertex_count;
    const double *u = sim_displacement(l->s);
    double *changes = calloc(n * (size_t)(pairs ? pairs : 1), sizeof *changes);
    const char *wrong = changes ? NULL : "out of memory; use a smaller mesh";
    for (int k = 0; k < pairs && !wrong; k++) {
        wrong = find_change(l, cJSON_GetArrayItem(by, k), u);
        memcpy(changes + n * (size_t)k, l->change, n * sizeof *changes);
    }
    for (int q = 0; q < quantities && !wrong; q++) {
        wrong = read_quantity(l->s, at, count, cJSON_GetArrayItem(of, q), l->x, l->b);
        if (!wrong && tm_world_static_response(l->s->model->world, l->b, TOLERANCE, l->x, &l->error))
            wrong = l->error.message;
        for (int k = 0; k < pairs && !wrong; k++) {
            double sum = 0;
            for (size_t i = 0; i < n; i++) sum += l->x[i] * changes[n * (size_t)k + i];
            table[q * pairs + k] = sum;
        }
    }
    free(changes);
    return wrong;
}

void trial_add_slopes(trial_shifts *shifts, const run_options *o, const app_host *host, sim *s, const trial_point *at,
                      int count, const cJSON *asked, cJSON *answer) {
    const int quantities = cJSON_GetArraySize(cJSON_GetObjectItem(asked, "of"));
    const int pairs = cJSON_GetArraySize(cJSON_GetObjectItem(asked, "by"));
    const size_t n = 3 * (size_t)s->mesh->vertex_count;
    double *work = calloc(4 * n + (size_t)(quantities * pairs) + 1, sizeof *work), *table = work + 4 * n;
    slopes l = {shifts, o, host, s, work, work + n, work + 2 * n, work + 3 * n, {0}};
    const char *wrong = !work              ? "out of memory; use a smaller mesh"
                        : !s->model->world ? "the model has no equilibrium of its own to derive"
                                           : fill(&l, at, count, asked, table);
    if (wrong) {
        cJSON_AddNullToObject(answer, "slopes");
        cJSON_AddStringToObject(answer, "why", wrong);
    } else {
        cJSON *rows = cJSON_AddArrayToObject(answer, "slopes");
        for (int q = 0; q < quantities; q++)
            cJSON_AddItemToArray(rows, cJSON_CreateDoubleArray(table + q * pairs, pairs));
    }
    free(work);
}
