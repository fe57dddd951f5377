/* What went wrong, as the library says it: filled by those who do not print it themselves. */
#include "app.h"

#include <stdarg.h>
#include <stdio.h>

tm_status app_fail(tm_error *error, tm_status status, int64_t entity, const char *format, ...) {
    if (!error) return status;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->message, sizeof error->message, format, arguments);
    va_end(arguments);
    error->status = status;
    error->entity = entity;
    return status;
}
