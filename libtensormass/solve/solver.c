/* One interface for both back ends, and the check of available memory before allocation. */
#include "internal.h"

#include <cholmod.h>
#include <stdio.h>
#include <string.h>

struct tms_solver {
    tm_solver kind;
    int32_t n;
    double tolerance;
    int32_t max_iterations;
    int64_t bytes;
    cholmod_common common; /* owns the factor */
    cholmod_factor *factor;
    tms_cg *cg;
};

struct tms_work {
    const tms_solver *solver;
    int32_t width;
    cholmod_common common; /* one per thread: the factor is only read */
    cholmod_dense *b, *x, *y, *e;
    double *cg_b, *cg_x;
};

static void start(cholmod_common *common) {
    cholmod_start(common);
    common->print = 0;
    common->error_handler = NULL;
    common->supernodal = CHOLMOD_SUPERNODAL;
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_METIS;
    common->quick_return_if_not_posdef = 1;
}

/* Returns "NAME 123" or "NAME: 123 kB" of a file, or its first number; -1 if missing. */
static int64_t number_in(const char *path, const char *name) {
    FILE *f = fopen(path, "r");
    long long value = -1;
    char line[128];
    const size_t n = strlen(name);
    while (f && value < 0 && fgets(line, sizeof line, f))
        if (!strncmp(line, name, n) && (!n || line[n] == ' ' || line[n] == ':'))
            if (sscanf(line + n, "%*[: ]%lld", &value) != 1) sscanf(line + n, "%lld", &value);
    if (f) fclose(f);
    return value;
}

/* Returns the memory that our control groups (cgroup v2) leave; their file pages count as free. */
static int64_t group_bytes(void) {
    char line[512] = "", path[640], *group = NULL;
    int64_t least = INT64_MAX;
    FILE *f = fopen("/proc/self/cgroup", "r");
    while (f && !group && fgets(line, sizeof line, f))
        if (!strncmp(line, "0::", 3)) group = line + 3;
    if (f) fclose(f);
    if (!group) return least;
    group[strcspn(group, "\n")] = 0;
    for (;;) {
        int64_t part[4];
        const char *file[4] = {"memory.max", "memory.current", "memory.stat", "memory.stat"},
                   *name[4] = {"", "", "active_file", "inactive_file"};
        for (int i = 0; i < 4; i++) {
            snprintf(path, sizeof path, "/sys/fs/cgroup%s/%s", group, file[i]);
            part[i] = number_in(path, name[i]);
        }
        if (part[0] >= 0 && part[1] >= 0) {
            int64_t left = part[0] - part[1];
            for (int i = 2; i < 4; i++) left += part[i] > 0 ? part[i] : 0;
            if (left < least) least = left > 0 ? left : 0;
        }
        char *slash = strrchr(group, '/');
        if (!slash) return least;
        *slash = 0;
    }
}

static int64_t available_bytes(void) {
    const int64_t kb = number_in("/proc/meminfo", "MemAvailable"), machine = kb < 0 ? INT64_MAX : kb * 1024,
                  group = group_bytes();
    return group < machine ? group : machine;
}

/* b, x, y, e of each thread. */
static int64_t work_bytes(const tm_solve_def *def, int32_t n) {
    return (int64_t)tms_threads(def) * TMS_BLOCK * n * 8 * (def->solver == TM_SOLVER_CG ? 2 : 4);
}

/* Checks the address space, besides memory itself: BLAS would hang without it. */
static tm_status ask_address_space(const tm_solve_def *def, int64_t need, tm_error *error) {
    const int32_t threads = tms_threads(def);
    const int64_t blas = def->solver == TM_SOLVER_CHOLESKY ? tms_blas_bytes(threads) : 0;
    int64_t limit;
    if (tms_address_space_has(need + blas, &limit)) return TM_OK;
    char t_need[32], t_blas[32], t_limit[32] = "less";
    tms_bytes_text(need, t_need);
    tms_bytes_text(blas, t_blas);
    if (limit < INT64_MAX) tms_bytes_text(limit, t_limit);
    return tm_fail(
        error, TM_ERR_MEMORY, -1,
        "too large: %s of memory and %s of address space for BLAS in %d threads are needed, and the limit of "
        "this process is %s (ulimit -v); raise the limit, or choose fewer threads%s, or a coarser mesh",
        t_need, t_blas, (int)threads, t_limit, blas ? ", conjugate gradients (slower)" : "");
}

static tm_status ask_memory(const tm_solve_def *def, int32_t n, int64_t factor, int64_t responses, int64_t single,
                            tm_error *error) {
    const int64_t limit = def->memory_limit_bytes > 0 ? def->memory_limit_bytes : available_bytes();
    const int64_t work = work_bytes(def, n), need = factor + responses + work;
    if (need <= limit) return ask_address_space(def, need, error);
    char t_need[32], t_limit[32], t_factor[32], t_resp[32], t_single[32], t_cg[32], t_work[32];
    tms_bytes_text(need, t_need);
    tms_bytes_text(limit, t_limit);
    tms_bytes_text(factor, t_factor);
    tms_bytes_text(responses, t_resp);
    tms_bytes_text(work, t_work);
    tms_bytes_text(need - responses + single, t_single);
    tms_bytes_text(need - factor, t_cg);
    char choices[160] = "";
    if (single < responses) snprintf(choices, sizeof choices, "single precision responses (%s), ", t_single);
    if (factor > 0)
        snprintf(choices + strlen(choices), sizeof choices - strlen(choices), "conjugate gradients (%s, slower), ",
                 t_cg);
    return tm_fail(error, TM_ERR_MEMORY, -1,
                   "too large: %s is needed (factor %s, responses %s, working memory of %d threads %s) and %s is "
                   "allowed; choose %sfewer threads, or a coarser mesh",
                   t_need, t_factor, t_resp, (int)tms_threads(def), t_work, t_limit, choices);
}

static tm_status not_definite(const tms_solver *s, const tms_system *system, tm_error *error) {
    const size_t bad = s->factor->minor;
    const int32_t free_index = bad < (size_t)s->n ? ((int32_t *)s->factor->Perm)[bad] : 0;
    const int32_t vertex = tm_mesh_original_vertex(system->mesh, system->dof[free_index] / 3);
    return tm_fail(error, TM_ERR_SUPPORT, vertex,
                   "the tissue can move without force near vertex %d (a part connected by one vertex or one edge); "
                   "connect it through faces, or support it",
                   (int)vertex);
}

static cholmod_sparse lower_of(const tms_system *system) {
    return (cholmod_sparse){.nrow = (size_t)system->n,
                            .ncol = (size_t)system->n,
                            .nzmax = (size_t)system->begin[system->n],
                            .p = system->begin,
                            .i = system->row,
                            .x = system->value,
                            .stype = -1,
                            .itype = CHOLMOD_INT,
                            .xtype = CHOLMOD_REAL,
                            .dtype = CHOLMOD_DOUBLE,
                            .sorted = 0,
                            .packed = 1};
}

/* Computes the numbers of a factor with known order. */
static tm_status fill(tms_solver *s, cholmod_sparse *a, const tms_system *system, tm_error *error) {
    cholmod_factorize(a, s->factor, &s->common);
    if (s->common.status == CHOLMOD_OUT_OF_MEMORY)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the factor; use conjugate gradients or a coarser mesh");
    if (s->common.status != CHOLMOD_OK || s->factor->minor < s->factor->n) return not_definite(s, system, error);
    /* Rounding can hide a mechanism from the pivots, but not from the condition number. */
    if (cholmod_rcond(s->factor, &s->common) < 1e-14)
        return tm_fail(error, TM_ERR_SUPPORT, -1,
                       "the tissue can almost move without force (pivots differ by more than 1e14); look for parts "
                       "connected by one vertex or one edge, or materials of very different stiffness");
    return TM_OK;
}

static tm_status factorise(tms_solver *s, const tms_system *system, const tm_solve_def *def, int64_t responses,
                           int64_t single, tm_solve_report *report, tm_error *error) {
    cholmod_sparse a = lower_of(system);
    start(&s->common);
    double t = tms_clock_s();
    tms_ordering_begin();
    s->factor = cholmod_analyze(&a, &s->common);
    tms_ordering_end();
    report->order_s = tms_clock_s() - t;
    if (!s->factor)
        return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to order %d unknowns; use a coarser mesh", (int)s->n);
    s->bytes = (int64_t)(s->factor->xsize * 8 + s->factor->ssize * 4);
    report->factor_bytes = s->bytes;
    tm_status status = ask_memory(def, s->n, s->bytes, responses, single, error);
    if (status != TM_OK) return status;
    if (!tms_progress(def, "factor", 0, -1)) return tm_fail(error, TM_ERR_CONVERGENCE, -1, "stopped by the caller");
    t = tms_clock_s();
    status = fill(s, &a, system, error);
    report->factor_s = tms_clock_s() - t;
    return status;
}

tm_status tms_solver_create(const tms_system *system, const tm_solve_def *def, int64_t responses, int64_t single,
                            tms_solver **solver, tm_solve_report *report, tm_error *error) {
    tms_solver *s = tms_alloc_zeroed(1, sizeof *s);
    if (!s) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for a solver; use a coarser mesh");
    s->kind = def->solver;
    s->n = system->n;
    s->tolerance = def->cg_tolerance;
    s->max_iterations = def->cg_max_iterations;
    report->work_bytes = work_bytes(def, s->n) + tms_system_bytes(system);
    tm_status status;
    if (s->kind == TM_SOLVER_CG) {
        status = ask_memory(def, s->n, 0, responses, single, error);
        if (status == TM_OK && !(s->cg = tms_cg_create(system)))
            status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for conjugate gradients; use a coarser mesh");
    } else {
        tms_process_enter();
        status = factorise(s, system, def, responses, single, report, error);
        tms_process_leave();
    }
    if (status != TM_OK) {
        tms_solver_destroy(s);
        return status;
    }
    *solver = s;
    return TM_OK;
}

tm_status tms_solver_renew(tms_solver *s, const tms_system *system, tm_error *error) {
    if (s->kind == TM_SOLVER_CG)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "only a Cholesky factor can be updated; use that solver");
    cholmod_sparse a = lower_of(system);
    tms_process_enter();
    const tm_status status = fill(s, &a, system, error);
    tms_process_leave();
    return status;
}

void tms_solver_destroy(tms_solver *s) {
    if (!s) return;
    if (s->kind == TM_SOLVER_CHOLESKY) {
        cholmod_free_factor(&s->factor, &s->common);
        cholmod_finish(&s->common);
    }
    tms_cg_destroy(s->cg);
    tms_free(s);
}

int64_t tms_solver_bytes(const tms_solver *s) { return s->bytes; }

tms_supernodes tms_solver_supernodes(const tms_solver *s) {
    const cholmod_factor *f = s->factor;
    if (!f) return (tms_supernodes){0};
    return (tms_supernodes){.n = s->n,
                            .count = (int32_t)f->nsuper,
                            .begin = f->super,
                            .row_begin = f->pi,
                            .x_begin = f->px,
                            .row = f->s,
                            .component = f->Perm,
                            .x = f->x};
}

/* --- one thread's work --- */

tms_work *tms_work_create(const tms_solver *solver, int32_t width) {
    tms_work *w = tms_alloc_zeroed(1, sizeof *w);
    if (!w) return NULL;
    const size_t n = (size_t)solver->n;
    w->solver = solver;
    w->width = width;
    tms_process_enter();
    start(&w->common);
    if (solver->kind == TM_SOLVER_CG) {
        w->cg_b = tms_alloc(n * (size_t)width * 8);
        w->cg_x = tms_alloc(n * (size_t)width * 8);
    } else {
        w->b = cholmod_allocate_dense(n, (size_t)width, n, CHOLMOD_REAL, &w->common);
    }
    tms_process_leave();
    if (w->b || (w->cg_b && w->cg_x)) return w;
    tms_work_destroy(w);
    return NULL;
}

void tms_work_destroy(tms_work *w) {
    if (!w) return;
    cholmod_free_dense(&w->b, &w->common);
    cholmod_free_dense(&w->x, &w->common);
    cholmod_free_dense(&w->y, &w->common);
    cholmod_free_dense(&w->e, &w->common);
    cholmod_finish(&w->common);
    tms_free(w->cg_b);
    tms_free(w->cg_x);
    tms_free(w);
}

double *tms_work_rhs(tms_work *w) { return w->cg_b ? w->cg_b : w->b->x; }

const double *tms_work_solve(tms_work *w) {
    const tms_solver *s = w->solver;
    if (s->kind == TM_SOLVER_CHOLESKY) {
        tms_process_enter();
        const int solved = cholmod_solve2(CHOLMOD_A, s->factor, w->b, NULL, &w->x, NULL, &w->y, &w->e, &w->common);
        tms_process_leave();
        return solved ? w->x->x : NULL;
    }
    for (int32_t j = 0; j < w->width; j++)
        if (!tms_cg_solve(s->cg, w->cg_b + (int64_t)j * s->n, w->cg_x + (int64_t)j * s->n, s->tolerance,
                          s->max_iterations))
            return NULL;
    return w->cg_x;
}

/* --- one static solution --- */

static tm_status solve(const tm_solve_def *def, const tms_system *system, const tms_solver *solver, double *u,
                       double *f, tm_error *error) {
    tms_work *work = tms_work_create(solver, 1);
    if (!work) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for one solution; use a coarser mesh");
    tm_tissue_force(def->tissue, u, f);
    double *b = tms_work_rhs(work);
    for (int32_t i = 0; i < system->n; i++) b[i] = f[system->dof[i]] + (def->load_N ? def->load_N[system->dof[i]] : 0);
    const double *x = tms_work_solve(work);
    for (int32_t i = 0; x && i < system->n; i++) u[system->dof[i]] = x[i];
    tms_work_destroy(work);
    return x ? TM_OK
             : tm_fail(error, TM_ERR_CONVERGENCE, -1,
                       "conjugate gradients did not reach %g in %d iterations; raise cg_max_iterations, or use the "
                       "Cholesky solver",
                       def->cg_tolerance, (int)def->cg_max_iterations);
}

tm_status tm_solve_static(const tm_solve_def *def, double *u_m, double *reaction_N, tm_solve_report *report,
                          tm_error *error) {
    TMS_REQUIRE_PROBLEM(def);
    tm_status checked = tms_check_problem(def, error);
    if (checked != TM_OK) return checked;
    const double start = tms_clock_s();
    const size_t dofs = 3 * (size_t)tm_tissue_mesh(def->tissue)->vertex_count;
    tm_solve_report mine = {.columns = 1};
    tms_system system = {0};
    tms_solver *solver = NULL;
    double *u = tms_alloc_zeroed(dofs, 8), *f = tms_alloc(dofs * 8);
    tm_status status =
        u && f ? TM_OK : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for one solution; use a coarser mesh");
    if (status == TM_OK) status = tms_system_create(def->tissue, def->fixed, &system, error);
    if (status == TM_OK) status = tms_solver_create(&system, def, 0, 0, &solver, &mine, error);
    for (size_t d = 0; status == TM_OK && d < dofs; d++)
        if (def->fixed[d] && def->fixed_value_m) u[d] = def->fixed_value_m[d];
    if (status == TM_OK) status = solve(def, &system, solver, u, f, error);
    if (status == TM_OK && u_m) memcpy(u_m, u, dofs * 8);
    if (status == TM_OK && reaction_N) {
        tm_tissue_force(def->tissue, u, f);
        for (size_t d = 0; d < dofs; d++)
            reaction_N[d] = def->fixed[d] ? -f[d] - (def->load_N ? def->load_N[d] : 0) : 0;
    }
    mine.free_dofs = system.n;
    mine.seconds = tms_clock_s() - start;
    if (report && status == TM_OK) *report = mine;
    tms_solver_destroy(solver);
    tms_system_destroy(&system);
    tms_free(u);
    tms_free(f);
    return status;
}
