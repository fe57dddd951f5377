/* Internals of the stage "touch". */
#ifndef TM_TOUCH_INTERNAL_H
#define TM_TOUCH_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/touch.h"

enum { TM_COOKIE_TOUCHING = 0x746f7563 };

/* Features of the surface as cuts leave it, ascending by their persistent numbers. Rebuilt after a cut. */
typedef struct tm_touch_surface {
    int32_t face_count, vertex_count, edge_count;
    int32_t *face;     /* [max_faces] 4*tet + local vertex */
    int32_t *triangle; /* [3*max_faces] vertices, normal outward */
    int32_t *vertex;   /* [mesh vertices] */
    int32_t *edge;     /* [mesh edges] the mesh's edges on the surface */
    int32_t *of_edge;  /* [2*mesh edges] indices of its two faces; -1: not on the surface */
    int32_t *body;     /* [mesh vertices] body of a surface vertex; -1: inside */
    double mean_edge_m;
} tm_touch_surface;

/* A pair of features that may come within reach: vertex and face (index), or two edges of the mesh. */
typedef struct tm_touch_pair {
    int32_t a, b;
    double thickness_m; /* of this pair */
    double wake_m;      /* reading of the odometer until which it cannot be in reach */
} tm_touch_pair;

typedef struct tm_touch_list {
    int32_t count;
    tm_touch_pair *pair; /* [max_candidates] ascending by a, b */
} tm_touch_list;

/* A row with what the sweeps need. */
typedef struct tm_touch_solver {
    double response[4][3]; /* displacement per newton along each axis: weight * mobility, 0 where prescribed */
    double diagonal_m_N;   /* along the normal */
    double weight2_m_N;    /* sum of weight^2 * mobility */
    double compliance_m_N, gap_m, soft_m; /* soft_m: depth beyond which it is stiff */
    double drag_N[3], rub_N[3];
    bool slips;
} tm_touch_solver;

/* What the next substep starts from, and snapshots hold. */
typedef struct tm_touch_memory {
    int32_t edges, a, b, slips;
    double lambda_N, drag_N[3], rub_N[3];
} tm_touch_memory;

typedef struct tm_touch_box {
    double low[3], high[3];
} tm_touch_box;

/* Cells of a hashed grid and what is in them. */
typedef struct tm_touch_grid {
    tm_touch_box *box; /* [mesh edges] of each edge or face of the surface, which has fewer faces than edges */
    double cell_m;
    int32_t buckets, capacity; /* buckets: a power of two */
    int32_t *begin;            /* [buckets+1] */
    int32_t *bucket;           /* [capacity] scratch */
    int64_t *key, *sorted_key; /* [capacity] cell of each entry */
    int32_t *item, *sorted;    /* [capacity] */
} tm_touch_grid;

struct tm_touching {
    tm_pool pool;
    tm_world *world;
    tm_touching_def def;
    uint8_t pair[TM_MAX_BODIES * TM_MAX_BODIES];
    int32_t *tet_body; /* [tet_count] or null */
    tm_touch_surface surface;
    int32_t revision; /* of the tissue's surface that `surface` was made of */
    /* broad phase */
    bool gathered;    /* the lists are valid */
    int32_t since;    /* substeps since the last gathering */
    bool maybe_moved; /* the caller may have moved tissue since the last substep */
    double reach_m, margin_m, odometer_m, moved_m;
    double *gathered_u_m; /* [3*mesh vertices] displacements at the last gathering */
    tm_touch_grid grid;
    tm_touch_list vf, ee;
    /* rows */
    int32_t row_count, memory_count, saved_count;
    tm_touching_row *row;
    tm_touch_solver *solver;
    tm_touch_memory *memory, *saved; /* [max_rows] of the last substep; when the step began */
    uint8_t *fixed;                  /* [3*vertex_count] */
    const void *fixed_by;
    tm_touching_report report;
    bool all_pairs; /* tests: lists of all pairs, without a broad phase */
};

/* touch_surface.c */
bool tm_touch_surface_init(tm_touch_surface *surface, tm_pool *pool, const tm_tissue *tissue);
void tm_touch_surface_build(tm_touching *touching);
static inline int32_t tm_touch_body(const tm_touching *t, int32_t face) {
    return t->tet_body ? t->tet_body[face / 4] : 0;
}
static inline bool tm_touch_enabled(const tm_touching *t, int32_t a, int32_t b) {
    return t->pair[a * t->def.body_count + b] != 0;
}

/* touch_geometry.c: closest points. */
typedef struct tm_touch_closest {
    double weight[3]; /* barycentric, of the nearest point of the triangle */
    double offset[3]; /* from that point to the vertex */
    double distance_m;
    bool inside; /* the projection is inside the triangle */
} tm_touch_closest;
tm_touch_closest tm_touch_point_triangle(const double p[3], const double a[3], const double b[3], const double c[3]);
/* Returns the distance of two segments; s and t are the nearest points' places on them, inside: both within. */
double tm_touch_segments(const double a0[3], const double a1[3], const double b0[3], const double b1[3], double *s,
                         double *t, bool *inside);

/* touch_gather.c: the lists of close pairs. */
bool tm_touch_gather_init(tm_touching *touching, tm_pool *pool);
/* Gathers again if a pair that is not in the lists may be in reach. */
void tm_touch_update(tm_touching *touching);

/* touch_rows.c */
void tm_touch_find(tm_touching *touching);

/* Returns the energy in a row's compliance, J. */
double tm_touching_stored_J(const tm_touching *touching, int32_t row);

/* touch_solve.c */
void tm_touch_prepare(tm_touching *touching);
void tm_touch_sweep(tm_touching *touching, int32_t sweep);
void tm_touch_remember(tm_touching *touching);

/* ties.c: calls `work` with each force of the ties in this substep; returns the energy that they store, J. */
double tm_ties_energy(tm_world *world, void *self, void (*work)(void *self, int32_t vertex, const double force_N[3]));

static inline void tm_touch_at(const tm_world *world, int32_t vertex, double x[3]) {
    for (int c = 0; c < 3; c++) x[c] = world->tissue->mesh->rest_m[3 * vertex + c] + world->state.u_m[3 * vertex + c];
}

#endif
