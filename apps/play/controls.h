/* From keys and mouse to where the hands want the instruments. Knows no window and no messages. */
#ifndef PLAY_CONTROLS_H
#define PLAY_CONTROLS_H

#include "hrt.h"
#include "view/camera.h"
#include "view/message_source.h"
#include "view/picture.h"
#include "window.h"

typedef struct play_hand {
    bool known;               /* the simulation has said where the instrument is */
    hrt_params params;        /* its device's own */
    double joint[HRT_JOINTS]; /* what the hand wants */
    bool acting;              /* cautery current, or jaws held shut, while the key is held */
    bool latched;             /* jaws kept shut after the key was let go */
} play_hand;

typedef struct play_controls {
    int selected;
    play_hand hand[VIEW_INSTRUMENTS];
    bool held[512], button[4];
    float motion[2], wheel; /* since the last step; pixels, steps */
    bool quit, help;
    view_command command; /* to be sent when has_command */
    bool has_command;
    char extrapolator[24];       /* storage of command.extrapolator */
    float eye_turn[2], eye_zoom; /* azimuth and elevation rad, factor: since the last step */
} play_controls;

void play_controls_begin(play_controls *controls);
void play_controls_event(play_controls *controls, const view_picture *picture, const play_event *event);
/* Moves the wanted joints by what was pressed for `dt_s`. Mouse motion moves the tip across the picture. */
void play_controls_step(play_controls *controls, const view_picture *picture, const view_camera *camera, int height_px,
                        double dt_s);
/* The hand's message for an instrument; false while nothing is known of it. */
bool play_controls_hand(const play_controls *controls, const view_picture *picture, int instrument, view_hand *hand);

#endif
