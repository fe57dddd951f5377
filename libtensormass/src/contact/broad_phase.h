/* Local surface near one tool: candidate triangles with their topology, and the rows found on them. */
#ifndef TM_CONTACT_SURFACE_H
#define TM_CONTACT_SURFACE_H

#include "tensormass/contact.h"

#define TM_LOCAL_FACES 1024 /* candidates of one tool */
#define TM_LOCAL_HITS 2048  /* (station, feature) pairs within reach */
#define TM_MAX_STATIONS 256

/* Features that the tool may touch (narrow_phase_features.c), ascending; valid until something has moved far. */
typedef struct tm_near {
    bool known; /* valid; cleared by each gathering */
    int32_t face_count, edge_count, vertex_count, wanted_count;
    int32_t face[TM_LOCAL_FACES], edge[3 * TM_LOCAL_FACES], vertex[3 * TM_LOCAL_FACES];
    int32_t wanted[TM_LOCAL_FACES]; /* faces whose geometry they require */
    /* state when they were found */
    double reach_m, sunk_m, end_m[2][3], position_m[3 * TM_LOCAL_FACES][3];
} tm_near;

/* Inward direction of a face at one of its edges. */
typedef struct tm_inward {
    double unit[3], altitude_m;
} tm_inward;

/* Local topology of the candidate triangles. Fixed arrays, so it fits in a stage or on a stack. */
typedef struct tm_local_surface {
    int32_t face_count, vertex_count, edge_count;
    bool overflowed;
    double edge_m; /* longest edge near the tool at the last gathering: estimate for the next, 0 at first */
    int32_t face_id[TM_LOCAL_FACES];         /* persistent id, ascending */
    int32_t face_vertex[TM_LOCAL_FACES][3];  /* local vertices */
    int32_t face_edge[TM_LOCAL_FACES][3];    /* local edge j: vertex j to vertex j+1 mod 3 */
    int32_t vertex_id[3 * TM_LOCAL_FACES];   /* number in the mesh, ascending */
    int32_t vertex_face[3 * TM_LOCAL_FACES]; /* lowest local face at the vertex */
    int32_t edge_vertex[3 * TM_LOCAL_FACES][2];
    int32_t edge_face[3 * TM_LOCAL_FACES][2]; /* lower first, -1: not a candidate */
    int32_t vertex_edge_begin[3 * TM_LOCAL_FACES + 1];
    int32_t vertex_edge[6 * TM_LOCAL_FACES];
    tm_near near;
    /* geometry at the last positions; of faces, only those that the last search required */
    double position_m[3 * TM_LOCAL_FACES][3];
    double normal[TM_LOCAL_FACES][3];      /* unit, outward; zero: a triangle without area, ignored */
    double area_normal[TM_LOCAL_FACES][3]; /* length is twice the area */
    double rest_normal[TM_LOCAL_FACES]
                      [3]; /* of the undeformed surface: tells apart folds made rounded and folds made sharp */
    double center_m[TM_LOCAL_FACES][3];
    double reach_m[TM_LOCAL_FACES];       /* radius of the bounding sphere about the centre */
    tm_inward inward[TM_LOCAL_FACES][3];  /* valid if bit j is set: */
    uint8_t inward_known[TM_LOCAL_FACES]; /* cleared when the face is placed */
    int64_t key[3 * TM_LOCAL_FACES];      /* scratch of the build */
} tm_local_surface;

/* A (station, feature) pair within reach. */
typedef struct tm_hit {
    int32_t station, kind, index; /* kind 0 face, 1 edge, 2 vertex; index local */
    double raw;                   /* weight before normalisation to shares */
    double distance_m;            /* signed, from station to feature */
} tm_hit;

typedef struct tm_hits {
    int32_t count;
    bool overflowed;
    tm_hit hit[TM_LOCAL_HITS];
    int32_t order[TM_LOCAL_HITS];
    int32_t begin[TM_MAX_STATIONS + 1];
} tm_hits;

/* Gathers triangles whose bounding box comes within reach_m of the box of the capsule's axis. */
void tm_local_gather(tm_local_surface *surface, const double *rest_m, const double *u_m, const int32_t *triangle,
                     const int32_t *face, const int32_t *candidate, int32_t candidate_count, const tm_capsule *capsule,
                     double reach_m);
/* Updates the positions of the gathered vertices. */
void tm_local_place(tm_local_surface *surface, const double *rest_m, const double *u_m);
/* Computes normal and bounds of a face from these positions. */
void tm_local_face(tm_local_surface *surface, int32_t f);

/* Finds faces, edges and vertices near the stations of the axis, by station. `history` as for the rows. */
void tm_local_hits(tm_local_surface *surface, tm_hits *hits, const tm_capsule *capsule, double margin_m,
                   const tm_contact_row *history, int32_t history_count);
static inline int tm_local_edge_slot(const tm_local_surface *s, int32_t f, int32_t edge) {
    return s->face_edge[f][0] == edge ? 0 : s->face_edge[f][1] == edge ? 1 : 2;
}

/* Finds rows on the gathered surface. `history` (may be null): rows of the previous step. They keep a station in
 * contact with a surface that it has sunk through. Sorted by (station, face, feature). */
int32_t tm_local_rows(tm_local_surface *surface, tm_hits *hits, const tm_capsule *capsule, double margin_m,
                      const tm_contact_row *history, int32_t history_count, tm_contact_row *row, int32_t max_rows,
                      bool *overflowed);

int32_t tm_capsule_stations(const tm_capsule *capsule);
void tm_capsule_station(const tm_capsule *capsule, int32_t station, double point_m[3]);

#endif
