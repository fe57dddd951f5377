/* Decorates pictures of a log or a running simulation, whose messages have only a surface. Adds the scene's title,
 * supports, fibres and region colours, and inner regions seen through the largest. Used by tm-view and tm-play. */
#ifndef VIEW_DRESS_H
#define VIEW_DRESS_H

#include "inner_regions.h"
#include "marks.h"
#include "picture.h"
#include "scene/sim.h"
#include "tensormass/mesh.h"
#include "tensormass_io.h"

/* --- the surface of a mesh at rest, in the colours of its regions, complete or cut open by a plane --- */

/* How a mesh is drawn. */
typedef struct view_cutaway {
    bool clipped;
    double normal[3], offset_m; /* tissue beyond middle + offset along the normal is not drawn */
    double through; /* share of light through the outer surface, 0..1; above 0 inner regions are drawn too */
} view_cutaway;

/* Sets names and colours: the largest region has the colour of tissue, the others have their own, rigid bodies
 * (rigid_tet; null: none) are grey. */
void view_regions_name(const tm_mesh_file *file, const tm_mesh *mesh, const uint8_t *rigid_tet, view_picture *picture);
/* Fills the picture's surface; it has no triangles if the plane removes everything. Returns false if memory is
 * exhausted. */
bool view_regions_surface(const tm_mesh *mesh, const view_cutaway *cut, view_picture *picture);
/* Fills the picture's ties, but for those with an end that the plane removes. Returns false if memory is exhausted. */
bool view_regions_ties(const tm_mesh *mesh, const tm_ties *ties, const view_cutaway *cut, view_picture *picture);

/* --- marks of an open scene --- */

/* Reads the marks. Returns false if memory is exhausted; the marks are then empty. */
bool view_marks_take(view_marks *marks, const sim *s, bool supports, bool fibres);
void view_marks_free(view_marks *marks);

/* Which marks of a scene are drawn. */
typedef struct view_mark_choice {
    bool supports, fibres;
} view_mark_choice;

/* --- a picture from a static file: a scene or a mesh --- */

/* Returns whether the path's ending is that of a scene or a mesh, not of a log. */
bool view_is_still(const char *path);
bool view_is_scene(const char *path);
/* Fills the picture's surface and, for a scene, its instruments at their start and its marks. Returns 0, or an exit
 * code after an error message. */
int view_still_load(const char *path, double scale, const view_mark_choice *choice, const view_cutaway *cut,
                    view_picture *picture, view_marks *marks);

typedef struct view_dress {
    const char *scene; /* null: no decoration */
    view_mark_choice choice;
    double through; /* share of light through the largest region, 0..0.95; above 0 inner regions are drawn */
    view_marks marks;
    view_inside inside;
    uint32_t tinted, followed; /* topology with regions set; version that the inner regions follow */
} view_dress;

/* Prints an error in the program's name if fibres or inner regions are requested without a scene. Returns 0 or an exit
 * code. */
int view_dress_check(const view_dress *dress, const char *program);
/* Reads the scene: marks, inner regions, and the picture's regions. Returns 0, or an exit code after an error
 * message. */
int view_dress_load(view_dress *dress, view_picture *picture);
/* Fills `shown`, the picture to be drawn, which borrows surfaces of both. Sets regions in the surface kinds of
 * `picture`. Returns 0, or an exit code after an error message. */
int view_dress_show(view_dress *dress, view_picture *picture, view_picture *shown);
/* Discards what was computed for the surface, because the picture began anew. */
void view_dress_restart(view_dress *dress);
void view_dress_free(view_dress *dress);

#endif
