/* A picture from a file that does not move: a scene or a mesh. */
#ifndef VIEW_STILL_H
#define VIEW_STILL_H

#include "inside.h"
#include "picture.h"
#include "regions.h"
#include "scene_marks.h"

/* Which marks of a scene are wanted. */
typedef struct view_mark_choice {
    bool supports, fibres;
} view_mark_choice;

/* By the ending: a scene or a mesh, not a log. */
bool view_is_still(const char *path);
bool view_is_scene(const char *path);
/* Fills the picture's surface, and of a scene its instruments where they start and its marks. 0, or an exit code after
 * complaining. */
int view_still_load(const char *path, double scale, const view_mark_choice *choice, const view_cutaway *cut,
                    view_picture *picture, view_marks *marks);
/* The marks and the regions' names and colours alone, for a source that tells none; `inside`, where it is wanted, too.
 */
int view_scene_marks(const char *path, const view_mark_choice *choice, view_picture *picture, view_marks *marks,
                     view_inside *inside);

#endif
