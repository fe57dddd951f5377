/* Meshes of meshes/, generated from formulas: bit-identical on every machine. */
#ifndef GENERATOR_H
#define GENERATOR_H

#include "mesh/mesh_builder.h"

/* Makes shapes with at least `tets` tetrahedra, and little more. */
void make_block(growing *m, int tets);
void make_cylinder(growing *m, int tets);
void make_liver(growing *m, int tets);
void make_gallbladder(growing *m, int tets);

/* Writes PREFIX.msh (Gmsh 2.2 text) and, if it has fibres, PREFIX.fibres.csv. */
bool write_mesh(const growing *m, const char *prefix);

#endif
