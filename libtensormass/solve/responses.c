/* Responses of a problem: read from a file, or computed. */
#include "internal.h"

#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

/* Hashes all inputs of the columns and nothing else: not density and damping, but a load. */
static uint64_t key_of(const tms_request *q) {
    const tm_tissue *tissue = q->def->tissue;
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const size_t n = (size_t)mesh->vertex_count;
    const int32_t settings[6] = {mesh->vertex_count,      mesh->tet_count,    (int32_t)q->precision,
                                 (int32_t)q->def->solver, q->interface_count, TMS_BLOCK};
    uint64_t h = tm_hash(settings, sizeof settings, TM_HASH_SEED);
    if (q->def->solver == TM_SOLVER_CG) h = tm_hash(&q->def->cg_tolerance, 8, h);
    const double shear = tm_tissue_smoothed_shear_share(tissue);
    if (shear >= 0) h = tm_hash(&shear, sizeof shear, h);
    h = tm_hash(mesh->rest_m, 24 * n, h);
    h = tm_hash(mesh->tet, 16 * (size_t)mesh->tet_count, h);
    h = tm_hash(tm_tissue_alive(tissue), (size_t)mesh->tet_count, h);
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const tm_material *m = tm_tissue_tet_material(tissue, t);
        const double constant[5] = {m->lambda_Pa, m->mu_Pa, m->dlambda_Pa, m->dmu_Pa, m->beta_Pa},
                     *fibre = tm_tissue_tet_fibre(tissue, t);
        h = tm_hash(constant, sizeof constant, h);
        if (fibre && !tm_material_is_isotropic(m)) h = tm_hash(fibre, 24, h);
    }
    /* The tensors may be stored in single, which changes the result. */
    double K[9];
    tm_tissue_vertex_tensor(tissue, 0, K);
    h = tm_hash(K, sizeof K, h);
    h = tm_hash(q->def->fixed, 3 * n, h);
    for (size_t d = 0; d < 3 * n; d++) {
        if (q->def->fixed[d] && q->def->fixed_value_m) h = tm_hash(&q->def->fixed_value_m[d], 8, h);
        if (q->def->load_N) h = tm_hash(&q->def->load_N[d], 8, h);
    }
    h = tm_hash(q->interface, 4 * (size_t)q->interface_count, h);
    return tm_hash(q->wanted, n, h);
}

static void view(tms_responses *r, char *memory, const char *columns) {
    const tms_file_head *head = (const tms_file_head *)(void *)memory;
    r->kept_count = head->kept_count;
    r->interface_count = head->interface_count;
    r->precision = (tm_precision)head->precision;
    const tms_layout l = tms_file_layout(r->kept_count, r->interface_count, r->precision);
    r->kept = (const int32_t *)(void *)(memory + l.kept);
    r->interface = (const int32_t *)(void *)(memory + l.interface);
    r->base_m = (const double *)(void *)(memory + l.base);
    r->interface_N = (const double *)(void *)(memory + l.force);
    r->schur = (const double *)(void *)(memory + l.schur);
    r->column = columns;
    r->bytes = (int64_t)l.bytes;
}

/* Makes the head of a partial file. The last bits of a distributed factor are its own, so another one may not continue
 * the file. */
static tms_file_head head_of(const tms_request *q, uint64_t key, int32_t kept_count) {
    const bool shared = q->ranks && q->ranks->distributed;
    return (tms_file_head){.key = shared ? tm_hash("shared", 6, key) : key,
                           .kept_count = kept_count,
                           .interface_count = q->interface_count,
                           .precision = (int32_t)q->precision};
}

/* Starts the lists of a new set in `memory`, after its head. */
static void begin_lists(const tms_request *q, const tms_system *system, int32_t kept_count, char *memory) {
    const tms_layout l = tms_file_layout(kept_count, q->interface_count, q->precision);
    int32_t *kept = (int32_t *)(void *)(memory + l.kept), at = 0;
    for (int32_t i = 0; i < system->n; i++)
        if (q->wanted[system->dof[i] / 3]) kept[at++] = system->dof[i];
    if (q->interface_count) memcpy(memory + l.interface, q->interface, 4 * (size_t)q->interface_count);
}

/* Solves one right-hand side, b [n] in and the solution out. With a distributed factor all ranks take part; b is null
 * except on rank 0. */
static tm_status solve_one(const tms_request *q, const tms_solver *solver, int32_t n, double *b, tm_error *error) {
    bool solved = false;
    if (solver) {
        tms_work *work = tms_work_create(solver, 1);
        if (!work) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for one solution; use a coarser mesh");
        memcpy(tms_work_rhs(work), b, 8 * (size_t)n);
        const double *x = tms_work_solve(work);
        if (x) memcpy(b, x, 8 * (size_t)n);
        solved = x != NULL;
        tms_work_destroy(work);
    } else {
        solved = q->ranks->distributed->solve_one(q->ranks->user, b);
    }
    if (solved) return TM_OK;
    return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                   "the loaded shape did not reach the tolerance; raise cg_max_iterations, or use the Cholesky solver");
}

/* Computes the displacement under the loads and prescribed values with the interface fixed at 0, and the force on the
 * interface. */
static tm_status solve_base(const tms_request *q, const tms_system *system, const tms_solver *solver,
                            const int32_t *kept, int32_t kept_count, double *base, double *force, tm_error *error) {
    const size_t dofs = 3 * (size_t)system->vertex_count;
    double *u = tms_alloc_zeroed(dofs, 8), *f = tms_alloc(dofs * 8), *b = tms_alloc(8 * (size_t)(system->n + 1));
    tm_status status = TM_OK;
    if (!u || !f || !b) {
        status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for one solution; use a coarser mesh");
        goto done;
    }
    for (size_t d = 0; d < dofs; d++)
        if (q->def->fixed[d] && q->def->fixed_value_m) u[d] = q->def->fixed_value_m[d];
    tm_tissue_force(q->def->tissue, u, f);
    for (int32_t i = 0; i < system->n; i++)
        b[i] = f[system->dof[i]] + (q->def->load_N ? q->def->load_N[system->dof[i]] : 0);
    status = solve_one(q, solver, system->n, b, error);
    if (status != TM_OK) goto done;
    for (int32_t i = 0; i < system->n; i++) u[system->dof[i]] = b[i];
    for (int32_t i = 0; i < kept_count; i++) base[i] = u[kept[i]];
    tm_tissue_force(q->def->tissue, u, f);
    for (int32_t i = 0; i < q->interface_count; i++) force[i] = f[q->interface[i]];
done:
    tms_free(u);
    tms_free(f);
    tms_free(b);
    return status;
}

static tm_status compute_into(const tms_request *q, const tms_system *system, const tms_solver *solver,
                              tms_partial_file *part, int32_t kept_count, char *memory, char *columns,
                              tm_error *error) {
    const tms_layout l = tms_file_layout(kept_count, q->interface_count, q->precision);
    const bool first = !q->ranks || q->ranks->rank == 0;
    begin_lists(q, system, kept_count, memory);
    const int32_t *kept = (const int32_t *)(void *)(memory + l.kept);
    tm_status status = first    ? solve_base(q, system, solver, kept, kept_count, (double *)(void *)(memory + l.base),
                                             (double *)(void *)(memory + l.force), error)
                       : solver ? TM_OK
                                : solve_one(q, NULL, system->n, NULL, error);
    if (status != TM_OK) return status;
    const tms_columns c = {.tissue = q->def->tissue,
                           .system = system,
                           .solver = solver,
                           .kept_count = kept_count,
                           .interface_count = q->interface_count,
                           .kept = kept,
                           .interface = q->interface,
                           .precision = q->precision,
                           .out = columns,
                           .schur = q->interface_count ? (double *)(void *)(memory + l.schur) : NULL,
                           .partial_file = part->done ? part : NULL};
    return solver ? tms_columns_run(&c, q->def, q->ranks, error) : tms_distributed_columns(&c, q->def, q->ranks, error);
}

/* Adds the reason for not writing a file to the reason for not reading one. */
static void in_memory(char why[160], const tm_error *lack) {
    const size_t used = strlen(why);
    snprintf(why + used, 160 - used, "; kept in memory alone: %s", lack->message);
}

/* Reserves the new file, which is already locked, if one is wanted. `need`: no file is a failure. */
static tm_status reserve(const tms_request *q, tms_file_write *file, const tms_file_head *head, size_t bytes, bool need,
                         tms_partial_file *part, char why[160], tm_error *error) {
    tm_error lack;
    if (file->fd < 0) return TM_OK;
    tm_status status = TM_OK;
    if (q->resume || q->ranks) {
        status = tms_partial_file_begin(part, file, head, &lack);
    } else {
        status = tms_file_reserve(file, bytes, &lack);
        if (status == TM_OK) memcpy(file->map, head, sizeof *head);
    }
    if (status == TM_OK) return TM_OK;
    tms_file_abandon(file);
    if (need) {
        if (error) *error = lack;
        return status;
    }
    in_memory(why, &lack);
    return TM_OK;
}

/* Opens the partial file that all ranks write: rank 0 creates it, the others open it afterwards. */
static tm_status open_part(const tms_request *q, tms_file_write *file, const tms_file_head *head, size_t bytes,
                           bool need, tms_partial_file *part, char why[160], tm_error *error) {
    const bool first = !q->ranks || q->ranks->rank == 0;
    tm_status status = first ? reserve(q, file, head, bytes, need, part, why, error) : TM_OK;
    if (status == TM_OK) status = tms_ranks_barrier(q->ranks, error);
    return status != TM_OK || first ? status : tms_partial_file_join(part, q->file, head, error);
}

/* Renames the computed file and maps it; if that fails, keeps the memory. */
static tm_status publish(const tms_request *q, uint64_t key, tms_file_write *file, bool need, tms_responses *r,
                         char why[160], tm_error *error) {
    tm_error lack;
    const int32_t threads = tms_threads(q->def);
    const size_t bytes = file->bytes;
    tm_status status = tms_file_commit(file, key, threads, &lack);
    if (status == TM_OK) {
        char bad[160];
        if (!tms_file_open(q->file, key, threads, &r->map, &r->map_bytes, bad))
            return tm_fail(error, TM_ERR_FILE, -1, "%s: just written, and already %s; check the disk", q->file, bad);
    } else if (need) {
        tms_file_abandon(file);
        if (error) *error = lack;
        return status;
    } else {
        in_memory(why, &lack);
        r->map = tms_file_keep(file);
        r->map_bytes = bytes;
    }
    const tms_file_head *head = r->map;
    view(r, r->map, (char *)r->map + head->column_offset);
    return TM_OK;
}

/* Computes a factor of its own, or this rank's part of a distributed one. */
static tm_status factor(const tms_request *q, const tms_system *system, const tms_layout *l, const tms_layout *single,
                        tms_solver **solver, tm_solve_report *report, tm_error *error) {
    if (!q->ranks || !q->ranks->distributed)
        return tms_solver_create(system, q->def, (int64_t)l->bytes, (int64_t)single->bytes, solver, report, error);
    const double start = tms_clock_s();
    if (!tms_progress(q->def, "factor", 0, -1)) return tm_fail(error, TM_ERR_CONVERGENCE, -1, "stopped by the caller");
    const tm_status status = q->ranks->distributed->factor(q->ranks->user, system->n, system->begin, system->row,
                                                           system->value, &report->factor_bytes, error);
    report->factor_s = tms_clock_s() - start;
    return status;
}

/* Computes the result into the mapped new file or own memory; on other ranks only the lists are in memory. */
static tm_status fill(const tms_request *q, const tms_system *system, const tms_solver *solver,
                      const tms_file_head *head, const tms_layout *l, tms_file_write *file, tms_partial_file *part,
                      tms_responses *r, tm_error *error) {
    const bool first = !q->ranks || q->ranks->rank == 0, mapped = file->map != MAP_FAILED;
    char *memory = mapped ? file->map : (r->head = tms_alloc_zeroed(1, l->column));
    char *columns = mapped ? memory + l->column : first ? (r->owned = tms_alloc(l->bytes - l->column + 1)) : NULL;
    if (!memory || (first && !columns))
        return tm_fail(error, TM_ERR_MEMORY, -1,
                       "no memory for the responses; store them in single precision, or use a coarser mesh");
    if (!mapped) memcpy(memory, head, sizeof *head);
    const tm_status status = compute_into(q, system, solver, part, head->kept_count, memory, columns, error);
    if (status == TM_OK && first && !mapped) view(r, memory, columns);
    return status;
}

static tm_status compute(const tms_request *q, uint64_t key, tms_file_write *file, bool need, tms_responses *r,
                         tm_solve_report *report, tm_error *error) {
    const int32_t rank = q->ranks ? q->ranks->rank : 0;
    tms_system system = {0};
    tms_solver *solver = NULL;
    tms_partial_file part = {.fd = -1};
    int32_t kept_count = 0;
    tm_status status = tms_system_create(q->def->tissue, q->def->fixed, &system, error);
    if (status != TM_OK) goto done;
    for (int32_t i = 0; i < system.n; i++) kept_count += q->wanted[system.dof[i] / 3];
    if (kept_count > TMS_MAX_COLUMNS || q->interface_count > TMS_MAX_COLUMNS) {
        status = tm_fail(error, TM_ERR_MEMORY, -1, "%d columns are too many; use a coarser mesh",
                         (int)(kept_count > q->interface_count ? kept_count : q->interface_count));
        goto done;
    }
    const tms_layout l = tms_file_layout(kept_count, q->interface_count, q->precision),
                     single = tms_file_layout(kept_count, q->interface_count, TM_SINGLE);
    const tms_file_head head = head_of(q, key, kept_count);
    report->free_dofs = system.n;
    report->columns = kept_count + q->interface_count;
    report->responses_bytes = (int64_t)l.bytes;
    status = factor(q, &system, &l, &single, &solver, report, error);
    if (status == TM_OK) status = open_part(q, file, &head, l.bytes, need, &part, report->why, error);
    if (status == TM_OK) report->columns_found = tms_partial_file_columns(&part, report->columns);
    if (status == TM_OK) status = fill(q, &system, solver, &head, &l, file, &part, r, error);
done:
    tms_partial_file_end(&part);
    if (q->solver && status == TM_OK) {
        *q->system = system;
        *q->solver = solver;
    } else {
        tms_solver_destroy(solver); /* before the file is flushed: the factor is the larger half of memory */
        tms_system_destroy(&system);
    }
    if (file->map != MAP_FAILED && status == TM_OK) status = publish(q, key, file, need, r, report->why, error);
    tms_file_abandon(file);
    if (status != TM_OK && q->solver && *q->solver) { /* the file failed after the factor was handed over */
        tms_solver_destroy(*q->solver);
        tms_system_destroy(q->system);
        *q->solver = NULL;
    }
    if (status != TM_OK || rank > 0) tms_responses_release(r);
    return status;
}

static tm_status factor_again(const tms_request *q, tm_solve_report *report, tm_error *error) {
    tm_status status = tms_system_create(q->def->tissue, q->def->fixed, q->system, error);
    if (status != TM_OK) return status;
    status = tms_solver_create(q->system, q->def, 0, 0, q->solver, report, error);
    if (status != TM_OK) tms_system_destroy(q->system);
    return status;
}

/* Checks that the lists are those of this problem: a damaged file may have wrong ones and still the right checksums. */
static bool lists_fit(const tms_request *q, const tms_responses *r) {
    const int32_t dofs = 3 * tm_tissue_mesh(q->def->tissue)->vertex_count;
    if (r->interface_count != q->interface_count || r->precision != q->precision) return false;
    if (r->interface_count && memcmp(r->interface, q->interface, 4 * (size_t)r->interface_count)) return false;
    for (int32_t i = 0, last = -1; i < r->kept_count; last = r->kept[i++])
        if (r->kept[i] <= last || r->kept[i] >= dofs || !q->wanted[r->kept[i] / 3] || q->def->fixed[r->kept[i]])
            return false;
    return true;
}

static bool from_file(const tms_request *q, uint64_t key, tms_responses *r, tm_solve_report *report) {
    if (!tms_file_open(q->file, key, tms_threads(q->def), &r->map, &r->map_bytes, report->why)) return false;
    const tms_file_head *head = r->map;
    view(r, r->map, (char *)r->map + head->column_offset);
    if (!lists_fit(q, r)) {
        tms_responses_release(r);
        snprintf(report->why, sizeof report->why, "its vertices are of another problem");
        return false;
    }
    report->from_file = true;
    report->why[0] = 0;
    report->columns = r->kept_count + r->interface_count;
    report->responses_bytes = r->bytes;
    return true;
}

tm_status tms_responses_get(const tms_request *q, bool force, tms_responses *r, tm_solve_report *report,
                            tm_error *error) {
    const double start = tms_clock_s();
    const uint64_t key = key_of(q);
    const bool writes = q->file && !(q->ranks && q->ranks->rank > 0);
    tms_file_write file = {.fd = -1, .map = MAP_FAILED};
    tm_status status = TM_OK;
    *r = (tms_responses){0};
    report->interface_dofs = q->interface_count;
    snprintf(report->why, sizeof report->why, "%s", q->file ? "a new computation was requested" : "no file is named");
    bool found = q->file && !force && from_file(q, key, r, report);
    if (writes && !found) {
        tm_error lack;
        status = tms_file_lock(q->def, q->file, TMS_WAIT_S, &file, &lack);
        if (status == TM_OK && !force) { /* the previous holder of the lock may have written it */
            found = from_file(q, key, r, report);
            if (found) tms_file_abandon(&file);
        } else if (status == TM_ERR_FILE && !force) {
            in_memory(report->why, &lack); /* everything works without a cache too */
            status = TM_OK;
        } else if (status != TM_OK && error) {
            *error = lack;
        }
    }
    if (status == TM_OK && found)
        status = q->solver ? factor_again(q, report, error) : TM_OK;
    else if (status == TM_OK)
        status = compute(q, key, &file, force, r, report, error);
    report->seconds = tms_clock_s() - start;
    if (status != TM_OK) tms_responses_release(r);
    return status;
}

void tms_responses_release(tms_responses *r) {
    if (r->map) munmap(r->map, r->map_bytes);
    tms_free(r->head);
    tms_free(r->owned);
    *r = (tms_responses){0};
}
