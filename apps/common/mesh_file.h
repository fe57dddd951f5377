/* Writes mesh files of programs: libtensormass_io formats, written like every output file. */
#ifndef TM_APP_MESH_FILE_H
#define TM_APP_MESH_FILE_H

#include "tensormass_io.h"

/* Writes the complete file or none; the path's ending selects the format. `error->message` names the path. */
tm_status app_mesh_write(const tm_mesh_file *mesh, const char *path, tm_error *error);

#endif
