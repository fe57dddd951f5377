/* What every program shares, the controller's and the others: errors with file and line, exits, signals, output files,
 * modules opened on demand. */
#ifndef TM_APP_H
#define TM_APP_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "clock.h"
#include "tensormass/base.h"

enum { APP_DONE = 0, APP_FAILED = 1, APP_BAD_INPUT = 2 };

/* "file:line: what; what to do" on stderr; line 0 leaves the line out. Returns APP_BAD_INPUT. */
int app_bad_input(const char *file, int line, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* The same for a tm_error, exit code by status: bad input 2, anything else 1. */
int app_report(const char *file, int line, const tm_error *error);
/* The exit code of a status. */
int app_exit_code(tm_status status);

/* A heavy dependency in a shared object of ours (lib/tensormass/NAME.so beside bin/), opened on first use. Null, with a
 * message that names the Debian package, when it cannot be. Never closed. */
void *app_module(const char *name, tm_error *error);
void *app_module_symbol(void *module, const char *symbol, tm_error *error);

/* What is installed beside the programs (scenes, references), named as in the source tree: in the working directory,
 * else in share/tensormass of the program's prefix, else in the tree that it was built in. False: in none of them;
 * `path` then holds the name as it was given. */
bool app_shared_file(const char *name, char *path, size_t size);

/* Output files appear whole or not at all: write to the stream, or to the temporary by name, then commit or abandon.
 * A killed run leaves nothing behind. Links are followed, the link stays. What is no regular file (device, FIFO,
 * /dev/stdout) is written through, as it comes; "-" is stdout, and what the program prints then goes to stderr. */
typedef struct app_output {
    char path[1024];      /* as it was given */
    char temporary[1100]; /* where a library that opens files by name writes */
    char target[4096];    /* private: what is replaced, links followed */
    char whole[4140];     /* private: the name that the finished file has before it is renamed */
    int fd;
    bool begun, through, named;
} app_output;
/* False: the folder is not there or not writable, or `path` is a folder or a disk. */
bool app_output_begin(app_output *output, const char *path, tm_error *error);
/* For app_output_end. Null: no memory. */
FILE *app_output_stream(const app_output *output);
/* Closes the stream (null: there was none) and commits, where all of it was written; abandons otherwise. On false the
 * message names the path. */
bool app_output_end(app_output *output, FILE *stream, tm_error *error);
bool app_output_commit(app_output *output, tm_error *error);
/* Nothing happens where nothing was begun. */
void app_output_abandon(app_output *output);
/* Complains now about a path (null: none) that cannot be written later. APP_DONE or an exit code. */
int app_output_check(const char *path);
/* Complains where a file's ending is none of `endings` (".png .ppm"): what is written would not be what it says. */
int app_output_ending(const char *option, const char *path, const char *endings);
/* Once, at the start: text that could not be written to stdout (a full disk) makes the program exit with 1. */
void app_check_stdout(void);

/* --quiet: no progress lines, no remarks; errors, warnings and what was asked for stay. */
void app_be_quiet(void);
bool app_is_quiet(void);
/* A line on stderr that --quiet leaves out. */
void app_remark(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* SIGINT and SIGTERM once: app_interrupted() is the signal's number, and the program ends what it does; twice: it is
 * ended by the system, at once. SIGPIPE is a write error like another. */
void app_catch_signals(void);
int app_interrupted(void);
/* 130 or 143 after a signal, else 0. */
int app_interrupted_exit(void);
/* The exit code of a program whose run came back with `rc`: what failed after a signal was interrupted, and says so. */
int app_ended(const char *program, int rc);

/* A progress line on a terminal, nothing in a pipe. fraction in [0,1]; call with done=true at the end. */
void app_progress(const char *what, double fraction, bool done);

/* A name for this start of a program, above 0: drawn, since a clock may stand anywhere after a restart. */
int64_t app_session(void);

#endif
