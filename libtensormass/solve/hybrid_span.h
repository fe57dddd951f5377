/* Between two solutions of contact in full: rows that keep their normals and shares. See hybrid_span.c. */
#ifndef TMS_HYBRID_SPAN_H
#define TMS_HYBRID_SPAN_H

#include "local.h"

/* --- few rows whose normals and shares are given: how hard each presses --- */

enum { TMS_SPAN_ROWS = 64 };

typedef struct tms_span_system {
    int32_t count;
    double cap_N;
    double give[TMS_SPAN_ROWS][TMS_SPAN_ROWS]; /* m/N: of row i's gap by the force of row j */
    double gap_m[TMS_SPAN_ROWS];               /* without any of these forces */
    double skin_m_N[TMS_SPAN_ROWS], radius_m[TMS_SPAN_ROWS];
    double lambda_N[TMS_SPAN_ROWS]; /* in: a guess; out: what each bears */
    double matrix[TMS_SPAN_ROWS * TMS_SPAN_ROWS], off_N[TMS_SPAN_ROWS];
    int32_t pivot[TMS_SPAN_ROWS];
} tms_span_system;

/* lambda = what its skin bears at the gap that all of them leave it, of every row at once. False: not found. */
bool tms_span_solve(tms_span_system *system);
/* The gap of row i with the forces in lambda_N. */
double tms_span_gap(const tms_span_system *system, int32_t i);

struct tm_hybrid;

enum { TMS_SPAN_MOST = 32 }; /* substeps */

/* How a tool is followed. */
enum {
    TMS_TOOL_FROZEN = 0,  /* its rows, if it has any, are on condensed tissue, and stay */
    TMS_TOOL_WATCHED = 1, /* on what has mass: looked for in every substep */
    TMS_TOOL_NONE = 2     /* it cannot touch */
};

typedef struct tms_span {
    /* what lasts from substep to substep */
    int32_t age, limit; /* substeps since the full solution, -1: none; how long it may be followed */
    int32_t length;     /* that spans have come to by how the force jumps where they end */
    int32_t most;       /* that this one may have, whatever the force does */
    int32_t kind[TM_MAX_INSTRUMENTS];
    double at_m[TM_MAX_INSTRUMENTS][6]; /* tip and tail of each tool then */
    double room_m[TM_MAX_INSTRUMENTS];  /* how far it may go from there */
    double swell[TM_MAX_INSTRUMENTS];   /* of a frozen tool's rows: how much more they bear with each substep, */
    double drift[TM_MAX_INSTRUMENTS];   /* and how much it was over the last span */
    int32_t frozen_count;
    int32_t frozen[TMS_SPAN_ROWS];  /* of local.before's row i: which of the frozen ones it is; -1: none */
    double offset_m[TMS_SPAN_ROWS]; /* of a frozen row: its gap with the station and the border at 0 and no forces */
    /* what is made of that */
    double *follow; /* [TMS_SPAN_ROWS][interface_count] how a frozen row's gap follows the border */
    double give[TMS_SPAN_ROWS][TMS_SPAN_ROWS]; /* m/N, of frozen rows */
    double *push_N;                            /* [interface_count] by all frozen rows, of the last substep */
    bool passed;                               /* a row was passed over: its vertices are in the jaws of its tool */
    int32_t whole_count;                       /* tetrahedra with mass, before any cut */
    bool cut;
    /* scratch */
    int32_t frozen_now[TMS_SPAN_ROWS];
    double offset_now_m[TMS_SPAN_ROWS];
    tms_span_system system;
} tms_span;

/* A span that ends: how long it was followed, and what it came to. */
typedef struct tms_span_past {
    int32_t age;
    double swell[TM_MAX_INSTRUMENTS], force_N[TM_MAX_INSTRUMENTS][3];
} tms_span_past;

/* False: no memory. */
bool tms_span_create(struct tm_hybrid *hybrid);
void tms_span_destroy(struct tm_hybrid *hybrid);
int64_t tms_span_bytes(const struct tm_hybrid *hybrid);
/* The next solution is a full one, and so is the one after it. */
void tms_span_forget(struct tm_hybrid *hybrid);
/* A substep on the rows there are: forces, rows and their sums in the on-line system. False: it cannot be followed, and
 * but for scratch nothing has changed. */
bool tms_span_follow(struct tm_hybrid *hybrid);
/* A full solution is due, even if this substep can be followed. */
bool tms_span_is_over(const struct tm_hybrid *hybrid);
/* What frozen rows are made of besides their offsets, by the on-line system's compliances. */
void tms_span_make(struct tm_hybrid *hybrid);
/* Where the row's station is now, and how far that is along its normal. */
double tms_span_station(const tms_local *local, const tm_contact_row *row, double point_m[3]);
/* The forces of a step followed, let into the coming positions. */
void tms_span_move(struct tm_hybrid *hybrid);
/* After a full solution; `swept`: by sweeps of rows that are not its shape's. */
void tms_span_begin(struct tm_hybrid *hybrid, bool swept);
/* Of what was followed up to now, and then in the same substep began anew: how long spans may be, and how forces go on
 * in the one that has begun. */
tms_span_past tms_span_past_of(const struct tm_hybrid *hybrid);
void tms_span_judge(struct tm_hybrid *hybrid, const tms_span_past *past);

/* As the hooks of a stage want it, in front of what the on-line system keeps; `forgotten` as there. Restored when
 * that is. */
int64_t tms_span_snapshot(const struct tm_hybrid *hybrid, bool forgotten, void *buffer);
int64_t tms_span_snapshot_most(const struct tm_hybrid *hybrid);
/* Bytes of the part that begins a buffer; -1: it is none. */
int64_t tms_span_snapshot_bytes(const struct tm_hybrid *hybrid, const void *buffer, int64_t bytes);
void tms_span_restore(struct tm_hybrid *hybrid, const void *buffer);

#endif
