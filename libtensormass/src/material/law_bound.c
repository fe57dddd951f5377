/* Upper bounds of the largest eigenvalue of d2W/dF2 under nonlinear laws, over all F, or all F within a strain.
 *
 * A law is W(G) + spring, G = phi(t) N, t = |F|, N = F/t (hyperelastic_kernel.h). With D = a N + b M, M normal to N,
 * |M| = 1, the derivatives of phi(t) N along D are phi' a N + phi/t b M and, twice,
 * N (phi'' a^2 - (phi/t - phi') b^2/t) - 2 (phi/t - phi') a b/t M. So for each term of W, with P its stress at G,
 *     D.d2.D = dG.W''.dG - P:N (-phi'' a^2 + turn b^2) - 2 turn a b P:M,   turn = (phi/t - phi')/t >= 0,
 * which tm_bound_add bounds by a 2x2 matrix in |a|, |b|. The largest eigenvalue of that is the bound; it grows with
 * each entry, as `mixed` >= 0. |F| and det G are divided into cells that cover all states; within a cell each quantity
 * is taken at its worst end. So the bound holds for every F, not only for those tried.
 *
 * Of R = |G|, J = det G, B = cof G, and singular values s_i of G:
 *     |J| <= R^3/sqrt(27)         the mean of s_i^2 is at least the geometric one
 *     B:N = 3 J/R, |B|^2 <= R^4/4 + 9/4 J^2/R^2         Schur's inequality, of s_i^2
 *     s^3 - R^2 s + 2 |J| <= 0 for the largest s        the other two: s_j^2 + s_k^2 >= 2 |J|/s
 *     d2J has the eigenvalues +-s_i and the roots of x^3 - R^2 x - 2 J, which hold these between the first and the last
 *     |E|^2 = (R^4 - 2 |B|^2 - 2 R^2 + 3)/4. */
#include "material/law_bound.h"

#include "material/hyperelastic.h"

enum { LENGTHS = 64, VOLUMES = 96 };

/* What restricts the states, beside the law's own limit. */
typedef struct states {
    double length, J[2], strain, volume[2]; /* volume: ratio of a domain's averages */
    double pressure_Pa;                     /* added to U' */
} states;

static double pair_most(double a, double b, double c) { return 0.5 * (a + c + sqrt((a - c) * (a - c) + 4 * b * b)); }

/* Of a cell: (B:N)^2 and the rest of |B|^2; largest and minus the least eigenvalue of d2J. */
typedef struct volume {
    double along2, across2, up, down, stiff;
} volume;

/* Returns an upper bound of the largest root x of x^3 - R^2 x - 2 J, or with `sign` -1 of x^3 - R^2 x + 2 J: Newton's
 * method from above, which stays above. */
static double root(double R, double J, int sign) {
    double x = 2 / sqrt(3) * R;
    for (int i = 0; i < 8; i++) x -= fmax((x * x * x - R * R * x - 2 * sign * J) / (3 * x * x - R * R), 0);
    return x;
}

static volume volume_of(const tm_bound *b, const tm_bound_cell *c, double averaged_Pa) {
    const double size[2] = {fabs(c->J[0]), fabs(c->J[1])}, R2 = c->R[1] * c->R[1];
    const double least = c->J[0] < 0 && c->J[1] > 0 ? 0 : fmin(size[0], size[1]), most = fmax(size[0], size[1]);
    const bool grows = c->J[1] >= TM_VOLUME_LEAST && c->J[0] <= TM_VOLUME_MOST;
    volume v = {.along2 = 9 * most * most / (c->R[0] * c->R[0]), .across2 = 0.25 * R2 * R2 - 6.75 * least * least / R2};
    v.across2 = fmax(v.across2, 0);
    v.up = root(c->R[1], c->J[1] > 0 ? most : least, c->J[1] > 0 ? 1 : -1);
    v.down = root(c->R[1], c->J[0] < 0 ? most : least, c->J[0] < 0 ? 1 : -1);
    v.stiff = (grows ? fmax(b->bulk_Pa, 0) : 0) + averaged_Pa;
    return v;
}

/* Within the limit, at the pressure `slope`: all other terms are isotropic. Along B, d2J is at least q = 6 J/R^2, and
 * then not more than sqrt((up - q)(q + down)) to the side. */
static double inside(const tm_bound *b, const tm_bound_cell *c, const volume *v, double slope) {
    const double along = b->along + v->stiff * (v->along2 + v->across2);
    const double all = along + (slope > 0 ? slope * v->up : -slope * v->down);
    if (slope >= 0 || c->J[0] < 0) return all;
    const double q = 6 * c->J[0] / (c->R[1] * c->R[1]), worst = fmin(fmax(q, 0.5 * (v->up - v->down)), v->up);
    const double side = -slope * sqrt(fmax(v->up - worst, 0) * (worst + v->down));
    return fmin(all, pair_most(along + slope * q, side, b->across - slope * v->down));
}

/* Beyond it: by all of d2J, or with N.d2J.N = 6 J/R^2, N.d2J.M = 2 B:M/R. */
static double beyond(tm_bound b, const tm_bound_cell *c, const volume *v, double slope) {
    const double both = c->along * c->across, bend = slope > 0 ? slope * v->up : -slope * v->down;
    const double work[2] = {fmin(slope * c->J[0], slope * c->J[1]), fmax(slope * c->J[0], slope * c->J[1])};
    b.along += v->stiff * c->along * c->along * v->along2, b.across += v->stiff * c->across * c->across * v->across2;
    b.mixed += v->stiff * both * sqrt(v->along2 * v->across2);
    tm_bound_add(&b, c, bend, 3 * work[0] / c->R[work[0] > 0], fabs(slope) * sqrt(v->across2));
    const double whole = pair_most(b.along, b.mixed, b.across), R = c->R[work[1] < 0];
    b.along += c->along * c->along * (6 * work[1] / (R * R) - bend);
    b.mixed += both * fabs(slope) * 2 * sqrt(v->across2) / c->R[0];
    return fmin(whole, pair_most(b.along, b.mixed, b.across));
}

/* Adds U(J) to the bound, and a domain's energy: the form is linear in the pressure, so that an end of its range is
 * worst. */
static double with_volume(const tm_bound *b, const tm_bound_cell *c, double averaged_Pa, const states *all) {
    const volume v = volume_of(b, c, averaged_Pa);
    double most = 0;
    for (int i = 0; i < 4; i++) {
        const double J1 = fmin(fmax(c->J[i % 2], TM_VOLUME_LEAST), TM_VOLUME_MOST) - 1;
        const double slope = b->bulk_Pa * J1 + averaged_Pa * (all->volume[i / 2] - 1) - b->offset_Pa + all->pressure_Pa;
        most = fmax(most, c->turn[1] > 0 ? beyond(*b, c, &v, slope) : inside(b, c, &v, slope));
    }
    return most;
}

/* Completes a cell whose R, and limits of J and strain, are set. */
static void measure(tm_bound_cell *c, double strain) {
    const double R2 = c->R[1] * c->R[1], least = c->J[0] < 0 && c->J[1] > 0 ? 0 : fmin(fabs(c->J[0]), fabs(c->J[1]));
    const double J = fmin(least, R2 * c->R[1] / sqrt(27)), from = fmax(c->R[0] * c->R[0], 3 * fmin(J, 1));
    c->stretch = fmin(root(c->R[1], J, -1), sqrt(1 + 2 * strain));
    c->strain = fmin(sqrt(fmax(0.25 * (R2 * R2 - 2 * R2 + 3) - 4.5 * J * J / R2, 0)), strain);
    c->e_most = fmax(0.5 * (c->stretch * c->stretch - 1), 0);
    c->trace[0] = fmax(c->turn[1] > 0 ? 0.5 * (from - 3) : 1.5 * fmin(J, 1) - 1.5, -sqrt(3) * strain);
    c->trace[1] = fmin(0.5 * (R2 - 3), sqrt(3) * strain);
}

/* The bound over the cells of one range of |F|. */
static double sweep(const tm_material *m, double averaged_Pa, const states *all, tm_bound_cell c,
                    const double spring[2]) {
    const double most_J = c.R[1] * c.R[1] * c.R[1] / sqrt(27);
    const double from = fmax(-most_J, all->J[0]), to = fmin(most_J, all->J[1]);
    double most = 0;
    for (int i = 0; i < VOLUMES && from < to; i++) {
        c.J[0] = from + (to - from) * i / VOLUMES, c.J[1] = from + (to - from) * (i + 1) / VOLUMES;
        measure(&c, all->strain);
        tm_bound b = {.along = spring[0], .across = spring[1]};
        tm_law_bound_terms(m, m->lambda_Pa - averaged_Pa, &c, &b);
        most = fmax(most, with_volume(&b, &c, averaged_Pa, all));
    }
    return most;
}

static double bound_over(const tm_material *m, double averaged_Pa, const states *all) {
    const double s = m->stretch_max, limit = sqrt(s * s + 2 / s), band = TM_STRETCH_BAND * limit;
    const double kappa = 4.0 / 3 * m->mu_Pa;
    const tm_bound_cell within = {.R = {fmin(limit, all->length), fmin(limit, all->length)}, .along = 1, .across = 1};
    double most = sweep(m, averaged_Pa, all, within, (double[]){0, 0});
    /* Beyond: t = limit + band v/(1 - v), phi = limit + band v, phi' = (1 - v)^2, phi'' = -2 (1 - v)^3/band. */
    for (int i = 0; i < LENGTHS; i++) {
        const double v[2] = {(double)i / LENGTHS, (i + 1.0) / LENGTHS};
        double t[2], ratio[2], slope[2];
        tm_bound_cell c;
        /* of G, which is shorter than F */
        const states loose = {
            all->length, {-HUGE_VAL, HUGE_VAL}, HUGE_VAL, {all->volume[0], all->volume[1]}, all->pressure_Pa};
        for (int k = 0; k < 2; k++) {
            t[k] = k && i == LENGTHS - 1 ? HUGE_VAL : limit + band * v[k] / (1 - v[k]);
            c.R[k] = limit + band * v[k], slope[k] = (1 - v[k]) * (1 - v[k]), ratio[k] = c.R[k] / t[k];
            c.bend[1 - k] = 2 * slope[k] * (1 - v[k]) / band;
        }
        if (t[0] > all->length) break;
        c.along = slope[0], c.across = ratio[0];
        c.turn[0] = fmax(ratio[1] - slope[0], 0) / t[1], c.turn[1] = (ratio[0] - slope[1]) / t[0];
        most = fmax(most, sweep(m, averaged_Pa, &loose, c, (double[]){kappa, kappa * (1 - limit / t[1])}));
    }
    return most;
}

/* With averaged dilatation, the energy of an average is at most the average of the energies: a domain's kappa/2 of the
 * squared dilatation adds at most kappa B B^T to each tetrahedron (Jensen), and its pressure, of the range allowed,
 * adds that times d2J. */
double tm_law_stiffest_Pa(const tm_material *m, bool averaged) {
    const states all = {HUGE_VAL, {-HUGE_VAL, HUGE_VAL}, HUGE_VAL, {TM_VOLUME_LEAST, TM_VOLUME_MOST}, 0};
    if (m->law == TM_LAW_LINEAR) return tm_material_stiffest_Pa(m);
    return bound_over(m, averaged ? tm_material_bulk_Pa(m) : 0, &all);
}

/* |F|^2 = 3 + 2 tr E. J^2 = det(1 + 2 E) is extreme at equal strains, and below TM_VOLUME_LEAST wherever it is not:
 * other stationary points on |E| = strain have two values of sum -1/2, and strain > 0.4. */
double tm_law_stiffest_within_Pa(const tm_material *m, bool averaged, double strain) {
    if (m->law == TM_LAW_LINEAR) return tm_material_stiffest_Pa(m);
    const double part = 2 * strain / sqrt(3), narrow = fmax(1 - part, 0);
    const double least = narrow * sqrt(narrow), most = (1 + part) * sqrt(1 + part);
    const states some = {sqrt(3 + 3 * part),
                         {strain < 0.4 ? least : 0, most},
                         strain,
                         {fmax(least, TM_VOLUME_LEAST), fmin(most, TM_VOLUME_MOST)},
                         0};
    return fmin(bound_over(m, averaged ? tm_material_bulk_Pa(m) : 0, &some), tm_law_stiffest_Pa(m, averaged));
}

/* --- histories of a Prony series --- */

/* Returns the largest pressure, at most `max_Pa`, that may be added to U' at the sign without raising the bound above
 * a_Pa: the bound is a maximum of functions linear in it, so convex. */
static double pressure_room(const tm_material *m, double averaged_Pa, int sign, double max_Pa, double a_Pa) {
    states all = {HUGE_VAL, {-HUGE_VAL, HUGE_VAL}, HUGE_VAL, {TM_VOLUME_LEAST, TM_VOLUME_MOST}, sign * max_Pa};
    double low = 0, high = max_Pa;
    if (bound_over(m, averaged_Pa, &all) <= a_Pa) return max_Pa;
    for (int k = 0; k < 6; k++) {
        const double middle = 0.5 * (low + high);
        all.pressure_Pa = sign * middle;
        if (bound_over(m, averaged_Pa, &all) <= a_Pa)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Returns an upper bound of the largest eigenvalue, in size, of the second derivative of det F by F, to a strain. */
static double bend_within(const tm_material *m, double strain) {
    const tm_material none = {.stretch_max = m->stretch_max};
    const states some = {sqrt(3 + 2 * sqrt(3) * strain), {0, HUGE_VAL}, strain, {1, 1}, 1};
    states other = some;
    other.pressure_Pa = -1;
    return fmax(bound_over(&none, 0, &some), bound_over(&none, 0, &other));
}

/* A step holds histories h_i, of S, and q_i, of p: averages over the past, as their weights are positive and have
 * sum 1. So |h_i| <= stress_Pa and pressure_Pa[0] <= q_i <= pressure_Pa[1] at any time, if what is stored is limited to
 * that. The tangent is
 *     K = A - sum shear_i (D -> D h_i) - sum volume_i q_i d2J,   D.D h_i >= -|h_i| |D|^2,
 * A that of the law. The last term adds to U', so that K <= a + room_Pa over all paths. A share of the room
 * is for h, the rest for q; averaged pressures need more. */
tm_history_limits tm_law_history_limits(const tm_material *m, bool averaged, double room_Pa, bool by_strain,
                                        double shear, double bulk) {
    const double kappa_Pa = tm_material_bulk_Pa(m), max_Pa = bulk * (1 - TM_VOLUME_LEAST) * kappa_Pa;
    const double share = averaged ? 0.25 : 0.4, rest_Pa = (1 - share) * room_Pa,
                 a_Pa = tm_law_stiffest_Pa(m, averaged) + rest_Pa;
    tm_history_limits l = {.stress_Pa = share * room_Pa / fmax(shear, 0.01), .more_Pa = room_Pa};
    for (int side = 0; side < 2; side++) { /* a history of compression, q < 0, adds to U' */
        double room = pressure_room(m, averaged ? kappa_Pa : 0, side ? -1 : 1, max_Pa, a_Pa);
        if (by_strain) room = fmin(room, rest_Pa / bend_within(m, TM_STRAIN_MOST));
        l.pressure_Pa[side] = (side ? 1 : -1) * (bulk > 0 ? room / bulk : HUGE_VAL);
    }
    return l;
}
