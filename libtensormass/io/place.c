/* Puts file and line before messages, and sets the locale of numbers. */
#include "place.h"

#include <stdio.h>
#include <string.h>
#ifdef _WIN32
#include <locale.h>
#endif

enum { PATH_TOLD = 200 }; /* a long path is cut to its end: the remedy must fit */

tm_status tm_io_place(const char *path, int line, tm_status status, tm_error *error) {
    if (!status || !error) return status;
    char place[PATH_TOLD + 24], what[sizeof error->message];
    const size_t length = strlen(path);
    const bool cut = length > PATH_TOLD;
    int used =
        snprintf(place, sizeof place, "%s%.*s:", cut ? "..." : "", PATH_TOLD, path + (cut ? length - PATH_TOLD : 0));
    if (line > 0) used += snprintf(place + used, sizeof place - (size_t)used, "%d:", line);
    memcpy(what, error->message, sizeof what);
    snprintf(error->message, sizeof error->message, "%s %.*s", place, (int)sizeof what - used - 2, what);
    return status;
}

#ifdef _WIN32
tm_io_locale tm_io_locale_enter(void) {
    tm_io_locale now = {.per_thread = _configthreadlocale(_ENABLE_PER_THREAD_LOCALE)};
    const char *name = setlocale(LC_NUMERIC, NULL);
    snprintf(now.name, sizeof now.name, "%s", name ? name : "C");
    setlocale(LC_NUMERIC, "C");
    return now;
}

void tm_io_locale_leave(tm_io_locale before) {
    setlocale(LC_NUMERIC, before.name);
    if (before.per_thread > 0) _configthreadlocale(before.per_thread);
}
#else
tm_io_locale tm_io_locale_enter(void) {
    tm_io_locale now = {newlocale(LC_NUMERIC_MASK, "C", (locale_t)0), (locale_t)0};
    if (now.here) now.before = uselocale(now.here);
    return now;
}

void tm_io_locale_leave(tm_io_locale now) {
    if (!now.here) return; /* no memory for it: keeps the process's locale */
    uselocale(now.before);
    freelocale(now.here);
}
#endif
