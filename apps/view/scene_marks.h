/* Marks of a scene that is open. */
#ifndef VIEW_SCENE_MARKS_H
#define VIEW_SCENE_MARKS_H

#include "marks.h"
#include "scene/sim.h"

/* False: no memory; the marks are then empty. */
bool view_marks_take(view_marks *marks, const sim *s, bool supports, bool fibres);
void view_marks_free(view_marks *marks);

#endif
