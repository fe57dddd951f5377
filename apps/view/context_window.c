/* The display's OpenGL, through a hidden window of SDL: pictures are drawn into a separate framebuffer and read
 * back. */
#include <SDL.h>
#include <stdio.h>
#include <stdlib.h>

#include "context.h"

struct view_context {
    SDL_Window *window;
    SDL_GLContext own;
    bool begun;
};

const bool view_context_in_memory = false;

view_context *view_context_open(int width, int height, uint8_t *pixels, tm_error *error) {
    (void)width, (void)height, (void)pixels;
    view_context *c = calloc(1, sizeof *c);
    if (c && !SDL_InitSubSystem(SDL_INIT_VIDEO)) { /* SDL counts: not initialised twice */
        c->begun = true;
        SDL_GL_SetAttribute(SDL_GL_CONTEXT_MAJOR_VERSION, 3);
        SDL_GL_SetAttribute(SDL_GL_CONTEXT_MINOR_VERSION, 3);
        SDL_GL_SetAttribute(SDL_GL_CONTEXT_PROFILE_MASK, SDL_GL_CONTEXT_PROFILE_CORE);
        c->window = SDL_CreateWindow("tensormass drawing", 0, 0, 16, 16, SDL_WINDOW_OPENGL | SDL_WINDOW_HIDDEN);
        if (c->window) c->own = SDL_GL_CreateContext(c->window);
    }
    if (c && c->own && view_context_use(c)) return c;
    error->status = TM_ERR_LIMIT, error->entity = -1;
    snprintf(error->message, sizeof error->message, "the display gives no OpenGL 3.3 (%s)", SDL_GetError());
    view_context_close(c);
    return NULL;
}

void view_context_close(view_context *c) {
    if (!c) return;
    if (c->own) SDL_GL_DeleteContext(c->own); /* frees all OpenGL objects of the context */
    if (c->window) SDL_DestroyWindow(c->window);
    if (c->begun) SDL_QuitSubSystem(SDL_INIT_VIDEO);
    free(c);
}

bool view_context_use(view_context *c) { return SDL_GL_MakeCurrent(c->window, c->own) == 0; }
