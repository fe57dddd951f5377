/* What the room `mesh` gives: mesh and material, which are public whole, and what their makers share. */
#ifndef TM_MESH_INTERNAL_H
#define TM_MESH_INTERNAL_H

#include "base/base_internal.h"
#include "tensormass/material.h"
#include "tensormass/mesh.h"

/* Of a filled tm_mesh_def: an unfilled one is a broken contract. */
enum { TM_COOKIE_MESH = 0x6d657368 };

/* For `mesh`, built as `def` says: `def` with vertices, in arrays of `pool`, in the order of tm_mesh_numbering, and
 * that order's given numbers in `*given`, where the given order is poor; else `def` as it was, `*given` null. False: no
 * memory. */
bool tm_numbering_better(const tm_mesh *mesh, tm_pool *pool, tm_mesh_def *def, const int32_t **given);

/* Diagonal of the rest positions' bounds. */
double tm_mesh_size_m(const tm_mesh *mesh);

#endif
