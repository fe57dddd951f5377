/* What a picture shows, whatever it came from: the tissue's surface, the instruments, and what is known about the
 * programs. */
#ifndef VIEW_PICTURE_H
#define VIEW_PICTURE_H

#include <stdbool.h>
#include <stdint.h>

#include "hrt.h"
#include "marks.h"
#include "mode.h"

enum {
    VIEW_INSTRUMENTS = 2,
    VIEW_TRACE = 512,
    VIEW_VERTICES_MAX = 2000000,
    VIEW_TRIANGLES_MAX = 4000000,
    VIEW_REGIONS = 16
};

/* What a triangle's kind says: laid open by a cut or a plane (bit 0), and of which region it is (the rest). */
static inline uint8_t view_kind_of(int32_t region) { return (uint8_t)(region < VIEW_REGIONS ? 2 * region : 0); }

typedef struct view_surface {
    int32_t vertex_count, triangle_count;
    float *vertex_m;       /* [3*vertex_count] m, world */
    int32_t *vertex_id;    /* [vertex_count] numbers in the mesh: they outlive a cut */
    int32_t *triangle;     /* [3*triangle_count] normals outward */
    uint8_t *kind;         /* [triangle_count] view_kind_of, | 1: laid open */
    int32_t inside_count;  /* so many triangles, the first ones, are seen through the others */
    int32_t between_count; /* and so many of these lie between two regions, not on the tissue's surface */
    bool planed;           /* what is laid open was so by a plane: it is smooth as it is */
    int64_t session;
    int32_t revision;
    uint32_t version;  /* grows with every new set of positions */
    uint32_t topology; /* grows whenever triangles or ids changed */
    int32_t vertex_capacity, triangle_capacity;
} view_surface;

typedef struct view_instrument {
    bool shown;
    hrt_mode mode;
    const hrt_device_type *device; /* what the hand holds; null: not told */
    bool active;                   /* cautery current */
    double tip_m[3], trocar_m[3], radius_m, roll_rad, grip;
    double axis[3], up[3]; /* the device's pose at the trocar; zero: not told */
    double force_N[3];     /* on the tool, as the simulation says */
    /* From the controller, while it is heard. */
    bool has_controller;
    hrt_state state;
    int32_t fault;
    char fault_text[96], extrapolator[24];
    bool passivity;
    double tick_hz, lateness_p99_us, sample_age_s;
    int64_t missed_ticks;
} view_instrument;

typedef struct view_trace {
    int count, next;
    double time_s[VIEW_TRACE];
    float force_N[VIEW_INSTRUMENTS][VIEW_TRACE];
} view_trace;

/* A region of a mesh, where it is known. */
typedef struct view_region {
    char name[64];
    bool tinted;  /* has a colour of its own */
    float rgb[3]; /* linear light */
} view_region;

typedef struct view_picture {
    view_surface surface;
    view_region region[VIEW_REGIONS];
    int regions;
    float through; /* of what is behind the surface, 0: nothing */
    view_instrument instrument[VIEW_INSTRUMENTS];
    char title[96], model[24]; /* scene and model, or the file's name */
    bool has_status;
    int32_t tets, substeps;
    double frame_hz, sample_hz, sim_rate, compute_s;
    double time_s;           /* since the source began */
    view_trace trace;        /* forces of the last seconds */
    double newton_m;         /* length of an arrow of one newton; 0: no arrows */
    const view_marks *marks; /* of the scene; null: none */
    char notice[128];        /* what it waits for, or empty */
} view_picture;

/* Room for these counts; contents are lost when it grows. False: no memory (the surface is left empty). */
bool view_surface_reserve(view_surface *surface, int32_t vertices, int32_t triangles);
void view_surface_free(view_surface *surface);
/* Each triangle's region into its kind, where the marks know regions. */
void view_marks_tint(const view_marks *marks, view_surface *surface);
void view_trace_add(view_trace *trace, double time_s, const float force_N[VIEW_INSTRUMENTS]);

#endif
