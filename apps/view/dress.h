/* What a scene adds to pictures of a log or a running simulation, whose messages tell a surface alone: title, supports,
 * fibres, regions' colours, and those inside seen through the largest one. Used by tm-view and tm-play. */
#ifndef VIEW_DRESS_H
#define VIEW_DRESS_H

#include "inside.h"
#include "still.h"

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
