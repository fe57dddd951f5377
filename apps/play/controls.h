/* Maps keys and mouse to the poses that the hands demand. Independent of window and messages. */
#ifndef PLAY_CONTROLS_H
#define PLAY_CONTROLS_H

#include "hrt.h"
#include "view/camera.h"
#include "view/message_source.h"
#include "view/picture.h"
#include "window.h"

typedef struct play_hand {
    bool known;               /* the simulation has reported the instrument's pose */
    hrt_params params;        /* parameters of its device */
    double joint[HRT_JOINTS]; /* pose that the hand demands, in joints */
    bool acting;              /* cautery current on, or jaws closed, while the key is held */
    bool latched;             /* jaws stay closed after the key was released */
} play_hand;

typedef struct play_controls {
    int selected;
    play_hand hand[VIEW_INSTRUMENTS];
    bool held[512], button[4];
    float motion[2], wheel; /* since the last step: mouse motion in pixels, wheel steps */
    bool quit, help;
    view_command command; /* to be sent if has_command is set */
    bool has_command;
    char extrapolator[24];       /* storage of command.extrapolator */
    float eye_turn[2], eye_zoom; /* since the last step: azimuth and elevation, rad; zoom factor */
} play_controls;

void play_controls_begin(play_controls *controls);
void play_controls_event(play_controls *controls, const view_picture *picture, const play_event *event);
/* Moves the demanded joints according to the keys pressed for `dt_s`. Mouse motion moves the tip in the picture
 * plane. */
void play_controls_step(play_controls *controls, const view_picture *picture, const view_camera *camera, int height_px,
                        double dt_s);
/* Fills the hand's message for an instrument. Returns false if its pose is still unknown. */
bool play_controls_hand(const play_controls *controls, const view_picture *picture, int instrument, view_hand *hand);

#endif
