/* Log lines that never block: if stderr is not read (a full pipe, a stopped terminal), the line is dropped. */
#ifndef TM_LOG_LINE_H
#define TM_LOG_LINE_H

#include <stdarg.h>

/* Prints one line to stderr, with a newline if it has none. Any thread may call it. */
void app_say(const char *format, ...) __attribute__((format(printf, 1, 2)));
void app_say_list(const char *format, va_list list);

#endif
