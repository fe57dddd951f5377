/* Internals of the stage "touch". */
#ifndef TM_TOUCH_INTERNAL_H
#define TM_TOUCH_INTERNAL_H

#include <math.h>

#include "contact/contact_internal.h"
#include "tensormass/touch.h"

enum {
    TM_COOKIE_TOUCHING = 0x746f7563,
    TM_TOUCH_MAX_INSIDE = 64,
    TM_TOUCH_MEMORY_INSIDE = 2,
    TM_TOUCH_MEMORY_ACCOUNT = 3
};

/* Features of the surface as cuts leave it, ascending by their persistent numbers. Rebuilt after a cut. */
typedef struct tm_touch_surface {
    int32_t max_faces, face_count, vertex_count, edge_count;
    int32_t *face;    /* [max_faces] 4*tet + local vertex */
    int32_t *before;  /* [max_faces] faces before a cut */
    int32_t *vertex;  /* [mesh vertices] */
    int32_t *edge;    /* [mesh edges] the mesh's edges on the surface */
    int32_t *of_edge; /* [2*mesh edges] its two faces; -1: not on the surface */
    int32_t *body;    /* [mesh vertices] body of a surface vertex; -1: inside */
    double mean_edge_m;
} tm_touch_surface;

/* A pair of features that may come within reach: vertex and face (4*tet + local vertex), or two edges of the mesh. */
typedef struct tm_touch_pair {
    int32_t a, b;
    double thickness_m; /* of this pair */
    double wake_m;      /* reading of the odometer until which it cannot be in reach */
    bool through;       /* of one body, with tissue between them at rest */
} tm_touch_pair;

typedef struct tm_touch_list {
    int32_t count, room;
    bool overflowed;     /* there was no room for a pair */
    tm_touch_pair *pair; /* [room] ascending by a, b */
} tm_touch_list;

/* Lists of pairs: vertices with faces, and edges. */
typedef struct tm_touch_lists {
    tm_touch_list vf, ee;
} tm_touch_lists;

/* A row with what the sweeps need. */
typedef struct tm_touch_solver {
    double response[4][3]; /* displacement per newton along each axis: weight * mobility, 0 where prescribed */
    double diagonal_m_N;   /* along the normal */
    double weight2_m_N;    /* sum of weight^2 * mobility */
    double compliance_m_N, gap_m, soft_m; /* soft_m: depth beyond which it is stiff */
    double drag_N[3], friction_N[3];
    bool slips;
} tm_touch_solver;

/* What the next substep starts from, and snapshots hold. */
typedef struct tm_touch_memory {
    int32_t edges, a, b, slips; /* edges TM_TOUCH_MEMORY_...: not a row, but what else lasts */
    double lambda_N, drag_N[3], friction_N[3];
} tm_touch_memory;

typedef struct tm_touch_box {
    double low[3], high[3];
} tm_touch_box;

static inline tm_touch_box tm_touch_no_box(void) {
    return (tm_touch_box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}
static inline void tm_touch_box_add(tm_touch_box *box, const double x[3]) {
    for (int c = 0; c < 3; c++) box->low[c] = law_min(box->low[c], x[c]), box->high[c] = law_max(box->high[c], x[c]);
}
static inline bool tm_touch_boxes_overlap(const tm_touch_box *a, const tm_touch_box *b) {
    bool meet = true;
    for (int c = 0; c < 3; c++) meet &= a->low[c] <= b->high[c] && b->low[c] <= a->high[c];
    return meet;
}

/* A body as a whole in a substep. */
typedef struct tm_touch_frame {
    double motion_m[3]; /* mean motion of its surface */
    tm_touch_box way;   /* of its vertices, from start to end */
    int32_t count;
} tm_touch_frame;

typedef struct tm_touch_closest {
    double weight[3]; /* barycentric, of the nearest point of the triangle */
    double offset[3]; /* from that point to the vertex */
    double distance_m;
    bool inside; /* the projection is inside the triangle */
} tm_touch_closest;

/* A vertex inside another body. */
typedef struct tm_touch_inside {
    int32_t vertex, face;     /* the nearest face of the body */
    tm_touch_closest closest; /* on that face */
    double thickness_m;
} tm_touch_inside;

/* A ball around a feature. */
typedef struct tm_touch_ball {
    double middle[3], radius_m;
} tm_touch_ball;

enum { TM_TOUCH_CLUSTER = 16, TM_TOUCH_MAX_FOLLOWED = 256 };
typedef struct tm_touch_bounds {
    float low[3], high[3];
} tm_touch_bounds;

typedef struct tm_touch_boxes {
    float low[3][TM_TOUCH_CLUSTER], high[3][TM_TOUCH_CLUSTER]; /* an empty one overlaps nothing */
} tm_touch_boxes;

/* Features that are neighbours at rest. */
typedef struct tm_touch_cluster {
    tm_touch_boxes box;
    int32_t item[TM_TOUCH_CLUSTER];
} tm_touch_cluster;

/* Features of the surface of one kind, by their persistent numbers. */
typedef struct tm_touch_clusters {
    int32_t count; /* of clusters */
    bool wide;     /* the machine has AVX2 */
    tm_touch_cluster *of;
    tm_touch_boxes *around; /* of each cluster, many together */
    int64_t items;
    int32_t *slot;               /* [items] its place in the clusters; -1: not on the surface */
    int32_t order_count, *order; /* neighbours next to each other; `together` features each */
    int together;
    int32_t listed_count, *listed; /* clusters with moving features */
    uint16_t *fresh;               /* of each cluster, a bit for each of these */
} tm_touch_clusters;

enum { TM_TOUCH_VERTICES, TM_TOUCH_FACES, TM_TOUCH_EDGES, TM_TOUCH_KINDS };

/* Some of the features of one kind. */
typedef struct tm_touch_set {
    uint8_t *is;   /* [items]; of `fresh`, faces that a cut removed too */
    int32_t count; /* of those on the surface */
    int32_t *list;
} tm_touch_set;

/* Searches one of several parts. */
typedef void tm_touch_work(tm_touching *touching, int32_t part, int32_t parts, tm_touch_lists *to);

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
    int32_t since;    /* substeps since the last search of the complete surface */
    bool maybe_moved; /* the caller may have moved tissue since the last substep */
    double reach_m, margin_m, odometer_m, moved_m;
    double *gathered_u_m;               /* [3*mesh vertices] displacement of each when its pairs were last searched */
    double *place_m;                    /* [3*mesh vertices] its place then */
    double *last_u_m;                   /* [3*mesh vertices] displacements in the last substep */
    tm_touch_set fresh[TM_TOUCH_KINDS]; /* whose pairs must be searched: with a fresh vertex, or changed by a cut */
    tm_touch_clusters clusters[TM_TOUCH_KINDS]; /* of places */
    bool clustered;                             /* they are of the surface as it is */
    int32_t most_items, *near_items;            /* [parts*most_items] features near another, of each thread */
    tm_touch_lists near;
    tm_touch_lists *found_by; /* [parts] those that each thread found; null for one thread */
    tm_touch_work *work;      /* of the threads */
    tm_touch_pair *scratch;   /* [max_candidates] */
    /* pairs beyond the reach of the lists, of this substep */
    tm_touch_lists fast;
    tm_touch_set quick[TM_TOUCH_KINDS]; /* features with a vertex that moves far in a substep, or is followed */
    uint8_t *is_followed;               /* [mesh vertices] those of surfaces with another body behind them */
    int32_t followed_count, *followed;  /* [TM_TOUCH_MAX_FOLLOWED] these */
    tm_touch_box box[TM_MAX_BODIES];    /* of each body */
    tm_touch_frame frame[TM_MAX_BODIES];
    double frames_motion_m; /* of the fastest frame */
    uint8_t *is_fast;       /* [mesh vertices] those of the surface that are fast in the frames */
    int32_t inside_count;
    tm_touch_inside inside[TM_TOUCH_MAX_INSIDE]; /* ascending */
    int32_t found_count;
    tm_touch_inside found[TM_TOUCH_MAX_INSIDE]; /* in this substep, ascending */
    int32_t suspect;                            /* vertex that is checked in this substep; -1: none */
    uint32_t suspect_rank;
    /* rows */
    bool updated;       /* the lists are those of this substep */
    bool found_early;   /* during the force pass of this substep */
    double increment_m; /* bound of the motion of a vertex in the last substep */
    int32_t row_count, memory_count, saved_count;
    bool may_cross;           /* in this substep, a vertex moves by more than a thickness */
    int32_t persistent_count; /* rows that the next substep starts from; those behind are of crossings */
    tm_touching_row *row;
    tm_touch_solver *solver;
    tm_touch_memory *memory, *saved; /* [max_rows] of the last substep; when the step began */
    double swept_J;                  /* energy that the rows gave after the sweeps of this substep */
    double reserve_J, pushed_J;      /* energy that rows took and may give back; that they gave beyond, of late */
    double stored_before_J[2];       /* in their compliance, after the last substep and the one before */
    uint8_t *fixed;                  /* [3*vertex_count] */
    const void *fixed_by;
    tm_touching_report report;
    bool all_pairs; /* tests: all pairs in each substep, without a broad phase */
};

/* touch_surface.c */
bool tm_touch_surface_init(tm_touch_surface *surface, tm_pool *pool, const tm_tissue *tissue);
/* Takes over the surface of the tissue. Features that came, went, or have other faces are fresh. */
void tm_touch_surface_build(tm_touching *touching);
/* Returns the vertices of a face (4*tet + local vertex), normal outward. */
static inline void tm_touch_triangle(const tm_touching *t, int32_t face, int32_t vertex[3]) {
    const int32_t *tet = t->world->tissue->mesh->tet + 4 * (int64_t)(face / 4);
    for (int j = 0; j < 3; j++) vertex[j] = tet[tm_face_vertex[face % 4][j]];
}
/* Returns the number of vertices of a feature, and lists them. */
static inline int tm_touch_vertices(const tm_touching *t, int kind, int32_t item, int32_t vertex[3]) {
    if (kind == TM_TOUCH_FACES) {
        tm_touch_triangle(t, item, vertex);
        return 3;
    }
    if (kind == TM_TOUCH_VERTICES) {
        vertex[0] = item;
        return 1;
    }
    const int32_t *ends = t->world->tissue->mesh->edge + 2 * (int64_t)item;
    vertex[0] = ends[0], vertex[1] = ends[1];
    return 2;
}
static inline int32_t tm_touch_body(const tm_touching *t, int32_t face) {
    return t->tet_body ? t->tet_body[face / 4] : 0;
}
/* Returns how far a vertex may be from the place for which the clusters have it, with a margin for rounding. */
static inline double tm_touch_misplaced_m(const tm_touching *t) { return 0.5001 * t->margin_m; }
static inline bool tm_touch_enabled(const tm_touching *t, int32_t a, int32_t b) {
    return t->pair[a * t->def.body_count + b] != 0;
}

/* touch_geometry.c: closest points. */
tm_touch_closest tm_touch_point_triangle(const double p[3], const double a[3], const double b[3], const double c[3]);
/* Returns the distance of two segments; s and t are the nearest points' places on them, inside: both within. */
double tm_touch_segments(const double a0[3], const double a1[3], const double b0[3], const double b1[3], double *s,
                         double *t, bool *inside);

static inline bool tm_touch_is_on_surface(const tm_touch_surface *s, int32_t edge) {
    return s->of_edge[2 * (int64_t)edge + 1] >= 0;
}

/* touch_clusters.c */
/* Allocates. order_count, together: features of the mesh, and how many are next to each other in any case; most: on the
 * surface. */
bool tm_touch_clusters_init(tm_touching *touching, tm_pool *pool, int kind, int32_t order_count, int together,
                            int64_t most);
/* Puts the features of the surface into clusters, with boxes of their places. */
void tm_touch_clusters_build(tm_touching *touching, int kind, const int32_t *item, int32_t count);
/* Renews the boxes of features with new places. */
void tm_touch_clusters_move(tm_touching *touching, int kind, const int32_t *item, int32_t count);
static inline bool tm_touch_clusters_have(const tm_touch_clusters *clusters, int32_t item) {
    return clusters->slot[item] >= 0;
}
/* Returns bounds of a box and what is nearer to it than grow_m. */
tm_touch_bounds tm_touch_bounds_around(const double low[3], const double high[3], double grow_m);
/* Finds all features whose boxes overlap these bounds. Returns their number. */
int32_t tm_touch_clusters_find(const tm_touch_clusters *clusters, const tm_touch_bounds *bounds, int32_t *found);
/* Lists the clusters of these features, until tm_touch_clusters_forget. */
void tm_touch_clusters_list(tm_touch_clusters *clusters, const int32_t *item, int32_t count);
void tm_touch_clusters_forget(tm_touch_clusters *clusters);
/* Calls `try` with each of these features and each of the kind `against` whose boxes are within grow_m; a part takes
 * every parts-th cluster. */
typedef void tm_touch_try(const tm_touching *touching, tm_touch_lists *to, int32_t item, int32_t other);
void tm_touch_clusters_try(const tm_touching *touching, int kind, int against, int32_t part, int32_t parts,
                           double grow_m, tm_touch_try *try, tm_touch_lists *to);

/* touch_pairs.c: add a pair to the lists if it is close in the places of its vertices, and may touch. */
/* Returns whether a pair may touch wherever it is, by its bodies and its places at rest. */
bool tm_touch_may_touch_face(const tm_touching *touching, int32_t vertex, int32_t face, tm_touch_pair *pair);
bool tm_touch_may_touch_edges(const tm_touching *touching, int32_t a, int32_t b, tm_touch_pair *pair); /* a < b */
void tm_touch_try_vertex_face(const tm_touching *touching, tm_touch_lists *to, int32_t vertex, int32_t face);
void tm_touch_try_edges(const tm_touching *touching, tm_touch_lists *to, int32_t a, int32_t b);
/* Sorts a list whose first `kept` pairs are sorted. */
void tm_touch_list_merge(tm_touch_list *list, int32_t kept, tm_touch_pair *scratch);
void tm_touch_list_drop_doubles(tm_touch_list *list); /* sorted */

/* touch_search.c: try the pairs of fresh features with all others, on all threads. */
bool tm_touch_set_init(tm_touching *touching, tm_pool *pool, tm_touch_set set[TM_TOUCH_KINDS]);
void tm_touch_add_fresh(tm_touching *touching, int kind, int32_t item);
/* Lists the fresh vertices, and adds their faces and edges to those of a cut. */
void tm_touch_list_fresh(tm_touching *touching);
/* Lists the complete surface. */
void tm_touch_list_all(tm_touching *touching);
void tm_touch_forget_fresh(tm_touching *touching);
void tm_touch_forget_removed(tm_touching *touching);
void tm_touch_search(tm_touching *touching);

/* touch_gather.c: the lists of close pairs. */
bool tm_touch_gather_init(tm_touching *touching, tm_pool *pool);
/* Gathers again if a pair that is not in the lists may be in reach. Once in a substep. */
void tm_touch_update(tm_touching *touching);

/* Calls `work` once for each part, on all threads with lists of their own, and appends what they found. */
void tm_touch_divide(tm_touching *touching, tm_touch_work *work, tm_touch_lists *to);
/* Lists the features with a quick vertex; returns whether there is one. */
typedef bool tm_touch_is_quick(const tm_touching *touching, int32_t vertex);
bool tm_touch_list_quick(tm_touching *touching, tm_touch_is_quick *is);

/* touch_fast.c: finds vertices and faces of two bodies that may meet in this substep from beyond the lists' reach. */
void tm_touch_find_fast(tm_touching *touching);

/* touch_follow.c: notes vertices of a surface near another body that is behind it; `depth_m`: of the pair. */
void tm_touch_follow(tm_touching *touching, const tm_touch_pair *pair, double depth_m, const int32_t *vertex,
                     int count);
void tm_touch_forget_followed(tm_touching *touching);

/* touch_frames.c: finds the motion of each body in this substep, as known by now, and the fast vertices: those that
 * move by more than a limit relative to a body that they may meet. */
void tm_touch_find_frames(tm_touching *touching, double limit_m);

/* touch_crossing.c: sweeps the rows; before some sweeps, adds rows of features that would cross in this substep. */
void tm_touch_sweep(tm_touching *touching, int32_t sweep);
/* After the sweeps, before energy is limited: stops what would still cross, against the rows of touch alone. */
void tm_touch_sweep_last(tm_touching *touching);
/* After the sweeps: lists vertices that entered another body in spite of their rows as inside. */
void tm_touch_list_entered(tm_touching *touching);

/* touch_inside.c: vertices inside another body. */
/* Returns whether a point is outside a body: its surface does not wind around it. O(surface). */
bool tm_touch_is_outside(const tm_touching *touching, const double p[3], int32_t body);
void tm_touch_find_inside(tm_touching *touching);
/* Names a vertex that is behind a face of another body; one of those named in a substep is checked. */
void tm_touch_suspect(tm_touching *touching, int32_t vertex);
void tm_touch_check_suspect(tm_touching *touching);
/* Lists a vertex as inside from the next substep on. */
void tm_touch_note_inside(tm_touching *touching, const tm_touch_inside *inside);
/* Adds the vertices that are inside to the memory. */
void tm_touch_remember_inside(tm_touching *touching);

/* touch_rows.c: notes what the rows of a substep depend on and its integration changes; then finds them, perhaps on
 * another thread. */
void tm_touch_begin(tm_touching *touching);
void tm_touch_find(tm_touching *touching);
/* Adds a row; drops and flags it where there is no room. Returns whether it was added. */
bool tm_touch_add_row(tm_touching *touching, const tm_touching_row *row, double compliance_m_N);

/* Returns the energy in a row's compliance, at its force or another, J. */
double tm_touching_stored_J(const tm_touching *touching, int32_t row);
double tm_touch_stored_at_J(const tm_touching *touching, int32_t row, double lambda_N);

/* touch_solve.c */
/* Calls `add` with each force of the last substep's rows. */
void tm_touch_forces(const void *self, void *to, tm_add_force *add);
/* Returns the derivative of a row's depth by its force, m/N, and whether its friction sticks. */
double tm_touching_slope_m_N(const tm_touching *touching, int32_t row, bool *sticks);
void tm_touch_prepare(tm_touching *touching);
void tm_touch_prepare_row(tm_touching *touching, int32_t row);
void tm_touch_sweep_once(tm_touching *touching, int32_t sweep);
void tm_touch_remember(tm_touching *touching);
/* Adds the displacements under a force on a row and its opposite. */
void tm_touch_push(tm_touching *touching, int32_t row, const double force_N[3]);
/* Computes the relative motion of a row's two sides between two displacements. */
void tm_touch_slip(const tm_touching_row *row, const double *to_m, const double *from_m, double way_m[3]);
/* Sweeps once, but only reduces forces: first from the last row, or, with `sweep` odd, from the first. */
void tm_touch_release(tm_touching *touching, int32_t sweep);

/* touch_passivity.c: limits and notes what the rows give after the sweeps, and limits them to that after instruments
 * were held back. Returns whether forces changed. */
void tm_touch_note_energy(tm_touching *touching);
/* Adds what the rows gave in this substep to their account, and the account to the memory, as the last. */
void tm_touch_remember_account(tm_touching *touching);
bool tm_touch_limit_energy(tm_touching *touching);

/* ties.c: calls `add` with each force of the ties in this substep; returns the energy that they store, J. */
double tm_ties_energy(tm_world *world, void *to, tm_add_force *add);

static inline void tm_touch_at(const tm_world *world, int32_t vertex, double x[3]) {
    for (int c = 0; c < 3; c++) x[c] = world->tissue->mesh->rest_m[3 * vertex + c] + world->state.u_m[3 * vertex + c];
}

#endif
