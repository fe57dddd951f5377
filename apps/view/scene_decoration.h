/* What a scene adds to pictures of a log or a running simulation, whose messages tell a surface alone: title, supports,
 * fibres, regions' colours, and those inside seen through the largest one. Used by tm-view and tm-play. */
#ifndef VIEW_DRESS_H
#define VIEW_DRESS_H

#include "inner_regions.h"
#include "marks.h"
#include "picture.h"
#include "scene/sim.h"
#include "tensormass/mesh.h"
#include "tensormass_io.h"

/* --- the surface of a mesh that stands still, in the colours of its regions, whole or cut open by a plane --- */

/* How a mesh is shown. */
typedef struct view_cutaway {
    bool clipped;
    double normal[3], offset_m; /* what lies beyond middle + offset along it is taken away */
    double through;             /* of the outer surface's light, 0..1: above 0 regions inside are drawn too */
} view_cutaway;

/* Names and colours: the largest region keeps the look of tissue, the others are told apart by it. */
void view_regions_name(const tm_mesh_file *file, const tm_mesh *mesh, view_picture *picture);
/* Fills the picture's surface. False: no memory. Nothing is left where the plane takes all away: no triangles. */
bool view_regions_surface(const tm_mesh *mesh, const view_cutaway *cut, view_picture *picture);

/* --- marks of a scene that is open --- */

/* False: no memory; the marks are then empty. */
bool view_marks_take(view_marks *marks, const sim *s, bool supports, bool fibres);
void view_marks_free(view_marks *marks);

/* Which marks of a scene are wanted. */
typedef struct view_mark_choice {
    bool supports, fibres;
} view_mark_choice;

/* --- a picture from a file that does not move: a scene or a mesh --- */

/* By the ending: a scene or a mesh, not a log. */
bool view_is_still(const char *path);
bool view_is_scene(const char *path);
/* Fills the picture's surface, and of a scene its instruments where they start and its marks. 0, or an exit code after
 * complaining. */
int view_still_load(const char *path, double scale, const view_mark_choice *choice, const view_cutaway *cut,
                    view_picture *picture, view_marks *marks);

typedef struct view_dress {
    const char *scene; /* null: nothing is added */
    view_mark_choice choice;
    double through; /* of the largest region's light, 0..0.95: above 0 those inside are drawn */
    view_marks marks;
    view_inside inside;
    uint32_t tinted, followed; /* the topology that has its regions; the positions that the inside follows */
} view_dress;

/* Complains in the program's name where fibres or the inside are asked for and no scene tells them. 0 or an exit
 * code. */
int view_dress_check(const view_dress *dress, const char *program);
/* Reads the scene: marks, the inside, and the picture's regions. 0 or an exit code, having complained. */
int view_dress_load(view_dress *dress, view_picture *picture);
/* `shown`: the picture as it is to be drawn; it borrows surfaces of both. Surface kinds of `picture` get their regions.
 * 0 or an exit code, having complained. */
int view_dress_show(view_dress *dress, view_picture *picture, view_picture *shown);
/* The picture began anew: what was found for its surface is not for the next one. */
void view_dress_restart(view_dress *dress);
void view_dress_free(view_dress *dress);

#endif
