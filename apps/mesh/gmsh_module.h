/* Inside the gmsh module (build/lib/tensormass/gmsh.so). */
#ifndef TM_GMSH_MODULE_H
#define TM_GMSH_MODULE_H

#include "common/mesh_parts.h"

/* Starts Gmsh, silent and without anybody's settings, and reads the file into its model. */
tm_status tm_gmsh_open(const char *path, tm_error *error);
/* TM_ERR_FILE with what Gmsh said last, else `what`. */
tm_status tm_gmsh_failed(tm_error *error, const char *what);

app_gmsh_read_fn tm_gmsh_read;

#endif
