/* The meshes of this folder, made from formulas: the same bytes on every machine. */
#ifndef GENERATOR_H
#define GENERATOR_H

#include "mesh/mesh_builder.h"

/* Shapes with about `tets` tetrahedra, never fewer. */
void make_block(growing *m, int tets);
void make_cylinder(growing *m, int tets);
void make_liver(growing *m, int tets);

/* PREFIX.msh (Gmsh 2.2 text) and, if it has fibres, PREFIX.fibres.csv. */
bool write_mesh(const growing *m, const char *prefix);

#endif
