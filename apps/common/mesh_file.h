/* Meshes of programs: read by libtensormass_io, written as every output file is. */
#ifndef TM_APP_MESH_FILE_H
#define TM_APP_MESH_FILE_H

#include "tensormass_io.h"

/* The whole file or none, by the path's ending. `error->message` names the path. */
tm_status app_mesh_write(const tm_mesh_file *mesh, const char *path, tm_error *error);

#endif
