/* The law of tests/physics/test_adding_a_law.py: neo-Hooke with a term of the second power, as Yeoh's (Rubber Chem.
 * Technol. 66 (1993) 754), a part of hyperelastic_kernel.h:
 *     W = neo-Hooke with lambda - k for lambda, and k/8 (I - 3)^2,   k = c mu, c the share `power`.
 * At small strains (I - 3)^2/8 is (tr E)^2/2, which lambda - k leaves room for. */

#ifdef TM_LAW_FACTS
/* The tangent of k/8 (I - 3)^2 is k/2 (R^2 - 3) across F and 2 R^2 more along it; its stress is along F. */
static void tm_yeoh_bound(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double k = m->law_constant[0] * m->mu_Pa, most = c->R[1] * c->R[1], least = c->R[0] * c->R[0];
    tm_neo_hooke_bound(m, lambda_Pa - k, c, b);
    tm_bound_add(b, c, 1.5 * k * (most - 1), 0.5 * k * (least - 3) * c->R[0], 0);
}

static const tm_law_facts tm_yeoh_facts = {
    .name = "yeoh",
    .constant = {{"power", "none", "0.2", 0, 1, 0.4, "stiffness of the second power, as a share of mu"}},
    .bound = tm_yeoh_bound};
#else

INSIDE void TM_NAME(yeoh)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9], M8 *outside) {
    TM_NAME(hyper) rest = *w;
    const V8 k = w->c[0] * w->mu, pull = REAL(0.5) * k * s->I3;
    rest.lambda -= k;
    TM_NAME(neo_hooke)(&rest, H, s, P, outside);
    for (int i = 0; i < 9; i++) P[i] += pull * H[i] + REAL(i % 4 ? 0.0 : 1.0) * pull;
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(yeoh_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane) {
    TM_NAME(hyper) rest = *w;
    const double k = w->c[0][lane] * w->mu[lane];
    rest.lambda[lane] -= k;
    return TM_NAME(neo_hooke_energy)(&rest, H, s, lane) + 0.125 * k * s->I3[lane] * s->I3[lane];
}
#endif
#endif
