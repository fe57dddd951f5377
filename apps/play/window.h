/* A window that shows pictures and hears keys and mouse: a module (lib/tensormass/window.so) around SDL2. */
#ifndef PLAY_WINDOW_H
#define PLAY_WINDOW_H

#include <stdbool.h>
#include <stdint.h>

#include "tensormass/base.h"

typedef enum play_event_type {
    PLAY_QUIT,
    PLAY_KEY,
    PLAY_BUTTON,
    PLAY_MOTION,
    PLAY_WHEEL,
    PLAY_FOCUS_LOST
} play_event_type;

/* Keys that are no character. Others carry their lower-case ASCII. */
enum {
    PLAY_LEFT = 256,
    PLAY_RIGHT,
    PLAY_UP,
    PLAY_DOWN,
    PLAY_PAGE_UP,
    PLAY_PAGE_DOWN,
    PLAY_TAB,
    PLAY_ESCAPE,
    PLAY_SHIFT
};

typedef struct play_event {
    play_event_type type;
    int code;     /* key; button 1 left, 2 middle, 3 right */
    bool down;    /* of key or button; keys that repeat by themselves are not told again */
    float dx, dy; /* motion in picture pixels, x right, y down; wheel steps in dy, away from the user positive */
} play_event;

typedef struct play_window play_window;

/* The module's one symbol. */
typedef struct play_window_api {
    /* TM_ERR_LIMIT: no display. */
    tm_status (*open)(int width, int height, const char *title, play_window **window, tm_error *error);
    void (*close)(play_window *window);
    bool (*next_event)(play_window *window, play_event *event);
    /* rgb[3*width*height], top row first; stretched when the window was resized. */
    void (*show)(play_window *window, const uint8_t *rgb);
} play_window_api;
#define PLAY_WINDOW_SYMBOL "play_sdl"

#endif
