/* What the room `mesh` gives: mesh and material, which are public whole, and what their makers share. */
#ifndef TM_MESH_INTERNAL_H
#define TM_MESH_INTERNAL_H

#include "base/base_internal.h"
#include "tensormass/material.h"
#include "tensormass/mesh.h"

/* Of a filled tm_mesh_def: an unfilled one is a broken contract. */
enum { TM_COOKIE_MESH = 0x6d657368 };

#endif
