#include "options.h"

#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

static const char help[] =
    "usage: tm-view [SOURCE] --png FILE | --frames FOLDER | --video FILE.mp4 [options]\n"
    "Draws tissue and instruments without a display. SOURCE is an LCM log, a scene (.yaml) or a mesh "
    "(.msh .vtk .mesh);\n"
    "without one, tm-view draws a running simulation. For a window use tm-play.\n"
    "\n"
    "  --png FILE         write one picture (of a log: at its end, or --at)\n"
    "  --frames FOLDER    write numbered pictures, frame_00000.png ...\n"
    "  --video FILE       write H.264 in MP4, by ffmpeg\n"
    "  --size WxH         [1280x720]          --fps N            pictures per second of the source [30]\n"
    "  --at S             time of --png, seconds after the log's first tissue message\n"
    "  --from S --to S    part of a log that --frames and --video show\n"
    "  --duration S       time to record of a live source [10]\n"
    "  --wait S           time to wait for a live source's first tissue message [60]\n"
    "  --azimuth DEG --elevation DEG --zoom X --shift X,Y --up x|y|z|-x|-y|-z\n"
    "                     view, relative to the tissue's centre [-110, 40, 1, 0,0, z]\n"
    "  --orbit DEG        rotate the view, degrees per second [0]\n"
    "  --newton MM        length of the arrow of one newton [chosen to fit]\n"
    "  --quality N        0: fast, 1: smooth edges, 2: also average 2x2 pixels [2 for one picture, 1 for "
    "many]\n"
    "  --smooth N         subdivisions of each triangle, 0 to 2 [1]\n"
    "  --crease DEG       angle above which edges stay sharp [52]  --no-words    draw no text\n"
    "  --scene FILE       scene of a log or running simulation, to show its title and supports\n"
    "  --fibres           draw the scene's fibres, as lines on the surface      --no-supports   do not "
    "mark supports\n"
    "  --clip X,Y,Z[,MM]  of a mesh or scene: hide what is beyond the plane with this normal and "
    "distance from the centre [0]\n"
    "  --through X        of a mesh, scene, or log with --scene: transparency of the largest region, 0 "
    "to 0.95, to show inner ones [0]\n"
    "  --scale X          metres per unit of a mesh file's coordinates [1]\n"
    "  --lcm-url URL      [LCM_DEFAULT_URL, else LCM's default]\n"
    "  --key FILE         accept only status messages authenticated by this key, shared with tm-sim "
    "(docs/trust.md)\n"
    "  --json FILE        write figures: pictures, seconds, pictures per second, messages accepted and refused\n"
    "  --quiet            print warnings and errors only\n"
    "  -h, --help, --version\n";

enum {
    PNG = 256,
    FRAMES,
    VIDEO,
    SIZE,
    FPS,
    AT,
    FROM,
    TO,
    DURATION,
    WAIT,
    AZIMUTH,
    ELEVATION,
    ZOOM,
    SHIFT,
    UP,
    ORBIT,
    NEWTON,
    QUALITY,
    SMOOTH,
    CREASE,
    NO_WORDS,
    KEY,
    SCALE,
    SCENE,
    FIBRES,
    NO_SUPPORTS,
    CLIP,
    THROUGH,
    URL,
    JSON,
    QUIET,
    VERSION,
    HELP = 'h'
};

static const struct option table[] = {
    {"png", 1, NULL, PNG},
    {"frames", 1, NULL, FRAMES},
    {"video", 1, NULL, VIDEO},
    {"size", 1, NULL, SIZE},
    {"fps", 1, NULL, FPS},
    {"at", 1, NULL, AT},
    {"from", 1, NULL, FROM},
    {"to", 1, NULL, TO},
    {"duration", 1, NULL, DURATION},
    {"wait", 1, NULL, WAIT},
    {"azimuth", 1, NULL, AZIMUTH},
    {"elevation", 1, NULL, ELEVATION},
    {"zoom", 1, NULL, ZOOM},
    {"shift", 1, NULL, SHIFT},
    {"up", 1, NULL, UP},
    {"orbit", 1, NULL, ORBIT},
    {"newton", 1, NULL, NEWTON},
    {"quality", 1, NULL, QUALITY},
    {"smooth", 1, NULL, SMOOTH},
    {"crease", 1, NULL, CREASE},
    {"no-words", 0, NULL, NO_WORDS},
    {"scale", 1, NULL, SCALE},
    {"lcm-url", 1, NULL, URL},
    {"key", 1, NULL, KEY},
    {"json", 1, NULL, JSON},
    {"scene", 1, NULL, SCENE},
    {"fibres", 0, NULL, FIBRES},
    {"no-supports", 0, NULL, NO_SUPPORTS},
    {"clip", 1, NULL, CLIP},
    {"through", 1, NULL, THROUGH},
    {"help", 0, NULL, HELP},
    {"quiet", 0, NULL, QUIET},
    {"version", 0, NULL, VERSION},
    {NULL, 0, NULL, 0},
};

static const char *name_of(int code) {
    for (const struct option *o = table; o->name; o++)
        if (o->val == code) return o->name;
    return "?";
}

/* Reads a number. Returns 0 and sets *value, or returns an exit code after an error message. */
static int number(int code, const char *text, double low, double high, double *value) {
    char *end;
    double v = strtod(text, &end);
    if (end == text || *end || !(v >= low && v <= high))
        return app_bad_input("tm-view", 0, "--%s %s: not a number from %g to %g; see tm-view --help", name_of(code),
                             text, low, high);
    *value = v;
    return 0;
}

static int whole(int code, const char *text, int low, int high, int *value) {
    double v = 0;
    int wrong = number(code, text, low, high, &v);
    if (!wrong && floor(v) != v)
        return app_bad_input("tm-view", 0, "--%s %s: not a whole number; see tm-view --help", name_of(code), text);
    *value = (int)v;
    return wrong;
}

static int size(const char *text, int *width, int *height) {
    char rest;
    if (sscanf(text, "%dx%d%c", width, height, &rest) == 2 && *width >= 64 && *width <= 8192 && *height >= 64 &&
        *height <= 8192)
        return 0;
    return app_bad_input("tm-view", 0,
                         "--size %s: not WIDTHxHEIGHT, 64 to 8192 pixels each; for example --size 1280x720", text);
}

static int shift(const char *text, float out[2]) {
    char rest;
    if (sscanf(text, "%f,%f%c", &out[0], &out[1], &rest) == 2 && fabsf(out[0]) <= 10 && fabsf(out[1]) <= 10) return 0;
    return app_bad_input("tm-view", 0,
                         "--shift %s: not RIGHT,UP in parts of the picture's height; for example --shift 0.1,0", text);
}

static int clip(const char *text, view_cutaway *out) {
    char rest;
    double *n = out->normal, offset_mm = 0;
    const int read = sscanf(text, "%lf,%lf,%lf,%lf%c", &n[0], &n[1], &n[2], &offset_mm, &rest);
    const double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if ((read != 3 && read != 4) || !(length > 0) || !isfinite(length) || !(fabs(offset_mm) < 1e6))
        return app_bad_input("tm-view", 0,
                             "--clip %s: not a direction X,Y,Z and millimetres; for example --clip 0,-1,0,10", text);
    out->offset_m = offset_mm * 1e-3, out->clipped = true;
    return 0;
}

static int up(const char *text, char *out) {
    const bool down = *text == '-';
    if (strlen(text + down) != 1 || !strchr("xyz", text[down]))
        return app_bad_input("tm-view", 0, "--up %s: not an axis; use x, y or z, or -x, -y or -z", text);
    *out = (char)(text[down] - (down ? 'a' - 'A' : 0));
    return 0;
}

/* Reads one numeric option of the camera or the renderer. */
static int read_figure(int code, const char *text, view_studio_def *s) {
    static const double DEG = 3.14159265358979 / 180;
    double v = 0;
    int wrong = 0;
    switch (code) {
    case AZIMUTH:
        wrong = number(code, text, -720, 720, &v);
        s->camera.azimuth_rad = (float)(v * DEG);
        break;
    case ELEVATION:
        wrong = number(code, text, -89, 89, &v);
        s->camera.elevation_rad = (float)(v * DEG);
        break;
    case ZOOM:
        wrong = number(code, text, 0.05, 50, &v);
        s->camera.zoom = (float)v;
        break;
    case ORBIT:
        wrong = number(code, text, -720, 720, &v);
        s->orbit_rad_s = (float)(v * DEG);
        break;
    case NEWTON:
        wrong = number(code, text, 0.001, 1e5, &v);
        s->newton_m = v * 1e-3;
        break;
    case CREASE:
        wrong = number(code, text, 0, 180, &v);
        s->render.crease_rad = (float)(v * DEG);
        break;
    }
    return wrong;
}

static int take(int code, const char *text, view_options *o) {
    switch (code) {
    case PNG: o->png = text; return 0;
    case FRAMES: o->frames = text; return 0;
    case VIDEO: o->video = text; return 0;
    case JSON: o->json = text; return 0;
    case URL: o->url = text; return 0;
    case KEY: o->key = text; return 0;
    case QUIET: app_be_quiet(); return 0;
    case NO_WORDS: o->studio.words = false; return 0;
    case SCENE: o->scene = text; return 0;
    case FIBRES: o->marks.fibres = true; return 0;
    case NO_SUPPORTS: o->marks.supports = false; return 0;
    case CLIP: return clip(text, &o->cut);
    case THROUGH: return number(code, text, 0, 0.95, &o->cut.through);
    case SIZE: return size(text, &o->studio.render.width, &o->studio.render.height);
    case FPS: return whole(code, text, 1, 240, &o->fps);
    case AT: o->has_at = true; return number(code, text, 0, 1e6, &o->at_s);
    case FROM: return number(code, text, 0, 1e6, &o->from_s);
    case TO: o->has_to = true; return number(code, text, 0, 1e6, &o->to_s);
    case DURATION: return number(code, text, 0.01, 1e5, &o->duration_s);
    case WAIT: return number(code, text, 0, 1e5, &o->wait_s);
    case SCALE: return number(code, text, 1e-9, 1e9, &o->scale);
    case QUALITY: return whole(code, text, 0, 2, &o->quality);
    case SMOOTH: return whole(code, text, 0, 2, &o->studio.render.levels);
    case SHIFT: return shift(text, o->studio.camera.shift);
    case UP: return up(text, &o->studio.camera.up);
    default: return read_figure(code, text, &o->studio);
    }
}

view_dress view_options_dress(const view_options *o) {
    return (view_dress){.scene = o->scene, .choice = o->marks, .through = o->cut.through};
}

static int check(const view_options *o) {
    if (!o->png && !o->frames && !o->video)
        return app_bad_input("tm-view", 0,
                             "the output is missing; add --png, --frames or --video, or run tm-play for a window");
    int wrong = o->png ? app_output_ending("--png", o->png, ".png") : 0;
    if (!wrong && o->video) wrong = app_output_ending("--video", o->video, ".mp4");
    if (!wrong) wrong = app_output_check(o->png);
    if (!wrong) wrong = app_output_check(o->json);
    if (wrong) return wrong;
    if (o->has_to && o->to_s < o->from_s) return app_bad_input("tm-view", 0, "--to is before --from; swap them");
    if (o->video && (o->studio.render.width % 2 || o->studio.render.height % 2))
        return app_bad_input("tm-view", 0, "the width and height of a video must be even; choose another --size");
    if (o->scene && o->source && view_is_still(o->source))
        return app_bad_input("tm-view", 0, "--scene applies to a log or a running simulation; give only the scene");
    const bool still = o->source && view_is_still(o->source);
    view_dress dress = view_options_dress(o);
    if (still) dress.through = 0; /* the mesh itself gives the inner regions */
    if (still && view_is_scene(o->source)) dress.scene = o->source;
    if ((wrong = view_dress_check(&dress, "tm-view"))) return wrong;
    if (o->cut.clipped && !still)
        return app_bad_input("tm-view", 0,
                             "--clip applies to a mesh or a scene, as a log has only the surface; leave it out");
    if (o->has_at && !o->png) return app_bad_input("tm-view", 0, "--at applies only to --png; use --from and --to");
    return 0;
}

int view_options_parse(int argc, char **argv, view_options *o) {
    memset(o, 0, sizeof *o);
    o->studio = view_studio_default(1280, 720);
    o->marks.supports = true;
    o->fps = 30, o->duration_s = 10, o->wait_s = 60, o->scale = 1, o->quality = -1;
    opterr = 0;
    for (int code; (code = getopt_long(argc, argv, "h", table, NULL)) != -1;) {
        if (code == HELP || code == VERSION) {
            if (code == HELP)
                fputs(help, stdout);
            else
                printf("tm-view %s\n", tm_version());
            o->finished = true;
            return 0;
        }
        if (code == '?' && !strncmp(argv[optind - 1], "--film", 6))
            return app_bad_input("tm-view", 0, "--film is called --video since 0.2; write --video");
        if (code == '?')
            return app_bad_input("tm-view", 0, "%s: unknown option, or its value is missing; see tm-view --help",
                                 argv[optind - 1]);
        int wrong = take(code, optarg, o);
        if (wrong) return wrong;
    }
    if (optind < argc) o->source = argv[optind++];
    if (optind < argc)
        return app_bad_input("tm-view", 0, "'%s': one source at a time; see tm-view --help", argv[optind]);
    if (o->quality < 0) o->quality = o->frames || o->video ? 1 : 2;
    o->studio.render.edges = o->quality > 0;
    o->studio.render.samples = o->quality > 1 ? 2 : 1;
    return check(o);
}
