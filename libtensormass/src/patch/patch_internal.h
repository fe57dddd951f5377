/* Shared by patch*.c. */
#ifndef TM_PATCH_INTERNAL_H
#define TM_PATCH_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/patch.h"

enum { TM_COOKIE_PATCH = 0x70617463 };

/* patch_force.c: position_m += sign C force_N. */
void tm_patch_deform(const tm_patch *patch, const double *force_N, double sign, double *position_m);

/* patch_force.c: where a vertex of the mesh stands in the patch, -1: it does not. */
int32_t tm_patch_place(const tm_patch *patch, int32_t vertex);

/* patch_force.c: what is solved next goes on from the reactions that the model itself found. Where the tissue has
 * several rests under one tool, those of the frame before may lead to another one. */
void tm_patch_solver_start(tm_patch_solver *solver, const tm_patch *patch, const tm_contact_row *row,
                           int32_t row_count);

/* Where a hold is eliminated: too large for a stack, so it lies in the solver. */
enum { TM_HOLD_DOFS = 3 * TM_HOLD_VERTICES };
typedef struct tm_hold_work {
    double M[TM_HOLD_DOFS][TM_HOLD_DOFS];      /* compliance of the held vertices and their springs; lower triangle */
    double Y[TM_HOLD_DOFS][TM_PATCH_DOFS + 3]; /* what the tip, and forces on the patch, do to them */
} tm_hold_work;
tm_hold_work *tm_patch_solver_work(tm_patch_solver *solver);

/* tm_patch_choose among triangles whose vertices are all usable (null: all are). */
int32_t tm_patch_grow(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                      const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                      const tm_contact_row *row, int32_t row_count, int32_t max_vertices, int32_t max_triangles,
                      bool (*usable)(void *self, int32_t vertex), void *self, tm_patch *patch);

/* Vertices of the surface nearest to the tip's way, nearest first, those of pressed triangles before all others; at
 * most TM_COMPLIANCE_WANTS, none farther than 40 mm. `inner` (may be null): [vertex_count] masses: all that have one
 * count as surface, as the next cut may make them. Returns how many. */
int32_t tm_patch_nearest(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                         const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                         const tm_contact_row *row, int32_t row_count, const double *inner, int32_t vertex_count,
                         int32_t vertex[TM_COMPLIANCE_WANTS]);

/* patch_columns.c: columns of the quasi-static compliance, computed little by little and remembered. */
typedef struct tm_columns tm_columns;
tm_columns *tm_columns_create(tm_pool *pool, tm_world *world, int32_t vertices, double tolerance);
/* These vertices' columns are needed from now on, most urgent first; others may be forgotten for them. Owner: one of
 * few. */
void tm_columns_want(tm_columns *columns, int32_t owner, const int32_t *vertex, int32_t count);
/* At most so many iterations. */
void tm_columns_work(tm_columns *columns, int32_t iterations);
/* The tissue was cut: what is there is a first guess from now on. */
void tm_columns_cut(tm_columns *columns);
bool tm_columns_good(const tm_columns *columns, int32_t vertex);
int32_t tm_columns_pending(const tm_columns *columns);
bool tm_columns_block(const tm_columns *columns, int32_t a, int32_t b, double C[9]);

#endif
