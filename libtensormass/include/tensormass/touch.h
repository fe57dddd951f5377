/* Contact of tissue with tissue: bodies that touch each other, folds and cut lips that touch themselves. One stage,
 * "touch": vertices against faces and edges against edges of the surface as cuts leave it (docs/bodies.md, "Contact").
 * Add it after contact, if there is any: both are then swept together. */
#ifndef TENSORMASS_TOUCH_H
#define TENSORMASS_TOUCH_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tm_touching tm_touching;

enum { TM_MAX_BODIES = 32 };

typedef struct tm_touching_def {
    uint32_t cookie, size;
    int32_t body_count;      /* 1 */
    const int32_t *tet_body; /* [tet_count] body of each tetrahedron, copied; null: all 0 */
    /* [body_count*body_count], symmetric: whether two bodies touch; on the diagonal, whether a body touches itself.
     * Copied; null: all pairs, and each body itself. */
    const uint8_t *pair;
    /* Thickness of the gap at which surfaces begin to touch, m; 0.5e-3. Less between surfaces that are closer at rest:
     * half of their rest distance in one body, all of it between two. */
    double thickness_m;
    double compliance_m_N; /* of each vertex or pair of edges; 0.5e-3. Stiffer by 20 beyond 0.3 thicknesses, by 400
                              beyond 0.8 */
    double mu_static, mu_kinetic; /* Coulomb friction, 0: none */
    int32_t sweeps;               /* 10; with contact, contact's */
    int32_t max_rows;             /* 4096 */
    int32_t max_candidates;       /* pairs of features that are close; 0: 65,536 */
    double force_cap_N;           /* of a row; 50 */
} tm_touching_def;

/* A row: a vertex against a face (vertex[0] against the others), or an edge against an edge (vertex[2], vertex[3]
 * against vertex[0], vertex[1]). The force on vertex[j] is weight[j] times `lambda_N` times `normal`, and
 * weight[j] times `across_N`. The weights sum to 0. */
typedef struct tm_touching_row {
    int32_t edges; /* 0: vertex and face; 1: two edges */
    int32_t a, b;  /* vertex and face (4*tet + local vertex), or the mesh's edges, a < b */
    int32_t vertex[4];
    double weight[4];
    double normal[3];
    double thickness_m; /* of this pair */
    double gap_m;       /* distance less the thickness, at the start of the substep */
    double lambda_N;
    double across_N[3]; /* viscous drag and friction */
} tm_touching_row;

typedef struct tm_touching_report {
    int32_t rows, candidates; /* of the last substep */
    int64_t gathers;          /* searches of the complete surface since the stage was added */
    bool overflowed;          /* rows or candidates were dropped since the stage was added */
    /* Deepest overlap at the start of the last substep, m, of rows and of the vertices found inside another body: 0,
     * none known. Features deeper than a thickness are known once a vertex of theirs was checked
     * (docs/bodies.md#contact). */
    double deepest_m;
} tm_touching_report;

TM_API tm_touching_def tm_touching_def_default(void);
TM_API tm_status tm_stage_touch(tm_world *world, const tm_touching_def *def, tm_touching **touching, tm_error *error);
/* Returns the world's stage "touch", or null. */
TM_API tm_touching *tm_world_touching(tm_world *world);
/* Returns the rows of the last substep; valid until the next. */
TM_API int32_t tm_touching_rows(const tm_touching *touching, const tm_touching_row **row);
TM_API tm_touching_report tm_touching_get_report(const tm_touching *touching);

#ifdef __cplusplus
}
#endif
#endif
