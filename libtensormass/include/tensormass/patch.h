/* What a controller needs to feel the tissue between two force samples: the contact stiffness dF/dP, and the patch of
 * surface near the tool with its compliance. Needs nothing of the model but positions and compliance, so that all
 * models share it. */
#ifndef TENSORMASS_PATCH_H
#define TENSORMASS_PATCH_H

#include "contact.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_PATCH_VERTICES 24
#define TM_PATCH_TRIANGLES 32
#define TM_PATCH_DOFS (3 * TM_PATCH_VERTICES)
#define TM_PATCH_COMPLIANCE (TM_PATCH_DOFS * (TM_PATCH_DOFS + 1) / 2)

/* As contact_patch_t.lcm has it, but in double and in world coordinates. */
typedef struct tm_patch {
    int32_t kind; /* 1 estimated, 2 exact */
    int32_t instrument;
    int32_t topology_revision;
    int32_t vertex_count, triangle_count;
    int32_t vertex[TM_PATCH_VERTICES];          /* numbers in the mesh */
    int32_t face[TM_PATCH_TRIANGLES];           /* persistent ids, ascending */
    int8_t triangle[3 * TM_PATCH_TRIANGLES];    /* into vertex, normal outward */
    double vertex_m[TM_PATCH_DOFS];             /* positions without this tool's contact */
    double rest_m[TM_PATCH_DOFS];               /* undeformed: tells which normals blend */
    double compliance_m_N[TM_PATCH_COMPLIANCE]; /* upper triangle, row by row, of the symmetric (3*vertex_count)^2
                                                   matrix */
    double contact_compliance_m_N, force_cap_N;
    double radius_m, contact_length_m;
    double drag_s_m; /* 0.3 where the model has a film, 0 where it has none (precomputed, hybrid) */
    /* What waves carry off, of a model whose tissue has mass: a dashpot on the tool's speed along the force (of what
     * jaws hold: on its speed), less its mean over radiation_s. */
    double radiation_N_s_m, radiation_s;
    double trocar_m[3];
    /* What a grasper holds, folded in: vertex_m and compliance_m_N are of the tissue as the jaws hold it, and follow
     * the tip. */
    bool grasps;
    uint32_t grasped;              /* bit v: vertex v is between the jaws: rows on such alone are no obstacle */
    double grasp_tip_m[3];         /* the tip that vertex_m and grasp_N are of */
    double grasp_N[3];             /* of the hold on the tool, equivalent at the tip, without rows of contact */
    double grasp_stiffness_N_m[9]; /* its derivative by the tip: symmetric, negative semidefinite */
    double dvertex_dtip[3 * TM_PATCH_DOFS]; /* derivative of vertex_m by the tip, [3*vertex_count][3], 1; by its
                                         transpose rows' forces on the vertices pass to the tool */
    /* Of the instrument (tensormass/friction.h), 0 without: for the controller, whose law rubs; tm_patch_force and
     * tm_patch_stiffness do not. */
    double friction_static, friction_kinetic;
} tm_patch;

/* Entry of the compliance matrix, 0 <= i, j < 3*vertex_count. */
TM_API double tm_patch_compliance(const tm_patch *patch, int32_t i, int32_t j);

/* Chooses vertices and triangles (and fills vertex, face, triangle, rest_m, and vertex_m with the positions as they
 * are): a connected piece grown from the triangle nearest to the tip's way over the coming `horizon_s` at
 * `velocity_m_s`; triangles of `row` (may be null) come first. At most max_vertices (3..24) and max_triangles (1..32).
 * Returns the number of triangles, 0 if none is within 20 mm. Allocates nothing. */
TM_API int32_t tm_patch_choose(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                               const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                               const tm_contact_row *row, int32_t row_count, int32_t max_vertices,
                               int32_t max_triangles, tm_patch *patch);

/* Fills the compliance from C (blocks 3x3 of vertex a by forces on vertex b, m/N, row-major), made symmetric and
 * positive semidefinite within rounding of a float, and takes from vertex_m what this tool's rows make of them:
 * vertex_m -= C f. False: some block is not known, or they make no such matrix. */
typedef bool (*tm_patch_block)(void *self, int32_t a, int32_t b, double C[9]);
TM_API bool tm_patch_fill(tm_patch *patch, tm_patch_block block, void *self, const tm_contact_row *row,
                          int32_t row_count);

/* Takes from vertex_m, and from grasp_N, what the force of friction on the tissue at a row makes of them; a row that
 * bears on other vertices is left with the tissue. After tm_patch_fill or tm_patch_fill_grasped, once for each row that
 * rubs. */
TM_API void tm_patch_remove_friction(tm_patch *patch, const tm_contact_row *row, const double force_N[3]);

/* More than a fifth of what the patch's tool bears (rows, and `held_N` of a hold), and more than 0.01 N, is on vertices
 * that are not the patch's: what is left of it would not be the tool's force. */
TM_API bool tm_patch_has_outside_load(const tm_patch *patch, double held_N, const tm_contact_row *row,
                                      int32_t row_count);

/* Contact solved against a patch: what the controller does in its ticks, here in double and to convergence. */
typedef struct tm_patch_solver tm_patch_solver;
TM_API tm_status tm_patch_solver_create(tm_patch_solver **solver, tm_error *error);
TM_API void tm_patch_solver_destroy(tm_patch_solver *solver);

/* Springs from points of a tool to vertices, as the jaws of a grasper hold them. */
enum { TM_GRASP_VERTICES = 48 };
typedef struct tm_patch_grasp {
    int32_t count;          /* 1..TM_GRASP_VERTICES; they need not be the patch's */
    const int32_t *vertex;  /* [count] numbers in the mesh */
    const double *target_m; /* [3*count] the springs' other ends */
    const double *force_N;  /* [3*count] on the tissue, now */
    double compliance_m_N;  /* of each spring per axis, above 0 */
} tm_patch_grasp;
/* tm_patch_fill for a tool that holds tissue, its tip at tip_m (trocar_m of the patch is read): the springs are
 * eliminated from the compliance, so that they cost a controller next to nothing. At most TM_PATCH_VERTICES - 1
 * vertices of patch, which takes the place of the last one; none: grasp_N and grasp_stiffness_N_m alone are of use.
 * False: a block is not known, or they make no compliance. No allocation. */
TM_API bool tm_patch_fill_grasped(tm_patch_solver *solver, tm_patch *patch, const tm_patch_grasp *grasp,
                                  const double tip_m[3], tm_patch_block block, void *self, const tm_contact_row *row,
                                  int32_t row_count);
/* Equivalent tip force on the tool with its tip at tip_m, from the reactions of the call before where the patch is the
 * same.
 * `*inside` (may be null): no row bears upon the patch's border, where the tissue goes on and the patch does not. No
 * allocation. */
TM_API void tm_patch_force(tm_patch_solver *solver, const tm_patch *patch, const double tip_m[3], double force_N[3],
                           bool *inside);
/* dF/dP there, row-major, N/m: central differences of tm_patch_force, so with turning normals and rows that come and
 * go. */
TM_API void tm_patch_stiffness(tm_patch_solver *solver, const tm_patch *patch, const double tip_m[3],
                               double stiffness_N_m[9]);

/* --- the dynamic model's own: stage "patch" of a world with contact --- */

/* A square piece of the tissue's quasi-static compliance K^-1. */
typedef struct tm_compliance {
    int32_t revision;       /* of the tissue's surface (tm_tissue_surface) that it is the compliance of */
    int32_t count;          /* of vertices */
    const int32_t *vertex;  /* [count] ascending */
    const double *C_m_N;    /* [3*count][3*count] symmetric: displacement of component i by a unit force on j */
    const double *rotation; /* [9*count] rotation of the tissue around each vertex since C, row-major; null: none */
} tm_compliance;

/* What the patch of an instrument needs. */
enum { TM_COMPLIANCE_REQUEST_MAX = 64 };
typedef struct tm_compliance_request {
    int32_t count, needed; /* vertices; the first `needed` of them make the patch now, the others may be next */
    const int32_t *vertex; /* [count] most urgent first */
    const double *u_m;     /* [3*vertex_count] displacement of tissue that turns; else null */
} tm_compliance_request;

/* Where compliance comes from: somebody beside the world (tm_compliance_factor of libtensormass_solve), who keeps a
 * factor of the stiffness and works while frames are computed. Between frames `exchange` hands over what the patch of
 * an instrument (`owner`) needs from now on, with the tissue as it is now, and gets back the newest piece that is
 * ready; null: nothing yet. What it returns is valid until the next call. In a thread of its own (`start`) it neither
 * waits nor allocates. */
typedef struct tm_compliance_source {
    void *self;
    const tm_compliance *(*exchange)(void *self, int32_t owner, const tm_compliance_request *wish);
    tm_status (*start)(void *self, tm_error *error); /* from now on in a thread of its own; null: it has none */
    void (*destroy)(void *self); /* called with the stage that has it; null: what `self` points to stays the caller's
                                    and must outlive the world */
    bool corotated;              /* it reads u_m: for a world with the stage "rotation" too */
} tm_compliance_source;

/* A surface that is more than that of the world's tissue: the hybrid model's. */
typedef struct tm_patch_surface {
    void *self;
    tm_surface_view (*view)(void *self);
} tm_patch_surface;

typedef struct tm_patch_def {
    uint32_t cookie, size;
    int32_t max_vertices, max_triangles; /* 24 and 32 (12 and 16 for less traffic) */
    int32_t column_vertices;             /* whose compliance is remembered, 64: 36 bytes a vertex of the mesh each */
    int32_t iterations; /* of conjugate gradients a call of tm_patch_compute may spend, each about 1.3 force passes; 0:
                           4 + 80000/vertices */
    double tolerance;   /* relative residual at which a column is good, 3e-3 */
    double horizon_s;   /* motion looked ahead, 0.08 */
    const tm_compliance_source *source; /* copied. Null: conjugate gradients between frames, little by little;
                                           column_vertices, iterations and tolerance are theirs alone */
    const tm_patch_surface *surface;    /* copied; null: the tissue's */
} tm_patch_def;

typedef struct tm_patch_builder tm_patch_builder;

TM_API tm_patch_def tm_patch_def_default(void);
/* The world owns the handle. */
TM_API tm_status tm_stage_patch(tm_world *world, tm_contact *contact, const tm_patch_def *def,
                                tm_patch_builder **builder, tm_error *error);
/* Between frames: goes on computing compliance, then makes the instrument's patch and stiffness from the contact of the
 * last substep. From then on tm_contact_reaction of the instrument carries the stiffness (kind 2 from a source that
 * knows the tissue as it is; kind 1 while it still knows the one before a cut, of tissue that turns, or from conjugate
 * gradients). Returns false, with kind 0, while a column that it needs is missing, when nothing is near, and when the
 * patch at rest bears another force than the model: what is not whole is not sent. Where a source lacks columns at the
 * border, the patch is a smaller one that has all around what bears the load. For an instrument that holds tissue
 * (TM_GRASP_VERTICES at most; with conjugate gradients 24 less what the patch takes) the patch holds it too; where that
 * takes more vertices than max_vertices allow there is the hold's stiffness alone: false with its kind. The stiffness
 * is without friction, whose force is held between samples where there is no patch. While the jaws let go, and
 * while what the instrument felt on removed tetrahedra fades (tm_cut_def.fade_s), there is neither. No allocation,
 * bounded work. */
TM_API bool tm_patch_compute(tm_patch_builder *builder, int32_t instrument, tm_patch *patch);
/* For real time: the source works in a thread of its own from now on, where it can. */
TM_API tm_status tm_patch_start(tm_patch_builder *builder, tm_error *error);
/* Columns that the patches now need and that are not good yet: 0 when all is there. Before a session starts, call
 * tm_patch_compute until it is. */
TM_API int32_t tm_patch_pending(const tm_patch_builder *builder);

#ifdef __cplusplus
}
#endif
#endif
