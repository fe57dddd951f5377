/* Internals of the hybrid model, shared by hybrid*.c, stage_hybrid.c and model_hybrid.c. */
#ifndef TMS_HYBRID_H
#define TMS_HYBRID_H

#include "contact_law/ledger.h"
#include "contact_solver.h"
#include "coupling.h"
#include "tensormass/energy.h"

/* --- solver for reused rows: forces of a few rows with given normals and shares --- */

enum { TMS_REUSE_ROWS = 64 };

typedef struct tms_reuse_system {
    int32_t count;
    double cap_N;
    double delassus_m_N[TMS_REUSE_ROWS][TMS_REUSE_ROWS]; /* m/N: change of row i's gap per force of row j */
    double gap_m[TMS_REUSE_ROWS];                        /* without any of these forces */
    double row_compliance_m_N[TMS_REUSE_ROWS], radius_m[TMS_REUSE_ROWS];
    double lambda_N[TMS_REUSE_ROWS]; /* in: initial guess; out: load of each row */
    double matrix[TMS_REUSE_ROWS * TMS_REUSE_ROWS], off_N[TMS_REUSE_ROWS];
    int32_t pivot[TMS_REUSE_ROWS];
} tms_reuse_system;

/* Solves lambda = force of the contact compliance at the gap under all of them, for all rows. Returns false without a
 * solution. */
bool tms_reuse_solve(tms_reuse_system *system);
/* Returns the gap of row i under the forces in lambda_N. */
double tms_reuse_gap(const tms_reuse_system *system, int32_t i);

/* --- contact between two full solves: rows keep their normals and shares. See hybrid_reuse.c --- */

struct tm_hybrid;

enum { TMS_REUSE_MAX = 32 }; /* substeps */

/* How a tool's rows are treated. */
enum {
    TMS_TOOL_FROZEN = 0,  /* its rows, if any, are on condensed tissue and are reused */
    TMS_TOOL_TRACKED = 1, /* on tissue with mass: rows are detected in each substep */
    TMS_TOOL_NONE = 2     /* it cannot touch */
};

typedef struct tms_contact_reuse {
    /* state from substep to substep */
    int32_t age, limit; /* substeps since the full solve, -1: none; maximum reuse interval */
    int32_t length;     /* interval adapted to the force jump at the end of previous ones */
    int32_t max_age;    /* maximum of this interval, independent of the force */
    int32_t kind[TM_MAX_INSTRUMENTS];
    double at_m[TM_MAX_INSTRUMENTS][6];          /* tip and tail of each tool at the full solve */
    double margin_m[TM_MAX_INSTRUMENTS];         /* distance that it may move from there */
    double predicted_growth[TM_MAX_INSTRUMENTS]; /* of a frozen tool's rows: growth of their force per substep, */
    double last_growth[TM_MAX_INSTRUMENTS];      /* and growth over the last interval */
    int32_t frozen_count;
    int32_t frozen[TMS_REUSE_ROWS];  /* frozen row that row i of the solver's `previous` is; -1: none */
    double offset_m[TMS_REUSE_ROWS]; /* of a frozen row: its gap with station and interface at 0 and no forces */
    /* derived from that state */
    double *gap_gradient; /* [TMS_REUSE_ROWS][interface_count] gap of a frozen row per interface displacement */
    double delassus_m_N[TMS_REUSE_ROWS][TMS_REUSE_ROWS]; /* m/N, of frozen rows */
    double *push_N;                                      /* [interface_count] sum over all frozen rows, in the last
                                                          * substep */
    bool passed;         /* a row was skipped: its vertices are in the jaws of its tool */
    int32_t whole_count; /* tetrahedra with mass, before any cut */
    bool cut;
    /* scratch */
    int32_t frozen_now[TMS_REUSE_ROWS];
    double offset_now_m[TMS_REUSE_ROWS];
    tms_reuse_system system;
} tms_contact_reuse;

/* An interval that ends: its age, and its predicted and final forces. */
typedef struct tms_reuse_past {
    int32_t age;
    double predicted_growth[TM_MAX_INSTRUMENTS], force_N[TM_MAX_INSTRUMENTS][3];
} tms_reuse_past;

/* Returns false if memory is exhausted. */
bool tms_contact_reuse_create(struct tm_hybrid *hybrid);
void tms_contact_reuse_destroy(struct tm_hybrid *hybrid);
int64_t tms_contact_reuse_bytes(const struct tm_hybrid *hybrid);
/* Makes the next two solves full ones. */
void tms_contact_reuse_forget(struct tm_hybrid *hybrid);
/* Advances contact by one substep with reused rows: sets forces, rows and their sums in the solver. Returns false if a
 * full solve is needed; only scratch data has changed then. */
bool tms_contact_reuse_advance(struct tm_hybrid *hybrid);
/* Returns whether a full solve is due, even if this substep can reuse rows. */
bool tms_contact_reuse_is_over(const struct tm_hybrid *hybrid);
/* Computes the derived data of frozen rows except offsets, from the solver's compliances. */
void tms_contact_reuse_build(struct tm_hybrid *hybrid);
/* Computes the position of the row's station on the tool; returns its coordinate along the row's normal. */
double tms_contact_reuse_station(const tm_capsule *capsule, const tm_contact_row *row, double point_m[3]);
/* Applies the forces of a reuse substep to the coming positions. */
void tms_contact_reuse_move(struct tm_hybrid *hybrid);
/* Begins an interval after a full solve; `swept`: solved by sweeps, with rows of an older shape. */
void tms_contact_reuse_begin(struct tm_hybrid *hybrid, bool swept);
/* Judges the interval that ended in this substep: sets the length of the next ones, and the force growth in the one
 * that has begun. */
tms_reuse_past tms_reuse_past_of(const struct tm_hybrid *hybrid);
void tms_contact_reuse_judge(struct tm_hybrid *hybrid, const tms_reuse_past *past);

/* Writes the state as a stage's hooks require, before the solver's own; `forgotten` as there. Restored together with
 * the solver. */
int64_t tms_contact_reuse_snapshot(const struct tm_hybrid *hybrid, bool forgotten, void *buffer);
int64_t tms_contact_reuse_snapshot_max(const struct tm_hybrid *hybrid);
/* Returns the bytes of this part at the start of a buffer; -1: it is invalid. */
int64_t tms_contact_reuse_snapshot_bytes(const struct tm_hybrid *hybrid, const void *buffer, int64_t bytes);
void tms_contact_reuse_restore(struct tm_hybrid *hybrid, const void *buffer);

enum { TMS_DYNAMIC = 1, TMS_CONDENSED = 2, TMS_INTERFACE = 3 }; /* tetrahedra at a vertex: dynamic, condensed, both */

/* Contact forces on condensed vertices. */
typedef struct tms_pressed {
    int32_t count, *vertex;  /* [most] */
    double *force_N, held_J; /* [3*most]; their elastic energy beyond the interface's shape */
} tms_pressed;

/* hybrid_energy.c: data of the last steps for the energy balance. */
typedef struct tms_hybrid_energy {
    tm_energy_part part;
    int32_t most;
    tms_pressed pressed[3];    /* in this step, the last and the one before */
    int64_t next_step;         /* number of the coming step; -1: none yet */
    double border_J;           /* of the interface, after the last step */
    double *pushed_N;          /* [interface_count] force of the condensed part, in this step */
    double *steady_N, *went_m; /* [interface_count] scratch */
    double *way_m;             /* [3*most] scratch */
} tms_hybrid_energy;

/* hybrid_passivity.c: energy that contact generated; all of it is state. */
typedef struct tms_hybrid_passivity {
    int32_t seen, placed[TM_MAX_INSTRUMENTS]; /* set by a teleport, and not moved since */
    int32_t unused;
    double was_m[2][TM_MAX_INSTRUMENTS][6]; /* tip and tail of each tool after the last substep and the one before */
    double strained_J[2];                   /* elastic energy of condensed tissue and contact compliance, by rows, in
                                             * these substeps */
    double generated_J, min_generated_J[LAW_LEDGER],
        window_s; /* total; minimum in each interval of a window; age of the newest */
} tms_hybrid_passivity;

struct tm_hybrid {
    const tm_mesh *mesh;
    uint8_t *alive, *condensed_tet; /* [tet_count] dynamic; condensed */
    uint8_t *vertex_kind;           /* [vertex_count] */
    tm_tissue *condensed;
    double *extra_mass_kg, *extra_damping_kg_s; /* [vertex_count] of condensed tetrahedra at the interface */
    double step_s;
    int32_t step_tet;
    /* the condensed part's problem */
    uint8_t *fixed;                      /* [3*vertex_count] supports and interface */
    double *value_m, *load_N;            /* [3*vertex_count] of its interior */
    int32_t *interface, interface_count; /* components, ascending */
    int32_t *interface_index;            /* [3*vertex_count] index in the interface, or among the kept components; -1 */
    tms_responses responses;
    double *schur; /* upper triangle by rows */
    tms_coupling coupling;
    tms_system system;
    tms_solver *solver; /* recovers the interior */
    tms_work *work;
    double *full_u, *full_f;            /* [3*vertex_count] */
    double *push_N, *at_m, *previous_m; /* [interface_count] force of the condensed part; displacement; displacement a
                                         * step ago */
    /* contact of the complete organ's surface, replacing the world's contact stage */
    bool has_contact;
    tm_contact_def contact_def;
    tm_instrument_def instrument[TM_MAX_INSTRUMENTS];
    int32_t max_contact_vertices;
    tms_contact_solver solver_contact;
    tms_contact_reuse *reuse;        /* null without contact */
    double *constraint_mode;         /* [3*capacity][interface_count] displacement of an interior slot per interface
                                      * displacement */
    int32_t *constraint_mode_vertex; /* [capacity] its vertex, -1 */
    float *constraint_mode_single;   /* [3*capacity][coupling.padded] the same in single, for the small interface motion
                                      * since the last gathering */
    double *gathered_m;              /* [interface_count] displacement at the last gathering; and of a slot, */
    double *gathered_base_m;         /* [3*capacity], its position then without contact forces */
    float *since_m;                  /* [coupling.padded] scratch */
    double *interface_mobility_m_N;  /* [interface_count] mobility within a substep, 0 if supported */
    bool stale;                      /* data derived from mobilities and supports is outdated */
    int32_t known_revision;          /* revision of the tissue's surface then */
    int32_t *moving, moving_count;   /* vertices with mass */
    tms_hybrid_energy energy;
    tms_hybrid_passivity passivity;
    void *saved; /* checkpoint of a step */
    int64_t saved_bytes;
    /* approximate surface for the search around a tool: see hybrid_compliance.c */
    int32_t neighbourhood_width;
    float *neighbourhood, *neighbourhood_by,
        *neighbourhood_m; /* [kept][neighbourhood_width]; [neighbourhood_width]; [kept] */
    bool owed;            /* the interior in the world's state is outdated */
    bool unrecovered;     /* the interior is an old one: its solution did not converge */
    bool returns;         /* rolled back: `saved` must be restored */
    tm_world *world;
    tm_contact *contact;
    uint8_t *fixed_dof; /* [3*vertex_count] the world's supports */
    /* surface */
    tm_surface_view surface;
    int32_t *surface_triangle, *surface_face, seen_revision;
};

/* Returns whether the vertex has a share of the row and is in that part. */
static inline bool tms_row_is_in(const tm_hybrid *hybrid, const tm_contact_row *row, int corner, int part) {
    return row->weight[corner] != 0 && hybrid->vertex_kind[row->vertex[corner]] == part;
}

/* hybrid.c. Fills the gaps between teeth of the dynamic part's interface [tet_count], if that removes a fifth of the
 * interface's vertices; else changes nothing. Returns false if memory is exhausted. */
bool tms_hybrid_smooth(const tm_mesh *mesh, uint8_t *alive);

/* hybrid_compliance.c. Returns false if memory is exhausted. */
bool tms_hybrid_build_neighbourhood(tm_hybrid *hybrid);
/* Implements tms_contact_solver.update_neighbourhood. */
void tms_hybrid_estimate_neighbourhood(void *hybrid);

/* Returns the displacement of an interior vertex with a slot per interface displacement: [3][interface_count]. */
const double *tms_hybrid_constraint_mode(tm_hybrid *hybrid, int32_t vertex);
/* Returns the mobility of a component with mass within a substep, m/N. */
double tms_hybrid_mobility(const tm_hybrid *hybrid, int32_t dof);
/* Implements tms_contact_solver.compliance. */
void tms_hybrid_compliance(void *hybrid, int32_t a, int32_t b, double C[9]);

/* hybrid_passivity.c. Reduces all contact forces of a solution if they generate more energy than allowed; push_N: its
 * forces on the interface. */
void tms_hybrid_limit_energy(tm_hybrid *hybrid, const double *push_N, int32_t row_count);

/* hybrid_energy.c. Returns false if memory is exhausted. */
bool tms_hybrid_make_energy(tm_hybrid *hybrid);
void tms_hybrid_drop_energy(tm_hybrid *hybrid);

/* Rebuilds the complete organ's surface after a cut. */
void tms_hybrid_rebuild_surface(tm_hybrid *hybrid);
/* Returns the bytes of contact's state between substeps, and writes it unless `buffer` is null. */
int64_t tms_hybrid_snapshot_contact(const tm_hybrid *hybrid, void *buffer);
int64_t tms_hybrid_snapshot_max(const tm_hybrid *hybrid);
/* Restores contact's state from a checkpoint. */
void tms_hybrid_rollback(tm_hybrid *hybrid, const void *buffer, int64_t bytes);
/* Takes ownership of the rows of `contact`. */
tm_status tms_hybrid_add_contact(tm_hybrid *hybrid, tm_contact *contact, tm_error *error);

#endif
