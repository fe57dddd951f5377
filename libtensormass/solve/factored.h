/* Exact compliance of tissue that is cut step by step: one factor, with the cuts since then as a low-rank update. */
#ifndef TMS_FACTORED_H
#define TMS_FACTORED_H

#include "internal.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TMS_RESULT_VERTICES = TM_MAX_INSTRUMENTS * TM_COMPLIANCE_REQUEST_MAX, /* maximum per result */
    TMS_TOUCHED_VERTICES = 160, /* of tetrahedra cut since the factor: more require a new factor */
    TMS_SLOTS = 2 * TMS_RESULT_VERTICES + TMS_TOUCHED_VERTICES
};

/* Request of the simulation: the present tissue, and the vertices whose compliance the patches need. */
typedef struct tms_compliance_request {
    int64_t frame; /* number of the request */
    int32_t revision;
    uint8_t *alive; /* [tet_count] */
    double *u_m;    /* [3*vertex_count] for rotating tissue or a nonlinear law, else null */
    int32_t count[TM_MAX_INSTRUMENTS], needed[TM_MAX_INSTRUMENTS],
        vertex[TM_MAX_INSTRUMENTS][TM_COMPLIANCE_REQUEST_MAX];
} tms_compliance_request;

/* Result; `is` points into the other members. */
typedef struct tms_compliance_result {
    tm_compliance is;
    int32_t vertex[TMS_RESULT_VERTICES];
    double *C_m_N;                         /* [(3*TMS_RESULT_VERTICES)^2] */
    double frame[9 * TMS_RESULT_VERTICES]; /* for rotating tissue: each vertex's rotation in the state of C */
} tms_compliance_result;

typedef struct tms_engine tms_engine;
/* Allocates all memory except the factor's. Reads only mesh, materials and fibres of `tissue`, which never change.
 * Copies fixed [3*vertex_count]. */
tms_engine *tms_engine_create(const tm_tissue *tissue, const uint8_t *fixed, bool turns);
void tms_engine_destroy(tms_engine *engine);
int64_t tms_engine_bytes(const tms_engine *engine);
/* Does one bounded part of a request: a factor, or one block of columns. Once all needed vertices are available, writes
 * `result`, exact for request->revision. It includes other requested vertices that are available (`needed_only`: none).
 * Returns false if it is not complete yet; `*more` tells whether another call would help. */
bool tms_engine_advance(tms_engine *engine, const tms_compliance_request *request, bool needed_only,
                        tms_compliance_result *result, bool *more);

/* factored_frame.c: computes R of F = R S, F the mean deformation of the active tetrahedra around the vertex. */
void tms_vertex_frame(const tm_mesh *mesh, const uint8_t *alive, const double *u_m, int32_t vertex, double R[9]);

/* factored_update.cpp: let Z = K^-1 E be the columns of the touched components and D the stiffness that the cut
 * removed. Then (K - E D E^T)^-1 = K^-1 + Z (I - D E^T Z)^-1 D Z^T (Woodbury). G [size][size] row-major: K^-1 among all
 * slots; touched [t], wanted [w]: its rows; D [t][t]. M [t][t], pivot [t] := L U of the middle factor. */
bool tms_update_middle(const double *G, int32_t size, const int32_t *touched, int32_t t, const double *D, double *M,
                       int32_t *pivot);
/* X [.][t], row column[j] := (I - D E^T Z)^-1 D Z^T of that slot component. */
bool tms_update_columns(const double *G, int32_t size, const int32_t *column, int32_t count, const int32_t *touched,
                        int32_t t, const double *D, const double *M, const int32_t *pivot, double *X);
/* C [w][w] := G among the wanted, plus the update by the touched (t may be 0), whose columns are in X. Returns false if
 * memory is exhausted or a value is not finite. */
bool tms_update_result(const double *G, int32_t size, const int32_t *wanted, int32_t w, const int32_t *touched,
                       int32_t t, const double *X, double *C);

#ifdef __cplusplus
}
#endif

/* --- shared by factored_engine.c and factored_cut.c --- */

typedef struct tms_slot {
    int32_t vertex; /* -1: free */
    int64_t wanted_at;
    bool updated; /* X has its rows */
} tms_slot;

enum { WIDTH = 3 * TMS_SLOTS, MIDDLE = 3 * TMS_TOUCHED_VERTICES };

struct tms_engine {
    const tm_tissue *tissue; /* mesh, materials, fibres */
    int32_t vertex_count, tet_count;
    uint8_t *fixed;       /* [3*vertex_count] */
    double *at_m;         /* [3*vertex_count] displacement of the factor's state; null: the tissue does not rotate */
    bool has_law;         /* the tissue has a nonlinear law */
    bool definite;        /* the complete tangent was not: the factor has each tetrahedron's semidefinite part */
    double *looked_m;     /* [3*vertex_count] displacement at the last comparison; null: no nonlinear law */
    double age;           /* tm_compliance.age at the last comparison */
    double moved_on_m;    /* displacement beyond which a factor is outdated */
    int64_t frame;        /* of the request that the factor was made for */
    uint8_t *base, *gone; /* [tet_count] active in the factor; cut since, at the last request */
    tms_system system;
    tms_solver *solver;
    tms_reach *reach;
    double *column; /* [3*TMS_SLOTS][TMS_BLOCK] while they are solved */
    bool ready;     /* a factor is available */
    bool broken;    /* no factor is possible: no memory, or a mechanism */
    tms_slot slot[TMS_SLOTS];
    int32_t *slot_of; /* [vertex_count] -1: none */
    double *G;        /* [3*TMS_SLOTS][3*TMS_SLOTS] compliance of the factor's tissue among the slots */
    int64_t clock;
    int32_t calm;                                         /* calls since the last cut */
    int32_t touched_count, touched[TMS_TOUCHED_VERTICES]; /* vertices of `gone` */
    bool middle_known;
    double *D, *M;         /* [3*touched][3*touched] */
    int32_t pivot[MIDDLE]; /* of M */
    double *X;             /* [3*TMS_SLOTS][3*touched] update of the slots' columns by the cut */
};

/* factored_cut.c: builds a tissue of these tetrahedra; with u_m, with the tensors of that state. */
bool tms_engine_partial_tissue(const tms_engine *e, const uint8_t *alive, const double *u_m, tm_tissue **part);
/* factored_age.c: compares the compliance of the factor with that of the tangent at the request's state, for forces
 * on the first needed vertices; cuts since the factor are left out. Returns the largest relative difference. */
double tms_engine_age(const tms_engine *e, const tms_compliance_request *request);
/* Returns whether a factor of tissue with a nonlinear law is to be renewed: its compliance decides, not the motion. */
bool tms_engine_has_aged(tms_engine *e, const tms_compliance_request *request);
/* Updates the set of cut tetrahedra. Returns false if a new factor is needed: too many are cut, one was restored, or
 * now is a good time. */
bool tms_engine_follow(tms_engine *e, const uint8_t *alive);
/* D := the stiffness of the cut tetrahedra, among the touched vertices. */
bool tms_engine_cut_stiffness(tms_engine *e);

#endif
