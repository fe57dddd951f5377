#ifndef TM_RESULT_FILE_H
#define TM_RESULT_FILE_H

#include "app.h"

/* Output files opened before the run, so that a missing folder is reported at once, and renamed after it. */
typedef struct app_file {
    app_output output;
    bool begun;
    FILE *stream;
} app_file;
/* Begins a file. A null path makes this and the functions below do nothing. */
int app_file_begin(app_file *file, const char *path);
int app_file_end(app_file *file, bool good);

#endif
