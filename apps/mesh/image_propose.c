/* Proposes options that keep the detail which a mesh lost; tries them before reporting them. */
#include <math.h>
#include <string.h>

#include "common/bandwidth.h"
#include "image.h"

static const double volume_told = 0.02; /* share of a label's volume; a larger difference is a warning */

static bool is_volume_off(const image_result *r) { return fabs(r->volume_m3 / r->image_m3 - 1) > volume_told; }

static bool is_far(const label_field *field, const image_mesh *m, int l) {
    const double *s = field->spacing_m;
    return m->of[l].hausdorff_m > fmax(m->edge_m[l], 2 * cbrt(s[0] * s[1] * s[2]));
}

/* Returns whether label `l` vanished, fell apart, or has a wrong volume or surface. */
static bool is_lost(const label_field *field, const image_mesh *m, int l) {
    return m->of[l].pieces != field->pieces[l] || is_volume_off(&m->of[l]) || is_far(field, m, l);
}

static int count_lost(const label_field *field, const image_mesh *m) {
    int lost = 0;
    for (int l = 1; l <= field->labels; l++) lost += is_lost(field, m, l);
    return lost;
}

/* Adds a size for every label that lost detail, as --label does. */
static void ask_finer(const label_field *field, const image_mesh *m, double factor, image_options *o) {
    const bool all = o->regions == 0 || o->all;
    for (int l = 1; l <= field->labels; l++) {
        if (!is_lost(field, m, l)) continue;
        int r = 1;
        while (r <= o->regions && o->region[r].value != field->value[l]) r++;
        if (r > o->regions) o->region[++o->regions] = (image_region){.value = field->value[l]};
        o->region[r].size_m = 1e-4 * round(1e4 * factor * m->edge_m[l]);
    }
    o->all = all;
}

/* Writes the trial's options as words, which replace those of the user. */
static void to_words(const image_options *asked, const image_options *o, const label_field *field, const image_mesh *m,
                     char *words, size_t size) {
    size_t at = 0;
    words[0] = 0;
    if (o->smooth != asked->smooth) at += (size_t)snprintf(words, size, " --smooth %.2g", o->smooth);
    if (o->budget != asked->budget) at += (size_t)snprintf(words + at, size - at, " --budget %d", o->budget);
    if (o->budget != asked->budget || o->smooth != asked->smooth) return;
    if (o->all && !asked->all && at < size) at += (size_t)snprintf(words + at, size - at, " --label all");
    for (int l = 1; l <= field->labels && at < size; l++) {
        if (!is_lost(field, m, l)) continue;
        for (int r = 1; r <= o->regions && at < size; r++)
            if (o->region[r].value == field->value[l])
                at += (size_t)snprintf(words + at, size - at, " --label %d%s%s:%.3gmm", o->region[r].value,
                                       o->region[r].name[0] ? "=" : "", o->region[r].name, 1e3 * o->region[r].size_m);
    }
}

/* Returns whether meshing with these options loses nothing, and the number of tetrahedra. */
static bool try(const image_api *api, image_attempt_fn *attempt, const image_options *o, const image_volume *volume,
                int *tets) {
    static image_options mine;
    label_field field = {0};
    image_mesh mesh = {0};
    tm_error error = {0};
    mine = *o;
    const bool good = attempt(api, &mine, volume, &field, &mesh) == APP_DONE && mesh.tets.tets > 0 &&
                      image_distances(&field, &mesh, &error) == TM_OK && count_lost(&field, &mesh) == 0;
    *tets = mesh.tets.tets;
    image_mesh_free(&mesh);
    label_field_free(&field);
    return good;
}

void image_propose(const image_api *api, image_attempt_fn *attempt, const image_options *asked,
                   const image_volume *volume, const label_field *field, const image_mesh *m, double took_s,
                   char words[IMAGE_WHY]) {
    static image_options trial;
    words[0] = 0;
    if (asked->strict || app_is_quiet() || count_lost(field, m) == 0) return;
    const double until_s = app_seconds() + 2 * took_s + 5;
    for (int way = 0; way < 3 && app_seconds() < until_s && !app_interrupted(); way++) {
        char found[IMAGE_WHY - 100];
        int tets = 0;
        trial = *asked;
        trial.trial = true;
        trial.trial_until_s = until_s;
        if (way == 0 && !(asked->even && asked->smooth > 0.3)) continue;
        if (way == 0)
            trial.smooth = 0.01 * round(50 * asked->smooth);
        else if (asked->budget_said && asked->budget > 0)
            trial.budget = way == 1 ? 2 * asked->budget : 4 * asked->budget;
        else
            ask_finer(field, m, way == 1 ? 0.7 : 0.45, &trial);
        to_words(asked, &trial, field, m, found, sizeof found);
        if (strlen(found) + 1 == sizeof found || !try(api, attempt, &trial, volume, &tets)) continue;
        snprintf(words, IMAGE_WHY, "all labels are kept with%s (tried: %d tetrahedra)", found, tets);
        return;
    }
}
