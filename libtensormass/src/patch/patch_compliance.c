/* Compliance of a patch, and its shape without the tool, from the model's blocks and from a grasp. */
#include "patch/patch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "libtensormass/numeric/linear.h"

static int32_t packed(int32_t n, int32_t i, int32_t j) { return i < j ? law_packed(n, i, j) : law_packed(n, j, i); }

double tm_patch_compliance(const tm_patch *patch, int32_t i, int32_t j) {
    TM_REQUIRE(patch && i >= 0 && j >= 0 && i < 3 * patch->vertex_count && j < 3 * patch->vertex_count,
               "patch is null, or i or j is not one of its components", 0);
    return patch->compliance_m_N[packed(3 * patch->vertex_count, i, j)];
}

/* Makes the matrix semidefinite. Columns accurate to a thousandth may make it indefinite by as much: the diagonal is
 * increased as needed. Returns false if a tenth of the largest entry was not enough, or an entry is NaN. */
static bool make_semidefinite(tm_patch *patch) {
    int32_t n = 3 * patch->vertex_count, size = n * (n + 1) / 2;
    double most = 0, work[TM_PATCH_COMPLIANCE];
    for (int32_t i = 0; i < size; i++) {
        if (!isfinite(patch->compliance_m_N[i])) return false;
        most = fmax(most, fabs(patch->compliance_m_N[i]));
    }
    for (double shift = 0; shift <= 0.1 * most; shift = shift > 0 ? 3 * shift : 1e-6 * most) {
        memcpy(work, patch->compliance_m_N, sizeof(double) * (size_t)size);
        if (!law_semidefinite(work, n, n, shift, 1e-8 * most, 1e-5 * most)) continue;
        for (int32_t i = 0; i < n; i++) patch->compliance_m_N[packed(n, i, i)] += shift > 0 ? shift + 1e-6 * most : 0;
        return true;
    }
    return false;
}

/* Adds a force to the patch's vertices at one of this tool's rows. A row on vertices outside the patch is left in. */
static void add_at_row(const tm_patch *patch, const tm_contact_row *row, double size, const double along[3],
                       double force_N[TM_PATCH_DOFS]) {
    int32_t at[3];
    bool within = row->instrument == patch->instrument && row->lambda_N > 0;
    for (int j = 0; j < 3; j++) {
        at[j] = tm_patch_place(patch, row->vertex[j]);
        within = within && (at[j] >= 0 || row->weight[j] == 0);
    }
    for (int j = 0; j < 3 && within; j++)
        if (at[j] >= 0) vmadd(force_N + 3 * at[j], size * row->weight[j], along, force_N + 3 * at[j]);
}

static void row_forces(const tm_patch *patch, const tm_contact_row *row, int32_t row_count,
                       double force_N[TM_PATCH_DOFS]) {
    memset(force_N, 0, sizeof(double) * TM_PATCH_DOFS);
    for (int32_t k = 0; k < row_count; k++) add_at_row(patch, row + k, row[k].lambda_N, row[k].normal, force_N);
}

void tm_patch_remove_friction(tm_patch *patch, const tm_contact_row *row, const double force_N[3]) {
    TM_REQUIRE(patch && row && force_N && patch->vertex_count >= 0 && patch->vertex_count <= TM_PATCH_VERTICES,
               "patch, row or force_N is null, or the patch has too many vertices", );
    double force[TM_PATCH_DOFS] = {0};
    add_at_row(patch, row, 1, force_N, force);
    tm_patch_deform(patch, force, -1, patch->vertex_m);
    for (int32_t i = 0; patch->grasps && i < 3 * patch->vertex_count; i++)
        vmadd(patch->grasp_N, -force[i], patch->dvertex_dtip + 3 * i, patch->grasp_N);
}

static bool fill_compliance(tm_patch *patch, tm_patch_block block, void *self) {
    int32_t n = 3 * patch->vertex_count;
    memset(patch->compliance_m_N, 0, sizeof patch->compliance_m_N);
    for (int32_t a = 0; a < patch->vertex_count; a++)
        for (int32_t b = 0; b < patch->vertex_count; b++) {
            double C[9];
            if (!block(self, patch->vertex[a], patch->vertex[b], C)) return false;
            for (int i = 0; i < 9; i++) { /* both halves are averaged in the upper one */
                int32_t r = 3 * a + i / 3, c = 3 * b + i % 3;
                patch->compliance_m_N[packed(n, r, c)] += r == c ? C[i] : 0.5 * C[i];
            }
        }
    return true;
}

bool tm_patch_fill(tm_patch *patch, tm_patch_block block, void *self, const tm_contact_row *row, int32_t row_count) {
    TM_REQUIRE(patch && block && patch->vertex_count >= 0 && patch->vertex_count <= TM_PATCH_VERTICES &&
                   (row || row_count <= 0),
               "patch, block or row is null, or the patch has too many vertices", false);
    double force[TM_PATCH_DOFS];
    if (!fill_compliance(patch, block, self) || !make_semidefinite(patch)) return false;
    row_forces(patch, row, row_count, force);
    tm_patch_deform(patch, force, -1, patch->vertex_m);
    return true;
}

/* --- grasp --- */

/* Computes the motion of a point fixed to the tool per tip motion: B such that d(point) = B d(tip), for a shaft that
 * rotates about the trocar without spin, or does not rotate if the tool is free. */
static void lever(const tm_patch *patch, const double tip_m[3], const double point_m[3], double B[3][3]) {
    for (int i = 0; i < 9 && patch->is_free; i++) B[i / 3][i % 3] = i % 4 == 0;
    if (patch->is_free) return;
    double e[3], arm[3];
    vsub(tip_m, patch->trocar_m, e);
    double length = fmax(vunit(e, e), 1e-3);
    vsub(point_m, patch->trocar_m, arm);
    for (int c = 0; c < 3; c++) {
        double tip[3] = {0, 0, 0}, spin[3], moved[3];
        tip[c] = 1;
        vcross(e, tip, spin);
        vcross(spin, arm, moved);
        vmadd(moved, vdot(e, tip) * length, e, moved);
        for (int i = 0; i < 3; i++) B[i][c] = moved[i] / length;
    }
}

/* Computes the mean of C_ab and the transpose of C_ba. */
static bool block_between(tm_patch_block block, void *self, int32_t a, int32_t b, double C[9]) {
    double one[9], other[9];
    if (!block(self, a, b, one) || !block(self, b, a, other)) return false;
    for (int i = 0; i < 9; i++) C[i] = 0.5 * (one[i] + other[3 * (i % 3) + i / 3]);
    return true;
}

/* Computes M := C + spring compliance between the held vertices, Y := [B, C of the patch's vertices by forces on the
 * held ones]. */
static bool set_up_grasp(tm_grasp_work *w, const tm_patch *patch, const tm_patch_grasp *grasp, const double tip_m[3],
                         tm_patch_block block, void *self) {
    for (int32_t a = 0; a < grasp->count; a++) {
        double C[9], B[3][3];
        for (int32_t b = 0; b <= a; b++) {
            if (!block_between(block, self, grasp->vertex[a], grasp->vertex[b], C)) return false;
            for (int i = 0; i < 9; i++)
                w->M[3 * a + i / 3][3 * b + i % 3] = C[i] + (a == b && i % 4 == 0 ? grasp->compliance_m_N : 0);
        }
        lever(patch, tip_m, grasp->target_m + 3 * a, B);
        for (int i = 0; i < 9; i++) w->Y[3 * a + i / 3][i % 3] = B[i / 3][i % 3];
        for (int32_t v = 0; v < patch->vertex_count; v++) {
            if (!block_between(block, self, grasp->vertex[a], patch->vertex[v], C)) return false;
            for (int i = 0; i < 9; i++) w->Y[3 * a + i / 3][3 + 3 * v + i % 3] = C[i];
        }
    }
    return true;
}

/* Factorises M = L L^T, Y := L^-1 Y. */
static bool solve_grasp(tm_grasp_work *w, int32_t n, int32_t columns) {
    for (int32_t i = 0; i < n; i++)
        for (int32_t j = 0; j <= i; j++) {
            double sum = w->M[i][j];
            for (int32_t k = 0; k < j; k++) sum -= w->M[i][k] * w->M[j][k];
            if (i == j && !(sum > 0 && sum < INFINITY)) return false;
            w->M[i][j] = i == j ? sqrt(sum) : sum / w->M[j][j];
        }
    for (int32_t i = 0; i < n; i++) {
        for (int32_t k = 0; k < i; k++)
            for (int32_t c = 0; c < columns; c++) w->Y[i][c] -= w->M[i][k] * w->Y[k][c];
        for (int32_t c = 0; c < columns; c++) w->Y[i][c] /= w->M[i][i];
    }
    return true;
}

static double column_product(const tm_grasp_work *w, int32_t n, int32_t a, int32_t b) {
    double sum = 0;
    for (int32_t k = 0; k < n; k++) sum += w->Y[k][a] * w->Y[k][b];
    return sum;
}

/* Eliminates f = M^-1 (target - x): computes compliance, stiffness, and the vertex motion per tip motion. */
static bool condense(tm_grasp_work *w, tm_patch *patch, const tm_patch_grasp *grasp, const double tip_m[3],
                     tm_patch_block block, void *self) {
    const int32_t n = 3 * grasp->count, dofs = 3 * patch->vertex_count;
    double sum = 0;
    if (!set_up_grasp(w, patch, grasp, tip_m, block, self) || !solve_grasp(w, n, 3 + dofs)) return false;
    for (int32_t i = 0; i < dofs; i++) {
        for (int32_t j = i; j < dofs; j++)
            patch->compliance_m_N[packed(dofs, i, j)] -= column_product(w, n, 3 + i, 3 + j);
        for (int c = 0; c < 3; c++) sum += fabs(patch->dvertex_dtip[3 * i + c] = column_product(w, n, 3 + i, c));
    }
    for (int i = 0; i < 9; i++) sum += fabs(patch->grasp_stiffness_N_m[i] = -column_product(w, n, i / 3, i % 3));
    patch->grasped = 0;
    for (int32_t i = 0; i < grasp->count; i++) {
        const int32_t at = tm_patch_place(patch, grasp->vertex[i]);
        if (at >= 0) patch->grasped |= 1u << at;
    }
    return isfinite(sum);
}

bool tm_patch_fill_grasped(tm_patch_solver *solver, tm_patch *patch, const tm_patch_grasp *grasp, const double tip_m[3],
                           tm_patch_block block, void *self, const tm_contact_row *row, int32_t row_count) {
    TM_REQUIRE(solver && patch && grasp && tip_m && block && (row || row_count <= 0) && grasp->vertex &&
                   grasp->target_m && grasp->force_N,
               "an argument is null", false);
    TM_REQUIRE(patch->vertex_count >= 0 && patch->vertex_count < TM_PATCH_VERTICES && grasp->count > 0 &&
                   grasp->count <= TM_GRASP_VERTICES && grasp->compliance_m_N > 0,
               "the patch or the grasp has no vertices or too many, or the grasp has no compliance", false);
    double force[TM_PATCH_DOFS];
    if (!fill_compliance(patch, block, self) ||
        !condense(tm_patch_solver_work(solver), patch, grasp, tip_m, block, self) || !make_semidefinite(patch))
        return false;
    patch->grasps = true;
    vset(tip_m, patch->grasp_tip_m);
    row_forces(patch, row, row_count, force);
    tm_patch_deform(patch, force, -1, patch->vertex_m);
    memset(patch->grasp_N, 0, sizeof patch->grasp_N);
    const tm_lever at = tm_patch_lever(patch, tip_m);
    for (int32_t i = 0; i < grasp->count; i++) {
        double on_tool[3], at_tip[3];
        vscale(-1, grasp->force_N + 3 * i, on_tool);
        tm_lever_force(&at, grasp->target_m + 3 * i, on_tool, at_tip);
        vmadd(patch->grasp_N, 1, at_tip, patch->grasp_N);
    }
    for (int32_t i = 0; i < 3 * patch->vertex_count; i++)
        vmadd(patch->grasp_N, -force[i], patch->dvertex_dtip + 3 * i, patch->grasp_N);
    return true;
}
