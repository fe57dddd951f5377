/* Internals of meshes: shared by mesh building and numbering. */
#ifndef TM_MESH_INTERNAL_H
#define TM_MESH_INTERNAL_H

#include "base/base_internal.h"
#include "tensormass/material.h"
#include "tensormass/mesh.h"

/* Marks a filled tm_mesh_def: an unfilled one is a broken contract. */
enum { TM_COOKIE_MESH = 0x6d657368 };

/* Renumbers where the original order is poor. `def` then gets vertices in the order of tm_mesh_numbering, in arrays of
 * `pool`, and `*given` their original numbers. Otherwise `def` is unchanged and `*given` null. `mesh` was built from
 * `def`. Returns false without memory. */
bool tm_numbering_better(const tm_mesh *mesh, tm_pool *pool, tm_mesh_def *def, const int32_t **given);

/* Diagonal of the rest positions' bounds. */
double tm_mesh_size_m(const tm_mesh *mesh);

#endif
