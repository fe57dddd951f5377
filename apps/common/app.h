/* What every program shares: versions, errors with file and line, exits, JSON, modules opened on demand. */
#ifndef TM_APP_H
#define TM_APP_H

#include <stdbool.h>
#include <stdint.h>

#include "tensormass/base.h"

enum { APP_DONE = 0, APP_FAILED = 1, APP_BAD_INPUT = 2 };

/* "file:line: what; what to do" on stderr; line 0 leaves the line out. Returns APP_BAD_INPUT. */
int app_bad_input(const char *file, int line, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* The same for a tm_error, exit code by status: bad input 2, anything else 1. */
int app_report(const char *file, int line, const tm_error *error);

/* A number with an optional unit: "5 kPa", "3 mm", "30 deg", "0.003". SI out. `dimension` is one of the strings of
 * units.c: "pressure" "length" "angle" "density" "force" "time" "rate" "mass" "acceleration" "velocity" "compliance"
 * "stiffness" "none". */
bool app_parse_quantity(const char *text, const char *dimension, double *si, char *why, int why_size);

/* A heavy dependency in a shared object of ours (lib/tensormass/NAME.so beside bin/), opened on first use. Null, with a
 * message that names the Debian package, when it cannot be. Never closed. */
void *app_module(const char *name, tm_error *error);
void *app_module_symbol(void *module, const char *symbol, tm_error *error);

/* Output files appear whole or not at all: write to the returned temporary name, then commit (rename) or abandon. */
typedef struct app_output {
    char path[1024], temporary[1040];
} app_output;
bool app_output_begin(app_output *output, const char *path, tm_error *error);
bool app_output_commit(app_output *output, tm_error *error);
void app_output_abandon(app_output *output);

/* A progress line on a terminal, nothing in a pipe. fraction in [0,1]; call with done=true at the end. */
void app_progress(const char *what, double fraction, bool done);

/* The folder of things that can be made again: $TM_CACHE_DIR, else $XDG_CACHE_HOME/tensormass, else
 * ~/.cache/tensormass. Made if it is not there; false when it cannot be. */
bool app_cache_folder(char *path, size_t size);

int64_t app_monotonic_us(void);
/* A name for this start of a program, above 0: drawn, since a clock may stand anywhere after a restart. */
int64_t app_session(void);

#endif
