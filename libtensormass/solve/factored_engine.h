/* Shared by factored_engine.c and factored_cut.c. */
#ifndef TMS_FACTORED_ENGINE_H
#define TMS_FACTORED_ENGINE_H

#include "factored.h"

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
bool tms_engine_part(const tms_engine *e, const uint8_t *alive, tm_tissue **part);
/* Takes note of what lives now. False: too much has gone, something came back, or now is the time: a new factor is
 * called for. */
bool tms_engine_follow(tms_engine *e, const uint8_t *alive);
/* D := the stiffness that left with the cut tetrahedra, among the touched vertices. */
bool tms_engine_cut_stiffness(tms_engine *e);

#endif
