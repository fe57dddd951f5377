/* Lines for people that cost a program nothing: where nobody reads stderr (a full pipe, a stopped terminal) a line is
 * left out instead of waiting. */
#ifndef TM_LOG_LINE_H
#define TM_LOG_LINE_H

#include <stdarg.h>

/* One line on stderr; its end is added if it has none. Any thread. */
void app_say(const char *format, ...) __attribute__((format(printf, 1, 2)));
void app_say_list(const char *format, va_list list);

#endif
