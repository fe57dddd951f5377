/* Prints errors as "file:line: what; what to do", and gives the exit code of the contract. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "app.h"

static void print_place(const char *file, int line) {
    if (!file) return;
    if (line > 0)
        fprintf(stderr, "%s:%d: ", file, line);
    else
        fprintf(stderr, "%s: ", file);
}

/* Prints text of a damaged file without control characters, to protect the terminal. */
static void print_plain(const char *text) {
    for (; *text; text++) {
        const bool plain = (unsigned char)*text >= ' ' || *text == '\n' || *text == '\t';
        fputc(plain && *text != 127 ? *text : '?', stderr);
    }
    fputc('\n', stderr);
}

int app_bad_input(const char *file, int line, const char *format, ...) {
    print_place(file, line);
    char text[4000];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    print_plain(text);
    return APP_BAD_INPUT;
}

/* Memory, convergence and instability are not input errors. */
int app_exit_code(tm_status status) {
    switch (status) {
    case TM_OK: return APP_DONE;
    case TM_ERR_MEMORY:
    case TM_ERR_CONVERGENCE:
    case TM_ERR_UNSTABLE:
    case TM_ERR_LIMIT: return APP_FAILED;
    case TM_ERR_ARGUMENT:
    case TM_ERR_MESH:
    case TM_ERR_MATERIAL:
    case TM_ERR_SUPPORT:
    case TM_ERR_STEP:
    case TM_ERR_FILE:
    case TM_ERR_EXCLUDED: return APP_BAD_INPUT;
    }
    return APP_FAILED;
}

int app_report(const char *file, int line, const tm_error *error) {
    print_place(file, line);
    print_plain(error->message[0] ? error->message
                : error->status   ? tm_status_name(error->status)
                                  : "the simulation did not finish; undo the last change");
    /* A failed step fills no error; the exit code must still not be success. */
    return error->status ? app_exit_code(error->status) : APP_FAILED;
}
