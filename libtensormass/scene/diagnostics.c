/* Diagnostics: stored for the caller, and reported as they arrive. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "host.h"

enum { TEXT_MAX = 4000 };

/* Finds the "; " between problem and remedy: the first outside parentheses. */
static const char *seam(const char *text) {
    int depth = 0;
    for (const char *c = text; *c; c++) {
        depth += (*c == '(') - (*c == ')' && depth);
        if (!depth && c[0] == ';' && c[1] == ' ') return c;
    }
    return NULL;
}

/* Drops the last item that is not a fault. Returns false if all are. */
static bool drop_last(tm_diagnostics *list) {
    int32_t at = list->count;
    while (at > 0 && list->item[at - 1].severity == TM_FAULT) at--;
    if (at-- == 0) return false;
    free((void *)(uintptr_t)list->item[at].file);
    memmove(list->item + at, list->item + at + 1, sizeof *list->item * (size_t)(--list->count - at));
    list->lost++;
    return true;
}

static bool has_capacity(tm_diagnostics *list, tm_severity severity) {
    if (list->count >= TM_DIAGNOSTICS_MAX) return severity == TM_FAULT && drop_last(list);
    if (list->count < list->capacity) return true;
    const int32_t capacity = list->capacity ? 2 * list->capacity : 8;
    tm_diagnostic *item = realloc(list->item, sizeof *item * (size_t)capacity);
    if (!item) return false;
    list->item = item;
    list->capacity = capacity;
    return true;
}

/* Stores a diagnostic. One block holds its strings, the file's name first. */
static void keep(tm_diagnostics *list, const tm_diagnostic *d) {
    const size_t file = strlen(d->file) + 1, what = strlen(d->what) + 1, remedy = strlen(d->remedy) + 1;
    char *text = has_capacity(list, d->severity) ? malloc(file + what + remedy) : NULL;
    if (!text) {
        list->lost++;
        return;
    }
    tm_diagnostic *to = &list->item[list->count++];
    *to = *d;
    to->file = memcpy(text, d->file, file);
    to->what = memcpy(text + file, d->what, what);
    to->remedy = memcpy(text + file + what, d->remedy, remedy);
}

void tm_diagnostics_clear(tm_diagnostics *list) {
    for (int32_t i = 0; i < list->count; i++) free((void *)(uintptr_t)list->item[i].file);
    free(list->item);
    *list = (tm_diagnostics){.on_diagnostic = list->on_diagnostic, .user = list->user};
}

int32_t tm_diagnostic_format(const tm_diagnostic *d, char *text, size_t size) {
    char line[16] = "";
    if (d->line > 0) snprintf(line, sizeof line, ":%d", d->line);
    return snprintf(text, size, "%s%s%s%s%s%s%s", d->file, line, *d->file ? ": " : "",
                    d->severity == TM_WARNING ? "warning: " : "", d->what, *d->remedy ? "; " : "", d->remedy);
}

tm_status app_host_tell(const app_host *host, tm_severity severity, tm_status status, const char *file, int line,
                        const char *text) {
    tm_diagnostics *list = host->diagnostics;
    if (!list) return status;
    char what[TEXT_MAX];
    const char *at = seam(text);
    snprintf(what, sizeof what, "%.*s", at ? (int)(at - text) : (int)strlen(text), text);
    const tm_diagnostic d = {.severity = severity,
                             .status = status,
                             .line = line > 0 ? line : 0,
                             .file = file ? file : "",
                             .what = what,
                             .remedy = at ? at + 2 : ""};
    if (list->on_diagnostic) list->on_diagnostic(list->user, &d);
    keep(list, &d);
    return status;
}

tm_status app_host_report(const app_host *host, const char *file, int line, const tm_error *error) {
    const char *text = error->message[0] ? error->message : tm_status_name(error->status);
    return app_host_tell(host, TM_FAULT, error->status ? error->status : TM_ERR_UNSTABLE, file, line, text);
}

tm_status app_host_bad(const app_host *host, const char *file, int line, const char *format, ...) {
    char text[TEXT_MAX];
    va_list list;
    va_start(list, format);
    vsnprintf(text, sizeof text, format, list);
    va_end(list);
    return app_host_tell(host, TM_FAULT, TM_ERR_ARGUMENT, file, line, text);
}
