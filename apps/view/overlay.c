/* Draws text and figures on the picture: status, legend, forces of the last seconds. */
#include "picture_renderer.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "layout.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"
static const view_colour WHITE = {240, 243, 246, 1}, GREY = {168, 180, 190, 1}, BAD = {255, 120, 96, 1},
                         GOOD = {132, 224, 150, 1}, PANEL = {10, 15, 19, 0.58f};
static const view_colour TOOL[VIEW_INSTRUMENTS] = {{255, 205, 74, 1}, {92, 204, 255, 1}};

static const view_colour HELD = {72, 205, 165, 1}, FIBRE = {226, 214, 178, 1}, TIE = {236, 200, 150, 1};

/* Position of the next line. */
typedef struct pen {
    const view_canvas *canvas;
    float x, y, cap, line;
} pen;

static float write_at(const pen *p, float x, view_colour colour, const char *format, ...)
    __attribute__((format(printf, 4, 5)));
static float write_at(const pen *p, float x, view_colour colour, const char *format, ...) {
    char text[192];
    va_list list;
    va_start(list, format);
    vsnprintf(text, sizeof text, format, list);
    va_end(list);
    view_text(p->canvas, x, p->y, p->cap, colour, text);
    return x + view_text_width(text, p->cap);
}

static void thousands(char *out, size_t room, int32_t n) {
    if (n >= 1000000)
        snprintf(out, room, "%d,%03d,%03d", n / 1000000, n / 1000 % 1000, n % 1000);
    else if (n >= 1000)
        snprintf(out, room, "%d,%03d", n / 1000, n % 1000);
    else
        snprintf(out, room, "%d", n);
}

/* Writes a line of the marks' legend and advances y. */
static void legend(pen *p, view_colour colour, const char *text) {
    p->y += p->line;
    view_box(p->canvas, p->x, p->y - 0.85f * p->cap, p->x + 0.85f * p->cap, p->y, 0.25f * p->cap, colour);
    write_at(p, p->x + 1.6f * p->cap, GREY, "%s", text);
}

/* Returns approximately the colour of the lit region; an uncoloured one has the tissue's. */
static view_colour colour_of(const view_region *region) {
    static const float tissue[3] = {0.20f, 0.035f, 0.025f};
    uint8_t shown[3];
    for (int k = 0; k < 3; k++)
        shown[k] = (uint8_t)(255 * fminf(powf(1.6f * (region->tinted ? region->rgb : tissue)[k], 1 / 2.2f), 1));
    return (view_colour){shown[0], shown[1], shown[2], 1};
}

/* Returns how many region names are shown: none of a single region, none where text would cover the tissue. */
static int named_regions(const pen *p, const view_picture *s, int lines) {
    bool fits = p->line * (float)(lines + s->regions) < 0.4f * (float)p->canvas->height;
    return s->regions > 1 && fits ? s->regions : 0;
}

static void simulation_panel(pen p, view_layout *l, const view_picture *s, double drawn_hz) {
    const view_marks *m = s->marks;
    const char *title = m && m->title[0] ? m->title : s->title;
    char held[160] = "";
    if (m && m->support_of) snprintf(held, sizeof held, "held%s%s", m->held_by[0] ? ": " : "", m->held_by);
    const int streams = s->sample_hz > 1.5 * s->frame_hz ? 9 : 0; /* width of the sample rate, in capitals */
    float right = p.x + (float)(streams + (drawn_hz > 0 ? 31 : 25)) * p.cap, top = p.y - 1.9f * p.cap;
    right = fmaxf(right, p.x + view_text_width(title, p.cap) + view_text_width(s->model, p.cap) + 2 * p.cap);
    right = fmaxf(right, p.x + view_text_width(held, p.cap) + 2.6f * p.cap);
    char ties[48] = "";
    if (s->ties.total) snprintf(ties, sizeof ties, "%d of %d ties hold", s->ties.count, s->ties.total);
    int lines = (s->has_status ? 3 : 1) + (held[0] != 0) + (ties[0] != 0) + (m && m->fibre);
    const int named = named_regions(&p, s, lines);
    for (int i = 0; i < named; i++)
        right = fmaxf(right, p.x + view_text_width(s->region[i].name, p.cap) + 2.6f * p.cap);
    lines += named;
    float bottom = top + p.line * (float)lines + 1.5f * p.cap;
    view_box(p.canvas, p.x - p.cap, top, right, bottom, 0.6f * p.cap, PANEL);
    view_layout_take(l, p.x - p.cap, top, right, bottom);
    float x = write_at(&p, p.x, WHITE, "%s", title);
    if (s->has_status) {
        write_at(&p, x + p.cap, GREY, "%s", s->model);
        char tets[24];
        thousands(tets, sizeof tets, s->tets);
        p.y += p.line;
        write_at(&p, p.x, GREY, "%s tetrahedra   %d substeps", tets, s->substeps);
        p.y += p.line;
        x = write_at(&p, p.x, GREY, "%.1f Hz   ", s->frame_hz);
        if (streams) x = write_at(&p, x, GREY, "force %.0f Hz   ", s->sample_hz);
        if (s->sim_rate > 0) {
            x = write_at(&p, x, GREY, "%.1f ms   ", 1e3 * s->compute_s);
            x = write_at(&p, x, s->sim_rate > 0.98 ? GOOD : BAD, "%.2f s/s", s->sim_rate);
        } else
            x = write_at(&p, x, GREY, "lockstep"); /* a virtual clock has no speed to report */
        if (drawn_hz > 0) write_at(&p, x + p.cap, GREY, "  view %.0f Hz", drawn_hz);
    }
    if (held[0]) legend(&p, HELD, held);
    if (ties[0]) legend(&p, TIE, ties);
    if (m && m->fibre) legend(&p, FIBRE, "fibres");
    for (int i = 0; i < named; i++) legend(&p, colour_of(&s->region[i]), s->region[i].name);
}

static void instrument_panel(pen p, view_layout *l, const view_instrument *t, int i, bool live) {
    float right = p.x + 24 * p.cap, top = p.y - 1.9f * p.cap;
    bool fault = t->has_controller && t->state == HRT_FAULT;
    float bottom = top + p.line * (t->has_controller ? 3.0f : 2.0f) + 1.5f * p.cap;
    view_box(p.canvas, p.x - p.cap, top, right, bottom, 0.6f * p.cap, PANEL);
    view_box(p.canvas, p.x - p.cap, top, p.x - 0.65f * p.cap, bottom, 0.15f * p.cap, TOOL[i]);
    view_layout_take(l, p.x - p.cap, top, right, bottom);
    float after = write_at(&p, p.x, TOOL[i], "%s%s", hrt_mode_name(t->mode),
                           t->mode == HRT_MODE_CAUTERY && t->active ? " ON" : "");
    if (t->patch_age >= 0.005) write_at(&p, after + p.cap, GREY, "patch %.0f %% aged", 100 * t->patch_age);
    char force[32];
    snprintf(force, sizeof force, "%.2f N", vnorm(t->force_N));
    pen big = p;
    big.cap *= 1.35f;
    write_at(&big, right - p.cap - view_text_width(force, big.cap), WHITE, "%s", force);
    p.y += p.line;
    if (!t->has_controller) {
        write_at(&p, p.x, live ? BAD : GREY, live ? "no controller heard" : "no controller");
        return;
    }
    char state[16];
    snprintf(state, sizeof state, "%s", hrt_state_name(t->state));
    for (char *c = state; *c; c++)
        if (*c == '_') *c = ' ';
    float x = write_at(&p, p.x, fault ? BAD : t->state == HRT_ENGAGED ? GOOD : GREY, "%s", state);
    write_at(&p, x + p.cap, GREY, "%s%s", fault ? t->fault_text : t->extrapolator,
             !fault && t->passivity ? " + passivity" : "");
    p.y += p.line;
    x = write_at(&p, p.x, GREY, "%.0f Hz   %lld missed", t->tick_hz, (long long)t->missed_ticks);
    if (t->lateness_p99_us > 0) write_at(&p, x, GREY, "   p99 %.0f us", t->lateness_p99_us);
}

/* Returns a round number of newtons at or below `peak`, for an axis. */
static double round_down(double peak) {
    double unit = pow(10, floor(log10(fmax(peak, 1e-6))));
    return peak >= 5 * unit ? 5 * unit : peak >= 2 * unit ? 2 * unit : unit;
}

enum { STRIP_SECONDS = 6 };

/* A plot's frame in pixels: x0 left edge, y0 zero line. */
typedef struct frame {
    float x0, y0, x1, y1;
} frame;

/* Draws whole seconds since the start of the source, as many as fit. */
static void time_axis(pen p, const frame *f, double now_s) {
    float second = (f->x1 - f->x0) / STRIP_SECONDS;
    int every = second > 6 * p.cap ? 1 : second > 3 * p.cap ? 2 : 3;
    for (int at_s = (int)fmax(0, ceil(now_s - STRIP_SECONDS)); at_s <= now_s; at_s++) {
        float x = f->x1 - second * (float)(now_s - at_s);
        view_line(p.canvas, x, f->y0, x, f->y0 + 0.5f * p.cap, 1, GREY);
        if (at_s % every) continue;
        char text[24];
        snprintf(text, sizeof text, "%d s", at_s);
        float width = view_text_width(text, p.cap);
        if (x + width / 2 > f->x1 + p.cap) continue;
        p.y = f->y0 + 2 * p.cap;
        write_at(&p, x - width / 2, GREY, "%s", text);
    }
}

static void force_line(pen p, const frame *f, const view_picture *s, int instrument, double peak) {
    float px = 0, py = 0;
    bool have = false;
    for (int i = 0; i < s->trace.count; i++) {
        int at = (s->trace.next - s->trace.count + i + VIEW_TRACE) % VIEW_TRACE;
        double age = s->time_s - s->trace.time_s[at];
        if (age > STRIP_SECONDS || age < 0) continue;
        float x = f->x1 - (float)(age / STRIP_SECONDS) * (f->x1 - f->x0),
              y = f->y0 - (float)((double)s->trace.force_N[instrument][at] / peak) * (f->y0 - f->y1);
        if (have) view_line(p.canvas, px, py, x, y, 0.17f * p.cap, TOOL[instrument]);
        px = x, py = y, have = true;
    }
}

/* Draws the forces of the last seconds along the lower edge. */
static void force_strip(pen p, view_layout *l, const view_picture *s) {
    float w = (float)p.canvas->width, h = (float)p.canvas->height, left = p.x - p.cap, right = w - left,
          bottom = h - left, top = bottom - 8.6f * p.cap;
    double peak = 0.1;
    for (int i = 0; i < s->trace.count; i++)
        for (int k = 0; k < VIEW_INSTRUMENTS; k++) peak = fmax(peak, (double)s->trace.force_N[k][i]);
    double tick = round_down(peak);
    view_box(p.canvas, left, top, right, bottom, 0.6f * p.cap, PANEL);
    view_layout_take(l, left, top, right, bottom);
    const frame f = {left + 5 * p.cap, bottom - 2.6f * p.cap, right - p.cap, top + p.cap};
    float tick_y = f.y0 - (float)(tick / peak) * (f.y0 - f.y1);
    view_line(p.canvas, f.x0, f.y0, f.x1, f.y0, 1, GREY);
    view_line(p.canvas, f.x0, tick_y, f.x1, tick_y, 1, (view_colour){168, 180, 190, 0.4f});
    time_axis(p, &f, s->time_s);
    p.y = tick_y + p.cap / 2;
    write_at(&p, left + 0.7f * p.cap, GREY, "%g N", tick);
    for (int k = 0; k < VIEW_INSTRUMENTS; k++)
        if (s->instrument[k].shown) force_line(p, &f, s, k, peak);
}

static void arrow_label(pen p, view_layout *l, const view_picture *s, const view_camera *camera, int i) {
    const view_instrument *t = &s->instrument[i];
    double force = vnorm(t->force_N), end[3];
    for (int k = 0; k < 3; k++) end[k] = t->tip_m[k] + s->newton_m * t->force_N[k];
    float at[2], from[2];
    int w = p.canvas->width, h = p.canvas->height;
    if (force < 0.05 || !view_camera_project(camera, w, h, end, at) ||
        !view_camera_project(camera, w, h, t->tip_m, from))
        return;
    char text[32];
    snprintf(text, sizeof text, "%.2f N", force);
    /* Beyond the arrow's point, centred on its direction. */
    float width = view_text_width(text, p.cap), dx = at[0] - from[0], dy = at[1] - from[1],
          length = fmaxf(hypotf(dx, dy), 1);
    float x = at[0] + dx / length * (width / 2 + 2.5f * p.cap) - width / 2,
          y = at[1] + dy / length * 2.5f * p.cap + p.cap / 2;
    x = fminf(fmaxf(x, p.cap), (float)w - width - 2 * p.cap);
    y = fminf(fmaxf(y, 3 * p.cap), (float)h - 2 * p.cap);
    float box[4] = {x - 0.5f * p.cap, y - 1.6f * p.cap, x + width + 0.5f * p.cap, y + 0.6f * p.cap};
    view_layout_find_space(l, (float)w, (float)h, 0.4f * p.cap, box);
    view_box(p.canvas, box[0], box[1], box[2], box[3], 0.4f * p.cap, PANEL);
    view_layout_take(l, box[0], box[1], box[2], box[3]);
    view_text(p.canvas, box[0] + 0.5f * p.cap, box[1] + 1.6f * p.cap, p.cap, TOOL[i], text);
}

static void notice(pen p, const char *text) {
    float width = view_text_width(text, p.cap), w = (float)p.canvas->width, h = (float)p.canvas->height;
    view_box(p.canvas, (w - width) / 2 - 1.5f * p.cap, h / 2 - 2 * p.cap, (w + width) / 2 + 1.5f * p.cap,
             h / 2 + 1.6f * p.cap, 0.6f * p.cap, (view_colour){10, 15, 19, 0.8f});
    view_text(p.canvas, (w - width) / 2, h / 2 + p.cap / 2, p.cap, WHITE, text);
}

static pen pen_for(const view_canvas *canvas) {
    float cap = fmaxf(8, fminf((float)canvas->height / 58, (float)canvas->width / 80));
    return (pen){canvas, 2.4f * cap, 3.4f * cap, cap, 1.95f * cap};
}

void view_overlay(const view_canvas *canvas, const view_picture *s, const view_camera *camera, double drawn_hz) {
    pen p = pen_for(canvas);
    view_layout l = {0};
    if (s->title[0]) simulation_panel(p, &l, s, drawn_hz);
    pen q = p;
    q.x = (float)canvas->width - 25.4f * p.cap;
    bool shown[VIEW_INSTRUMENTS], any = false;
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) {
        shown[i] = s->has_status && s->instrument[i].shown;
        if (!shown[i]) continue;
        instrument_panel(q, &l, &s->instrument[i], i, s->sim_rate > 0); /* 0: lockstep */
        q.y += 8.2f * p.cap;
        any = true;
    }
    if (any && s->trace.count > 1) force_strip(p, &l, s);
    for (int i = 0; i < VIEW_INSTRUMENTS && s->newton_m > 0; i++)
        if (shown[i]) arrow_label(p, &l, s, camera, i);
    if (s->notice[0]) notice(p, s->notice);
}

void view_overlay_waiting(const view_canvas *canvas, const view_picture *s) {
    for (size_t i = 0; i < (size_t)canvas->width * (size_t)canvas->height; i++)
        memcpy(canvas->rgb + 3 * i, (uint8_t[3]){34, 44, 50}, 3);
    notice(pen_for(canvas), s->notice);
}
