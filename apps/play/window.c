#include "window.h"

#include <SDL.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct play_window {
    SDL_Window *window;
    SDL_Renderer *renderer;
    SDL_Texture *texture;
    int width, height;
};

static void window_close(play_window *w) {
    if (!w) return;
    if (w->texture) SDL_DestroyTexture(w->texture);
    if (w->renderer) SDL_DestroyRenderer(w->renderer);
    if (w->window) SDL_DestroyWindow(w->window);
    SDL_Quit();
    free(w);
}

/* Returns whether SDL's driver shows windows. Without a display SDL falls back to invisible drivers. */
static bool seen_by_people(void) {
    const char *driver = SDL_GetCurrentVideoDriver();
    if (driver && (!strcmp(driver, "x11") || !strcmp(driver, "wayland"))) return true;
    if (driver) SDL_SetError("no display: neither DISPLAY nor WAYLAND_DISPLAY gives one");
    return false;
}

static tm_status window_open(int width, int height, const char *title, play_window **out, tm_error *error) {
    play_window *w = calloc(1, sizeof *w);
    error->status = w ? TM_ERR_LIMIT : TM_ERR_MEMORY;
    if (!w) return error->status;
    SDL_SetHint(SDL_HINT_NO_SIGNAL_HANDLERS, "1");
    /* The picture is rendered elsewhere, perhaps by OSMesa, which conflicts with a second OpenGL in one process. */
    SDL_SetHint(SDL_HINT_FRAMEBUFFER_ACCELERATION, "0");
    SDL_SetHint(SDL_HINT_VIDEO_X11_NET_WM_BYPASS_COMPOSITOR, "0");
    if (!getenv("SDL_VIDEODRIVER"))
        SDL_SetHint(SDL_HINT_VIDEODRIVER, getenv("WAYLAND_DISPLAY") ? "wayland,x11" : "x11");
    w->width = width, w->height = height;
    if (!SDL_Init(SDL_INIT_VIDEO) && seen_by_people())
        w->window = SDL_CreateWindow(title, SDL_WINDOWPOS_UNDEFINED, SDL_WINDOWPOS_UNDEFINED, width, height,
                                     SDL_WINDOW_RESIZABLE);
    if (w->window) w->renderer = SDL_CreateRenderer(w->window, -1, SDL_RENDERER_SOFTWARE);
    if (w->renderer)
        w->texture = SDL_CreateTexture(w->renderer, SDL_PIXELFORMAT_RGB24, SDL_TEXTUREACCESS_STREAMING, width, height);
    if (w->texture) {
        *out = w;
        return TM_OK;
    }
    snprintf(error->message, sizeof error->message,
             "no window (%s); run it on a desktop or over ssh -X, or use tm-view, which needs no display",
             SDL_GetError());
    window_close(w);
    return error->status;
}

static int key_code(SDL_Keycode key) {
    switch (key) {
    case SDLK_LEFT: return PLAY_LEFT;
    case SDLK_RIGHT: return PLAY_RIGHT;
    case SDLK_UP: return PLAY_UP;
    case SDLK_DOWN: return PLAY_DOWN;
    case SDLK_PAGEUP: return PLAY_PAGE_UP;
    case SDLK_PAGEDOWN: return PLAY_PAGE_DOWN;
    case SDLK_TAB: return PLAY_TAB;
    case SDLK_ESCAPE: return PLAY_ESCAPE;
    case SDLK_LSHIFT:
    case SDLK_RSHIFT: return PLAY_SHIFT;
    default: return key >= ' ' && key <= '~' ? (int)key : 0;
    }
}

/* Converts motion in window pixels to picture pixels. */
static void picture_motion(const play_window *w, int dx, int dy, play_event *event) {
    int wide = w->width, high = w->height;
    SDL_GetWindowSize(w->window, &wide, &high);
    event->dx = (float)dx * (float)w->width / (float)(wide > 0 ? wide : 1);
    event->dy = (float)dy * (float)w->height / (float)(high > 0 ? high : 1);
}

static bool next_event(play_window *w, play_event *event) {
    SDL_Event e;
    while (SDL_PollEvent(&e)) {
        *event = (play_event){.type = PLAY_QUIT};
        switch (e.type) {
        case SDL_QUIT: return true;
        case SDL_KEYDOWN:
        case SDL_KEYUP:
            event->type = PLAY_KEY, event->code = key_code(e.key.keysym.sym), event->down = e.type == SDL_KEYDOWN;
            if (!e.key.repeat && event->code) return true;
            break;
        case SDL_MOUSEBUTTONDOWN:
        case SDL_MOUSEBUTTONUP:
            event->type = PLAY_BUTTON, event->down = e.type == SDL_MOUSEBUTTONDOWN;
            event->code = e.button.button == SDL_BUTTON_LEFT ? 1 : e.button.button == SDL_BUTTON_MIDDLE ? 2 : 3;
            return true;
        case SDL_MOUSEMOTION:
            event->type = PLAY_MOTION;
            picture_motion(w, e.motion.xrel, e.motion.yrel, event);
            return true;
        case SDL_MOUSEWHEEL: event->type = PLAY_WHEEL, event->dy = (float)e.wheel.y; return true;
        case SDL_WINDOWEVENT:
            event->type = PLAY_FOCUS_LOST;
            if (e.window.event == SDL_WINDOWEVENT_FOCUS_LOST) return true;
            break;
        default: break;
        }
    }
    return false;
}

static void show(play_window *w, const uint8_t *rgb) {
    SDL_UpdateTexture(w->texture, NULL, rgb, 3 * w->width);
    SDL_RenderCopy(w->renderer, w->texture, NULL, NULL);
    SDL_RenderPresent(w->renderer);
}

__attribute__((visibility("default"))) extern const play_window_api play_sdl;
const play_window_api play_sdl = {window_open, window_close, next_event, show};
