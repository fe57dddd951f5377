/* Reads a table of numbers from CSV. */
#include "csv_table.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "line_reader.h"

static char *trim(char *s) {
    while (*s == ' ' || *s == '\t') s++;
    for (char *end = s + strlen(s); end > s && strchr(" \t\r\n", end[-1]); end--) end[-1] = 0;
    return s;
}

static bool read_header(hrt_table *t, char *line, const char *path, int number) {
    char *rest = line;
    for (char *cell; (cell = strsep(&rest, ",")) != NULL; t->fields++) {
        cell = trim(cell);
        if (t->fields == HRT_TABLE_FIELDS || *cell == 0 || strlen(cell) >= sizeof t->name[0]) {
            app_bad_input(
                path, number,
                "a column name is empty, too long, or one of more than %d; write names like time_s,insertion_m",
                HRT_TABLE_FIELDS);
            return false;
        }
        strcpy(t->name[t->fields], cell);
    }
    return true;
}

static bool read_row(hrt_table *t, char *line, const char *path, int number) {
    if (t->rows % 1024 == 0) {
        double *value = realloc(t->value, sizeof *value * (size_t)((t->rows + 1024) * t->fields));
        if (value) t->value = value;
        int *lines = realloc(t->line, sizeof *lines * (size_t)(t->rows + 1024));
        if (lines) t->line = lines;
        if (!value || !lines) {
            app_bad_input(path, number, "out of memory; use a shorter file");
            return false;
        }
    }
    char *rest = line;
    int32_t c = 0;
    for (char *cell; (cell = strsep(&rest, ",")) != NULL; c++) {
        char *end;
        cell = trim(cell);
        const double x = strtod(cell, &end);
        if (c == t->fields || end == cell || *end || !isfinite(x)) {
            app_bad_input(path, number,
                          c == t->fields ? "more than %d values; write one a column"
                                         : "a value of %d is not a finite number; write digits",
                          t->fields);
            return false;
        }
        t->value[t->rows * t->fields + c] = x;
    }
    if (c != t->fields) {
        app_bad_input(path, number, "%d values where the header has %d; write one a column", c, t->fields);
        return false;
    }
    t->line[t->rows++] = number;
    return true;
}

bool hrt_table_read(const char *path, hrt_table *t) {
    memset(t, 0, sizeof *t);
    hrt_lines lines;
    if (!hrt_lines_open(&lines, path)) return false;
    bool good = true;
    for (char *line; good && (line = hrt_lines_next(&lines)) != NULL;) {
        char *text = trim(line);
        if (*text == 0) continue;
        good = t->fields == 0 ? read_header(t, text, path, lines.number) : read_row(t, text, path, lines.number);
    }
    good = good && lines.good;
    hrt_lines_close(&lines);
    if (good && t->rows == 0) {
        app_bad_input(path, 0, "holds no rows; write a header line and at least one row of numbers");
        good = false;
    }
    if (!good) hrt_table_free(t);
    return good;
}

void hrt_table_free(hrt_table *t) {
    free(t->value);
    free(t->line);
    memset(t, 0, sizeof *t);
}

int32_t hrt_table_column(const hrt_table *t, const char *name) {
    for (int32_t c = 0; c < t->fields; c++)
        if (strcmp(t->name[c], name) == 0) return c;
    return -1;
}

bool hrt_table_need(const hrt_table *t, const char *path, const char *name, int32_t *column) {
    *column = hrt_table_column(t, name);
    if (*column < 0) app_bad_input(path, 1, "no column '%s'; add it to the header", name);
    return *column >= 0;
}
