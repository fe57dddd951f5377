#ifndef TM_RESULT_FILE_H
#define TM_RESULT_FILE_H

#include "app.h"

/* Output files, opened before the run so that a folder that is not there is told at once, and renamed after it. */
typedef struct app_file {
    app_output output;
    bool begun;
    FILE *stream;
} app_file;
/* path null: nothing happens, and nothing in the others either. */
int app_file_begin(app_file *file, const char *path);
int app_file_end(app_file *file, bool good);

#endif
