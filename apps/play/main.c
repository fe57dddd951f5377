/* tm-play: a window in which mouse and keys act as the hands of the virtual devices. `make play` starts the other
 * programs of the session. */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "app.h"
#include "controls.h"
#include "json_file.h"
#include "view/output.h"
#include "view/picture_renderer.h"
#include "view/scene_decoration.h"

static const char help[] =
    "usage: tm-play [options]\n"
    "Opens a window on a running tm-sim --realtime: shows tissue and forces, and moves the instruments "
    "of\n"
    "tm-device --hand lcm by mouse and keys. `make play` starts all of them.\n"
    "\n"
    "  --size WxH          size of the picture [960x600]\n"
    "  --quality N         0: fast, 1: smooth edges [0]\n"
    "  --azimuth DEG --elevation DEG --zoom X   first view [-110, 40, 1]\n"
    "  --renderer NAME     auto, opengl (the display's), osmesa (software) [auto: the display's if "
    "possible]\n"
    "  --scene FILE        show title, supports and colours of regions of this scene, which is "
    "simulated\n"
    "  --through X         transparency of its largest region, 0 to 0.95, to show the regions inside "
    "[0]\n"
    "  --fibres            draw its fibres, as lines on the surface   --no-supports   do not mark "
    "supports\n"
    "  --watch             show only; do not move instruments\n"
    "  --duration S        close after this time [never]\n"
    "  --png FILE          write the last picture when the window closes\n"
    "  --json FILE         write figures: pictures a second, hand messages sent, messages accepted and "
    "refused\n"
    "  --lcm-url URL       [LCM_DEFAULT_URL, else LCM's default]\n"
    "  --key FILE          authenticate sent messages by this key, shared with all programs "
    "(docs/trust.md)\n"
    "  --no-key            send without key, even if messages leave this machine\n"
    "  --quiet             print warnings and errors only\n"
    "  -h, --help, --version\n"
    "\n"
    "Keys and mouse: see the window's own list (H), or docs/viewing.md.\n";

typedef struct play {
    view_studio_def studio_def;
    const char *url, *key, *png, *json;
    double duration_s;
    bool watch, no_key, display_only;
    view_studio studio;
    view_picture picture;
    view_dress dress; /* decoration from the scene */
    view_feed *feed;
    const play_window_api *window_api;
    play_window *window;
    play_controls controls;
    int64_t pictures, hands;
    double began_s;
} play;

static double now_s(void) { return (double)app_monotonic_us() * 1e-6; }

enum {
    SIZE = 256,
    QUALITY,
    AZIMUTH,
    ELEVATION,
    ZOOM,
    RENDERER,
    SCENE,
    THROUGH,
    FIBRES,
    NO_SUPPORTS,
    WATCH,
    DURATION,
    PNG,
    JSON,
    URL,
    KEY,
    NO_KEY,
    QUIET,
    VERSION,
    HELP = 'h'
};
static const struct option table[] = {
    {"size", 1, NULL, SIZE},
    {"quality", 1, NULL, QUALITY},
    {"azimuth", 1, NULL, AZIMUTH},
    {"elevation", 1, NULL, ELEVATION},
    {"zoom", 1, NULL, ZOOM},
    {"renderer", 1, NULL, RENDERER},
    {"scene", 1, NULL, SCENE},
    {"through", 1, NULL, THROUGH},
    {"fibres", 0, NULL, FIBRES},
    {"no-supports", 0, NULL, NO_SUPPORTS},
    {"watch", 0, NULL, WATCH},
    {"duration", 1, NULL, DURATION},
    {"png", 1, NULL, PNG},
    {"json", 1, NULL, JSON},
    {"lcm-url", 1, NULL, URL},
    {"key", 1, NULL, KEY},
    {"no-key", 0, NULL, NO_KEY},
    {"help", 0, NULL, HELP},
    {"quiet", 0, NULL, QUIET},
    {"version", 0, NULL, VERSION},
    {NULL, 0, NULL, 0},
};

static int number(const char *name, const char *text, double low, double high, double *value) {
    char *end;
    double v = strtod(text, &end);
    if (end == text || *end || !(v >= low && v <= high))
        return app_bad_input("tm-play", 0, "--%s %s: not a number from %g to %g; see tm-play --help", name, text, low,
                             high);
    *value = v;
    return 0;
}

static int take(play *p, int code, const char *text) {
    static const double DEG = 3.14159265358979 / 180;
    view_render_def *r = &p->studio_def.render;
    double v = 0;
    int wrong = 0;
    char rest;
    switch (code) {
    case SIZE:
        if (sscanf(text, "%dx%d%c", &r->width, &r->height, &rest) == 2 && r->width >= 160 && r->width <= 4096 &&
            r->height >= 120 && r->height <= 4096)
            return 0;
        return app_bad_input("tm-play", 0,
                             "--size %s: not WIDTHxHEIGHT, 160x120 to 4096x4096; for example --size 960x600", text);
    case QUALITY:
        wrong = number("quality", text, 0, 1, &v);
        r->edges = v > 0.5;
        return wrong;
    case AZIMUTH:
        wrong = number("azimuth", text, -720, 720, &v);
        p->studio_def.camera.azimuth_rad = (float)(v * DEG);
        return wrong;
    case ELEVATION:
        wrong = number("elevation", text, -89, 89, &v);
        p->studio_def.camera.elevation_rad = (float)(v * DEG);
        return wrong;
    case ZOOM:
        wrong = number("zoom", text, 0.05, 50, &v);
        p->studio_def.camera.zoom = (float)v;
        return wrong;
    case DURATION: return number("duration", text, 0.05, 1e6, &p->duration_s);
    case QUIET: app_be_quiet(); return 0;
    case RENDERER:
        p->studio_def.display = strcmp(text, "osmesa") != 0;
        p->display_only = !strcmp(text, "opengl");
        if (!p->studio_def.display || p->display_only || !strcmp(text, "auto")) return 0;
        return app_bad_input("tm-play", 0, "--renderer %s: not one of auto, opengl, osmesa; choose one", text);
    case SCENE: p->dress.scene = text; return 0;
    case THROUGH: return number("through", text, 0, 0.95, &p->dress.through);
    case FIBRES: p->dress.choice.fibres = true; return 0;
    case NO_SUPPORTS: p->dress.choice.supports = false; return 0;
    case WATCH: p->watch = true; return 0;
    case PNG: p->png = text; return 0;
    case JSON: p->json = text; return 0;
    case URL: p->url = text; return 0;
    case KEY: p->key = text; return 0;
    case NO_KEY: p->no_key = true; return 0;
    default: return 0;
    }
}

/* Parses the options. Returns -1 to continue, else the exit code. */
static int parse(play *p, int argc, char **argv) {
    p->studio_def = view_studio_default(960, 600);
    p->studio_def.render.edges = false;
    p->studio_def.display = true;
    p->dress.choice.supports = true;
    opterr = 0;
    for (int code; (code = getopt_long(argc, argv, "h", table, NULL)) != -1;) {
        if (code == HELP) return fputs(help, stdout), APP_DONE;
        if (code == VERSION) return printf("tm-play %s\n", tm_version()), APP_DONE;
        if (code == '?')
            return app_bad_input("tm-play", 0, "%s: unknown option, or its value is missing; see tm-play --help",
                                 argv[optind - 1]);
        int wrong = take(p, code, optarg);
        if (wrong) return wrong;
    }
    if (optind < argc) return app_bad_input("tm-play", 0, "'%s': not an option; see tm-play --help", argv[optind]);
    int wrong = p->png ? app_output_ending("--png", p->png, ".png") : 0;
    if (!wrong) wrong = app_output_check(p->png);
    if (!wrong) wrong = app_output_check(p->json);
    if (!wrong) wrong = view_dress_check(&p->dress, "tm-play");
    return wrong ? wrong : -1;
}

/* Tests the display's driver in a child process: a driver may end its process. It also keeps two OpenGL libraries,
 * whose functions have the same names, out of this process. */
static bool display_draws(const play *p, char *why, size_t size) {
    int ends[2];
    snprintf(why, size, "its OpenGL crashed in a test");
    if (pipe(ends)) return false;
    pid_t child = fork();
    if (!child) {
        view_studio studio;
        tm_error error = {0};
        alarm(10);
        bool good = view_studio_open(&studio, &p->studio_def, &error) == TM_OK;
        if (!good && write(ends[1], error.message, strlen(error.message)) < 0) _exit(2);
        _exit(!good);
    }
    close(ends[1]);
    ssize_t length = child > 0 ? read(ends[0], why, size - 1) : 0;
    if (length > 0) why[length] = 0;
    close(ends[0]);
    int status = 1;
    return child > 0 && waitpid(child, &status, 0) == child && status == 0;
}

static int open_all(play *p) {
    tm_error error = {0};
    char why[TM_ERROR_MESSAGE_MAX] = "";
    bool asked = p->studio_def.display;
    p->studio_def.display = asked && display_draws(p, why, sizeof why);
    void *module = app_module("window", &error);
    if (!module || !(p->window_api = app_module_symbol(module, PLAY_WINDOW_SYMBOL, &error)))
        return app_report("tm-play", 0, &error);
    if (p->window_api->open(p->studio_def.render.width, p->studio_def.render.height, "tensormass", &p->window, &error))
        return app_bad_input("tm-play", 0, "%s", error.message);
    if (p->display_only && !p->studio_def.display)
        return app_bad_input("tm-play", 0, "%s; choose --renderer auto or osmesa", why);
    if (asked && !p->studio_def.display) app_remark("tm-play: drawing in software, which is slower: %s", why);
    if (view_studio_open(&p->studio, &p->studio_def, &error)) return app_report("tm-play", 0, &error);
    const view_live_key key = {.path = p->key, .none = p->no_key || p->watch};
    if (view_feed_open_live(p->url, &key, &p->feed, &error)) return app_report("tm-play", 0, &error);
    return 0;
}

static void draw_help(const play *p) {
    static const char *const line[] = {
        "left drag, arrows   pivot",
        "wheel, W S   insert",
        "Q E   roll",
        "right button, space   grip / cauterise",
        "F   keep the jaws shut",
        "1 2 Tab   instrument",
        "X   next extrapolator",
        "P   passivity",
        "R   reset a fault",
        "middle drag, Z + wheel   eye",
        "Shift   slowly",
        "H   this list      Esc   end",
    };
    enum { LINES = sizeof line / sizeof line[0] };
    const view_canvas *canvas = &p->studio.canvas;
    float cap = fmaxf(8, (float)canvas->height / 62), step = 1.9f * cap, x = 2.4f * cap,
          y = (float)canvas->height / 2 - step * LINES / 2;
    float width = 0;
    for (int i = 0; i < LINES; i++) width = fmaxf(width, view_text_width(line[i], cap));
    view_box(canvas, x - cap, y - 2 * cap, x + width + cap, y + step * (LINES - 1) + cap, 0.6f * cap,
             (view_colour){10, 15, 19, 0.58f});
    for (int i = 0; i < LINES; i++)
        view_text(canvas, x, y + step * (float)i, cap, (view_colour){215, 222, 228, 1}, line[i]);
}

/* Marks the instrument that the mouse moves. */
static void draw_selected(const play *p) {
    const view_canvas *canvas = &p->studio.canvas;
    const view_instrument *t = &p->picture.instrument[p->controls.selected];
    float at[2], cap = fmaxf(8, (float)canvas->height / 62);
    if (p->watch || !t->shown || !view_camera_project(&p->studio.camera, canvas->width, canvas->height, t->tip_m, at))
        return;
    for (int i = 0; i < 4; i++) {
        float sx = i & 1 ? 1.0f : -1.0f, sy = i & 2 ? 1.0f : -1.0f, r = 2.6f * cap;
        view_line(canvas, at[0] + sx * r, at[1] + sy * r, at[0] + sx * (r - cap), at[1] + sy * r, 0.2f * cap,
                  (view_colour){255, 255, 255, 0.8f});
        view_line(canvas, at[0] + sx * r, at[1] + sy * r, at[0] + sx * r, at[1] + sy * (r - cap), 0.2f * cap,
                  (view_colour){255, 255, 255, 0.8f});
    }
}

static void move_eye(play *p) {
    play_controls *c = &p->controls;
    if (c->eye_turn[0] == 0 && c->eye_turn[1] == 0 && c->eye_zoom == 1) return;
    view_camera_def *eye = &p->studio.def.camera;
    eye->azimuth_rad += c->eye_turn[0];
    eye->elevation_rad = fminf(fmaxf(eye->elevation_rad + c->eye_turn[1], -1.4f), 1.4f);
    eye->zoom = fminf(fmaxf(eye->zoom * c->eye_zoom, 0.2f), 20);
    c->eye_turn[0] = c->eye_turn[1] = 0, c->eye_zoom = 1;
    view_studio_turn(&p->studio);
}

static void send(play *p) {
    view_hand hand;
    for (int i = 0; i < VIEW_INSTRUMENTS && !p->watch; i++)
        if (play_controls_hand(&p->controls, &p->picture, i, &hand) && view_feed_send_hand(p->feed, &hand)) p->hands++;
    if (p->controls.has_command && !p->watch) view_feed_send_command(p->feed, &p->controls.command);
    p->controls.has_command = false;
}

static int one_picture(play *p, double dt_s) {
    tm_error error = {0};
    play_event event;
    while (p->window_api->next_event(p->window, &event)) play_controls_event(&p->controls, &p->picture, &event);
    play_controls_step(&p->controls, &p->picture, &p->studio.camera, p->studio.canvas.height, dt_s);
    send(p);
    move_eye(p);
    view_picture shown;
    const int wrong = view_dress_show(&p->dress, &p->picture, &shown);
    if (wrong) return wrong;
    if (view_studio_draw(&p->studio, &shown, &error)) return app_report("tm-play", 0, &error);
    draw_selected(p);
    if (p->controls.help && !p->watch) draw_help(p);
    p->window_api->show(p->window, p->studio.canvas.rgb);
    p->pictures++;
    return 0;
}

static int loop(play *p) {
    double last = p->began_s = now_s(), smooth_s = 1.0 / 30;
    int wrong = 0;
    while (!wrong && !app_interrupted() && !p->controls.quit &&
           (p->duration_s <= 0 || now_s() - p->began_s < p->duration_s)) {
        double next = last + 1.0 / 60;
        view_feed_listen(p->feed, (int)fmax(0, 1e3 * (next - now_s())), &p->picture);
        double now = now_s(), dt_s = now - last;
        last = now;
        smooth_s += 0.1 * (dt_s - smooth_s);
        p->studio.drawn_hz = 1 / fmax(smooth_s, 1e-3);
        wrong = one_picture(p, fmin(dt_s, 0.1));
    }
    return wrong;
}

static int write_png(play *p) {
    tm_error error = {0};
    const view_canvas *c = &p->studio.canvas;
    return view_png_write(p->png, c->width, c->height, c->rgb, &error) ? app_report("tm-play", 0, &error) : 0;
}

static int write_json(const play *p) {
    tm_error error = {0};
    const view_feed_counts counts = view_feed_counted(p->feed);
    const double seconds = now_s() - p->began_s;
    cJSON *root = cJSON_CreateObject();
    cJSON_AddNumberToObject(root, "pictures", (double)p->pictures);
    cJSON_AddNumberToObject(root, "seconds", seconds);
    cJSON_AddNumberToObject(root, "pictures_per_second", (double)p->pictures / fmax(seconds, 1e-3));
    cJSON_AddNumberToObject(root, "hands_sent", (double)p->hands);
    cJSON_AddNumberToObject(root, "messages_taken", (double)counts.accepted);
    cJSON_AddNumberToObject(root, "messages_refused", (double)counts.rejected);
    cJSON_AddStringToObject(root, "renderer", p->studio.module);
    cJSON_AddStringToObject(root, "opengl", p->studio.api->name(p->studio.renderer));
    tm_status status = app_json_write(p->json, root, &error);
    cJSON_Delete(root);
    return status ? app_report(NULL, 0, &error) : 0;
}

int main(int argc, char **argv) {
    static play p;
    app_check_stdout();
    int wrong = parse(&p, argc, argv);
    if (wrong >= 0) return wrong;
    app_catch_signals();
    setpriority(PRIO_PROCESS, 0, 5); /* simulation and controllers have priority over drawing */
    play_controls_begin(&p.controls);
    wrong = view_dress_load(&p.dress, &p.picture);
    if (!wrong) wrong = open_all(&p);
    if (!wrong) wrong = loop(&p);
    if (!wrong && p.png) wrong = write_png(&p);
    if (!wrong && p.json) wrong = write_json(&p);
    if (p.feed) view_feed_close(p.feed);
    if (p.studio.api) view_studio_close(&p.studio);
    if (p.window) p.window_api->close(p.window);
    view_picture_free(&p.picture);
    view_dress_free(&p.dress);
    return wrong;
}
