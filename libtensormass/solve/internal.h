/* Internals of libtensormass_solve. */
#ifndef TMS_INTERNAL_H
#define TMS_INTERNAL_H

#include "base/contract.h"
#include "tensormass_solve.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TMS_COOKIE_PROBLEM = 0x736f6c76,
    TMS_COOKIE_PRECOMPUTED = 0x70726563,
    TMS_COOKIE_HYBRID = 0x68796272,
    TMS_COOKIE_FACTORED = 0x66616374
};

/* Columns are always solved in blocks of this width, the last one padded with zeros. Dense kernels may sum in another
 * order for another width, and the result must not depend on the number of threads or ranks. */
#define TMS_BLOCK 64
#define TMS_MAX_COLUMNS (1 << 24) /* of either kind: sizes would overflow above it */
#define TMS_WAIT_S 600            /* for another process that computes the same file */

/* Returns whether these `count` doubles of a snapshot, at any address, are numbers of size below `most` (INFINITY:
 * finite). */
bool tms_are_below(const void *from, size_t count, double most);
/* Compares two int32_t, for qsort and bsearch. */
static inline int tms_ascending(const void *a, const void *b) {
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* Checks the caller's part of a problem's contract. */
#define TMS_REQUIRE_PROBLEM(problem)                                                                                   \
    do {                                                                                                               \
        TM_REQUIRE_DEF(problem, TMS_COOKIE_PROBLEM, TM_ERR_ARGUMENT);                                                  \
        TM_REQUIRE((problem)->tissue && (problem)->fixed, #problem " has no tissue, or no fixed components",           \
                   TM_ERR_ARGUMENT);                                                                                   \
    } while (0)
/* Checks a problem's data: solver, tolerances and counts in range, values and loads finite; `entity` is the invalid
 * vertex. */
tm_status tms_check_problem(const tm_solve_def *def, tm_error *error);
tm_status tms_check_precision(tm_precision precision, tm_error *error);
double tms_clock_s(void);
int32_t tms_threads(const tm_solve_def *def);
void tms_bytes_text(int64_t bytes, char text[32]);
/* Returns false if the caller requests a stop. */
bool tms_progress(const tm_solve_def *def, const char *what, double fraction, double seconds_left);

/* --- util.c: memory of the one allocator (tm_set_allocator), aligned to 64 bytes, with its size stored. CHOLMOD and
 * Eigen allocate their own. --- */

void *tms_alloc(size_t bytes);
void *tms_alloc_zeroed(size_t count, size_t size);
void tms_free(void *memory); /* null is allowed */

/* --- coupling_kernel.c: inner loops; bit-identical on all machines --- */

/* out := rows x; rows [count][width], width a multiple of 16. */
void tms_rows_times(const float *rows, int32_t count, int32_t width, const float *x, float *out);
double tms_dot(const double *a, const double *b, int32_t n);
/* out [3][3] := sums over k of a[i][k] weight[k] b[j][k]; a and b [3][n]. */
void tms_weighted_dots(const double *a, const double *weight, const double *b, int32_t n, double out[9]);
/* out += f a */
void tms_add_times(double f, const double *a, int32_t n, double *out);

/* --- library_globals.c: settings of the process --- */

/* Between enter and leave OpenBLAS has one thread in each of ours, and SuiteSparse aligns its memory. May be nested and
 * called from many threads. */
void tms_process_enter(void);
void tms_process_leave(void);
/* Must enclose each ordering, one at a time: METIS uses rand(). */
void tms_ordering_begin(void);
void tms_ordering_end(void);
/* Returns false if OpenBLAS was built without threading; it must then not be called from two threads. */
bool tms_blas_is_parallel(void);
/* Address space that BLAS needs besides ours, and whether it is available. */
int64_t tms_blas_bytes(int32_t threads);
bool tms_address_space_has(int64_t bytes, int64_t *limit_bytes);

/* --- system.c: free components and their stiffness --- */

typedef struct tms_system {
    const tm_mesh *mesh;     /* for messages */
    int32_t vertex_count, n; /* n free components */
    int32_t *index;          /* [3*vertex_count] free index, -1: prescribed, or in no active tetrahedron */
    int32_t *dof;            /* [n] 3*vertex + axis, ascending */
    int32_t *begin;          /* [n+1] lower triangle by columns */
    int32_t *row;            /* ascending within a column */
    double *value;           /* N/m */
} tms_system;

/* Sets part_kg [vertex_count] to the mass of the connected piece that a vertex belongs to, if that can move as a rigid
 * body, else to 0. Returns false if memory is exhausted. */
bool tms_find_loose(const tm_tissue *tissue, const uint8_t *fixed, double *part_kg);
/* Checks that `fixed` constrains each connected component (else TM_ERR_SUPPORT names one of its vertices). */
tm_status tms_check_constrained(const tm_tissue *tissue, const uint8_t *fixed, tm_error *error);
tm_status tms_system_create(const tm_tissue *tissue, const uint8_t *fixed, tms_system *system, tm_error *error);
/* The same for tissue that needs no support. */
tm_status tms_system_assemble(const tm_tissue *tissue, const uint8_t *fixed, tms_system *system, tm_error *error);
void tms_system_destroy(tms_system *system);
int64_t tms_system_bytes(const tms_system *system);
/* Returns the name of its first nonlinear law; null: none. */
const char *tms_nonlinear_law(const tm_tissue *tissue);
/* Builds a tissue of the same materials with the marked tetrahedra only, linear, double. */
tm_status tms_sub_tissue(const tm_tissue *whole, const uint8_t *alive, tm_tissue **tissue, tm_error *error);

/* --- solver.c, cg.cpp: A x = b on the free components, TMS_BLOCK right-hand sides at a time --- */

typedef struct tms_solver tms_solver;
typedef struct tms_work tms_work; /* of one thread */

/* Checks for all memory first: factor, work of `threads`, and `responses_bytes` besides. */
tm_status tms_solver_create(const tms_system *system, const tm_solve_def *def, int64_t responses_bytes,
                            int64_t responses_bytes_single, tms_solver **solver, tm_solve_report *report,
                            tm_error *error);
/* Factorises another system with the same entries (n, begin, row) in the same order; works stay valid. After a failure
 * there is no factor: destroy the solver. */
tm_status tms_solver_renew(tms_solver *solver, const tms_system *system, tm_error *error);
void tms_solver_destroy(tms_solver *solver);
int64_t tms_solver_bytes(const tms_solver *solver);
tms_work *tms_work_create(const tms_solver *solver, int32_t width);
void tms_work_destroy(tms_work *work);
double *tms_work_rhs(tms_work *work); /* [n*width], column after column; the caller fills all of it */
/* Returns null if it does not converge. No allocation after the first call (CHOLMOD). */
const double *tms_work_solve(tms_work *work);

typedef struct tms_cg tms_cg;
tms_cg *tms_cg_create(const tms_system *system);
void tms_cg_destroy(tms_cg *cg);
bool tms_cg_solve(const tms_cg *cg, const double *b, double *x, double tolerance, int32_t max_iterations);

/* --- reach.cpp: the same for few components, which need a small part of a factor --- */

/* CHOLMOD's factor L L^T of the permuted system. Supernode s has the columns begin[s].. of L, dense, with the rows
 * row[row_begin[s]..], its own columns first. x null: no factor (conjugate gradients). */
typedef struct tms_supernodes {
    int32_t n, count;
    const int32_t *begin, *row_begin, *x_begin, *row;
    const int32_t *component; /* [n] component at each position of the factor */
    const double *x;
} tms_supernodes;
tms_supernodes tms_solver_supernodes(const tms_solver *solver);

/* Belongs to one thread and one solver, also after tms_solver_renew. */
typedef struct tms_reach tms_reach;
tms_reach *tms_reach_create(const tms_solver *solver); /* null: no memory, or no factor */
void tms_reach_destroy(tms_reach *reach);
int64_t tms_reach_bytes(const tms_reach *reach);
/* out [rows][units] := components row[] of the solutions for unit forces on components unit[], at most TMS_BLOCK.
 * Component -1 is prescribed: zeros. No allocation. */
void tms_reach_solve(tms_reach *reach, const tms_solver *solver, const int32_t *unit, int32_t units, const int32_t *row,
                     int32_t rows, double *out);

/* --- partial_file.c: finished blocks of columns and their place --- */

typedef struct tms_partial_file {
    int32_t block_count, found; /* found: already complete when the file was opened */
    uint64_t *done; /* [blocks] checksum of a block, 0: not done; on rank 0 in the file itself. Null: no journal */
    int fd;         /* of ranks above 0, which write; -1 */
    size_t column, journal, block_bytes;
} tms_partial_file;

/* Writes block `b`, of `bytes`, to its place and records it. On rank 0 it is already in place. */
bool tms_partial_file_put(tms_partial_file *part, int32_t block, const void *data, size_t bytes);
int32_t tms_partial_file_columns(const tms_partial_file *part, int32_t columns); /* number of columns found, of
                                                                                  * `columns` */
void tms_partial_file_end(tms_partial_file *part);

/* --- columns.c: responses --- */

/* Column j < kept_count: displacement of the kept components for a unit force on kept component j. The next
 * interface_count columns: for a unit displacement of an interface component, with all other prescribed ones at 0. */
typedef struct tms_columns {
    const tm_tissue *tissue;
    const tms_system *system;
    const tms_solver *solver;
    int32_t kept_count, interface_count;
    const int32_t *kept;      /* components, 3*vertex + axis */
    const int32_t *interface; /* components, prescribed in `system` */
    tm_precision precision;
    void *out;     /* [(kept_count + interface_count)][kept_count], or null: all of it goes through `part` */
    double *schur; /* [interface_count][interface_count] condensed stiffness, or null */
    tms_partial_file *partial_file;
} tms_columns;

/* Waits for the other ranks; null: there are none. */
tm_status tms_ranks_barrier(const tm_solve_ranks *ranks, tm_error *error);
tm_status tms_columns_run(const tms_columns *columns, const tm_solve_def *def, const tm_solve_ranks *ranks,
                          tm_error *error);
/* The same with one factor distributed over the ranks. */
tm_status tms_distributed_columns(const tms_columns *columns, const tm_solve_def *def, const tm_solve_ranks *ranks,
                                  tm_error *error);

/* --- responses.c: stored data of a factorised problem, in memory or in a file --- */

typedef struct tms_responses {
    int32_t kept_count, interface_count;
    const int32_t *kept, *interface;
    const double *base_m; /* [kept_count] displacement under the loads and prescribed values, interface at 0 */
    const double
        *interface_N;    /* [interface_count] force of the interior's loads and supports on the interface fixed at 0 */
    const double *schur; /* [interface_count^2] */
    const void *column;  /* as tms_columns.out */
    tm_precision precision;
    int64_t bytes;
    void *map; /* of the file, or null */
    size_t map_bytes;
    void *head; /* owned copies when not mapped */
    void *owned;
} tms_responses;

/* A problem for these functions: interface components are marked in def->fixed, with value 0. */
typedef struct tms_request {
    const tm_solve_def *def;
    const int32_t *interface;
    int32_t interface_count;
    const uint8_t *wanted; /* [vertex_count] 1: responses of this vertex are stored */
    tm_precision precision;
    const char *file;
    bool resume;
    const tm_solve_ranks *ranks;
    tms_system
        *system; /* out, both or neither: kept for online solutions; recomputed if the responses came from a file */
    tms_solver **solver;
} tms_request;

/* Reads the responses from the file, else computes and writes them. `force`: always computes them. On ranks above 0
 * nothing is returned. */
tm_status tms_responses_get(const tms_request *request, bool force, tms_responses *responses, tm_solve_report *report,
                            tm_error *error);
void tms_responses_release(tms_responses *responses);
/* Returns one entry of a column; callers gather the 3x3 block of kept vertices with it. */
static inline double tms_response(const tms_responses *r, int32_t column, int32_t row) {
    const int64_t at = (int64_t)column * r->kept_count + row;
    return r->precision == TM_DOUBLE ? ((const double *)r->column)[at] : (double)((const float *)r->column)[at];
}

/* --- file.c --- */

typedef struct tms_file_head {
    char magic[8];
    uint32_t version, byte_order;
    uint64_t key; /* of mesh, materials, supports, loads, solver, precision */
    int32_t kept_count, interface_count, precision, block;
    int64_t column_offset, bytes; /* of the file */
    uint64_t head_checksum;       /* of all before the columns, with this field 0 */
} tms_file_head;

/* Maps a complete, valid file. Returns false with the reason in `why`. */
bool tms_file_open(const char *path, uint64_t key, int32_t threads, void **map, size_t *bytes, char why[160]);
typedef struct tms_file_write {
    char path[1024], partial_file[1040];
    int fd;
    bool keep_partial; /* the partial file, when it is abandoned */
    void *map;
    size_t bytes;
} tms_file_write;
/* Creates and locks `path`.part, so that only one process computes the file. Otherwise waits up to wait_s for the other
 * process, calling def->progress (false: TM_ERR_CONVERGENCE). After a wait, the caller must look for the finished file
 * again. */
tm_status tms_file_lock(const tm_solve_def *def, const char *path, double wait_s, tms_file_write *file,
                        tm_error *error);
/* Reserves `bytes` on the disk, for a new or an existing file, and maps them for writing. */
tm_status tms_file_map(tms_file_write *file, size_t bytes, tm_error *error);
tm_status tms_file_reserve(tms_file_write *file, size_t bytes, tm_error *error);
/* Writes checksums, flushes to disk and renames the file to `path`. After a failure the file is left to _keep or
 * _abandon. */
tm_status tms_file_commit(tms_file_write *file, uint64_t key, int32_t threads, tm_error *error);
uint64_t tms_checksum(const void *data, size_t bytes, uint64_t seed);
/* Rank 0: reuses the partial file of `head`, or creates it; maps it and finds its complete blocks. Other ranks: open it
 * (`file` needs no lock there). */
tm_status tms_partial_file_begin(tms_partial_file *part, tms_file_write *file, const tms_file_head *head,
                                 tm_error *error);
tm_status tms_partial_file_join(tms_partial_file *part, const char *path, const tms_file_head *head, tm_error *error);
/* Drops the name but keeps the memory, which the caller must unmap. */
void *tms_file_keep(tms_file_write *file);
void tms_file_abandon(tms_file_write *file);

/* Sections of the head, in this order after tms_file_head: kept, interface (int32), base, interface_N, schur (double),
 * block checksums (uint64). */
typedef struct tms_layout {
    size_t kept, interface, base, force, schur, checksum, column, bytes;
    int32_t blocks;
} tms_layout;
/* Counts up to TMS_MAX_COLUMNS; larger ones cannot be stored. */
tms_layout tms_file_layout(int32_t kept_count, int32_t interface_count, tm_precision precision);

#ifdef __cplusplus
}
#endif
#endif
