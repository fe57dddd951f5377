/* Contact of instruments with the tissue's surface: capsule against triangles, unilateral, without friction (friction.h
 * adds it), regularised by a contact compliance. One stage for all instruments. tm_contact_find finds the rows, for the
 * precomputed model too. Projection makes them non-penetrating (docs/contact.md). */
#ifndef TENSORMASS_CONTACT_H
#define TENSORMASS_CONTACT_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_MAX_INSTRUMENTS 2

typedef enum tm_tool_mode { TM_TOOL_PROBE = 0, TM_TOOL_GRASPER = 1, TM_TOOL_CAUTERY = 2 } tm_tool_mode;

/* Pose of an instrument. The shaft runs from the trocar (fixed pivot) through the tip, or along `direction` if the
 * instrument is free; roll is about the shaft. */
typedef struct tm_tool_pose {
    double tip_m[3];
    double roll_rad;
    double grip;         /* 0 open .. 1 closed */
    bool active;         /* cautery: current is on; others: in the body. false: no contact */
    double direction[3]; /* of a free instrument: along the shaft, towards the tip; any length. Else unused */
} tm_tool_pose;

typedef struct tm_instrument_def {
    tm_tool_mode mode;
    bool is_free;            /* no trocar: the hand turns the shaft, and the pose holds its direction */
    double trocar_m[3];      /* world coordinates; unused if free */
    double radius_m;         /* of shaft and tip, 0.0025 */
    double contact_length_m; /* length of shaft behind the tip that can touch, 0.1 */
    tm_tool_pose pose;       /* initial pose */
} tm_instrument_def;

typedef struct tm_contact_def {
    uint32_t cookie, size;
    int32_t instrument_count;
    const tm_instrument_def *instrument;
    double contact_compliance_m_N; /* of each station of the tool, shared among its rows; 0.5e-3 by default: see docs */
    int32_t sweeps;                /* projected Gauss-Seidel sweeps per substep, constant; 10 */
    int32_t max_rows;              /* in total, 256; beyond it the deepest are kept, and the reaction is flagged */
    double force_cap_N;            /* maximum force of a row; 50; flagged */
} tm_contact_def;

/* Feature of the triangle that a row touches: its face, local edge j (vertex j to j+1 mod 3), or local vertex j. */
enum { TM_FEATURE_FACE = 0, TM_FEATURE_EDGE = 1, TM_FEATURE_VERTEX = 4 }; /* EDGE+j, VERTEX+j */

/* Contact row: a station of one instrument against a feature of the surface. Stations are points of the tool's axis,
 * one radius apart, station 0 the tip. Each is a sphere of the tool's radius; its rows share its contact compliance
 * (docs/contact.md). */
typedef struct tm_contact_row {
    int32_t face; /* persistent id of the triangle; for an edge or a vertex the lowest among the candidates */
    int32_t vertex[3];
    int32_t instrument;
    int32_t station;   /* index along the axis, 0 at the tip */
    int32_t feature;   /* TM_FEATURE_... */
    double share;      /* in (0,1], of the station's compliance: the row's own is contact_compliance_m_N / share */
    double weight[3];  /* barycentric, sum 1 */
    double normal[3];  /* unit, from tool to tissue: the force on the tissue is +lambda*normal */
    double point_m[3]; /* centre of the station, on the tool's axis */
    double gap_m;      /* signed distance minus radius, at the positions where the row was found */
    double lambda_N;   /* normal force, >= 0 */
} tm_contact_row;

/* Maximum motion within one substep, in radii: a faster tool may cross a surface undetected. */
#define TM_TOO_FAST 0.5

/* Properties of a reaction. */
typedef enum tm_reaction_flag {
    TM_REACTION_CAPPED = 1,      /* a row reached the force cap */
    TM_REACTION_OVERFLOWED = 2,  /* more rows or triangles than the capacity: the deepest were kept */
    TM_REACTION_UNCONVERGED = 4, /* the online solver stopped before its tolerance */
    TM_REACTION_REPEATED = 8,    /* the previous reaction, sent again */
    TM_REACTION_UNSTABLE = 16,   /* no reaction: its step failed */
    TM_REACTION_TOO_FAST = 32,   /* moved more than TM_TOO_FAST radii in a substep: tissue may have been missed */
    TM_REACTION_INSIDE = 64,     /* was placed inside the tissue: no contact until it has left */
    TM_REACTION_RELEASING = 128  /* the jaws open: the force falls without motion */
} tm_reaction_flag;

/* Reaction for the controller: averages over the last `average` substeps of the frame. */
typedef struct tm_tool_reaction {
    double time_s;           /* mean simulated time of the average */
    double tip_m[3];         /* mean tip position */
    double force_N[3];       /* equivalent tip force ON THE TOOL (J_tip^-T sum J_i^T f_i) */
    double resultant_N[3];   /* sum of the row forces on the tool */
    double stiffness_N_m[9]; /* dF/dP, row-major: material part and rotating normals; see stiffness_kind */
    int32_t stiffness_kind;  /* 0 none, 1 estimated, 2 exact */
    int32_t row_count;
    uint32_t flags; /* tm_reaction_flag, collected over the complete frame */
} tm_tool_reaction;

typedef struct tm_contact tm_contact;

TM_API tm_contact_def tm_contact_def_default(void);
/* Adds the stage "contact" to the world, which owns the handle. */
TM_API tm_status tm_stage_contact(tm_world *world, const tm_contact_def *def, tm_contact **contact, tm_error *error);

/* Sets the path of one instrument over the next `substeps`: from its pose to `to`, linear in the joints at the
 * trocar. */
TM_API void tm_contact_set_target(tm_contact *contact, int32_t instrument, const tm_tool_pose *to, int32_t substeps);
/* Sets the pose at once (a teleport: no swept path). */
TM_API void tm_contact_set_pose(tm_contact *contact, int32_t instrument, const tm_tool_pose *at);
TM_API tm_tool_pose tm_contact_pose(const tm_contact *contact, int32_t instrument);

/* Begins a frame of `substeps`; reactions are averaged over its last `average`. */
TM_API void tm_contact_begin_frame(tm_contact *contact, int32_t substeps, int32_t average);
TM_API tm_tool_reaction tm_contact_reaction(const tm_contact *contact, int32_t instrument);
TM_API int32_t tm_contact_rows(const tm_contact *contact, const tm_contact_row **rows);

/* Constraint block for a surface larger than that of the world's tissue, as the hybrid model has. `solve` is called
 * once a substep, after the sweeps of the other blocks. It corrects u_next_m, writes the rows (ordered as by
 * tm_contact_find, lambda_N filled in) and sets the tm_reaction_flag of each instrument. Reactions, averages and
 * touched faces are summed from these rows as from the stage's own. pose[].active: the instrument can touch. */
typedef struct tm_contact_block {
    void *self; /* `self` of a stage: the time is recorded under it */
    int32_t (*solve)(void *self, tm_world *world, const tm_tool_pose *pose, tm_contact_row *row, int32_t max_rows,
                     uint32_t flags[TM_MAX_INSTRUMENTS]);
} tm_contact_block;
/* Sets the block whose rows contact uses from now on; null: the stage's own, for the tissue's surface. */
TM_API void tm_contact_set_block(tm_contact *contact, const tm_contact_block *block);
/* Returns whether all loaded vertices of the row are between the jaws of its tool: the row is no obstacle then. */
TM_API bool tm_contact_is_grasped(const tm_contact *contact, const tm_contact_row *row);

/* --- geometry: shared with the precomputed model and the patch --- */

/* Triangles around one tool, gathered once and searched many times while iterations move the surface. */
typedef struct tm_contact_search tm_contact_search;
/* Part of a tool that can touch: a segment with a radius. */
typedef struct tm_capsule {
    double tip_m[3];
    double tail_m[3];
    double radius_m;
    int32_t instrument;
} tm_capsule;
/* Finds the rows of a capsule against triangles at the positions rest + u, with gaps up to `margin_m`. `candidate`
 * lists triangle slots: any superset of those in reach, each once; null: all of 0..candidate_count-1. At most 1024 in
 * reach are used. Returns the number of rows (<= max_rows, deepest kept), ordered by station, face, feature.
 * `*overflowed` (may be null) is set if triangles or rows were left out, else unchanged. `work` is working memory from
 * tm_contact_search_create; its gathered triangles are lost. No allocation. Needs less than 128 kB of stack, as does
 * every call of the library except those that create objects. */
TM_API int32_t tm_contact_find(tm_contact_search *work, const double *rest_m, const double *u_m,
                               const int32_t *triangle, const int32_t *face, const int32_t *candidate,
                               int32_t candidate_count, const tm_capsule *capsule, double margin_m, tm_contact_row *row,
                               int32_t max_rows, bool *overflowed);
/* Allocates the working memory of a search. */
TM_API tm_status tm_contact_search_create(tm_contact_search **search, tm_error *error);
TM_API void tm_contact_search_destroy(tm_contact_search *search);
/* Gathers all triangles within `reach_m` of the axis, with complete fans around them. Returns false if there are more
 * than 1024: the rest is left out. */
TM_API bool tm_contact_search_gather(tm_contact_search *search, const double *rest_m, const double *u_m,
                                     const tm_surface_view *surface, const tm_capsule *capsule, double reach_m);
/* Returns the vertices of the gathered triangles, ascending. Rows depend on the u of these only. */
TM_API int32_t tm_contact_search_vertices(const tm_contact_search *search, const int32_t **vertex);
/* Finds rows as tm_contact_find, among the gathered triangles. `before` (may be null): this instrument's rows of the
 * previous solution. They keep a station in contact with a surface that it has gradually sunk through. `*overflowed` is
 * set if rows were left out. */
TM_API int32_t tm_contact_search_rows(tm_contact_search *search, const double *rest_m, const double *u_m,
                                      const tm_capsule *capsule, double margin_m, const tm_contact_row *before,
                                      int32_t before_count, tm_contact_row *row, int32_t max_rows, bool *overflowed);
/* For snapshots: returns the persistent ids of the gathered triangles (at most 1024, ascending), and their edge length.
 * _restore gathers exactly these from the surface. It returns false, with nothing gathered, if one is missing. */
TM_API int32_t tm_contact_search_faces(const tm_contact_search *search, const int32_t **face, double *edge_m);
TM_API bool tm_contact_search_restore(tm_contact_search *search, const double *rest_m, const tm_surface_view *surface,
                                      const int32_t *face, int32_t count, double edge_m);
/* Computes the unit direction of the shaft, towards the tip; straight down if it is undefined. */
TM_API void tm_tool_direction(const tm_instrument_def *def, const tm_tool_pose *pose, double direction[3]);
/* Returns the part of an instrument that can touch. */
TM_API tm_capsule tm_tool_capsule(const tm_instrument_def *def, const tm_tool_pose *pose, int32_t instrument);
/* Contact compliance of one row, c = contact compliance / share, m/N:
 *   depth = c lambda up to 0.3 radii; slope c/20 beyond.
 * So no force of a hand pushes the tool's axis through the surface. _depth returns the penetration under lambda, _slope
 * its derivative, _reaction the lambda in [0, cap] that solves gap + diagonal*lambda + depth(lambda) = 0. */
TM_API double tm_contact_compliance_depth(double compliance_m_N, double radius_m, double lambda_N);
TM_API double tm_contact_compliance_slope(double compliance_m_N, double radius_m, double lambda_N);
TM_API double tm_contact_compliance_reaction(double compliance_m_N, double radius_m, double gap_m, double diagonal_m_N,
                                             double cap_N);

/* Viscous contact drag: 0.3 s/m * lambda * (velocity of the tissue relative to the tool), in any direction. That is
 * 0.3 % of the reaction at 0.01 m/s, and 0 at rest. Blended normals are not the gradient of an energy: without drag, a
 * tool two edges deep in lightly damped tissue can make it flutter at 100 to 250 Hz. The law's constants are in
 * contact_law/, which the controller's core uses too. */

/* Computes the tip force equivalent to a force at `point`, for a tool that pivots about `trocar` with its tip at
 * `tip`. */
TM_API void tm_tip_force(const double trocar_m[3], const double tip_m[3], const double point_m[3],
                         const double force_N[3], double tip_force_N[3]);
/* Computes it for an instrument. At a free one it is the force itself: the tip moves without turning the shaft. */
TM_API void tm_tool_tip_force(const tm_instrument_def *def, const tm_tool_pose *pose, const double point_m[3],
                              const double force_N[3], double tip_force_N[3]);

#ifdef __cplusplus
}
#endif
#endif
