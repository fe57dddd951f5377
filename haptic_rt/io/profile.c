#include "profile.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

static float *values(hrt_params *params, const hrt_param_info *row) {
    return (float *)(void *)((char *)params + row->offset);
}

static const hrt_param_info *find(const char *name) {
    for (int32_t r = 0; r < hrt_param_count; r++)
        if (strcmp(hrt_param_table[r].name, name) == 0) return &hrt_param_table[r];
    return NULL;
}

/* `text` is "name = value value" and is changed. */
static bool set(char *text, hrt_params *params, const char *file, int line) {
    char *value = strchr(text, '='), *rest = NULL;
    if (!value) {
        app_bad_input(file, line, "no '='; write name = value");
        return false;
    }
    *value++ = 0;
    const char *name = strtok_r(text, " \t\r\n", &rest);
    const hrt_param_info *row = name ? find(name) : NULL;
    if (!row) {
        app_bad_input(file, line, "'%s' is no parameter; see haptic-rt --params", name ? name : "");
        return false;
    }
    rest = NULL;
    int32_t i = 0;
    for (char *cell = strtok_r(value, " \t\r\n,", &rest); cell; cell = strtok_r(NULL, " \t\r\n,", &rest), i++) {
        char *end;
        const float x = strtof(cell, &end);
        if (*end || i == row->count || !(x >= row->min && x <= row->max)) {
            app_bad_input(file, line, "%s: '%s' will not do; it has %d value(s) of %g..%g in %s", name, cell,
                          row->count, (double)row->min, (double)row->max, row->unit);
            return false;
        }
        values(params, row)[i] = x;
    }
    if (i != row->count) app_bad_input(file, line, "%s: %d value(s), needs %d, in %s", name, i, row->count, row->unit);
    return i == row->count;
}

bool hrt_profile_set(const char *text, hrt_params *params) {
    char copy[256];
    snprintf(copy, sizeof copy, "%s", text);
    return set(copy, params, "--set", 0);
}

bool hrt_profile_read(const char *path, hrt_params *params) {
    FILE *file = fopen(path, "r");
    if (!file) {
        app_bad_input(path, 0, "cannot be read (%s); name an existing profile", strerror(errno));
        return false;
    }
    char text[512];
    bool good = true;
    for (int line = 1; good && fgets(text, sizeof text, file); line++) {
        text[strcspn(text, "#")] = 0;
        if (strspn(text, " \t\r\n") == strlen(text)) continue;
        good = set(text, params, path, line);
    }
    fclose(file);
    const int32_t bad = good ? hrt_params_check(params) : -1;
    if (bad >= 0)
        app_bad_input(path, 0, "%s: lower end not below upper end, or out of range; mend it",
                      hrt_param_table[bad].name);
    return good && bad < 0;
}

void hrt_profile_write(FILE *file, const hrt_params *params) {
    for (int32_t r = 0; r < hrt_param_count; r++) {
        const hrt_param_info *row = &hrt_param_table[r];
        const float *value = (const float *)(const void *)((const char *)params + row->offset);
        fprintf(file, "# %s. %s, %g..%g\n%s =", row->text, row->unit, (double)row->min, (double)row->max, row->name);
        for (int32_t i = 0; i < row->count; i++) fprintf(file, " %g", (double)value[i]);
        fputc('\n', file);
    }
}
