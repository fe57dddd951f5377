/* Contact of instruments with the tissue's surface: capsule against triangles, unilateral, frictionless (friction.h
 * adds that), regularised by a stated skin compliance. One stage for all instruments. Rows are found by tm_contact_find
 * (also used by the precomputed model) and made non-penetrating by projection (docs/contact.md). */
#ifndef TENSORMASS_CONTACT_H
#define TENSORMASS_CONTACT_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_MAX_INSTRUMENTS 2

typedef enum tm_tool_mode { TM_TOOL_PROBE = 0, TM_TOOL_GRASPER = 1, TM_TOOL_CAUTERY = 2 } tm_tool_mode;

/* Where an instrument is. The shaft runs from the trocar (fixed pivot) through the tip; roll is about it. */
typedef struct tm_tool_pose {
    double tip_m[3];
    double roll_rad;
    double grip; /* 0 open .. 1 closed */
    bool active; /* cautery current, or in the body at all for a probe: false = no contact */
} tm_tool_pose;

typedef struct tm_instrument_def {
    tm_tool_mode mode;
    double trocar_m[3];      /* world */
    double radius_m;         /* shaft and tip, 0.0025 */
    double contact_length_m; /* of shaft behind the tip that can touch, 0.1 */
    tm_tool_pose pose;       /* at the start */
} tm_instrument_def;

typedef struct tm_contact_def {
    uint32_t cookie, size;
    int32_t instrument_count;
    const tm_instrument_def *instrument;
    double contact_compliance_m_N; /* of each station of the tool (one row alone has it all); 0.5e-3 by default: see
                                      docs */
    int32_t sweeps;                /* projected Gauss-Seidel sweeps per substep, fixed; 10 */
    int32_t max_rows;              /* 256 in all; more are dropped, deepest kept, and flagged */
    double force_cap_N;            /* per row; 50; flagged */
} tm_contact_def;

/* What of the triangle a row touches: its inside, local edge j (vertex j to j+1 mod 3), or local vertex j. */
enum { TM_FEATURE_FACE = 0, TM_FEATURE_EDGE = 1, TM_FEATURE_VERTEX = 4 }; /* EDGE+j, VERTEX+j */

/* One row: a station of one instrument against a feature of the surface. Stations are points of the tool's axis, one
 * radius apart, station 0 the tip; each is a sphere of the tool's radius and has one skin, shared among its rows
 * (docs/contact.md). */
typedef struct tm_contact_row {
    int32_t face; /* persistent id of the triangle; of an edge or a vertex the lowest among the candidates */
    int32_t vertex[3];
    int32_t instrument;
    int32_t station;   /* along the axis, 0 the tip */
    int32_t feature;   /* TM_FEATURE_... */
    double share;      /* (0,1] of its station's skin: the row's own compliance is contact_compliance_m_N / share */
    double weight[3];  /* barycentric, sum 1 */
    double normal[3];  /* unit, from tool to tissue: the reaction on the tissue is +lambda*normal */
    double point_m[3]; /* the station: on the tool's axis */
    double gap_m;      /* signed distance minus radius at the geometry the row was found in */
    double lambda_N;   /* reaction >= 0 */
} tm_contact_row;

/* Radii: a tool that moves farther within one substep may cross a surface unnoticed. */
#define TM_TOO_FAST 0.5

/* How a reaction came about. */
typedef enum tm_reaction_flag {
    TM_REACTION_CAPPED = 1,      /* a row reached the force cap */
    TM_REACTION_OVERFLOWED = 2,  /* there were more rows or triangles than there is room for: the deepest were kept */
    TM_REACTION_UNCONVERGED = 4, /* the on-line solution stopped before its tolerance */
    TM_REACTION_REPEATED = 8,    /* the reaction of before, given again */
    TM_REACTION_UNSTABLE = 16,   /* no reaction: the step that was to give it failed */
    TM_REACTION_TOO_FAST = 32,   /* it moved more than TM_TOO_FAST radii in a substep: it may have missed tissue */
    TM_REACTION_INSIDE = 64,     /* it appeared inside the tissue and touches nothing until it has left it */
    TM_REACTION_RELEASING = 128  /* its jaws open: the force falls although nothing moves */
} tm_reaction_flag;

/* Frame averages, as the controller wants them: over the last `average` substeps of the frame. */
typedef struct tm_tool_reaction {
    double time_s;           /* mean simulated time of the average */
    double tip_m[3];         /* mean tip position */
    double force_N[3];       /* equivalent tip force ON THE TOOL (J_tip^-T sum J_i^T f_i) */
    double resultant_N[3];   /* plain sum of row forces on the tool */
    double stiffness_N_m[9]; /* dF/dP, row-major, material part and turning normals; see stiffness_kind */
    int32_t stiffness_kind;  /* 0 none, 1 estimated, 2 exact */
    int32_t row_count;
    uint32_t flags; /* tm_reaction_flag, of the whole frame */
} tm_tool_reaction;

typedef struct tm_contact tm_contact;

TM_API tm_contact_def tm_contact_def_default(void);
/* Adds the "contact" stage to the world; the handle stays owned by the world. */
TM_API tm_status tm_stage_contact(tm_world *world, const tm_contact_def *def, tm_contact **contact, tm_error *error);

/* The path of one instrument over the coming `substeps`: from where it is to `to`, joint-linear about the trocar. */
TM_API void tm_contact_set_target(tm_contact *contact, int32_t instrument, const tm_tool_pose *to, int32_t substeps);
/* Puts it there at once (a teleport: no swept path). */
TM_API void tm_contact_set_pose(tm_contact *contact, int32_t instrument, const tm_tool_pose *at);
TM_API tm_tool_pose tm_contact_pose(const tm_contact *contact, int32_t instrument);

/* Begin a frame of `substeps`, the last `average` of which are averaged. */
TM_API void tm_contact_begin_frame(tm_contact *contact, int32_t substeps, int32_t average);
TM_API tm_tool_reaction tm_contact_reaction(const tm_contact *contact, int32_t instrument);
TM_API int32_t tm_contact_rows(const tm_contact *contact, const tm_contact_row **rows);

/* The block of rows of a surface that is more than that of the world's tissue: the hybrid model's. `solve` is called
 * once a substep, after the sweeps of the other blocks; it corrects u_next_m and writes the rows (order as in
 * tm_contact_find, lambda_N filled in) and each instrument's tm_reaction_flag. Reactions, averages and touched faces
 * are summed from those rows as from the stage's own. pose[].active: it can touch. */
typedef struct tm_contact_block {
    void *self; /* of a stage: its time is booked on that */
    int32_t (*solve)(void *self, tm_world *world, const tm_tool_pose *pose, tm_contact_row *row, int32_t max_rows,
                     uint32_t flags[TM_MAX_INSTRUMENTS]);
} tm_contact_block;
/* The block whose rows contact has from now on; null: the stage's own, of the tissue's surface. */
TM_API void tm_contact_set_block(tm_contact *contact, const tm_contact_block *block);
/* All vertices that bear the row are between the jaws of its tool: it is no obstacle to it. */
TM_API bool tm_contact_is_grasped(const tm_contact *contact, const tm_contact_row *row);

/* --- geometry alone: shared with the precomputed model and the patch --- */

/* Rows of a capsule against triangles at the positions rest + u, those with a gap of at most `margin_m`. `candidate`
 * lists triangle slots (any superset of those in reach, each once; null: all of 0..candidate_count-1; of more than 1024
 * in reach the rest is left out). Returns the count (<= max_rows, deepest kept), in the fixed order (station, face,
 * feature). `*overflowed` (may be null) is set when triangles or rows were left out, else untouched. `work` is memory
 * to work in, from tm_contact_search_create: what it had gathered is lost. No allocation; as any call of the library
 * but those that create, it fits a thread with 128 kB of stack. */
typedef struct tm_contact_search tm_contact_search;
typedef struct tm_capsule {
    double tip_m[3];
    double tail_m[3];
    double radius_m;
    int32_t instrument;
} tm_capsule;
TM_API int32_t tm_contact_find(tm_contact_search *work, const double *rest_m, const double *u_m,
                               const int32_t *triangle, const int32_t *face, const int32_t *candidate,
                               int32_t candidate_count, const tm_capsule *capsule, double margin_m, tm_contact_row *row,
                               int32_t max_rows, bool *overflowed);
/* What surrounds one tool, gathered once and looked at many times: for iterations that move the surface between looks.
 */
TM_API tm_status tm_contact_search_create(tm_contact_search **search, tm_error *error);
TM_API void tm_contact_search_destroy(tm_contact_search *search);
/* Takes all triangles within `reach_m` of the axis, and whole fans around them (at most 1024; false: some were left
 * out). */
TM_API bool tm_contact_search_gather(tm_contact_search *search, const double *rest_m, const double *u_m,
                                     const tm_surface_view *surface, const tm_capsule *capsule, double reach_m);
/* Vertices of the gathered triangles, ascending: the only ones whose u the rows depend on. */
TM_API int32_t tm_contact_search_vertices(const tm_contact_search *search, const int32_t **vertex);
/* As tm_contact_find, of the gathered triangles. `before` (may be null): rows of the solution before, those of this
 * instrument: a station stays in touch with a surface that it has sunk through little by little. `*overflowed` is set
 * when rows were left out. */
TM_API int32_t tm_contact_search_rows(tm_contact_search *search, const double *rest_m, const double *u_m,
                                      const tm_capsule *capsule, double margin_m, const tm_contact_row *before,
                                      int32_t before_count, tm_contact_row *row, int32_t max_rows, bool *overflowed);
/* What it has gathered, for snapshots: persistent ids of the triangles (at most 1024, ascending), and how long edges
 * are there. _take gathers these very ones from the surface: false, with nothing gathered, when one is not in it. */
TM_API int32_t tm_contact_search_faces(const tm_contact_search *search, const int32_t **face, double *edge_m);
TM_API bool tm_contact_search_restore(tm_contact_search *search, const double *rest_m, const tm_surface_view *surface,
                                      const int32_t *face, int32_t count, double edge_m);
/* The part of an instrument that can touch. */
TM_API tm_capsule tm_tool_capsule(const tm_instrument_def *def, const tm_tool_pose *pose, int32_t instrument);
/* The skin of one row of compliance c (skin_compliance / share), m/N: it gives c*lambda up to 0.3 radii and a
 * twentieth as easily beyond, so that no force of a hand brings the tool's axis through the surface.
 * tm_contact_compliance_depth is the penetration under lambda, tm_contact_compliance_slope its derivative,
 * tm_contact_compliance_reaction the lambda in [0, cap] that solves gap + diagonal*lambda + depth(lambda) = 0. */
TM_API double tm_contact_compliance_depth(double compliance_m_N, double radius_m, double lambda_N);
TM_API double tm_contact_compliance_slope(double compliance_m_N, double radius_m, double lambda_N);
TM_API double tm_contact_compliance_reaction(double compliance_m_N, double radius_m, double gap_m, double diagonal_m_N,
                                             double cap_N);

/* Between tool and tissue is a film: its drag is 0.3 s/m * lambda * (speed of the tissue against the tool),
 * whatever the direction; 0.3 % of the reaction at 0.01 m/s, nothing at rest. Blended normals are not the gradient of
 * any energy, and without a film a tool that is two edges deep in lightly damped tissue can make it flutter at 100 to
 * 250 Hz. (The law's numbers stand in contact_law/, which the controller's core is made of too.) */

/* Equivalent tip force of a force acting at `point` on a tool pivoting about `trocar` with its tip at `tip`. */
TM_API void tm_tip_force(const double trocar_m[3], const double tip_m[3], const double point_m[3],
                         const double force_N[3], double tip_force_N[3]);

#ifdef __cplusplus
}
#endif
#endif
