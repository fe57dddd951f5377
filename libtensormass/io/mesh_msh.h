/* The two parts of .msh: mesh_msh.c reads, mesh_msh_write.c writes. */
#ifndef TM_MESH_MSH_H
#define TM_MESH_MSH_H

#include "mesh_format.h"

void tm_io_write_msh(const tm_mesh_file *mesh, FILE *file);

#endif
