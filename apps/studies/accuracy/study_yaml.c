/* A scene with some keys changed: its own lines stay, comments and all. Keys of one or two levels ("model",
 * "tissue.mesh"), and of a list's item ("supports[0].group"), which is what a recommendation changes. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study.h"
#include "study_yaml.h"

enum { LINES = 4000, LONG = 4096 };

typedef struct text {
    char *line[LINES];
    int count;
} text;

static bool put_line(text *t, int at, const char *line) {
    if (t->count == LINES) return false;
    for (int i = t->count++; i > at; i--) t->line[i] = t->line[i - 1];
    t->line[at] = strdup(line);
    return t->line[at] != NULL;
}

static void change_line(text *t, int at, const char *line) {
    char *old = t->line[at];
    t->line[at] = strdup(line);
    free(old);
}

static bool read_lines(text *t, const char *path) {
    char line[LONG];
    FILE *file = fopen(path, "r");
    bool good = file != NULL;
    while (good && fgets(line, sizeof line, file)) {
        line[strcspn(line, "\r\n")] = 0;
        good = put_line(t, t->count, line);
    }
    if (file) fclose(file);
    return good;
}

/* "key:" at the beginning of `line`, or at `indent` in it. */
static bool is_key(const char *line, const char *key, size_t indent) {
    return strspn(line, " ") == indent && !strncmp(line + indent, key, strlen(key)) &&
           line[indent + strlen(key)] == ':';
}

static int find_section(const text *t, const char *key) {
    for (int i = 0; i < t->count; i++)
        if (is_key(t->line[i], key, 0)) return i;
    return -1;
}

/* First line that is not the section's any more. */
static int section_end(const text *t, int at) {
    int end = at + 1;
    for (int i = at + 1; i < t->count; i++) {
        const char *line = t->line[i];
        const bool inside = line[0] == ' ' || line[0] == '-';
        if (inside) end = i + 1;
        if (!inside && line[0] && line[0] != '#') break;
    }
    return end;
}

/* Where the value beginning at `from` ends: at a comma or bracket of its own level, a comment, or the end. */
static const char *value_end(const char *from, bool flow) {
    int depth = 0;
    char quote = 0;
    for (const char *c = from;; c++) {
        if (!*c) return c;
        if (quote) {
            if (*c == quote) quote = 0;
        } else if (*c == '"' || *c == '\'')
            quote = *c;
        else if (*c == '{' || *c == '[')
            depth++;
        else if (flow && depth == 0 && (*c == ',' || *c == '}'))
            return c;
        else if (*c == '}' || *c == ']')
            depth--;
        else if (*c == '#' && c > from && c[-1] == ' ')
            return c - 1;
    }
}

/* The value after "key:" at `colon` becomes another. */
static void change_value(text *t, int at, const char *colon, const char *value, bool flow) {
    char line[LONG];
    const char *begin = colon + 1, *end = value_end(begin, flow);
    snprintf(line, sizeof line, "%.*s %s%s", (int)(begin - t->line[at]), t->line[at], value, end);
    change_line(t, at, line);
}

/* "{... key: value ...}" on one line. */
static bool change_flow(text *t, int at, const char *key, const char *value) {
    char line[LONG];
    const char *open = strchr(t->line[at], '{');
    for (const char *c = open; *c;) {
        const char *word = c + 1 + strspn(c + 1, " "), *end = value_end(word, true);
        if (!strncmp(word, key, strlen(key)) && word[strlen(key)] == ':') {
            change_value(t, at, word + strlen(key), value, true);
            return true;
        }
        if (*end != ',') break;
        c = end;
    }
    const char *rest = open + 1;
    snprintf(line, sizeof line, "%.*s%s: %s%s%s", (int)(rest - t->line[at]), t->line[at], key, value,
             rest[strspn(rest, " ")] == '}' ? "" : ", ", rest);
    change_line(t, at, line);
    return true;
}

static bool set_nested(text *t, const char *section, const char *key, const char *value) {
    char line[LONG];
    const int at = find_section(t, section);
    if (at < 0) {
        snprintf(line, sizeof line, "%s: {%s: %s}", section, key, value);
        return put_line(t, t->count, line);
    }
    const char *rest = t->line[at] + strlen(section) + 1;
    if (rest[strspn(rest, " ")] == '{') return change_flow(t, at, key, value);
    const int end = section_end(t, at);
    size_t indent = 2;
    for (int i = at + 1; i < end; i++) {
        if (t->line[i][strspn(t->line[i], " ")] == '#') continue;
        indent = strspn(t->line[i], " ");
        break;
    }
    for (int i = at + 1; i < end; i++)
        if (is_key(t->line[i], key, indent)) {
            change_value(t, i, t->line[i] + indent + strlen(key), value, false);
            return true;
        }
    snprintf(line, sizeof line, "%*s%s: %s", (int)indent, "", key, value);
    return put_line(t, at + 1, line);
}

static void unset(text *t, const char *section) {
    char line[LONG];
    const int at = find_section(t, section);
    for (int i = at, end = at < 0 ? at : section_end(t, at); i < end; i++) {
        snprintf(line, sizeof line, "# left out: %s", t->line[i]);
        change_line(t, i, line);
    }
}

/* "list[2].key" taken apart. */
static bool is_item(const char *edit, char list[40], int *number, char key[40]) {
    int end = 0;
    return sscanf(edit, "%39[a-z_][%d].%39[a-z_]%n", list, number, key, &end) == 3 && *number >= 0 &&
           (!edit[end] || edit[end] == '=');
}

/* A path of more levels cannot be. */
bool study_yaml_can(const char *edit) {
    const size_t path = strcspn(edit, "="), dot = strcspn(edit, ".");
    char list[40], key[40];
    int number;
    if (memchr(edit, '[', path)) return is_item(edit, list, &number, key);
    return dot >= path || (edit[path] && !memchr(edit + dot + 1, '.', path - dot - 1));
}

/* The lines as one text, and back. */
static bool change_item(text *t, const char *list, int number, const char *key, const char *value) {
    size_t room = 1000;
    for (int i = 0; i < t->count; i++) room += strlen(t->line[i]) + 1;
    char *whole = malloc(room), *end = whole;
    if (!whole) return false;
    for (int i = 0; i < t->count; i++) {
        end += sprintf(end, "\n%s", t->line[i]);
        free(t->line[i]);
    }
    const bool good = study_yaml_item(whole, list, number, key, value);
    t->count = 0;
    bool fits = true;
    for (char *rest = whole + 1, *line; (line = strsep(&rest, "\n"));) fits = put_line(t, t->count, line) && fits;
    free(whole);
    return good && fits;
}

static bool change(text *t, const char *edit) {
    char path[200], line[LONG], list[40], key[40];
    const char *value = strchr(edit, '=');
    int number;
    if (is_item(edit, list, &number, key)) return change_item(t, list, number, key, value ? value + 1 : NULL);
    snprintf(path, sizeof path, "%.*s", value ? (int)(value - edit) : 199, edit);
    char *dot = strchr(path, '.');
    if (!study_yaml_can(edit)) return false;
    if (!value) {
        unset(t, path);
        return true;
    }
    if (dot) {
        *dot = 0;
        return set_nested(t, path, dot + 1, value + 1);
    }
    const int at = find_section(t, path);
    if (at >= 0) {
        change_value(t, at, t->line[at] + strlen(path), value + 1, false);
        return true;
    }
    snprintf(line, sizeof line, "%s: %s", path, value + 1);
    return put_line(t, t->count, line);
}

/* `file`, absolute, from the folder `from`, absolute and without a slash at its end. */
static void write_relative(const char *file, const char *from, char *out, size_t size) {
    size_t shared = 0, used = 0;
    for (size_t i = 0; file[i] == from[i] || (file[i] == '/' && !from[i]); i++) {
        if (file[i] == '/') shared = i + 1; /* what both begin with, as far as a slash */
        if (!from[i]) break;
    }
    out[0] = 0;
    for (const char *c = from + shared - (shared > strlen(from)); *c; c += strcspn(c, "/"), c += *c == '/')
        used += (size_t)snprintf(out + used, used < size ? size - used : 0, "../");
    snprintf(out + used, used < size ? size - used : 0, "%s", file + shared);
}

/* The folder of `path`, absolute. */
static bool find_folder(const char *path, char folder[4096]) {
    char name[2048];
    snprintf(name, sizeof name, "%.2000s", path);
    char *slash = strrchr(name, '/');
    if (slash) slash[slash == name] = 0;
    return realpath(slash ? name : ".", folder) != NULL;
}

/* A change whose value is a file's absolute name, from the written scene's folder. */
static void make_relative(const char *edit, const char *path, char *out, size_t size) {
    char folder[4096], file[LONG];
    const char *value = strchr(edit, '=');
    snprintf(out, size, "%s", edit);
    if (!value || value[1] != '/' || !find_folder(path, folder)) return;
    write_relative(value + 1, folder, file, sizeof file);
    snprintf(out, size, "%.*s=%s", (int)(value - edit), edit, file);
}

/* Paths are relative to the scene's folder, and this one may be written to another. */
static void move_path(text *t, const char *scene, const char *to, const char *section, const char *key) {
    char folder[2048], found[4096], target[4096], value[LONG];
    const int at = find_section(t, section);
    snprintf(folder, sizeof folder, "%s", scene);
    char *slash = strrchr(folder, '/');
    if (slash) slash[1] = 0;
    for (int i = at, end = at < 0 ? at : section_end(t, at); i < end; i++) {
        char wanted[80];
        snprintf(wanted, sizeof wanted, "%s:", key);
        char *word = strstr(t->line[i], wanted), *comment = strstr(t->line[i], " #");
        if (!word || (comment && comment < word) || (word > t->line[i] && isalnum((unsigned char)word[-1]))) continue;
        const char *begin = word + strlen(wanted), *end_of = value_end(begin, strchr(t->line[i], '{') != NULL);
        begin += strspn(begin, " \"'");
        while (end_of > begin && strchr(" \"'", end_of[-1])) end_of--;
        snprintf(value, sizeof value, "%s%.*s", *begin == '/' || !slash ? "" : folder, (int)(end_of - begin), begin);
        if (!realpath(value, found) || !find_folder(to, target)) return;
        write_relative(found, target, value, sizeof value);
        set_nested(t, section, key, value);
        return;
    }
}

int study_write_yaml(const study *t, const char *path, char *const *edit, int edit_count, const char *evidence) {
    static text lines;
    tm_error error = {0};
    app_output output;
    lines.count = 0;
    if (!read_lines(&lines, t->file)) return app_bad_input(t->file, 0, "cannot be read again, or is very long");
    move_path(&lines, t->file, path, "tissue", "mesh");
    move_path(&lines, t->file, path, "anisotropy", "file");
    move_path(&lines, t->file, path, "haptics", "profile");
    for (int i = 0; i < edit_count; i++) {
        char moved[LONG + 200];
        make_relative(edit[i], path, moved, sizeof moved);
        if (!change(&lines, moved))
            app_remark("tm-accuracy: --set %s cannot be written into %s; give it to tm-sim again", edit[i], path);
    }
    if (!app_output_begin(&output, path, &error)) return app_report(NULL, 0, &error);
    FILE *file = app_output_stream(&output);
    if (file) fputs(evidence, file);
    for (int i = 0; i < lines.count; i++) {
        if (file) fprintf(file, "%s\n", lines.line[i]);
        free(lines.line[i]);
    }
    return app_output_end(&output, file, &error) ? 0 : app_report(NULL, 0, &error);
}
