/* Writes fibres as CSV. */
#include "command.h"

tm_status write_fibres(const double *fibre, int32_t tet_count, const char *path, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
    FILE *file = app_output_stream(&output);
    if (file) fprintf(file, "tet,ax,ay,az\n");
    for (int32_t t = 0; file && t < tet_count; t++)
        fprintf(file, "%d,%.9g,%.9g,%.9g\n", t, fibre[3 * (size_t)t], fibre[3 * (size_t)t + 1],
                fibre[3 * (size_t)t + 2]);
    return app_output_end(&output, file, error) ? TM_OK : TM_ERR_FILE;
}
