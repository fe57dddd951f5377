/* The subcommands of tm-mesh. */
#ifndef MESH_COMMAND_H
#define MESH_COMMAND_H

#include <stdio.h>

#include "app.h"
#include "common/mesh_file.h"

typedef int command_fn(int argc, char **argv);
command_fn command_info, command_check, command_fill, command_refine, command_repair, command_renumber, command_convert,
    command_image;

/* "--scale 30 mm" and the like into SI; false after a complaint. */
bool command_quantity(const char *option, const char *text, const char *dimension, double *si);
/* "mm" and the like as metres per unit of the file; false after a complaint. */
bool command_unit(const char *command, const char *text, double *scale);
/* `option` 's' (--scale S) or 'u' (--unit UNIT), which say the same: once, as `sized` knows. False: told. */
bool command_scale(const char *command, int option, const char *text, bool *sized, double *scale);
/* Complains now about an output that cannot be written later, or whose ending is no mesh's. */
int command_output(const char *path);
/* Complains; APP_FAILED. */
int command_no_memory(const char *file);
/* Bad usage: says what, points at --help, APP_BAD_INPUT. */
int command_usage(const char *command, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Directions as the CSV that tm_fibres_load reads. */
tm_status write_fibres(const double *fibre, int32_t tet_count, const char *path, tm_error *error);

/* Names of regions that a .msh file declares and gives no tetrahedron. Returns how many, at most `most`. */
enum { REGIONS_WITHOUT = 32 };
int32_t find_empty_regions(const tm_mesh_file *mesh, const char *path, char name[REGIONS_WITHOUT][64]);

/* The mesh without the tetrahedra whose `keep` is 0 and the vertices that none of the rest uses. `kept` [tet_count] may
 * be null: old number of each. */
bool command_subset(tm_mesh_file *mesh, const uint8_t *keep, int32_t *kept);

#endif
