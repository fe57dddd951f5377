/* libtensormass_solve: static solutions, the precomputed and the hybrid model. A separate library, since it requires
 * SuiteSparse and Eigen (CHOLMOD's supernodal module is GPL). Conventions are those of the core: SI units, flat arrays,
 * a status and a message, nothing printed.
 *
 * Threads: all functions that create or solve may be called from several threads, one model from one thread at a time;
 * no bit of a result depends on it. Calls that factorise or solve (_create, _write, tm_solve_static, tm_hybrid_recover)
 * change three process-wide settings and restore them before they return:
 *   - OpenBLAS's number of threads (1 meanwhile);
 *   - SuiteSparse's malloc, calloc and realloc: page-aligned memory, released by free(). If a program has
 *     set its own allocator they stay, and last bits may then differ from run to run;
 *   - the state of rand(). A thread of the program that calls it during an ordering changes last bits. */
#ifndef TENSORMASS_SOLVE_H
#define TENSORMASS_SOLVE_H

#include "tensormass.h"
#include "tensormass/grasp.h"
#include "tensormass/model.h"
#include "tensormass/patch.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- the static problem K u = f, with prescribed components --- */

typedef enum tm_solver {
    TM_SOLVER_CHOLESKY = 0, /* CHOLMOD, nested dissection, supernodal */
    /* Eigen's conjugate gradients with Jacobi preconditioner, as in the paper: slower, needs no factor. */
    TM_SOLVER_CG = 1
} tm_solver;

typedef struct tm_solve_def {
    uint32_t cookie, size;
    const tm_tissue
        *tissue;          /* its active tetrahedra; constant during the call; its mesh must outlive what is created */
    const uint8_t *fixed; /* [3*vertex_count] 1 where a component is prescribed (tm_support_mask) */
    const double *fixed_value_m; /* [3*vertex_count] read where fixed; null: all 0 */
    const double *load_N;        /* [3*vertex_count] constant forces, gravity included; null: none */
    tm_solver solver;
    double cg_tolerance;        /* relative residual, 1e-11 */
    int32_t cg_max_iterations;  /* per column; 20000 */
    int32_t threads;            /* 0: one per core. Results do not depend on it */
    int64_t memory_limit_bytes; /* 0: the memory that is available now */
    /* May be null. `what` is "factor", "responses" ...; seconds_left < 0: unknown. Return false to stop
     * (TM_ERR_CONVERGENCE). */
    bool (*progress)(void *user, const char *what, double fraction, double seconds_left);
    void *user;
} tm_solve_def;

typedef struct tm_solve_report {
    int32_t free_dofs, columns, interface_dofs;
    int32_t columns_found;   /* of `columns`, those found from an earlier, interrupted run */
    int64_t factor_bytes;    /* 0 with CG */
    int64_t responses_bytes; /* stored, and mapped online */
    int64_t work_bytes;      /* other memory requested during the computation */
    double order_s, factor_s, columns_s, seconds;
    bool from_file;
    char why[160]; /* why a file was not used: "no file", "another mesh, material or support", "checksum differs" ... */
} tm_solve_report;

TM_API tm_solve_def tm_solve_def_default(void);

/* Solves for static equilibrium. u_m [3*vertex_count]; reaction_N [3*vertex_count], force of the supports ON THE
 * TISSUE, 0 elsewhere; either may be null. TM_ERR_SUPPORT: an unconstrained component, `entity` one of its vertices.
 * TM_ERR_MEMORY: the message gives the amount and a smaller alternative. */
TM_API tm_status tm_solve_static(const tm_solve_def *def, double *u_m, double *reaction_N, tm_solve_report *report,
                                 tm_error *error);

/* --- ranks: columns over several processes; the transport is the caller's --- */

/* Factor distributed over the ranks, so that it may exceed the memory of one. All ranks make each call at the same
 * time. Last bits may depend on the number of ranks. */
typedef struct tm_solve_distributed {
    /* Factorises a symmetric positive definite matrix [n][n] in N/m, given completely to every rank: its lower
     * triangle, column j in row[begin[j]] to row[begin[j + 1]], ascending. `bytes`: size of this rank's share. The
     * matrix need not outlive the call. TM_ERR_MEMORY, TM_ERR_SUPPORT (not definite). */
    tm_status (*factor)(void *user, int32_t n, const int32_t *begin, const int32_t *row, const double *value,
                        int64_t *bytes, tm_error *error);
    /* Solves on rank 0: x [n], the right-hand side, becomes the solution; null on the others. */
    bool (*solve_one)(void *user, double *x);
    /* Solves unit right-hand sides: the j-th of rank r has its 1 at unit[r * width + j], or is unused (-1). x
     * [width][row_count]: this rank's solutions at the listed rows (ascending). */
    bool (*solve)(void *user, const int32_t *unit, int32_t width, const int32_t *row, int32_t row_count, double *x);
} tm_solve_distributed;

/* Ranks of a computation. Each writes its solutions into the file of rank 0, which all must be able to open. Width and
 * number of blocks do not depend on ranks and threads. */
typedef struct tm_solve_ranks {
    int32_t rank, count;
    bool (*barrier)(void *user); /* returns when all ranks have called it; false: one cannot */
    void *user;
    /* Null: every rank has its own factor, and the file's bits are those of a single rank. */
    const tm_solve_distributed *distributed;
} tm_solve_ranks;

/* --- precomputed model: quasi-static, no cutting --- */

typedef struct tm_precomputed_def {
    uint32_t cookie, size;
    tm_solve_def problem;
    tm_precision precision; /* of the stored responses */
    const char *file;       /* cache; null: none. Replaced atomically when rebuilt */
    /* Keep the results of a failed or killed run in `file`.part (8 more bytes per block); the next run with the same
     * problem continues from it. false: it is removed. Always on with ranks. */
    bool resume;
    const tm_solve_ranks *ranks;   /* null: this process only */
    const tm_contact_def *contact; /* instruments, contact compliance, cap; null: none. contact_compliance_m_N > 0 */
    /* Instruments in grasper mode grasp tissue as in the dynamic model (spring forces have no cap); null: none does. */
    const tm_grasp_def *grasp;
    const tm_friction_def *friction; /* as in the dynamic model; null: frictionless */
    double update_s; /* time between updates, 0.002; sets the release of grasps and the recovery of stick friction */
    /* Capacity of the online solver: vertices near the tools and imposed vertices together; 256. */
    int32_t max_contact_vertices;
} tm_precomputed_def;

typedef struct tm_precomputed tm_precomputed;

TM_API tm_precomputed_def tm_precomputed_def_default(void);

/* Opens def.file if it has exactly this problem, complete; else computes, and writes it. A foreign or damaged file is
 * never read in part: it is rebuilt, and `report->why` gives the reason. The tissue must outlive the model. */
TM_API tm_status tm_precomputed_create(const tm_precomputed_def *def, tm_precomputed **model, tm_solve_report *report,
                                       tm_error *error);
/* Computes and writes def.file in any case. With ranks, every rank calls it. */
TM_API tm_status tm_precomputed_write(const tm_precomputed_def *def, tm_solve_report *report, tm_error *error);
TM_API void tm_precomputed_destroy(tm_precomputed *model);
TM_API int64_t tm_precomputed_bytes(const tm_precomputed *model);

/* Updates the online solution: every instrument moves from its pose to `pose[instrument]`. The path is divided into
 * increments of at most an eighth of its radius. At each of them contact is solved to convergence (256 solves at most).
 * No allocation. Returns the Newton iterations of the last increment; negative: its residual is still above 1e-9 of the
 * displacement. */
TM_API int32_t tm_precomputed_update(tm_precomputed *model, const tm_tool_pose *pose);
/* Sets the pose of an instrument at once: no swept path. The next update solves contact. */
TM_API void tm_precomputed_set_pose(tm_precomputed *model, int32_t instrument, const tm_tool_pose *at);
TM_API tm_tool_pose tm_precomputed_pose(const tm_precomputed *model, int32_t instrument);
/* Returns the tm_reaction_flag of the last update, and the equivalent tip force on the tool, N. For callers that need
 * no stiffness. */
TM_API uint32_t tm_precomputed_force(const tm_precomputed *model, int32_t instrument, double force_N[3]);
/* Returns the reaction of the last update. stiffness_kind 2: derivative of the converged force, with rotating normals,
 * computed here (as expensive as a few updates). time_s is 0. */
TM_API tm_tool_reaction tm_precomputed_reaction(tm_precomputed *model, int32_t instrument);
TM_API int32_t tm_precomputed_rows(const tm_precomputed *model, const tm_contact_row **rows);

/* Returns the vertices in the instrument's jaws, as tm_grasp_vertices. */
TM_API int32_t tm_precomputed_grasped(const tm_precomputed *model, int32_t instrument, const int32_t **vertex,
                                      tm_grasp_state *state);

/* Computes the surface patch near the instrument with its exact compliance (kind 2), as tm_patch_compute does for the
 * dynamic model. It includes the effect of other instruments and imposed vertices, and the instrument's own grasp (at
 * most TM_GRASP_VERTICES, as tm_patch_fill_grasped). velocity_m_s: of the tip, for the look-ahead by horizon_s. Returns
 * false if nothing is near, or the load exceeds the capacity of a patch. No allocation. */
TM_API bool tm_precomputed_patch(tm_precomputed *model, int32_t instrument, const double velocity_m_s[3],
                                 double horizon_s, int32_t max_vertices, int32_t max_triangles, tm_patch *patch);

/* Returns the displacements [3*vertex_count], superposed over the surface; inner vertices read 0. Computed on request,
 * at most once per update. */
TM_API const double *tm_precomputed_displacement(tm_precomputed *model);
/* Returns the surface vertices with responses (not completely fixed), ascending. */
TM_API int32_t tm_precomputed_surface(const tm_precomputed *model, const int32_t **vertex);

/* Imposes displacements on surface vertices (all free components), as in the paper, from the next update on. Replaces
 * the previous list; count 0 releases all. compliance_m_N 0: exact. TM_ERR_LIMIT: more than max_contact_vertices;
 * TM_ERR_ARGUMENT: not a surface vertex. */
TM_API tm_status tm_precomputed_impose(tm_precomputed *model, int32_t count, const int32_t *vertex, const double *u_m,
                                       double compliance_m_N, tm_error *error);
/* Returns the force of the i-th imposed vertex on the tissue, N. */
TM_API void tm_precomputed_imposed_force(const tm_precomputed *model, int32_t i, double force_N[3]);

/* --- hybrid model: a tensor/mass part that can be cut; the rest is condensed onto the interface --- */

typedef struct tm_hybrid_def {
    uint32_t cookie, size;
    tm_solve_def problem;   /* of the complete organ: tissue with all tetrahedra active, supports, loads */
    const uint8_t *dynamic; /* [tet_count] 1: tensor/mass */
    tm_precision precision;
    const char *file;              /* cache, as above */
    const tm_contact_def *contact; /* null: no contact on the condensed part */
    int32_t max_contact_vertices;  /* 256 */
    /* false: tetrahedra between the teeth of a jagged interface become tensor/mass too, if that removes a fifth of its
     * vertices: the cost of an interface grows with its square. */
    bool as_marked;
} tm_hybrid_def;

typedef struct tm_hybrid tm_hybrid;

TM_API tm_hybrid_def tm_hybrid_def_default(void);
TM_API tm_status tm_hybrid_create(const tm_hybrid_def *def, tm_hybrid **hybrid, tm_solve_report *report,
                                  tm_error *error);
TM_API void tm_hybrid_destroy(tm_hybrid *hybrid);
TM_API int64_t tm_hybrid_bytes(const tm_hybrid *hybrid);

/* Sets active tetrahedra, condensed tetrahedra and the interface's extra mass in the definition of the world's tissue.
 * The pointers are into `hybrid`, which must outlive the tissue. */
TM_API void tm_hybrid_tissue(const tm_hybrid *hybrid, tm_tissue_def *def);
/* Returns the guaranteed step of the hybrid: dynamic tetrahedra, and condensed ones at the interface. Upper limit of
 * the world's step. */
TM_API double tm_hybrid_critical_step(const tm_hybrid *hybrid, int32_t *tet);
/* Adds the stage "hybrid". `contact` (may be null) is the world's own contact stage; its instruments also touch the
 * condensed part. The world's loads and supports act on the dynamic part and the interface; those of condensed inner
 * vertices come from def.problem. The hybrid must outlive the stage. After removal of the stage, or failure here, it
 * may join another world. */
TM_API tm_status tm_stage_hybrid(tm_world *world, tm_hybrid *hybrid, tm_contact *contact, tm_error *error);
/* Computes the displacement of condensed inner vertices into the world's state. Call once per frame. No allocation. If
 * conjugate gradients do not converge, these vertices stay unchanged and reactions have TM_REACTION_UNCONVERGED. */
TM_API void tm_hybrid_recover(tm_hybrid *hybrid, tm_world *world);
/* Returns the reaction of both parts on an instrument, averaged as by tm_contact_reaction. */
TM_API tm_tool_reaction tm_hybrid_reaction(const tm_hybrid *hybrid, int32_t instrument);
/* Returns the surface of the complete organ, dynamic and condensed, without the interface while it is inside. */
TM_API tm_surface_view tm_hybrid_surface(tm_hybrid *hybrid);

/* --- exact compliance for the patches of the dynamic model, cut or not --- */

typedef struct tm_compliance_factor_def {
    uint32_t cookie, size;
    /* The world's, with mesh, materials, fibres; must outlive the factor. Its active tetrahedra are read between
     * frames. */
    const tm_tissue *tissue;
    const uint8_t *fixed; /* [3*vertex_count] 1 where a component is prescribed (tm_support_mask); copied */
    /* [tet_count] 1: always active, also if not in the tissue (the condensed part of a hybrid); copied; null: none. */
    const uint8_t *condensed;
    bool corotated; /* the world has the stage "rotation"; a nonlinear law is read from the tissue */
} tm_compliance_factor_def;

/* Factor (CHOLMOD) of the tissue's stiffness, with columns of its inverse for the vertices that patches need. Cuts
 * since the factorisation are low-rank updates (Woodbury), so a patch is exact again one block of columns after a cut.
 * Beyond TMS_TOUCHED_VERTICES touched vertices it is factorised again. Computed on first use. Under a nonlinear law it
 * is the factor of the tangent, which is renewed when its compliance is off by 2 % (tm_compliance.age). */
typedef struct tm_compliance_factor tm_compliance_factor;
TM_API tm_compliance_factor_def tm_compliance_factor_def_default(void);
TM_API tm_status tm_compliance_factor_create(const tm_compliance_factor_def *def, tm_compliance_factor **factor,
                                             tm_error *error);
/* Call it after destroying the world whose patch stage has its source. */
TM_API void tm_compliance_factor_destroy(tm_compliance_factor *factor);
TM_API int64_t tm_compliance_factor_bytes(const tm_compliance_factor *factor);
/* Returns the source for tm_patch_def.source. Before tm_compliance_factor_start, a request is computed completely
 * within its exchange, in the caller's thread: equal calls give equal bits. */
TM_API tm_compliance_source tm_compliance_factor_source(tm_compliance_factor *factor);
/* Returns the same for a stage that destroys `factor` with itself. */
TM_API tm_compliance_source tm_compliance_factor_owned_source(tm_compliance_factor *factor);
/* Moves the work to its own thread, with lower priority than the caller's. From then on exchanges never wait. */
TM_API tm_status tm_compliance_factor_start(tm_compliance_factor *factor, tm_error *error);

/* --- as models (tensormass/model.h) --- */

/* Creates a precomputed model. `how` gives solver, tolerances, threads, memory and progress of its problem, precision,
 * file, max_contact_vertices; its other members are not read, as `def` gives the organ. `report` may be null. def->cut:
 * TM_ERR_EXCLUDED. */
TM_API tm_status tm_model_precomputed(const tm_model_def *def, const tm_precomputed_def *how, tm_model **model,
                                      tm_solve_report *report, tm_error *error);
/* Only computes and writes how->file in any case, as tm_precomputed_write. */
TM_API tm_status tm_model_precompute(const tm_model_def *def, const tm_precomputed_def *how, tm_solve_report *report,
                                     tm_error *error);
/* Creates a hybrid model. `how` as for tm_model_precomputed, and its `dynamic`: the tensor/mass part, which may be cut.
 * Patches are as in the dynamic model, with surface and compliance of the complete organ, cut or not. */
TM_API tm_status tm_model_hybrid(const tm_model_def *def, const tm_hybrid_def *how, tm_model **model,
                                 tm_solve_report *report, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
