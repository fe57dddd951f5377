/* libtensormass_solve: static solutions, the precomputed and the hybrid model. A library of its own, since it brings
 * SuiteSparse and Eigen with it (CHOLMOD's supernodal module is GPL). The manner is the core's: SI units, flat arrays,
 * a status and a message, nothing printed.
 *
 * Threads: everything that makes or solves may be called from several threads at once, one model from one thread at a
 * time; no bit of a result depends on it. Of what belongs to the whole process, these are changed while a call that
 * factorises or solves (_create, _write, tm_solve_static, tm_hybrid_recover) runs, and put back before it returns:
 * OpenBLAS's number of threads (1 meanwhile), SuiteSparse's malloc, calloc and realloc (memory aligned to pages, freed
 * by free(); left alone where a program has set an allocator of its own, and then last bits may differ from run to
 * run), and the state of rand() (a thread of yours that draws from it during an ordering changes last bits). */
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
    TM_SOLVER_CG = 1 /* Eigen's conjugate gradients, Jacobi preconditioner, as the paper did: slower, needs no factor */
} tm_solver;

typedef struct tm_solve_def {
    uint32_t cookie, size;
    const tm_tissue *tissue; /* its living tetrahedra; const while the call runs, its mesh must outlive what is made */
    const uint8_t *fixed;    /* [3*vertex_count] 1 where a component is prescribed (tm_support_mask) */
    const double *fixed_value_m; /* [3*vertex_count] read where fixed; null: all 0 */
    const double *load_N;        /* [3*vertex_count] constant forces, gravity included; null: none */
    tm_solver solver;
    double cg_tolerance;        /* relative residual, 1e-11 */
    int32_t cg_max_iterations;  /* per column; 20000 */
    int32_t threads;            /* 0: one for each core. Never changes a bit of the result */
    int64_t memory_limit_bytes; /* 0: what the machine has available now */
    /* May be null. `what` is "factor", "responses" ...; seconds_left < 0: not known yet. Returning false stops
     * (TM_ERR_CONVERGENCE). */
    bool (*progress)(void *user, const char *what, double fraction, double seconds_left);
    void *user;
} tm_solve_def;

typedef struct tm_solve_report {
    int32_t free_dofs, columns, interface_dofs;
    int32_t columns_found;   /* of them, done by an earlier run that did not come to its end */
    int64_t factor_bytes;    /* 0 with CG */
    int64_t responses_bytes; /* stored, and mapped on line */
    int64_t work_bytes;      /* asked for beside them while computing */
    double order_s, factor_s, columns_s, seconds;
    bool from_file;
    char why[160]; /* why a file was not used: "no file", "another mesh, material or support", "checksum differs" ... */
} tm_solve_report;

TM_API tm_solve_def tm_solve_def_default(void);

/* u_m [3*vertex_count]; reaction_N [3*vertex_count], force of the supports ON THE TISSUE, 0 elsewhere; either may be
 * null. TM_ERR_SUPPORT: a part that nothing holds, `entity` a vertex of it. TM_ERR_MEMORY: says how much, and what
 * would be smaller. */
TM_API tm_status tm_solve_static(const tm_solve_def *def, double *u_m, double *reaction_N, tm_solve_report *report,
                                 tm_error *error);

/* --- ranks: columns over several processes, without this library knowing of any transport --- */

/* One factor in pieces over the ranks, so that it may be larger than what one of them has. Every rank makes each call
 * at the same time as the others. Last bits may depend on how many ranks there are. */
typedef struct tm_solve_distributed {
    /* Factorises a symmetric positive definite matrix [n][n] in N/m, given whole to every rank: its lower triangle,
     * column j in row[begin[j]] to row[begin[j + 1]], ascending. `bytes`: of this rank's piece. The matrix need not
     * outlive the call. TM_ERR_MEMORY, TM_ERR_SUPPORT (not definite). */
    tm_status (*factor)(void *user, int32_t n, const int32_t *begin, const int32_t *row, const double *value,
                        int64_t *bytes, tm_error *error);
    /* Of rank 0: x [n], the right-hand side, becomes the solution; null on the others. */
    bool (*solve_one)(void *user, double *x);
    /* Answers to unit right-hand sides: rank r's j-th has its 1 at unit[r * width + j], or is not asked for (-1). x
     * [width][row_count]: of this rank's, at the rows listed (ascending). */
    bool (*solve)(void *user, const int32_t *unit, int32_t width, const int32_t *row, int32_t row_count, double *x);
} tm_solve_distributed;

/* Each rank writes what it solved into the file of rank 0, which all of them must be able to open. Blocks have a fixed
 * width and number, whatever the ranks and threads. */
typedef struct tm_solve_ranks {
    int32_t rank, count;
    bool (*barrier)(void *user); /* returns when all ranks have called it; false: one never will */
    void *user;
    const tm_solve_distributed
        *distributed; /* null: every rank makes a factor of its own, and the file's bits are those of one */
} tm_solve_ranks;

/* --- precomputed model: quasi-static, no cutting --- */

typedef struct tm_precomputed_def {
    uint32_t cookie, size;
    tm_solve_def problem;
    tm_precision precision; /* of the stored responses */
    const char *file;       /* cache; null: none. Atomically replaced when it is rebuilt */
    bool resume; /* what a run that failed or was killed had done stays in `file`.part (8 bytes a block more), and the
                    next one with the same problem goes on from it; else it is removed. Always with a team */
    const tm_solve_ranks *ranks;   /* null: this process alone */
    const tm_contact_def *contact; /* instruments, skin compliance, cap; null: none. contact_compliance_m_N > 0 */
    const tm_grasp_def *grasp; /* instruments of mode grasper hold tissue as in the dynamic model (no cap on a hold);
                                  null: they do not */
    const tm_friction_def *friction; /* of the instruments, as in the dynamic model; null: they slide freely */
    double update_s; /* time between updates, 0.002: what is let go fades with it, and what sticks rests with it */
    int32_t
        max_contact_vertices; /* of the on-line system: surroundings of the tools and imposed vertices together; 256 */
} tm_precomputed_def;

typedef struct tm_precomputed tm_precomputed;

TM_API tm_precomputed_def tm_precomputed_def_default(void);

/* Opens def.file if it holds this very problem, whole; else computes, and writes it. A foreign or damaged file is never
 * half-read: it is rebuilt and `report->why` says why. The tissue must outlive it. */
TM_API tm_status tm_precomputed_create(const tm_precomputed_def *def, tm_precomputed **model, tm_solve_report *report,
                                       tm_error *error);
/* Computes and writes def.file, whatever is there. With a team every rank calls it. */
TM_API tm_status tm_precomputed_write(const tm_precomputed_def *def, tm_solve_report *report, tm_error *error);
TM_API void tm_precomputed_destroy(tm_precomputed *model);
TM_API int64_t tm_precomputed_bytes(const tm_precomputed *model);

/* One on-line update: every instrument moves from where it is to `pose[instrument]`, the path cut into pieces no longer
 * than an eighth of its radius, contact solved anew at each to convergence (256 solves at most). No allocation. Returns
 * the Newton steps of the last piece; negative: the residual is still above 1e-9 of the displacement after the last
 * allowed step. */
TM_API int32_t tm_precomputed_update(tm_precomputed *model, const tm_tool_pose *pose);
/* Puts an instrument there at once: no swept path. Contact is solved by the next update. */
TM_API void tm_precomputed_set_pose(tm_precomputed *model, int32_t instrument, const tm_tool_pose *at);
TM_API tm_tool_pose tm_precomputed_pose(const tm_precomputed *model, int32_t instrument);
/* Equivalent tip force on the tool at the last update, N: enough where the stiffness is not asked for. Returns its
 * tm_reaction_flag. */
TM_API uint32_t tm_precomputed_force(const tm_precomputed *model, int32_t instrument, double force_N[3]);
/* At the last update; stiffness_kind 2: the derivative of the converged force, turning normals included, computed here
 * (as expensive as a few updates). time_s is 0. */
TM_API tm_tool_reaction tm_precomputed_reaction(tm_precomputed *model, int32_t instrument);
TM_API int32_t tm_precomputed_rows(const tm_precomputed *model, const tm_contact_row **rows);

/* Vertices in the instrument's jaws; as tm_grasp_vertices. */
TM_API int32_t tm_precomputed_grasped(const tm_precomputed *model, int32_t instrument, const int32_t **vertex,
                                      tm_grasp_state *state);

/* The surface near the instrument with its exact compliance (kind 2), as tm_patch_compute gives it from the dynamic
 * model: what other instruments and imposed vertices hold is in it, and what the instrument itself holds
 * (TM_GRASP_VERTICES at most, as tm_patch_fill_grasped). velocity_m_s: of the tip, looked ahead along by horizon_s.
 * False: nothing near, or the tool bears on more than a patch can hold. No allocation. */
TM_API bool tm_precomputed_patch(tm_precomputed *model, int32_t instrument, const double velocity_m_s[3],
                                 double horizon_s, int32_t max_vertices, int32_t max_triangles, tm_patch *patch);

/* [3*vertex_count] superposed over the surface; inner vertices read 0. Computed when asked for, at most once per
 * update. */
TM_API const double *tm_precomputed_displacement(tm_precomputed *model);
/* The surface vertices that have responses (not wholly fixed), ascending. */
TM_API int32_t tm_precomputed_surface(const tm_precomputed *model, const int32_t **vertex);

/* The paper's way: displacements imposed on surface vertices (all free components), held from the next update on.
 * Replaces the list before; count 0 lets go. compliance_m_N 0 holds exactly. TM_ERR_LIMIT: more than
 * max_contact_vertices; TM_ERR_ARGUMENT: not a surface vertex. */
TM_API tm_status tm_precomputed_impose(tm_precomputed *model, int32_t count, const int32_t *vertex, const double *u_m,
                                       double compliance_m_N, tm_error *error);
/* Force that the i-th imposed vertex exerts on the tissue, N. */
TM_API void tm_precomputed_imposed_force(const tm_precomputed *model, int32_t i, double force_N[3]);

/* --- hybrid model: part tensor/mass and cuttable, the rest condensed onto their interface --- */

typedef struct tm_hybrid_def {
    uint32_t cookie, size;
    tm_solve_def problem;   /* of the whole organ: tissue with all tetrahedra alive, supports, loads */
    const uint8_t *dynamic; /* [tet_count] 1: tensor/mass */
    tm_precision precision;
    const char *file;              /* cache, as above */
    const tm_contact_def *contact; /* null: no contact on the condensed part */
    int32_t max_contact_vertices;  /* 256 */
    bool as_marked; /* false: tetrahedra between the teeth of a jagged border become tensor/mass too, where a fifth of
                       its vertices goes by that: what a border costs grows with its square */
} tm_hybrid_def;

typedef struct tm_hybrid tm_hybrid;

TM_API tm_hybrid_def tm_hybrid_def_default(void);
TM_API tm_status tm_hybrid_create(const tm_hybrid_def *def, tm_hybrid **hybrid, tm_solve_report *report,
                                  tm_error *error);
TM_API void tm_hybrid_destroy(tm_hybrid *hybrid);
TM_API int64_t tm_hybrid_bytes(const tm_hybrid *hybrid);

/* Sets alive, elsewhere and the interface's extra mass in the definition of the world's tissue: pointers into `hybrid`,
 * which must outlive it. */
TM_API void tm_hybrid_tissue(const tm_hybrid *hybrid, tm_tissue_def *def);
/* Guaranteed step of the whole: dynamic tetrahedra, and condensed ones at the interface. The world's step must not
 * exceed it. */
TM_API double tm_hybrid_critical_step(const tm_hybrid *hybrid, int32_t *tet);
/* Adds the stage "hybrid". `contact` (may be null) is the world's own contact stage: its instruments are the condensed
 * part's too. World's loads and supports act on the dynamic part and the interface; those of the condensed inside come
 * from def.problem. The hybrid must outlive the stage; once that is removed, or could not be added, it may join another
 * world. */
TM_API tm_status tm_stage_hybrid(tm_world *world, tm_hybrid *hybrid, tm_contact *contact, tm_error *error);
/* Once per frame: displacement of the condensed inside, written into the world's state. No allocation. Where conjugate
 * gradients do not converge the inside stays as it was, and the reactions say TM_REACTION_UNCONVERGED. */
TM_API void tm_hybrid_recover(tm_hybrid *hybrid, tm_world *world);
/* Both parts' reaction on an instrument, averages as of tm_contact_reaction. */
TM_API tm_tool_reaction tm_hybrid_reaction(const tm_hybrid *hybrid, int32_t instrument);
/* Surface of the whole organ: dynamic and condensed, without the interface while it is inside. */
TM_API tm_surface_view tm_hybrid_surface(tm_hybrid *hybrid);

/* --- exact compliance for the patches of the dynamic model, cut or whole --- */

typedef struct tm_compliance_factor_def {
    uint32_t cookie, size;
    const tm_tissue
        *tissue;          /* the world's; must outlive it. Mesh, materials, fibres, and between frames who is alive */
    const uint8_t *fixed; /* [3*vertex_count] 1 where a component is prescribed (tm_support_mask); copied */
    const uint8_t *condensed; /* [tet_count] 1: alive too, whatever the tissue says (the condensed part of a hybrid);
                                 copied; null: none */
    bool corotated;           /* the world has the stage "rotation" */
} tm_compliance_factor_def;

/* A factor (CHOLMOD) of the tissue's stiffness, columns of its inverse for the vertices that patches want, and what was
 * cut since the factor as an update of low rank (Woodbury), so that a patch is exact again one block of columns after a
 * cut; past TMS_TOUCHED_VERTICES touched vertices the factor is made anew. Made when first asked for. */
typedef struct tm_compliance_factor tm_compliance_factor;
TM_API tm_compliance_factor_def tm_compliance_factor_def_default(void);
TM_API tm_status tm_compliance_factor_create(const tm_compliance_factor_def *def, tm_compliance_factor **factor,
                                             tm_error *error);
TM_API void
tm_compliance_factor_destroy(tm_compliance_factor *factor); /* after the world whose patch stage has its source */
TM_API int64_t tm_compliance_factor_bytes(const tm_compliance_factor *factor);
/* For tm_patch_def.source. Until tm_compliance_factor_start a wish is served whole within its exchange, in the caller's
 * thread: the same calls give the same bits. */
TM_API tm_compliance_source tm_compliance_factor_source(tm_compliance_factor *factor);
/* The same, for a stage that destroys `factored` with itself. */
TM_API tm_compliance_source tm_compliance_factor_owned_source(tm_compliance_factor *factor);
/* From now on a thread of its own, nicer than the caller's, does the work, and exchanges never wait. */
TM_API tm_status tm_compliance_factor_start(tm_compliance_factor *factor, tm_error *error);

/* --- as models (tensormass/model.h) --- */

/* `how` says how it is computed: solver, tolerances, threads, memory and progress of its problem, precision, file,
 * max_contact_vertices. What it is comes from `def`: the rest of `how` is not read. `report` may be null. def->cut:
 * TM_ERR_EXCLUDED. */
TM_API tm_status tm_model_precomputed(const tm_model_def *def, const tm_precomputed_def *how, tm_model **model,
                                      tm_solve_report *report, tm_error *error);
/* Only computes and writes how->file, whatever is there, as tm_precomputed_write. */
TM_API tm_status tm_model_precompute(const tm_model_def *def, const tm_precomputed_def *how, tm_solve_report *report,
                                     tm_error *error);
/* As tm_model_precomputed; of `how` also `dynamic`, the part that is tensor/mass and may be cut. Its patches are those
 * of the dynamic model, of the whole organ's surface and compliance, cut or not. */
TM_API tm_status tm_model_hybrid(const tm_model_def *def, const tm_hybrid_def *how, tm_model **model,
                                 tm_solve_report *report, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
