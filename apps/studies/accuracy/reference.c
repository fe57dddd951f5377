/* Reads reference.json: what CalculiX answered. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accuracy.h"

struct reference {
    cJSON *root;
};

reference *reference_open(const char *path, tm_error *error) {
    reference *r = calloc(1, sizeof *r);
    if (r) r->root = app_json_read(path);
    if (r && r->root) return r;
    free(r);
    tm_fail(error, TM_ERR_FILE, -1,
            "%s: not the JSON of the references; make it with make_inp.py --gather, or name it with --reference", path);
    return NULL;
}

void reference_close(reference *r) {
    if (r) cJSON_Delete(r->root);
    free(r);
}

static const cJSON *cases(const reference *r, const char *name) {
    return cJSON_GetObjectItem(cJSON_GetObjectItem(r->root, name), "cases");
}

int reference_cases(const reference *r, const char *name) { return cJSON_GetArraySize(cases(r, name)); }

bool reference_case(const reference *r, const char *name, int index, double *depth, measured *m) {
    const cJSON *one = cJSON_GetArrayItem(cases(r, name), index), *u = cJSON_GetObjectItem(one, "probe_u_m");
    const cJSON *force = cJSON_GetObjectItem(one, "force_z_N"), *energy = cJSON_GetObjectItem(one, "energy_J");
    const cJSON *share = cJSON_GetObjectItem(one, "depth");
    if (cJSON_GetArraySize(u) != PROBES || !cJSON_IsNumber(force) || !cJSON_IsNumber(energy) || !cJSON_IsNumber(share))
        return false;
    for (int i = 0; i < PROBES; i++)
        for (int axis = 0; axis < 3; axis++)
            m->probe_u_m[3 * i + axis] = cJSON_GetNumberValue(cJSON_GetArrayItem(cJSON_GetArrayItem(u, i), axis));
    m->force_z_N = force->valuedouble, m->energy_J = energy->valuedouble, *depth = share->valuedouble;
    return true;
}

tm_status reference_take(const run *r, const char *name, int index, double *depth, measured *m, tm_error *error) {
    if (reference_case(r->truth, name, index, depth, m)) return TM_OK;
    return tm_fail(error, TM_ERR_FILE, -1, "the references hold no case '%s'; make them again", name);
}
