/* The two halves of .msh: mesh_msh.c reads, mesh_msh_write.c writes. */
#ifndef TM_MESH_MSH_H
#define TM_MESH_MSH_H

#include "mesh_format.h"

void app_mesh_write_msh(const app_mesh *mesh, FILE *file);

#endif
