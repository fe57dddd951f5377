/* Place of a message in a file, and the locale for reading and writing numbers. */
#ifndef TM_IO_PLACE_H
#define TM_IO_PLACE_H

#include "tensormass/base.h"

/* Puts "path:line: " before a failure's message (line 0: only the path). Returns `status`. */
tm_status tm_io_place(const char *path, int line, tm_status status, tm_error *error);

/* The "C" locale for this thread, restored afterwards. A program may have set its own, as windows do; strtod and printf
 * would then use a decimal comma. */
#ifdef _WIN32
typedef struct tm_io_locale {
    int per_thread;
    char name[256];
} tm_io_locale;
#else
#include <locale.h>
#ifdef __APPLE__
#include <xlocale.h>
#endif
typedef struct tm_io_locale {
    locale_t here, before;
} tm_io_locale;
#endif
tm_io_locale tm_io_locale_enter(void);
void tm_io_locale_leave(tm_io_locale locale);

#endif
