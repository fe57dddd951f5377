/* A window that shows pictures and reads keys and mouse: a module (lib/tensormass/window.so) around SDL2. */
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

/* Keys without a character. Others have the code of their lower-case ASCII character. */
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
    bool down;    /* key or button is down; automatic repeats are not reported */
    float dx, dy; /* pixels, x right, y down; wheel: steps in dy, positive away from the user */
} play_event;

typedef struct play_window play_window;

/* Functions of the module, reached through its single symbol. */
typedef struct play_window_api {
    /* Opens a window. Returns TM_ERR_LIMIT without a display. */
    tm_status (*open)(int width, int height, const char *title, play_window **window, tm_error *error);
    void (*close)(play_window *window);
    bool (*next_event)(play_window *window, play_event *event);
    /* Shows rgb[3*width*height], top row first, stretched to the window's size. */
    void (*show)(play_window *window, const uint8_t *rgb);
} play_window_api;
#define PLAY_WINDOW_SYMBOL "play_sdl"

#endif
