/* Contents of a picture, independent of its source: the tissue's surface, the instruments, and the programs' status. */
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
    VIEW_TIES_MAX = 100000,
    VIEW_REGIONS = 64 /* as many colours as the tissue's shader has */
};

/* Returns a triangle's kind: bit 0 is set if a cut or a plane exposed it, the other bits are its region. */
static inline uint8_t view_kind_of(int32_t region) { return (uint8_t)(region < VIEW_REGIONS ? 2 * region : 0); }

typedef struct view_surface {
    int32_t vertex_count, triangle_count;
    float *vertex_m;       /* [3*vertex_count] m, world */
    int32_t *vertex_id;    /* [vertex_count] indices in the mesh; cuts do not change them */
    int32_t *triangle;     /* [3*triangle_count] normals outward */
    uint8_t *kind;         /* [triangle_count] view_kind_of, | 1: exposed */
    int32_t inside_count;  /* the first triangles, seen through the others */
    int32_t between_count; /* the first of these: between two regions, not on the tissue's surface */
    bool planed;           /* a plane exposed the faces: they need no fairing */
    int64_t session;
    int32_t revision;
    uint32_t version;  /* increases with every new set of positions */
    uint32_t topology; /* increases when triangles or ids change */
    int32_t vertex_capacity, triangle_capacity;
} view_surface;

/* Ties between bodies. */
typedef struct view_ties {
    int32_t total, count; /* of the scene; those that hold */
    float *end_m;         /* [6*count] both ends of each, m, world */
    int32_t capacity;
} view_ties;

typedef struct view_instrument {
    bool shown;
    hrt_mode mode;
    const hrt_device_type *device; /* device in the hand; null: not reported */
    bool active;                   /* cautery current is on */
    double tip_m[3], trocar_m[3], radius_m, roll_rad, grip;
    bool is_free;          /* no trocar: trocar_m is the device's origin */
    double direction[3];   /* of a free one's shaft, unit, towards the tip */
    double axis[3], up[3]; /* the device's pose at the trocar; zero: not reported */
    double force_N[3];     /* force on the tool, reported by the simulation */
    double patch_age;      /* sim_status_t.patch_age; -1: none */
    /* From the controller, while its messages arrive. */
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

/* A region of a mesh, if known. */
typedef struct view_region {
    char name[64];
    bool tinted;  /* has a colour of its own */
    float rgb[3]; /* linear light */
} view_region;

typedef struct view_picture {
    view_surface surface;
    view_ties ties;
    view_region region[VIEW_REGIONS];
    int regions;
    float through; /* share of light from behind the surface; 0: opaque */
    view_instrument instrument[VIEW_INSTRUMENTS];
    char title[96], model[24]; /* scene and model, or the file's name */
    bool has_status;
    int32_t tets, substeps;
    double frame_hz, sample_hz, sim_rate, compute_s;
    double time_s;           /* since the start of the source */
    view_trace trace;        /* forces of the last seconds */
    double newton_m;         /* length of an arrow of one newton; 0: no arrows */
    const view_marks *marks; /* marks of the scene; null: none */
    char notice[128];        /* what the picture waits for, or empty */
} view_picture;

/* Allocates for these counts; contents are lost if it grows. Returns false if memory is exhausted, with the surface
 * empty. */
bool view_surface_reserve(view_surface *surface, int32_t vertices, int32_t triangles);
void view_surface_free(view_surface *surface);
/* Allocates for this many ties; the ends are lost if it grows. Returns false if memory is exhausted, without ties. */
bool view_ties_reserve(view_ties *ties, int32_t count);
/* Frees surface and ties. */
void view_picture_free(view_picture *picture);
/* Adds each triangle's region to its kind, if the marks have regions. */
void view_marks_tint(const view_marks *marks, view_surface *surface);
void view_trace_add(view_trace *trace, double time_s, const float force_N[VIEW_INSTRUMENTS]);

#endif
