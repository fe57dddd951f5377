/* Reads and writes parameters as `name = value ...`. */
#include "profile.h"

#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "line_reader.h"

static float *values(hrt_params *params, const hrt_param_range *row) {
    return (float *)(void *)((char *)params + row->offset);
}

/* Returns a parameter's row, hrt_param_count if there is none. */
static int32_t find(const char *name) {
    int32_t r = 0;
    while (r < hrt_param_count && strcmp(hrt_param_text[r].name, name) != 0) r++;
    return r;
}

/* Checks `device = NAME`: a profile of another device may fit by its counts, and would move this one wrongly. */
static bool check_device(char *value, const hrt_params *params, const char *file, int line) {
    char *rest = NULL;
    const char *name = strtok_r(value, " \t\r\n", &rest);
    if (name && strcmp(name, params->device->name) == 0) return true;
    app_bad_input(
        file, line,
        "the profile is of device '%s', and this device is '%s'; add --device-type %s, or give a profile of %s",
        name ? name : "", params->device->name, name ? name : "NAME", params->device->name);
    return false;
}

/* Sets a parameter from `text`, "name = value value", which it modifies. */
static bool set(char *text, hrt_params *params, const char *file, int line) {
    char *value = strchr(text, '='), *rest = NULL;
    if (!value) {
        app_bad_input(file, line, "no '='; write name = value");
        return false;
    }
    *value++ = 0;
    const char *name = strtok_r(text, " \t\r\n", &rest);
    if (name && strcmp(name, "device") == 0) return check_device(value, params, file, line);
    const int32_t r = name ? find(name) : hrt_param_count;
    if (r == hrt_param_count) {
        app_bad_input(file, line, "'%s' is not a parameter; see haptic-rt --params", name ? name : "");
        return false;
    }
    const hrt_param_range *row = &hrt_param_table[r];
    const char *unit = hrt_param_text[r].unit;
    const int32_t values_of = hrt_param_values(params, row);
    rest = NULL;
    int32_t i = 0;
    for (char *cell = strtok_r(value, " \t\r\n,", &rest); cell; cell = strtok_r(NULL, " \t\r\n,", &rest), i++) {
        char *end;
        const float x = strtof(cell, &end);
        if (*end || i == values_of || !(x >= row->min && x <= row->max)) {
            app_bad_input(file, line, "%s: '%s' is not allowed; give %d value(s) from %g to %g, unit %s", name, cell,
                          values_of, (double)row->min, (double)row->max, unit);
            return false;
        }
        values(params, row)[i] = x;
    }
    if (i != values_of)
        app_bad_input(file, line, "%s: %d value(s) are given; give %d, unit %s", name, i, values_of, unit);
    return i == values_of;
}

bool hrt_profile_set(const char *text, hrt_params *params) {
    char copy[1024];
    if (strlen(text) >= sizeof copy) {
        app_bad_input("--set", 0, "it is longer than any parameter; write NAME=VALUE");
        return false;
    }
    strcpy(copy, text);
    return set(copy, params, "--set", 0);
}

bool hrt_profile_read(const char *path, hrt_params *params) {
    hrt_lines lines;
    if (!hrt_lines_open(&lines, path)) return false;
    bool good = true;
    for (char *text; good && (text = hrt_lines_next(&lines)) != NULL;)
        if (strspn(text, " \t\r\n") < strlen(text)) good = set(text, params, path, lines.number);
    good = good && lines.good;
    hrt_lines_close(&lines);
    const int32_t bad = good ? hrt_params_check(params) : -1;
    if (bad >= 0)
        app_bad_input(path, 0, "%s is out of range, or its lower end is not below its upper end; correct it",
                      hrt_param_text[bad].name);
    return good && bad < 0;
}

void hrt_profile_write(FILE *file, const hrt_params *params) {
    fprintf(file, "# %s. Joints:", params->device->text);
    for (int32_t j = 0; j < params->device->joints; j++) fprintf(file, " %s", params->device->joint[j].name);
    fprintf(file, "\ndevice = %s\n", params->device->name);
    for (int32_t r = 0; r < hrt_param_count; r++) {
        const hrt_param_range *row = &hrt_param_table[r];
        const hrt_param_words *words = &hrt_param_text[r];
        const float *value = (const float *)(const void *)((const char *)params + row->offset);
        fprintf(file, "# %s. %s, %g..%g\n%s =", words->text, words->unit, (double)row->min, (double)row->max,
                words->name);
        for (int32_t i = 0; i < hrt_param_values(params, row); i++) fprintf(file, " %g", (double)value[i]);
        fputc('\n', file);
    }
}
