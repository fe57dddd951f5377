/* Writes meshes to files, completely or not at all. */
#include "mesh_file.h"

#include "app.h"

tm_status app_mesh_write(const tm_mesh_file *mesh, const char *path, tm_error *error) {
    app_output output;
    if (!app_output_begin(&output, path, error)) return TM_ERR_FILE;
    FILE *file = app_output_stream(&output);
    const tm_status status = file ? tm_mesh_file_write(mesh, path, file, error) : TM_OK;
    if (status && !ferror(file)) { /* unknown file type */
        fclose(file);
        app_output_abandon(&output);
        return status;
    }
    return app_output_end(&output, file, error) ? TM_OK : TM_ERR_FILE;
}
