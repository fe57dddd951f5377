/* Internals shared by patch*.c. */
#ifndef TM_PATCH_INTERNAL_H
#define TM_PATCH_INTERNAL_H

#include "contact/contact_internal.h"
#include "tensormass/patch.h"

enum { TM_COOKIE_PATCH = 0x70617463 };

/* Maximum compliance of tissue that is held: beyond it there is no equilibrium, so no patch. */
#define TM_PATCH_LOOSE_M_N 1.0

static inline tm_lever tm_patch_lever(const tm_patch *patch, const double tip_m[3]) {
    return patch->is_free ? (tm_lever){.length_m = INFINITY} : tm_lever_at(patch->trocar_m, tip_m);
}

/* patch_solver.c: position_m += sign C force_N. */
void tm_patch_deform(const tm_patch *patch, const double *force_N, double sign, double *position_m);

/* patch_solver.c: returns the index of a mesh vertex in the patch, -1: it is not there. */
int32_t tm_patch_place(const tm_patch *patch, int32_t vertex);

/* patch_solver.c: computes tm_patch_stiffness from the model's own rows. Returns false if the patch is in another
 * equilibrium than the model; the stiffness is then that of the patch. */
bool tm_patch_find_stiffness(tm_patch_solver *solver, const tm_patch *patch, const tm_contact_row *row,
                             int32_t row_count, const double tip_m[3], double stiffness_N_m[9]);

/* Work space for the elimination of a grasp: too large for a stack, so the solver holds it. */
enum { TM_GRASP_DOFS = 3 * TM_GRASP_VERTICES };
typedef struct tm_grasp_work {
    double M[TM_GRASP_DOFS][TM_GRASP_DOFS];     /* compliance of the held vertices and their springs; lower triangle */
    double Y[TM_GRASP_DOFS][TM_PATCH_DOFS + 3]; /* their motion per tip motion and per force on the patch */
} tm_grasp_work;
tm_grasp_work *tm_patch_solver_work(tm_patch_solver *solver);

/* Chooses a patch as tm_patch_choose, among triangles whose vertices are all usable (null: all are). `by_load`: the
 * most loaded come first, at any distance. `*fans`: whether all triangles around the loaded vertices are in the
 * patch. */
int32_t tm_patch_grow(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                      const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                      const tm_contact_row *row, int32_t row_count, int32_t max_vertices, int32_t max_triangles,
                      bool by_load, bool (*usable)(void *self, int32_t vertex), void *self, bool *fans,
                      tm_patch *patch);

/* Finds the surface vertices nearest to the tip's path, nearest first, those of loaded triangles before all others. At
 * most TM_COMPLIANCE_REQUEST_MAX, none farther than 40 mm. `inner` (may be null): masses [vertex_count]. With it, all
 * vertices with mass count as surface, as the next cut may expose them. Returns the count. */
int32_t tm_patch_nearest(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                         const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                         const tm_contact_row *row, int32_t row_count, const double *inner, int32_t vertex_count,
                         int32_t vertex[TM_COMPLIANCE_REQUEST_MAX]);

typedef struct tm_columns tm_columns;
typedef struct tm_patch_behind tm_patch_behind;
struct tm_patch_builder {
    tm_pool pool;
    tm_patch_def def;
    tm_contact *contact;
    tm_world *world;
    tm_columns *columns; /* null with a source */
    tm_compliance_source source;
    tm_patch_behind *behind; /* null: the world has no stage "touch", or columns come from conjugate gradients */
    int32_t behind_count;    /* vertices of its rows, which a request contains after those of the patch */
    const int32_t *behind_vertex;
    tm_patch_surface surface;           /* view null: the tissue's */
    const tm_compliance *columns_known; /* last result of the source */
    bool corotated;                     /* the law of the world is nonlinear */
    tm_patch_solver *solver;
    int32_t revision;
    int32_t missing[TM_MAX_INSTRUMENTS]; /* with a source: requested vertices without a column, or with an old one */
    double tip_m[TM_MAX_INSTRUMENTS][3], velocity_m_s[TM_MAX_INSTRUMENTS][3], time_s[TM_MAX_INSTRUMENTS];
};

/* --- patch_known.c: surface and known compliance of an instrument --- */

tm_surface_view tm_patch_surface_of(const tm_patch_builder *builder);
/* Chooses the instrument's patch regardless of known columns, and requests its columns, those of held vertices
 * first. */
void tm_patch_want(tm_patch_builder *builder, int32_t t, const int32_t *fixed, int32_t count, tm_patch *patch);
/* Keeps the chosen patch, or reduces it. Returns false if neither is completely known. */
bool tm_patch_find_known(tm_patch_builder *builder, int32_t t, int32_t max_vertices, double held_N, tm_patch *patch);
/* Returns whether the column of a vertex is there, and supports or other tissue hold the vertex. */
bool tm_patch_is_known(const tm_patch_builder *builder, int32_t vertex);
/* Returns tm_patch.kind by the source of the compliance. */
int32_t tm_patch_known_kind(const tm_patch_builder *builder);

/* --- patch_columns.c: entries of the known compliance --- */

/* Returns the index of a vertex in the result of the source, -1: it is not there. */
int32_t tm_patch_column_of(const tm_compliance *known, int32_t vertex);
/* Returns whether a diagonal entry is at least `limit_m_N`. */
bool tm_patch_is_beyond(const tm_compliance *known, int32_t at, double limit_m_N);
/* Returns whether the column of a vertex is there. */
bool tm_patch_has_column(const tm_patch_builder *builder, int32_t vertex);
/* tm_patch_block for the known compliance; self: the builder. */
bool tm_patch_known_block(void *self, int32_t a, int32_t b, double C[9]);

/* --- patch_behind.c: tissue that the tissue under the tool rests on --- */

/* Returns null if the world has no stage "touch". */
tm_patch_behind *tm_patch_behind_create(tm_pool *pool, tm_world *world);
/* Chooses the rows that bear most, as far as a request has room for their vertices. Returns the count of the
 * vertices. */
int32_t tm_patch_behind_choose(tm_patch_behind *behind, const int32_t **vertex);
/* Eliminates those chosen rows whose columns are known. Returns false if they have no Cholesky factor. */
bool tm_patch_behind_prepare(tm_patch_behind *behind, const tm_patch_builder *builder);
/* Returns whether the rows hold a vertex of tissue without supports. */
bool tm_patch_behind_holds(const tm_patch_builder *builder, int32_t vertex);
/* tm_patch_block for the known compliance with the rows behind; self: the builder. */
bool tm_patch_coupled_block(void *self, int32_t a, int32_t b, double C[9]);

/* compliance_cg.c: columns of the quasi-static compliance, computed incrementally and stored. */
tm_columns *tm_columns_create(tm_pool *pool, tm_world *world, int32_t vertices, double tolerance);
/* Requests the columns of these vertices, most urgent first; others may be discarded for them. A patch needs the first
 * `needed`; the others may be needed soon. `owner` is an instrument. */
void tm_columns_want(tm_columns *columns, int32_t owner, const int32_t *vertex, int32_t needed, int32_t count);
/* Runs at most so many iterations. */
void tm_columns_work(tm_columns *columns, int32_t iterations);
/* Handles a cut: present columns remain in use until they are renewed. */
void tm_columns_cut(tm_columns *columns);
/* Returns how far columns of an earlier tangent are from the newest one (tm_patch.age); 0 once all are of that. */
double tm_columns_age(const tm_columns *columns);
bool tm_columns_good(const tm_columns *columns, int32_t vertex);
int32_t tm_columns_pending(const tm_columns *columns);
bool tm_columns_block(const tm_columns *columns, int32_t a, int32_t b, double C[9]);

/* compliance_coarse.c: inverse of a vertex tensor between its free components, zero elsewhere. */
void tm_vertex_inverse(const double tensor[9], const uint8_t fixed[3], double inverse[9]);
/* compliance_coarse.c: coarse correction of a preconditioner. */
typedef struct tm_coarse tm_coarse;
struct tm_force_graph;
tm_coarse *tm_coarse_create(tm_pool *pool, const tm_mesh *mesh);
/* Computes it for the tensors of a graph. fixed: [3*vertex_count]. */
void tm_coarse_refresh(tm_coarse *coarse, const struct tm_force_graph *graph, const uint8_t *fixed);
/* Computes z = M^-1 r: inverse vertex tensors [9*vertex_count] and the correction. r is zero at fixed components. */
void tm_precondition(tm_coarse *coarse, const double *inverse, const uint8_t *fixed, const double *r, double *z);

#endif
