/* The subcommands of tm-mesh. */
#ifndef MESH_COMMAND_H
#define MESH_COMMAND_H

#include <stdio.h>

#include "app.h"
#include "common/mesh_file.h"

typedef int command_fn(int argc, char **argv);
command_fn command_info, command_check, command_fill, command_refine, command_repair, command_renumber, command_convert,
    command_image;

/* Converts "--scale 30 mm" and similar to SI. Returns false after an error message. */
bool command_quantity(const char *option, const char *text, const char *dimension, double *si);
/* Converts "mm" and similar to metres per unit of the file. Returns false after an error message. */
bool command_unit(const char *command, const char *text, double *scale);
/* Reads option 's' (--scale S) or 'u' (--unit UNIT), which set the same value; `sized` refuses a second one. Returns
 * false after an error message. */
bool command_scale(const char *command, int option, const char *text, bool *sized, double *scale);
/* Rejects an output path that cannot be written, or whose suffix is no mesh format, before the work begins. */
int command_output(const char *path);
/* Prints that memory is exhausted; returns APP_FAILED. */
int command_no_memory(const char *file);
/* Reports wrong usage with a pointer to --help; returns APP_BAD_INPUT. */
int command_usage(const char *command, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Writes directions as the CSV that tm_fibres_load reads. */
tm_status write_fibres(const double *fibre, int32_t tet_count, const char *path, tm_error *error);

/* Finds the regions that a .msh file names and that have no tetrahedron. Returns their number, at most `most`. */
enum { REGIONS_WITHOUT = 32 };
int32_t find_empty_regions(const tm_mesh_file *mesh, const char *path, char name[REGIONS_WITHOUT][64]);

#endif
