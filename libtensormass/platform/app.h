/* Shared by all programs, the controller's included: errors with file and line, exit codes, signals, output files,
 * modules opened on demand. */
#ifndef TM_APP_H
#define TM_APP_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "clock.h"
#include "tensormass/base.h"

enum { APP_DONE = 0, APP_FAILED = 1, APP_BAD_INPUT = 2 };

/* Prints "file:line: what; what to do" to stderr; without the line if it is 0. Returns APP_BAD_INPUT. */
int app_bad_input(const char *file, int line, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* The same for a tm_error. Returns 2 for bad input, else 1. */
int app_report(const char *file, int line, const tm_error *error);
/* Returns the exit code of a status. */
int app_exit_code(tm_status status);

/* Opens a module with a heavy dependency (lib/tensormass/NAME.so next to bin/), on first use. Returns null on failure,
 * with a message that names the Debian package. Modules are never closed. */
void *app_module(const char *name, tm_error *error);
void *app_module_symbol(void *module, const char *symbol, tm_error *error);

/* Finds an installed file (scenes, references), named as in the source tree. Searches the working directory, then
 * share/tensormass of the program's prefix, then its source tree. Returns false if it is in none; `path` is then
 * `name`. */
bool app_shared_file(const char *name, char *path, size_t size);

/* Output files appear complete or not at all: write to the stream, or to the temporary by name, then commit or abandon.
 * A killed run leaves nothing behind. Links are followed and stay. Devices, FIFOs and /dev/stdout are written directly.
 * "-" is stdout; the program's messages then go to stderr. */
typedef struct app_output {
    char path[1024];      /* as given by the user */
    char temporary[1100]; /* file for libraries that open files by name */
    char target[4096];    /* private: file that is replaced, links resolved */
    char whole[4140];     /* private: name of the finished file before it is renamed */
    int fd;
    bool begun, through, named;
} app_output;
/* Returns false if the folder is missing or not writable, or `path` is a folder or a disk. */
bool app_output_begin(app_output *output, const char *path, tm_error *error);
/* Opens a stream for app_output_end. Returns null if memory is exhausted. */
FILE *app_output_stream(const app_output *output);
/* Closes the stream (may be null). Commits if all of it was written, else abandons. Returns false with a message that
 * names the path. */
bool app_output_end(app_output *output, FILE *stream, tm_error *error);
bool app_output_commit(app_output *output, tm_error *error);
/* Abandons an output; does nothing if none has begun. */
void app_output_abandon(app_output *output);
/* Reports a path (null: none) that could not be written later. Returns APP_DONE or an exit code. */
int app_output_check(const char *path);
/* Reports a file's ending that is not in `endings` (".png .ppm"): its contents would not match its name. */
int app_output_ending(const char *option, const char *path, const char *endings);
/* Call once at the start: makes the program exit with 1 if text could not be written to stdout (a full disk). */
void app_check_stdout(void);

/* --quiet: suppresses progress lines and remarks; errors, warnings and results stay. */
void app_be_quiet(void);
bool app_is_quiet(void);
/* Prints a line to stderr, unless --quiet. */
void app_remark(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Catches SIGINT and SIGTERM. After the first, app_interrupted() is the signal's number and the program finishes; the
 * second ends it at once. SIGPIPE becomes a write error. */
void app_catch_signals(void);
int app_interrupted(void);
/* Returns 130 or 143 after a signal, else 0. */
int app_interrupted_exit(void);
/* Returns the exit code of a run that returned `rc`; a failure after a signal is reported as an interruption. */
int app_ended(const char *program, int rc);

/* Prints a progress line to a terminal, nothing to a pipe. fraction in [0,1]; call with done=true at the end. */
void app_progress(const char *what, double fraction, bool done);

/* Draws a session number above 0 for this start of a program; random, since a clock may be wrong after a restart. */
int64_t app_session(void);

#endif
