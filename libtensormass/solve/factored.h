/* Exact compliance of a tissue that is being cut, little by little: one factor, what was cut since as an update of low
 * rank. */
#ifndef TMS_FACTORED_H
#define TMS_FACTORED_H

#include "internal.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TMS_PIECE_VERTICES = TM_MAX_INSTRUMENTS * TM_COMPLIANCE_WANTS, /* handed over at a time */
    TMS_TOUCHED_VERTICES = 160, /* of tetrahedra cut since the factor: with more it is made anew */
    TMS_SLOTS = 2 * TMS_PIECE_VERTICES + TMS_TOUCHED_VERTICES
};

/* What the simulation asks for: the tissue as it is, and the vertices whose compliance the patches need. */
typedef struct tms_wish {
    int64_t frame; /* counted by the wishes */
    int32_t revision;
    uint8_t *alive; /* [tet_count] */
    double *u_m;    /* [3*vertex_count] of tissue that turns, else null */
    int32_t count[TM_MAX_INSTRUMENTS], needed[TM_MAX_INSTRUMENTS], vertex[TM_MAX_INSTRUMENTS][TM_COMPLIANCE_WANTS];
} tms_wish;

/* What it gets: `is` points into the other two. */
typedef struct tms_piece {
    tm_compliance is;
    int32_t vertex[TMS_PIECE_VERTICES];
    double *C_m_N;                        /* [(3*TMS_PIECE_VERTICES)^2] */
    double frame[9 * TMS_PIECE_VERTICES]; /* of tissue that turns: each vertex's rotation in the state that C is of */
} tms_piece;

typedef struct tms_engine tms_engine;
/* Takes all memory but the factor's. `tissue` is read for its mesh, materials and fibres alone, which never change.
 * fixed [3*vertex_count], copied. */
tms_engine *tms_engine_create(const tm_tissue *tissue, const uint8_t *fixed, bool turns);
void tms_engine_destroy(tms_engine *engine);
int64_t tms_engine_bytes(const tms_engine *engine);
/* Goes one bounded way towards the wish (a factor, or one block of columns) and, when all that is needed is there,
 * writes it into `piece`, exact for wish->revision; of the other wanted vertices those that are there (`needed_only`:
 * none). False: it is not there yet, and `*more` tells whether another call would bring something. */
bool tms_engine_serve(tms_engine *engine, const tms_wish *wish, bool needed_only, tms_piece *piece, bool *more);

/* vertex_frame.c: R of F = R S, F the mean deformation of the living tetrahedra around the vertex. */
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
bool tms_update_piece(const double *G, int32_t size, const int32_t *wanted, int32_t w, const int32_t *touched,
                      int32_t t, const double *X, double *C);

#ifdef __cplusplus
}
#endif
#endif
