/* Local contact model for a controller between two force samples: the contact stiffness dF/dP, and the surface patch
 * near the tool with its compliance. It uses positions and compliance only, so all models share it. */
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

/* Surface patch: as contact_patch_t.lcm, but in double and in world coordinates. */
typedef struct tm_patch {
    int32_t kind; /* 1 estimated, 2 exact */
    int32_t instrument;
    int32_t topology_revision;
    int32_t vertex_count, triangle_count;
    int32_t vertex[TM_PATCH_VERTICES];          /* vertex numbers in the mesh */
    int32_t face[TM_PATCH_TRIANGLES];           /* persistent ids, ascending */
    int8_t triangle[3 * TM_PATCH_TRIANGLES];    /* indices into vertex, normal outward */
    double vertex_m[TM_PATCH_DOFS];             /* positions without this tool's contact */
    double rest_m[TM_PATCH_DOFS];               /* undeformed positions: they decide which normals blend */
    double compliance_m_N[TM_PATCH_COMPLIANCE]; /* upper triangle, row by row, of the symmetric (3*vertex_count)^2
                                                   matrix */
    double contact_compliance_m_N, force_cap_N;
    double radius_m, contact_length_m;
    double drag_s_m; /* viscous contact drag: 0.3, or 0 in models without it (precomputed, hybrid) */
    /* Radiation of waves, for tissue with mass: a dashpot on the tool's velocity along the force (with a grasp: on the
     * full velocity), minus its mean over radiation_s. */
    double radiation_N_s_m, radiation_s;
    double trocar_m[3];
    bool is_free; /* the tool has no trocar, and this direction of its shaft */
    double direction[3];
    /* The patch includes a grasp: vertex_m and compliance_m_N are those of the grasped tissue and follow the tip. */
    bool grasps;
    uint32_t grasped;              /* bit v: vertex v is between the jaws; a row on such vertices only is no obstacle */
    double grasp_tip_m[3];         /* tip position for vertex_m and grasp_N */
    double grasp_N[3];             /* grasp force on the tool, equivalent at the tip, without contact rows */
    double grasp_stiffness_N_m[9]; /* its derivative by the tip: symmetric, negative semidefinite */
    /* Derivative of vertex_m by the tip, [3*vertex_count][3], 1. Its transpose maps row forces on the vertices to the
     * tool. */
    double dvertex_dtip[3 * TM_PATCH_DOFS];
    /* Coefficients of the instrument (tensormass/friction.h); 0: none. For the controller, which computes friction;
     * tm_patch_force and tm_patch_stiffness do not. */
    double friction_static, friction_kinetic;
    /* Of tissue with a nonlinear law or rotation: relative difference of the compliance in use from that of the tangent
     * at the last comparison, for a force on the four vertices nearest to the tip; at least 0. */
    double age;
} tm_patch;

/* Returns entry (i, j) of the compliance matrix, 0 <= i, j < 3*vertex_count. */
TM_API double tm_patch_compliance(const tm_patch *patch, int32_t i, int32_t j);

/* Selects vertices and triangles, and fills vertex, face, triangle, rest_m and vertex_m (present positions). The patch
 * is a connected region. It grows from the triangle nearest to the tip's path over the next `horizon_s` at
 * `velocity_m_s`; triangles of `row` (may be null) come first. At most max_vertices (3..24) and max_triangles (1..32).
 * Returns the number of triangles, 0 if none is within 20 mm. No allocation. */
TM_API int32_t tm_patch_choose(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                               const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                               const tm_contact_row *row, int32_t row_count, int32_t max_vertices,
                               int32_t max_triangles, tm_patch *patch);

/* Fills the compliance from 3x3 blocks C: displacement of vertex a by a force on vertex b, m/N, row-major. The result
 * is symmetric, and positive semidefinite within float rounding. Removes the effect of this tool's rows from vertex_m:
 * vertex_m -= C f. Returns false if a block is unknown or the blocks make no such matrix. */
typedef bool (*tm_patch_block)(void *self, int32_t a, int32_t b, double C[9]);
TM_API bool tm_patch_fill(tm_patch *patch, tm_patch_block block, void *self, const tm_contact_row *row,
                          int32_t row_count);

/* Removes the effect of a row's friction force on the tissue from vertex_m and grasp_N. A row on vertices outside the
 * patch is left in. Call after tm_patch_fill or tm_patch_fill_grasped, once for each row with friction. */
TM_API void tm_patch_remove_friction(tm_patch *patch, const tm_contact_row *row, const double force_N[3]);

/* Returns whether too much of the tool's load (rows, and `held_N` of a grasp) is on vertices outside the patch: more
 * than a fifth of it, and more than 0.01 N. The patch would then not give the tool's force. */
TM_API bool tm_patch_has_outside_load(const tm_patch *patch, double held_N, const tm_contact_row *row,
                                      int32_t row_count);

/* Solver of contact against a patch: the controller's method, in double and iterated to convergence. */
typedef struct tm_patch_solver tm_patch_solver;
TM_API tm_status tm_patch_solver_create(tm_patch_solver **solver, tm_error *error);
TM_API void tm_patch_solver_destroy(tm_patch_solver *solver);

/* Springs from points of a tool to vertices, as in a grasp. */
enum { TM_GRASP_VERTICES = 48 };
typedef struct tm_patch_grasp {
    int32_t count;          /* 1..TM_GRASP_VERTICES; vertices outside the patch are allowed */
    const int32_t *vertex;  /* [count] numbers in the mesh */
    const double *target_m; /* [3*count] points of the tool to which the springs are attached */
    const double *force_N;  /* [3*count] present force on the tissue */
    double compliance_m_N;  /* of each spring per axis, above 0 */
} tm_patch_grasp;
/* Fills a patch as tm_patch_fill, for a tool with a grasp and its tip at tip_m (trocar_m, is_free and direction of the
 * patch are read). The springs are eliminated from the compliance, so they cost a controller almost nothing. At most
 * TM_PATCH_VERTICES - 1 patch vertices: the last place is used for work. With none, only grasp_N and
 * grasp_stiffness_N_m are valid. Returns false if a block is unknown or the blocks are no compliance. No allocation. */
TM_API bool tm_patch_fill_grasped(tm_patch_solver *solver, tm_patch *patch, const tm_patch_grasp *grasp,
                                  const double tip_m[3], tm_patch_block block, void *self, const tm_contact_row *row,
                                  int32_t row_count);
/* Computes the equivalent tip force on the tool with its tip at tip_m. It starts from the previous call's reactions if
 * the patch is the same. `*inside` (may be null): no row loads the border of the patch, beyond which the tissue
 * continues. No allocation. */
TM_API void tm_patch_force(tm_patch_solver *solver, const tm_patch *patch, const double tip_m[3], double force_N[3],
                           bool *inside);
/* Computes dF/dP there, row-major, N/m, by central differences of tm_patch_force: rotating normals and changes of the
 * active rows are included. */
TM_API void tm_patch_stiffness(tm_patch_solver *solver, const tm_patch *patch, const double tip_m[3],
                               double stiffness_N_m[9]);

/* --- dynamic model: stage "patch" of a world with contact --- */

/* Square block of the tissue's quasi-static compliance K^-1. */
typedef struct tm_compliance {
    int32_t revision;      /* revision of the tissue's surface (tm_tissue_surface) that it belongs to */
    int32_t count;         /* of vertices */
    const int32_t *vertex; /* [count] ascending */
    const double *C_m_N;   /* [3*count][3*count] symmetric: displacement of component i by a unit force on j */
    const double
        *rotation; /* [9*count] rotation of the tissue at each vertex since C was computed, row-major; null: none */
    double age;    /* as tm_patch.age */
} tm_compliance;

/* Request: the vertices whose compliance the patch of an instrument needs. */
enum { TM_COMPLIANCE_REQUEST_MAX = 64 };
typedef struct tm_compliance_request {
    int32_t count, needed; /* vertices; the first `needed` are for the present patch, the others may be needed next */
    const int32_t *vertex; /* [count] most urgent first */
    const double *u_m;     /* [3*vertex_count] displacement, of tissue with a nonlinear law or rotation; else null */
} tm_compliance_request;

/* Source of compliance outside the world (tm_compliance_factor of libtensormass_solve). It keeps a factor of the
 * stiffness and works while frames are computed. Between frames, `exchange` passes what the patch of an instrument
 * (`owner`) needs from now on, and the present tissue. It returns the newest result, or null if there is none yet,
 * valid until the next call. With its own thread (`start`) it neither waits nor allocates. */
typedef struct tm_compliance_source {
    void *self;
    const tm_compliance *(*exchange)(void *self, int32_t owner, const tm_compliance_request *request);
    tm_status (*start)(void *self, tm_error *error); /* continues in its own thread from now on; null: it has none */
    /* Called when its stage is destroyed. Null: the caller keeps what `self` points to, which must outlive the
     * world. */
    void (*destroy)(void *self);
    bool corotated; /* it reads u_m, and so also serves a world with the stage "rotation" or a nonlinear law */
} tm_compliance_source;

/* A surface larger than that of the world's tissue, as the hybrid model has. */
typedef struct tm_patch_surface {
    void *self;
    tm_surface_view (*view)(void *self);
} tm_patch_surface;

typedef struct tm_patch_def {
    uint32_t cookie, size;
    int32_t max_vertices, max_triangles; /* 24 and 32 (12 and 16 for less traffic) */
    int32_t column_vertices; /* vertices whose compliance is stored, 64; each costs 36 bytes per mesh vertex */
    /* Maximum conjugate gradient iterations in a call of tm_patch_compute, each about 1.3 force passes; 0: 4 +
     * 80000/vertices. */
    int32_t iterations;
    double tolerance; /* relative residual at which a column has converged, 3e-3 */
    double horizon_s; /* look-ahead time of the tip's path, 0.08 */
    /* Copied. Null: conjugate gradients between frames, a few iterations each; only they use column_vertices,
     * iterations and tolerance. */
    const tm_compliance_source *source;
    const tm_patch_surface *surface; /* copied; null: the surface of the tissue */
} tm_patch_def;

typedef struct tm_patch_builder tm_patch_builder;

TM_API tm_patch_def tm_patch_def_default(void);
/* Adds the stage "patch"; the world owns the handle. */
TM_API tm_status tm_stage_patch(tm_world *world, tm_contact *contact, const tm_patch_def *def,
                                tm_patch_builder **builder, tm_error *error);
/* Continues the computation of compliance, then computes the instrument's patch and stiffness from the contact of the
 * last substep. Call it between frames. From then on tm_contact_reaction of the instrument has the stiffness. It is
 * kind 2 if the source has the present tissue. It is kind 1 from conjugate gradients, with corotated tissue, or while
 * the source still has the tissue before a cut.
 *
 * Returns false, with kind 0, if a needed column is missing, nothing is near, or the patch at rest has another force
 * than the model. An incomplete patch is not sent. If a source lacks columns at the border, the patch is smaller, but
 * complete around the load.
 *
 * With a grasp (at most TM_GRASP_VERTICES; with conjugate gradients 24 minus the patch's vertices) the patch includes
 * it. If that takes more vertices than max_vertices, there is only the stiffness of the grasp: false, with its kind.
 * The stiffness excludes friction; without a patch, its force is held between samples. There is neither patch nor
 * stiffness while the jaws release, or while the force of removed tetrahedra fades (tm_cut_def.fade_s). No allocation,
 * bounded work. */
TM_API bool tm_patch_compute(tm_patch_builder *builder, int32_t instrument, tm_patch *patch);
/* For real time: the source continues in its own thread from now on, if it can. */
TM_API tm_status tm_patch_start(tm_patch_builder *builder, tm_error *error);
/* Returns the number of columns that the patches need now and that have not converged. Before a session, call
 * tm_patch_compute until it is 0. */
TM_API int32_t tm_patch_pending(const tm_patch_builder *builder);

#ifdef __cplusplus
}
#endif
#endif
