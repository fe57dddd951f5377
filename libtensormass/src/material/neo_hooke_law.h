/* Compressible neo-Hooke, stable under inversion (Smith, de Goes and Kim, ACM Trans. Graph. 37 (2018) 12), a part of
 * hyperelastic_kernel.h:
 *     W = m/2 (I - 3) - m/2 log((I + 1)/4) + l/2 (J - 1)^2 - 3/4 m (J - 1),  I = |F|^2, J = det F,
 * m = 4/3 mu and l = lambda + 5/6 mu, so that small strains have lambda and mu. Beyond TM_VOLUME_LEAST and _MOST the
 * pressure is constant: the tangent has a bound, and flat or inverted tetrahedra still recover. */

#ifdef TM_LAW_FACTS
/* The terms in I depend on R = |F| alone: their tangent is m (1 + (R^2 - 1)/(R^2 + 1)^2) along F, at most 9/8 m, and m
 * R^2/(R^2 + 1) across. */
static void tm_neo_hooke_bound(const tm_material *material, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double m = 4.0 / 3 * material->mu_Pa, least = c->R[0] * c->R[0];
    tm_bound_add(b, c, 1.125 * m, m * c->R[0] * (least / (1 + least)), 0);
    b->bulk_Pa = lambda_Pa + 5.0 / 6 * material->mu_Pa, b->offset_Pa = 0.75 * m;
}

static const tm_law_facts tm_neo_hooke_facts = {.name = "neo-hooke", .bound = tm_neo_hooke_bound};
#else

INSIDE void TM_NAME(neo_hooke)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9],
                               M8 *outside) {
    const V8 m = REAL(4.0 / 3) * w->mu, l = w->lambda + REAL(5.0 / 6) * w->mu, over = 1.0 / (s->I3 + 4.0);
    V8 J1;
    TM_NAME(clamp)(&s->J1, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, outside);
    /* shear (F - cof F) + pressure cof F: each vanishes at rest without a difference of large numbers. */
    const V8 shear = m - m * over, pressure = l * J1 + 0.25 * m * s->I3 * over;
    for (int i = 0; i < 9; i++)
        P[i] = shear * (H[i] - s->cof[i]) + pressure * s->cof[i] + REAL(i % 4 ? 0.0 : 1.0) * pressure;
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(neo_hooke_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane) {
    (void)H;
    const double mu = w->mu[lane], m = 4.0 / 3 * mu, l = w->lambda[lane] + 5.0 / 6 * mu;
    const double I3 = s->I3[lane], J1 = s->J1[lane];
    const double c = fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    return 0.5 * m * (I3 - log1p(0.25 * I3)) + l * c * (J1 - 0.5 * c) - 0.75 * m * J1;
}
#endif
#endif
