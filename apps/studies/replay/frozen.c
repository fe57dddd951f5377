/* SOFA's method to render force at the haptic rate, for comparison (LCPForceFeedback of its haptics plugin). The last
 * frame's constraint problem is kept with fixed directions and compliance. The tool's motion since then changes the
 * gaps along these directions. At most a hundred sweeps from the last forces solve the problem again, and the reactions
 * act on the tool along the same directions. No contact is detected anew: a sliding tool meets no other face.
 *
 * The problem is built from the sample's patch. SOFA's compliance is that of one implicit step; this one is that of
 * tissue at rest. Contact compliance stays in each row's branch, and a grasp is bilateral. The part of the sample's
 * force that the problem does not explain (friction, waves) is added unchanged. A sample without a patch is held. */
#include <math.h>
#include <string.h>

#include "studies/replay/frozen.h"

enum { SETTLING = 16, SWEEPS = 100 };
static const double tolerance = 1e-6; /* of the largest force, per sweep */
/* The branches of contact_law/compliance.h: radii, and stiffness ratio beyond. */
static const double soft_travel = 0.3, hardening = 20;

/* Returns entry (i, j) of a patch's compliance, which is stored as the upper triangle row by row. */
static double compliance(const hrt_patch *p, int i, int j) {
    const int n = 3 * hrt_patch_nodes(p), a = i < j ? i : j, b = i < j ? j : i;
    return (double)p->compliance_m_N[a * n - a * (a - 1) / 2 + b - a];
}

/* Fills weight[] with the force on each degree of freedom per newton of the row. */
static void spread(const hrt_patch *p, const hrt_contact_row *row, double weight[HRT_PATCH_DOFS]) {
    memset(weight, 0, HRT_PATCH_DOFS * sizeof *weight);
    for (int k = 0; k < 9; k++)
        weight[3 * p->triangle[3 * row->triangle + k / 3] + k % 3] += (double)(row->weight[k / 3] * row->normal[k % 3]);
}

/* Returns the displacement of degree of freedom i under forces on the vertices, N. */
static double respond(const hrt_patch *p, int i, const double force_N[HRT_PATCH_DOFS]) {
    double sum = 0;
    for (int j = 0; j < 3 * p->vertex_count; j++)
        if (force_N[j] != 0) sum += compliance(p, i, j) * force_N[j];
    return sum;
}

/* Computes the compliance between the rows and the coupling of each row with the tip of a grasp. */
static void couple(frozen *z, const hrt_patch *p) {
    double weight[HRT_CONTACT_ROWS][HRT_PATCH_DOFS];
    const int tip = 3 * p->vertex_count;
    for (int i = 0; i < z->rows; i++) spread(p, &z->row[i], weight[i]);
    for (int i = 0; i < z->rows; i++) {
        double moved[HRT_PATCH_DOFS] = {0};
        for (int d = 0; d < tip; d++) moved[d] = respond(p, d, weight[i]);
        for (int j = 0; j < z->rows; j++) {
            z->w[i][j] = 0;
            for (int d = 0; d < tip; d++) z->w[i][j] += weight[j][d] * moved[d];
        }
        for (int c = 0; c < 3; c++) z->hold[i][c] = z->holds ? respond(p, tip + c, weight[i]) : 0;
    }
    for (int c = 0; c < 9 && z->holds; c++) z->stiffness[c] = compliance(p, tip + c / 3, tip + c % 3);
}

/* Returns the row's compliance depth at a force, linear in the branch of the sample. */
static double depth_at(const frozen *z, int i, double lambda_N) {
    return z->hard[i] ? z->soft_m * (1 - 1 / hardening) + z->row_compliance_m_N[i] / hardening * lambda_N
                      : z->row_compliance_m_N[i] * lambda_N;
}

/* Runs Gauss-Seidel sweeps from the last forces. */
static void sweep(frozen *z, const double gap_m[HRT_CONTACT_ROWS]) {
    for (int k = 0; k < SWEEPS; k++) {
        double change = 0, largest = 1e-9;
        for (int i = 0; i < z->rows; i++) {
            double error = gap_m[i] + depth_at(z, i, z->lambda_N[i]);
            for (int j = 0; j < z->rows; j++) error += z->w[i][j] * z->lambda_N[j];
            const double slope =
                z->w[i][i] + (z->hard[i] ? z->row_compliance_m_N[i] / hardening : z->row_compliance_m_N[i]);
            const double next = fmin(fmax(z->lambda_N[i] - error / fmax(slope, 1e-12), 0), z->cap_N);
            change = fmax(change, fabs(next - z->lambda_N[i]));
            z->lambda_N[i] = next;
            largest = fmax(largest, next);
        }
        if (change < tolerance * largest) return;
    }
}

/* Computes the position of a station on the axis of a tool that pivots about the origin. */
static void station_at(const float tip_m[3], double back_m, double at_m[3]) {
    const double reach = sqrt((double)tip_m[0] * (double)tip_m[0] + (double)tip_m[1] * (double)tip_m[1] +
                              (double)tip_m[2] * (double)tip_m[2]);
    for (int c = 0; c < 3; c++) at_m[c] = (double)tip_m[c] * (1 - back_m / reach);
}

/* Adds the rows' reactions as equivalent forces at the tip, and their forces on the grasp. */
static void add_reactions(const frozen *z, double force[3]) {
    const float *tip = z->now.tip_m;
    double reach = 0, along_N = 0;
    for (int c = 0; c < 3; c++) reach += (double)tip[c] * (double)tip[c];
    reach = sqrt(reach);
    for (int i = 0; i < z->rows; i++) {
        const double lever = 1 - (double)z->row[i].station * z->radius_m / reach;
        for (int c = 0; c < 3; c++) {
            const double normal = (double)z->row[i].normal[c];
            force[c] += z->lambda_N[i] * (z->hold[i][c] - lever * normal);
            along_N -= z->lambda_N[i] * (1 - lever) * normal * (double)tip[c] / reach;
        }
    }
    for (int c = 0; c < 3; c++) force[c] += along_N * (double)tip[c] / reach;
}

/* Computes the problem's force at the tip. */
static void solve_at(frozen *z, const float tip_m[3], double force[3]) {
    double gap_m[HRT_CONTACT_ROWS], moved[3];
    for (int c = 0; c < 3; c++) moved[c] = (double)tip_m[c] - (double)z->now.tip_m[c];
    for (int i = 0; i < z->rows; i++) {
        double from[3], to[3];
        const double back_m = (double)z->row[i].station * z->radius_m;
        station_at(z->now.tip_m, back_m, from);
        station_at(tip_m, back_m, to);
        gap_m[i] = z->gap_m[i];
        for (int c = 0; c < 3; c++)
            gap_m[i] += z->hold[i][c] * moved[c] - (double)z->row[i].normal[c] * (to[c] - from[c]);
    }
    sweep(z, gap_m);
    for (int c = 0; c < 3; c++) {
        force[c] = z->rest_N[c];
        for (int d = 0; d < 3 && z->holds; d++) force[c] += z->stiffness[3 * c + d] * moved[d];
    }
    add_reactions(z, force);
}

void frozen_sample(frozen *z, const hrt_params *params, const hrt_sample *sample) {
    static hrt_extrapolation x;
    const hrt_patch *p = sample->patch;
    hrt_sample whole = *sample;
    float force_N[3];
    z->now = *sample;
    z->known = p && p->topology_revision == sample->topology_revision && !(sample->unilateral && hrt_patch_grasps(p)) &&
               hrt_flags_rule(sample->flags) == HRT_RULE_TAKE;
    z->rows = 0;
    if (!z->known) return;
    whole.flags = 0;
    hrt_extrapolation_reset(&x, HRT_LOCAL_MODEL);
    hrt_extrapolation_sample(&x, params, &whole);
    for (int k = 0; k < SETTLING; k++) hrt_extrapolation_force(&x, params, sample->t_us, sample->tip_m, force_N);
    z->rows = x.touch.row_count;
    z->holds = hrt_patch_grasps(p);
    z->soft_m = soft_travel * (double)p->radius_m;
    z->radius_m = (double)p->radius_m, z->cap_N = p->force_cap_N > 0 ? (double)p->force_cap_N : 50;
    memcpy(z->row, x.touch.row, sizeof z->row);
    for (int c = 0; c < 3; c++) z->rest_N[c] = z->holds ? (double)p->rest_m[3 * p->vertex_count + c] : 0;
    couple(z, p);
    for (int i = 0; i < z->rows; i++) {
        z->lambda_N[i] = (double)z->row[i].lambda_N;
        z->row_compliance_m_N[i] = (double)(p->contact_compliance_m_N / z->row[i].share);
        z->hard[i] = z->row_compliance_m_N[i] * z->lambda_N[i] > z->soft_m;
    }
    for (int i = 0; i < z->rows; i++) {
        z->gap_m[i] = (double)z->row[i].gap_m;
        for (int j = 0; j < z->rows; j++) z->gap_m[i] -= z->w[i][j] * z->lambda_N[j];
    }
    double own_N[3];
    solve_at(z, sample->tip_m, own_N);
    for (int c = 0; c < 3; c++) z->rest_of_it_N[c] = (double)sample->force_N[c] - own_N[c];
}

void frozen_force(frozen *z, const float tip_m[3], float force_N[3]) {
    double force[3];
    memcpy(force_N, z->now.force_N, sizeof z->now.force_N);
    if (!z->known) return;
    solve_at(z, tip_m, force);
    for (int c = 0; c < 3; c++) force_N[c] = (float)(force[c] + z->rest_of_it_N[c]);
}
