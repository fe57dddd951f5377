/* Exact compliance of a tissue that is being cut, little by little: one factor, what was cut since as an update of low
 * rank. */
#ifndef TMS_FACTORED_H
#define TMS_FACTORED_H

#include "internal.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TMS_RESULT_VERTICES = TM_MAX_INSTRUMENTS * TM_COMPLIANCE_REQUEST_MAX, /* handed over at a time */
    TMS_TOUCHED_VERTICES = 160, /* of tetrahedra cut since the factor: with more it is made anew */
    TMS_SLOTS = 2 * TMS_RESULT_VERTICES + TMS_TOUCHED_VERTICES
};

/* What the simulation asks for: the tissue as it is, and the vertices whose compliance the patches need. */
typedef struct tms_compliance_request {
    int64_t frame; /* counted by the wishes */
    int32_t revision;
    uint8_t *alive; /* [tet_count] */
    double *u_m;    /* [3*vertex_count] of tissue that turns, else null */
    int32_t count[TM_MAX_INSTRUMENTS], needed[TM_MAX_INSTRUMENTS],
        vertex[TM_MAX_INSTRUMENTS][TM_COMPLIANCE_REQUEST_MAX];
} tms_compliance_request;

/* What it gets: `is` points into the other two. */
typedef struct tms_compliance_result {
    tm_compliance is;
    int32_t vertex[TMS_RESULT_VERTICES];
    double *C_m_N;                         /* [(3*TMS_RESULT_VERTICES)^2] */
    double frame[9 * TMS_RESULT_VERTICES]; /* of tissue that turns: each vertex's rotation in the state that C is of */
} tms_compliance_result;

typedef struct tms_engine tms_engine;
/* Takes all memory but the factor's. `tissue` is read for its mesh, materials and fibres alone, which never change.
 * fixed [3*vertex_count], copied. */
tms_engine *tms_engine_create(const tm_tissue *tissue, const uint8_t *fixed, bool turns);
void tms_engine_destroy(tms_engine *engine);
int64_t tms_engine_bytes(const tms_engine *engine);
/* Goes one bounded way towards the wish (a factor, or one block of columns) and, when all that is needed is there,
 * writes it into `piece`, exact for wish->revision; of the other wanted vertices those that are there (`needed_only`:
 * none). False: it is not there yet, and `*more` tells whether another call would bring something. */
bool tms_engine_advance(tms_engine *engine, const tms_compliance_request *request, bool needed_only,
                        tms_compliance_result *result, bool *more);

/* factored_engine.c: R of F = R S, F the mean deformation of the living tetrahedra around the vertex. */
void tms_vertex_frame(const tm_mesh *mesh, const uint8_t *alive, const double *u_m, int32_t vertex, double R[9]);

/* factored_update.cpp: with Z = K^-1 E the columns of the touched components and D the stiffness that was cut off them,
 * (K - E D E^T)^-1 = K^-1 + Z (I - D E^T Z)^-1 D Z^T (Woodbury). G [size][size] row-major: K^-1 among all slots;
 * touched [t], wanted [w]: rows of it; D [t][t]. M [t][t], pivot [t] := L U of the middle. */
bool tms_update_middle(const double *G, int32_t size, const int32_t *touched, int32_t t, const double *D, double *M,
                       int32_t *pivot);
/* X [.][t], row column[j] := (I - D E^T Z)^-1 D Z^T of that slot component. */
bool tms_update_columns(const double *G, int32_t size, const int32_t *column, int32_t count, const int32_t *touched,
                        int32_t t, const double *D, const double *M, const int32_t *pivot, double *X);
/* C [w][w] := G among the wanted, and the update of the touched (t may be 0), whose columns are in X. False: no
 * memory, or no numbers. */
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
    double *at_m;         /* [3*vertex_count] displacement that the factor is of; null: the tissue does not turn */
    double moved_on_m;    /* a factor farther away is an old one */
    int64_t frame;        /* of the wish that the factor was made for */
    uint8_t *base, *gone; /* [tet_count] alive in the factor; cut since, at the last wish */
    tms_system system;
    tms_solver *solver;
    tms_reach *reach;
    double *column; /* [3*TMS_SLOTS][TMS_BLOCK] as they are solved */
    bool ready;     /* there is a factor */
    bool broken;    /* there can be none: no memory, or a mechanism */
    tms_slot slot[TMS_SLOTS];
    int32_t *slot_of; /* [vertex_count] -1: none */
    double *G;        /* [3*TMS_SLOTS][3*TMS_SLOTS] compliance of the factor's tissue among the slots */
    int64_t clock;
    int32_t calm;                                         /* calls since the last cut */
    int32_t touched_count, touched[TMS_TOUCHED_VERTICES]; /* vertices of `gone` */
    bool middle_known;
    double *D, *M;         /* [3*touched][3*touched] */
    int32_t pivot[MIDDLE]; /* of M */
    double *X;             /* [3*TMS_SLOTS][3*touched] what the cut adds to the slots' columns */
};

/* factored_cut.c: the tissue of these tetrahedra, where it turns with the tensors of the factor's state. */
bool tms_engine_partial_tissue(const tms_engine *e, const uint8_t *alive, tm_tissue **part);
/* Takes note of what lives now. False: too much has gone, something came back, or now is the time: a new factor is
 * called for. */
bool tms_engine_follow(tms_engine *e, const uint8_t *alive);
/* D := the stiffness that left with the cut tetrahedra, among the touched vertices. */
bool tms_engine_cut_stiffness(tms_engine *e);

#endif
