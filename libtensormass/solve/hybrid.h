/* Insides of the hybrid model, shared by hybrid*.c, stage_hybrid.c and model_hybrid.c. */
#ifndef TMS_HYBRID_H
#define TMS_HYBRID_H

#include "contact_solver.h"
#include "coupling.h"
#include "tensormass/energy.h"

/* --- few rows whose normals and shares are given: how hard each presses --- */

enum { TMS_REUSE_ROWS = 64 };

typedef struct tms_reuse_system {
    int32_t count;
    double cap_N;
    double delassus_m_N[TMS_REUSE_ROWS][TMS_REUSE_ROWS]; /* m/N: of row i's gap by the force of row j */
    double gap_m[TMS_REUSE_ROWS];                        /* without any of these forces */
    double row_compliance_m_N[TMS_REUSE_ROWS], radius_m[TMS_REUSE_ROWS];
    double lambda_N[TMS_REUSE_ROWS]; /* in: a guess; out: what each bears */
    double matrix[TMS_REUSE_ROWS * TMS_REUSE_ROWS], off_N[TMS_REUSE_ROWS];
    int32_t pivot[TMS_REUSE_ROWS];
} tms_reuse_system;

/* lambda = what its skin bears at the gap that all of them leave it, of every row at once. False: not found. */
bool tms_reuse_solve(tms_reuse_system *system);
/* The gap of row i with the forces in lambda_N. */
double tms_reuse_gap(const tms_reuse_system *system, int32_t i);

/* --- between two solutions of contact in full: rows that keep their normals and shares. See hybrid_reuse.c --- */

struct tm_hybrid;

enum { TMS_REUSE_MAX = 32 }; /* substeps */

/* How a tool is followed. */
enum {
    TMS_TOOL_FROZEN = 0,  /* its rows, if it has any, are on condensed tissue, and stay */
    TMS_TOOL_TRACKED = 1, /* on what has mass: looked for in every substep */
    TMS_TOOL_NONE = 2     /* it cannot touch */
};

typedef struct tms_contact_reuse {
    /* what lasts from substep to substep */
    int32_t age, limit; /* substeps since the full solution, -1: none; how long it may be followed */
    int32_t length;     /* that spans have come to by how the force jumps where they end */
    int32_t max_age;    /* that this one may have, whatever the force does */
    int32_t kind[TM_MAX_INSTRUMENTS];
    double at_m[TM_MAX_INSTRUMENTS][6];  /* tip and tail of each tool then */
    double margin_m[TM_MAX_INSTRUMENTS]; /* how far it may go from there */
    double
        predicted_growth[TM_MAX_INSTRUMENTS]; /* of a frozen tool's rows: how much more they bear with each substep, */
    double last_growth[TM_MAX_INSTRUMENTS];   /* and how much it was over the last span */
    int32_t frozen_count;
    int32_t frozen[TMS_REUSE_ROWS];  /* of local.before's row i: which of the frozen ones it is; -1: none */
    double offset_m[TMS_REUSE_ROWS]; /* of a frozen row: its gap with the station and the border at 0 and no forces */
    /* what is made of that */
    double *gap_gradient; /* [TMS_REUSE_ROWS][interface_count] how a frozen row's gap follows the border */
    double delassus_m_N[TMS_REUSE_ROWS][TMS_REUSE_ROWS]; /* m/N, of frozen rows */
    double *push_N;                                      /* [interface_count] by all frozen rows, of the last substep */
    bool passed;         /* a row was passed over: its vertices are in the jaws of its tool */
    int32_t whole_count; /* tetrahedra with mass, before any cut */
    bool cut;
    /* scratch */
    int32_t frozen_now[TMS_REUSE_ROWS];
    double offset_now_m[TMS_REUSE_ROWS];
    tms_reuse_system system;
} tms_contact_reuse;

/* A span that ends: how long it was followed, and what it came to. */
typedef struct tms_reuse_past {
    int32_t age;
    double predicted_growth[TM_MAX_INSTRUMENTS], force_N[TM_MAX_INSTRUMENTS][3];
} tms_reuse_past;

/* False: no memory. */
bool tms_contact_reuse_create(struct tm_hybrid *hybrid);
void tms_contact_reuse_destroy(struct tm_hybrid *hybrid);
int64_t tms_contact_reuse_bytes(const struct tm_hybrid *hybrid);
/* The next solution is a full one, and so is the one after it. */
void tms_contact_reuse_forget(struct tm_hybrid *hybrid);
/* A substep on the rows there are: forces, rows and their sums in the on-line system. False: it cannot be followed, and
 * but for scratch nothing has changed. */
bool tms_contact_reuse_advance(struct tm_hybrid *hybrid);
/* A full solution is due, even if this substep can be followed. */
bool tms_contact_reuse_is_over(const struct tm_hybrid *hybrid);
/* What frozen rows are made of besides their offsets, by the on-line system's compliances. */
void tms_contact_reuse_build(struct tm_hybrid *hybrid);
/* Where the row's station is now, and how far that is along its normal. */
double tms_contact_reuse_station(const tms_contact_solver *solver, const tm_contact_row *row, double point_m[3]);
/* The forces of a step followed, let into the coming positions. */
void tms_contact_reuse_move(struct tm_hybrid *hybrid);
/* After a full solution; `swept`: by sweeps of rows that are not its shape's. */
void tms_contact_reuse_begin(struct tm_hybrid *hybrid, bool swept);
/* Of what was followed up to now, and then in the same substep began anew: how long spans may be, and how forces go on
 * in the one that has begun. */
tms_reuse_past tms_reuse_past_of(const struct tm_hybrid *hybrid);
void tms_contact_reuse_judge(struct tm_hybrid *hybrid, const tms_reuse_past *past);

/* As the hooks of a stage want it, in front of what the on-line system keeps; `forgotten` as there. Restored when
 * that is. */
int64_t tms_contact_reuse_snapshot(const struct tm_hybrid *hybrid, bool forgotten, void *buffer);
int64_t tms_contact_reuse_snapshot_max(const struct tm_hybrid *hybrid);
/* Bytes of the part that begins a buffer; -1: it is none. */
int64_t tms_contact_reuse_snapshot_bytes(const struct tm_hybrid *hybrid, const void *buffer, int64_t bytes);
void tms_contact_reuse_restore(struct tm_hybrid *hybrid, const void *buffer);

enum {
    TMS_DYNAMIC = 1,
    TMS_CONDENSED = 2,
    TMS_INTERFACE = 3
}; /* of a vertex: tetrahedra on the one side, the other, both */

/* What rows press on condensed vertices. */
typedef struct tms_pressed {
    int32_t count, *vertex;  /* [most] */
    double *force_N, held_J; /* [3*most]; what that strains beyond the border's shape */
} tms_pressed;

/* hybrid_energy.c: what the account of energy needs to know of the last steps. */
typedef struct tms_hybrid_energy {
    tm_energy_part part;
    int32_t most;
    tms_pressed pressed[3];    /* in this step, the last and the one before */
    int64_t next_step;         /* that is to come; -1: none yet */
    double border_J;           /* of the border, after the last step */
    double *pushed_N;          /* [interface_count] by the condensed part, in this step */
    double *steady_N, *went_m; /* [interface_count] scratch */
    double *way_m;             /* [3*most] scratch */
} tms_hybrid_energy;

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
    double *value_m, *load_N;            /* [3*vertex_count] of its inside */
    int32_t *interface, interface_count; /* components, ascending */
    int32_t *interface_index;            /* [3*vertex_count] in the interface, or among the kept ones; -1 */
    tms_responses responses;
    double *schur; /* upper triangle by rows */
    tms_coupling coupling;
    tms_system system;
    tms_solver *solver; /* recovers the inside */
    tms_work *work;
    double *full_u, *full_f;            /* [3*vertex_count] */
    double *push_N, *at_m, *previous_m; /* [interface_count] force of the condensed part; displacement; a step ago */
    /* contact of the whole organ's surface, in the world's contact stage's place */
    bool has_contact;
    tm_contact_def contact_def;
    tm_instrument_def instrument[TM_MAX_INSTRUMENTS];
    int32_t max_contact_vertices;
    tms_contact_solver solver_contact;
    tms_contact_reuse *reuse;        /* null without contact */
    double *constraint_mode;         /* [3*capacity][interface_count] how a slot inside follows the interface */
    int32_t *constraint_mode_vertex; /* [capacity] whose it is, -1 */
    float
        *constraint_mode_single; /* [3*capacity][coupling.padded] the same, for how little the border has moved since */
    double *gathered_m;          /* [interface_count] what surrounds the tools was looked for; and of a slot, */
    double *gathered_base_m;     /* [3*capacity], its place then without what presses on it */
    float *since_m;              /* [coupling.padded] scratch */
    double *interface_mobility_m_N; /* [interface_count] mobility within a substep, 0 where supported */
    bool stale;                     /* what was made of mobilities and supports is not theirs any more */
    int32_t known_revision;         /* of the tissue's surface, then */
    int32_t *moving, moving_count;  /* vertices that have mass */
    tms_hybrid_energy energy;
    void *saved; /* of a step that may be given back */
    int64_t saved_bytes;
    /* surface for those who look for what is around a tool: see hybrid_compliance.c */
    int32_t neighbourhood_width;
    float *neighbourhood, *neighbourhood_by,
        *neighbourhood_m; /* [kept][neighbourhood_width]; [neighbourhood_width]; [kept] */
    bool owed;            /* the inside in the world's state is not that of the present */
    bool unrecovered;     /* the inside is that of before: its solution did not converge */
    bool returns;         /* it was given back, and `kept` is to be taken */
    tm_world *world;
    tm_contact *contact;
    uint8_t *fixed_dof; /* [3*vertex_count] the world's supports */
    /* surface */
    tm_surface_view surface;
    int32_t *surface_triangle, *surface_face, seen_revision;
};

/* The vertex bears the row, and is in that part. */
static inline bool tms_row_is_in(const tm_hybrid *hybrid, const tm_contact_row *row, int corner, int part) {
    return row->weight[corner] != 0 && hybrid->vertex_kind[row->vertex[corner]] == part;
}

/* hybrid.c. The tensor/mass part [tet_count] with the gaps between its border's teeth filled, where that takes a
 * fifth of the border's vertices away; else as it is. False: no memory. */
bool tms_hybrid_smooth(const tm_mesh *mesh, uint8_t *alive);

/* hybrid_compliance.c. False: no memory. */
bool tms_hybrid_build_neighbourhood(tm_hybrid *hybrid);
/* As tms_contact_solver.update_neighbourhood. */
void tms_hybrid_estimate_neighbourhood(void *hybrid);

/* How the components of an inside vertex that has a slot follow the interface: [3][interface_count]. */
const double *tms_hybrid_constraint_mode(tm_hybrid *hybrid, int32_t vertex);
/* m/N within a substep, of a component with mass. */
double tms_hybrid_mobility(const tm_hybrid *hybrid, int32_t dof);
/* As tms_contact_solver.compliance. */
void tms_hybrid_compliance(void *hybrid, int32_t a, int32_t b, double C[9]);

/* hybrid_energy.c. False: no memory. */
bool tms_hybrid_make_energy(tm_hybrid *hybrid);
void tms_hybrid_drop_energy(tm_hybrid *hybrid);

/* Of the whole organ, where the tissue was cut. */
void tms_hybrid_rebuild_surface(tm_hybrid *hybrid);
/* What contact keeps from substep to substep: bytes, or what is written. */
int64_t tms_hybrid_snapshot_contact(const tm_hybrid *hybrid, void *buffer);
int64_t tms_hybrid_snapshot_max(const tm_hybrid *hybrid);
/* What contact had kept is its state again. */
void tms_hybrid_rollback(tm_hybrid *hybrid, const void *buffer, int64_t bytes);
/* Takes over the rows of `contact`. */
tm_status tms_hybrid_add_contact(tm_hybrid *hybrid, tm_contact *contact, tm_error *error);

#endif
