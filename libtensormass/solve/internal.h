/* Private to libtensormass_solve. */
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

/* Columns are solved in blocks of this width always, the last one filled up with zeros: dense kernels may sum in
 * another order for another width, and the result must not depend on how many threads or ranks share the work. */
#define TMS_BLOCK 64
#define TMS_MAX_COLUMNS (1 << 24) /* of either kind: above it sizes would wrap */
#define TMS_WAIT_S 600            /* for another process that computes the same file */

/* Are these `count` doubles of a snapshot, at any address, all numbers of less than `most` (INFINITY: finite) in size?
 */
bool tms_are_below(const void *from, size_t count, double most);
/* Of two int32_t: for qsort and bsearch. */
static inline int tms_ascending(const void *a, const void *b) {
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* The caller's part of the contract of a problem. */
#define TMS_REQUIRE_PROBLEM(problem)                                                                                   \
    do {                                                                                                               \
        TM_REQUIRE_DEF(problem, TMS_COOKIE_PROBLEM, TM_ERR_ARGUMENT);                                                  \
        TM_REQUIRE((problem)->tissue && (problem)->fixed, #problem " has no tissue or no fixed", TM_ERR_ARGUMENT);     \
    } while (0)
/* Its data: solver, tolerances and counts in range, values and loads finite; `entity` is the vertex to blame. */
tm_status tms_check_problem(const tm_solve_def *def, tm_error *error);
tm_status tms_check_precision(tm_precision precision, tm_error *error);
double tms_clock_s(void);
int32_t tms_threads(const tm_solve_def *def);
void tms_bytes_text(int64_t bytes, char text[32]);
/* False when the caller wants to stop. */
bool tms_progress(const tm_solve_def *def, const char *what, double fraction, double seconds_left);

/* --- util.c: memory of ours, of the one allocator (tm_set_allocator), aligned to 64 bytes, which knows its own size.
 * What CHOLMOD and Eigen take for themselves is theirs. --- */

void *tms_alloc(size_t bytes);
void *tms_alloc_zeroed(size_t count, size_t size);
void tms_free(void *memory); /* null is allowed */

/* --- coupling_kernel.c: inner loops; the same bits on every machine --- */

/* out := rows x; rows [count][width], width a multiple of 16. */
void tms_rows_times(const float *rows, int32_t count, int32_t width, const float *x, float *out);
double tms_dot(const double *a, const double *b, int32_t n);
/* out [3][3] := the sums over k of a[i][k] weight[k] b[j][k]; a and b [3][n]. */
void tms_weighted_dots(const double *a, const double *weight, const double *b, int32_t n, double out[9]);
/* out += f a */
void tms_add_times(double f, const double *a, int32_t n, double *out);

/* --- library_globals.c: what belongs to the whole process --- */

/* Between these OpenBLAS has one thread in each of ours, and SuiteSparse aligns its memory. Nested, and from many
 * threads. */
void tms_process_enter(void);
void tms_process_leave(void);
/* About each ordering, one at a time: METIS draws from rand(). */
void tms_ordering_begin(void);
void tms_ordering_end(void);
/* False: OpenBLAS built without threading, which must not be called from two threads. */
bool tms_blas_is_parallel(void);
/* Address space that BLAS will want beside ours, and whether there is so much of it. */
int64_t tms_blas_bytes(int32_t threads);
bool tms_address_space_has(int64_t bytes, int64_t *limit_bytes);

/* --- system.c: free components and their stiffness --- */

typedef struct tms_system {
    const tm_mesh *mesh;     /* for messages */
    int32_t vertex_count, n; /* n free components */
    int32_t *index;          /* [3*vertex_count] free index, -1: prescribed, or in no living tetrahedron */
    int32_t *dof;            /* [n] 3*vertex + axis, ascending */
    int32_t *begin;          /* [n+1] lower triangle by columns */
    int32_t *row;            /* ascending within a column */
    double *value;           /* N/m */
} tms_system;

/* Every part of the tissue must be held by `fixed` (TM_ERR_SUPPORT names a vertex of the one that is not). */
tm_status tms_check_constrained(const tm_tissue *tissue, const uint8_t *fixed, tm_error *error);
tm_status tms_system_create(const tm_tissue *tissue, const uint8_t *fixed, tms_system *system, tm_error *error);
/* The same of a tissue that nothing need hold. */
tm_status tms_system_assemble(const tm_tissue *tissue, const uint8_t *fixed, tms_system *system, tm_error *error);
void tms_system_destroy(tms_system *system);
int64_t tms_system_bytes(const tms_system *system);
/* A tissue of the same materials with the marked tetrahedra only, double. */
tm_status tms_sub_tissue(const tm_tissue *whole, const uint8_t *alive, tm_tissue **tissue, tm_error *error);

/* --- solver.c, cg.cpp: A x = b on the free components, TMS_BLOCK right-hand sides at a time --- */

typedef struct tms_solver tms_solver;
typedef struct tms_work tms_work; /* of one thread */

/* Asks for all memory first: factor, work of `threads`, and `responses_bytes` beside it. */
tm_status tms_solver_create(const tms_system *system, const tm_solve_def *def, int64_t responses_bytes,
                            int64_t responses_bytes_single, tms_solver **solver, tm_solve_report *report,
                            tm_error *error);
/* The factor of another system with the same entries (n, begin, row) in the order that is found; works go on. After a
 * failure there is none: destroy it. */
tm_status tms_solver_renew(tms_solver *solver, const tms_system *system, tm_error *error);
void tms_solver_destroy(tms_solver *solver);
int64_t tms_solver_bytes(const tms_solver *solver);
tms_work *tms_work_create(const tms_solver *solver, int32_t width);
void tms_work_destroy(tms_work *work);
double *tms_work_rhs(tms_work *work); /* [n*width], column after column; the caller fills all of it */
/* Null when it does not converge. No allocation after the first call (CHOLMOD). */
const double *tms_work_solve(tms_work *work);

typedef struct tms_cg tms_cg;
tms_cg *tms_cg_create(const tms_system *system);
void tms_cg_destroy(tms_cg *cg);
bool tms_cg_solve(const tms_cg *cg, const double *b, double *x, double tolerance, int32_t max_iterations);

/* --- reach.cpp: the same for few components, which need a small part of a factor --- */

/* CHOLMOD's factor L L^T of the permuted system; supernode s has the columns begin[s].. of L, dense, with the rows
 * row[row_begin[s]..], its own columns first. x null: none (conjugate gradients). */
typedef struct tms_supernodes {
    int32_t n, count;
    const int32_t *begin, *row_begin, *x_begin, *row;
    const int32_t *component; /* [n] that the factor has at a place */
    const double *x;
} tms_supernodes;
tms_supernodes tms_solver_supernodes(const tms_solver *solver);

/* Of one thread, for a solver however often it is renewed. */
typedef struct tms_reach tms_reach;
tms_reach *tms_reach_create(const tms_solver *solver); /* null: no memory, or no factor */
void tms_reach_destroy(tms_reach *reach);
int64_t tms_reach_bytes(const tms_reach *reach);
/* out [rows][units] := components row[] of the solutions for unit forces on components unit[], at most TMS_BLOCK; a
 * component of -1 is prescribed: zeros. No allocation. */
void tms_reach_solve(tms_reach *reach, const tms_solver *solver, const int32_t *unit, int32_t units, const int32_t *row,
                     int32_t rows, double *out);

/* --- partial_file.c: which blocks of columns are done, and where they go --- */

typedef struct tms_partial_file {
    int32_t block_count, found; /* found: whole already when it was opened */
    uint64_t *done; /* [blocks] checksum of a block, 0: not done; rank 0's is the file's own. Null: no journal */
    int fd;         /* of ranks above 0, which write; -1 */
    size_t column, journal, block_bytes;
} tms_partial_file;

/* Puts block `b`, of `bytes`, where it belongs, and notes it. On rank 0 it is there already. */
bool tms_partial_file_put(tms_partial_file *part, int32_t block, const void *data, size_t bytes);
int32_t tms_partial_file_columns(const tms_partial_file *part, int32_t columns); /* found, of so many */
void tms_partial_file_end(tms_partial_file *part);

/* --- columns.c: responses --- */

/* Column j < kept_count: displacement of the kept components for a unit force on kept component j. The interface_count
 * columns after them: for a unit displacement of an interface component, all other prescribed ones at 0. */
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
/* The same with one factor that the ranks share. */
tm_status tms_distributed_columns(const tms_columns *columns, const tm_solve_def *def, const tm_solve_ranks *ranks,
                                  tm_error *error);

/* --- responses.c: what is kept of a factorised problem, in memory or in a file --- */

typedef struct tms_responses {
    int32_t kept_count, interface_count;
    const int32_t *kept, *interface;
    const double *base_m; /* [kept_count] displacement under the loads and prescribed values, interface at 0 */
    const double
        *interface_N;    /* [interface_count] force of the inside's loads and supports on the interface held at 0 */
    const double *schur; /* [interface_count^2] */
    const void *column;  /* as tms_columns.out */
    tm_precision precision;
    int64_t bytes;
    void *map; /* of the file, or null */
    size_t map_bytes;
    void *head; /* owned copies when not mapped */
    void *owned;
} tms_responses;

/* The problem as these want it: interface components are marked fixed in def->fixed with value 0. */
typedef struct tms_request {
    const tm_solve_def *def;
    const int32_t *interface;
    int32_t interface_count;
    const uint8_t *wanted; /* [vertex_count] 1: responses of this vertex are kept */
    tm_precision precision;
    const char *file;
    bool resume;
    const tm_solve_ranks *ranks;
    tms_system
        *system; /* out, both or neither: kept for solutions on line, made anew where the responses came from a file */
    tms_solver **solver;
} tms_request;

/* From the file, else computed and written. `force`: whatever the file holds. On ranks above 0 nothing is returned. */
tm_status tms_responses_get(const tms_request *request, bool force, tms_responses *responses, tm_solve_report *report,
                            tm_error *error);
void tms_responses_release(tms_responses *responses);
/* Three entries C[3*i.., component j] etc.: the 3x3 block of kept vertices is gathered by the callers with this. */
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

/* Memory map of a whole, checked file; false with the reason in `why`. */
bool tms_file_open(const char *path, uint64_t key, int32_t threads, void **map, size_t *bytes, char why[160]);
typedef struct tms_file_write {
    char path[1024], partial_file[1040];
    int fd;
    bool keep_partial; /* the part file, when it is abandoned */
    void *map;
    size_t bytes;
} tms_file_write;
/* Makes `path`.part and locks it, so that one process at a time computes the file. While another does, waits, at most
 * wait_s, asking def->progress (false: TM_ERR_CONVERGENCE). Whoever has waited looks at the file again. */
tm_status tms_file_lock(const tm_solve_def *def, const char *path, double wait_s, tms_file_write *file,
                        tm_error *error);
/* Takes `bytes` on the disk, of an empty file or of what is there, and maps them for writing. */
tm_status tms_file_map(tms_file_write *file, size_t bytes, tm_error *error);
tm_status tms_file_reserve(tms_file_write *file, size_t bytes, tm_error *error);
/* Checksums, flushes to disk and renames over `path`. Failed, it leaves the file to _keep or _abandon. */
tm_status tms_file_commit(tms_file_write *file, uint64_t key, int32_t threads, tm_error *error);
uint64_t tms_checksum(const void *data, size_t bytes, uint64_t seed);
/* Of rank 0: takes the part file of `head` as it was left, or makes it anew, maps it, and says what is in it that is
 * whole. Of the others: opens it (`file` needs no lock there). */
tm_status tms_partial_file_begin(tms_partial_file *part, tms_file_write *file, const tms_file_head *head,
                                 tm_error *error);
tm_status tms_partial_file_join(tms_partial_file *part, const char *path, const tms_file_head *head, tm_error *error);
/* Gives up the name and keeps the memory, which is the caller's to unmap. */
void *tms_file_keep(tms_file_write *file);
void tms_file_abandon(tms_file_write *file);

/* Sections of the head, in this order after tms_file_head: kept, interface (int32), base, interface_N, schur (double),
 * block checksums (uint64). */
typedef struct tms_layout {
    size_t kept, interface, base, force, schur, checksum, column, bytes;
    int32_t blocks;
} tms_layout;
/* Counts up to TMS_MAX_COLUMNS: what is larger can be stored nowhere. */
tms_layout tms_file_layout(int32_t kept_count, int32_t interface_count, tm_precision precision);

#ifdef __cplusplus
}
#endif
#endif
