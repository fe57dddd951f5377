/* What lies behind a patch: rows of the stage "touch" that bear load couple the tissue under the tool to other tissue.
 *
 * With J the active rows (their normals; both tangents too where friction sticks) and c their compliance, the coupled
 * compliance is C - C J^T (J C J^T + c)^-1 J C: the rows are eliminated, so a controller sees one compliance. The rows
 * that bear most come first, as far as the columns of their vertices fit into a request. Rows that touch or part
 * between two samples are left out. */
#include "patch/patch_internal.h"
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

enum { VERTICES = TM_COMPLIANCE_REQUEST_MAX - TM_PATCH_VERTICES, ROWS = 32, DOFS = 3 * ROWS };
enum { CACHE = TM_PATCH_VERTICES + TM_GRASP_VERTICES };
#define STICKS 0.01 /* compliance of sticking friction, of the normal's: keeps redundant rows regular */

struct tm_patch_behind {
    tm_touching *touching;
    int32_t row_count, row[ROWS];           /* chosen, those that bear most first */
    int32_t vertex_count, vertex[VERTICES]; /* of the chosen rows */
    int32_t dofs;
    int32_t dof_begin[ROWS + 1]; /* of each chosen row: 0, 1 or 3 components */
    double direction[DOFS][3];
    double M[DOFS][DOFS];         /* lower triangle of the Cholesky factor */
    double JC[VERTICES][DOFS][3]; /* of the rows' vertices */
    int32_t cached, cached_vertex[CACHE];
    double W[CACHE][DOFS][3]; /* L^-1 J C of each vertex */
};

tm_patch_behind *tm_patch_behind_create(tm_pool *pool, tm_world *world) {
    tm_touching *touching = tm_world_touching(world);
    tm_patch_behind *b = touching ? TM_ALLOC(pool, tm_patch_behind, 1) : NULL;
    if (b) b->touching = touching;
    return b;
}

/* --- choice --- */

static bool is_listed(const tm_patch_behind *b, int32_t vertex) {
    for (int32_t i = 0; i < b->vertex_count; i++)
        if (b->vertex[i] == vertex) return true;
    return false;
}

/* Adds a row and its vertices, if they fit. */
static void add_row(tm_patch_behind *b, int32_t index) {
    const tm_touching_row *row = b->touching->row + index;
    int32_t added = 0;
    for (int j = 0; j < 4; j++) {
        if (row->weight[j] == 0 || is_listed(b, row->vertex[j])) continue;
        if (b->vertex_count + added == VERTICES) return;
        b->vertex[b->vertex_count + added++] = row->vertex[j];
    }
    b->vertex_count += added;
    b->row[b->row_count++] = index;
}

int32_t tm_patch_behind_choose(tm_patch_behind *b, const int32_t **vertex) {
    double last_N = INFINITY;
    int32_t last = -1;
    b->row_count = b->vertex_count = b->dofs = b->cached = 0;
    while (b->row_count < ROWS) { /* in descending order of load; equal loads by index */
        int32_t best = -1;
        for (int32_t i = 0; i < b->touching->row_count; i++) {
            const double load_N = b->touching->row[i].lambda_N;
            if (!(load_N > 0) || load_N > last_N || (load_N == last_N && i <= last)) continue;
            if (best < 0 || load_N > b->touching->row[best].lambda_N) best = i;
        }
        if (best < 0) break;
        last_N = b->touching->row[best].lambda_N, last = best;
        add_row(b, best);
    }
    *vertex = b->vertex;
    return b->vertex_count;
}

/* --- elimination --- */

static void add_dof(tm_patch_behind *b, const double direction[3], double compliance_m_N) {
    vset(direction, b->direction[b->dofs]);
    b->M[b->dofs][b->dofs] = compliance_m_N;
    b->dofs++;
}

/* Lists the components of a row if all its columns are known. */
static void add_dofs(tm_patch_behind *b, const tm_patch_builder *builder, int32_t index) {
    const tm_touching_row *row = b->touching->row + index;
    double first[3], second[3], axis[3] = {0, 0, 0};
    bool sticks;
    for (int j = 0; j < 4; j++)
        if (row->weight[j] != 0 && !tm_patch_has_column(builder, row->vertex[j])) return;
    const double slope = tm_touching_slope_m_N(b->touching, index, &sticks);
    add_dof(b, row->normal, slope);
    if (!sticks) return;
    axis[fabs(row->normal[0]) < 0.7 ? 0 : 1] = 1;
    vcross(row->normal, axis, first);
    vunit(first, first);
    vcross(row->normal, first, second);
    add_dof(b, first, STICKS * slope);
    add_dof(b, second, STICKS * slope);
}

/* Computes the motion of all components' gaps by unit forces on a vertex, J C. */
static bool gaps_of(const tm_patch_behind *b, const tm_patch_builder *builder, int32_t vertex, double (*out)[3]) {
    for (int32_t r = 0; r < b->row_count; r++) {
        const tm_touching_row *row = b->touching->row + b->row[r];
        double sum[9] = {0};
        for (int j = 0; j < 4 && b->dof_begin[r] < b->dof_begin[r + 1]; j++) {
            double C[9];
            if (row->weight[j] == 0) continue;
            if (!tm_patch_known_block((void *)(uintptr_t)builder, row->vertex[j], vertex, C)) return false;
            for (int i = 0; i < 9; i++) sum[i] += row->weight[j] * C[i];
        }
        for (int32_t k = b->dof_begin[r]; k < b->dof_begin[r + 1]; k++)
            for (int c = 0; c < 3; c++)
                out[k][c] =
                    b->direction[k][0] * sum[c] + b->direction[k][1] * sum[3 + c] + b->direction[k][2] * sum[6 + c];
    }
    return true;
}

static int32_t place_of(const tm_patch_behind *b, int32_t vertex) {
    int32_t i = 0;
    while (b->vertex[i] != vertex) i++;
    return i;
}

/* Computes M := J C J^T + compliance, lower triangle. */
static bool fill(tm_patch_behind *b, const tm_patch_builder *builder) {
    for (int32_t v = 0; v < b->vertex_count; v++)
        if (tm_patch_has_column(builder, b->vertex[v]) && !gaps_of(b, builder, b->vertex[v], b->JC[v])) return false;
    for (int32_t r = 0; r < b->row_count; r++) {
        const tm_touching_row *row = b->touching->row + b->row[r];
        for (int32_t k = b->dof_begin[r]; k < b->dof_begin[r + 1]; k++)
            for (int32_t i = k; i < b->dofs; i++) {
                double sum = i == k ? b->M[i][i] : 0;
                for (int j = 0; j < 4; j++)
                    if (row->weight[j] != 0)
                        sum += row->weight[j] * vdot(b->JC[place_of(b, row->vertex[j])][i], b->direction[k]);
                b->M[i][k] = sum;
            }
    }
    return true;
}

static bool factorise(tm_patch_behind *b) {
    for (int32_t i = 0; i < b->dofs; i++)
        for (int32_t k = 0; k <= i; k++) {
            double sum = b->M[i][k];
            for (int32_t n = 0; n < k; n++) sum -= b->M[i][n] * b->M[k][n];
            if (i == k && !(sum > 0 && sum < INFINITY)) return false;
            b->M[i][k] = i == k ? sqrt(sum) : sum / b->M[k][k];
        }
    return true;
}

bool tm_patch_behind_prepare(tm_patch_behind *b, const tm_patch_builder *builder) {
    b->dofs = b->cached = 0;
    for (int32_t i = 0; i < b->row_count; i++) {
        b->dof_begin[i] = b->dofs;
        add_dofs(b, builder, b->row[i]);
        b->dof_begin[i + 1] = b->dofs;
    }
    if (fill(b, builder) && factorise(b)) return true;
    b->dofs = 0;
    return false;
}

/* Returns L^-1 J C of a vertex; null: a block is unknown. */
static double (*column(tm_patch_behind *b, const tm_patch_builder *builder, int32_t vertex))[3] {
    for (int32_t i = 0; i < b->cached; i++)
        if (b->cached_vertex[i] == vertex) return b->W[i];
    if (b->cached == CACHE) b->cached = 0;
    double(*w)[3] = b->W[b->cached];
    if (!gaps_of(b, builder, vertex, w)) return NULL;
    for (int32_t i = 0; i < b->dofs; i++) {
        for (int32_t k = 0; k < i; k++) vmadd(w[i], -b->M[i][k], w[k], w[i]);
        vscale(1 / b->M[i][i], w[i], w[i]);
    }
    b->cached_vertex[b->cached++] = vertex;
    return w;
}

bool tm_patch_coupled_block(void *self, int32_t first, int32_t second, double C[9]) {
    const tm_patch_builder *builder = self;
    tm_patch_behind *b = builder->behind;
    if (!tm_patch_known_block(self, first, second, C)) return false;
    if (!b || b->dofs == 0) return true;
    double(*x)[3] = column(b, builder, first), (*y)[3] = x ? column(b, builder, second) : NULL;
    for (int32_t k = 0; y && k < b->dofs; k++)
        for (int i = 0; i < 9; i++) C[i] -= x[k][i / 3] * y[k][i % 3];
    return y != NULL;
}

bool tm_patch_behind_holds(const tm_patch_builder *builder, int32_t vertex) {
    double C[9];
    return builder->behind->dofs > 0 && tm_patch_coupled_block((void *)(uintptr_t)builder, vertex, vertex, C) &&
           law_max(C[0], law_max(C[4], C[8])) < TM_PATCH_LOOSE_M_N;
}
