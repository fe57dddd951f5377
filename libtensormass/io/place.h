/* Where a message is about, and the locale that numbers of files are read and written in. */
#ifndef TM_IO_PLACE_H
#define TM_IO_PLACE_H

#include "tensormass/base.h"

/* Puts "path:line: " before the message of a failure (0: no line); gives `status` back. */
tm_status tm_io_place(const char *path, int line, tm_status status, tm_error *error);

/* A program may have set its locale (windows do): then strtod and printf would want a comma in 0.5. Of this thread
 * alone, and given back. */
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
