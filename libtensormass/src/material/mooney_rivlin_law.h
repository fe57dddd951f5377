/* Compressible Mooney-Rivlin, a part of hyperelastic_kernel.h:
 *     W = a/2 (I - 3) + b/2 (II - 3) - (a + 2 b) (J - 1) + l/2 (J - 1)^2,  II = |cof F|^2,
 * a = (1 - c) mu, b = c mu and l = lambda + (1 - c) mu, so that small strains have lambda and mu; c the share of the
 * second invariant. Pressure as in neo_hooke_law.h. */

#ifdef TM_LAW_FACTS
/* The tangent of II/2 is, in principal stretches, I + 2 (s.v)^2 - 3 sum s_i^2 v_i^2 <= I + (s.v)^2 <= 2 I, and s_k^2 -+
 * s_i s_j <= I. Its stress is a third of the tangent along F, and pulls. */
static void tm_mooney_rivlin_bound(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double first = (1 - m->law_constant[0]) * m->mu_Pa, second = m->law_constant[0] * m->mu_Pa, R = c->R[1];
    tm_bound_add(b, c, first, first * c->R[0], 0);
    tm_bound_add(b, c, 2 * second * R * R, 0, 2.0 / 3 * second * R * R * R);
    b->bulk_Pa = lambda_Pa + first, b->offset_Pa = first + 2 * second;
}

static tm_status tm_mooney_rivlin_check(const tm_material *m, tm_error *error) {
    const double bulk_Pa = m->lambda_Pa + (1 - m->law_constant[0]) * m->mu_Pa;
    return bulk_Pa > 0 ? TM_OK
                       : tm_law_bad(m, "lambda + (1 - second) mu", bulk_Pa, "lambda + (1 - second) mu > 0", error);
}

static const tm_law_facts tm_mooney_rivlin_facts = {
    .name = "mooney-rivlin",
    .constant = {{"second", "none", "0", 0, 1, 0.3, "share of mu in the second invariant"}},
    .check = tm_mooney_rivlin_check,
    .bound = tm_mooney_rivlin_bound};
#else

INSIDE void TM_NAME(mooney_rivlin)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9],
                                   M8 *outside) {
    const V8 a = (1.0 - w->c[0]) * w->mu, b = w->c[0] * w->mu;
    V8 E[9], J1;
    TM_NAME(green_strain)(H, E);
    TM_NAME(clamp)(&s->J1, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, outside);
    const V8 pressure = (w->lambda + a) * J1;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 * i + j;
            const V8 HE = H[3 * i] * E[j] + H[3 * i + 1] * E[3 + j] + H[3 * i + 2] * E[6 + j];
            /* F - cof F, and I F - F C - 2 cof F; both are 0 at rest. */
            const V8 first = H[k] - s->cof[k], second = 2.0 * (H[k] - E[k] - HE - s->cof[k]) + s->I3 * H[k];
            P[k] = a * first + b * second + pressure * s->cof[k];
        }
    for (int i = 0; i < 9; i += 4) P[i] += b * s->I3 + pressure;
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(mooney_rivlin_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s,
                                            int lane) {
    (void)H;
    const double a = (1 - w->c[0][lane]) * w->mu[lane], b = w->c[0][lane] * w->mu[lane], J1 = s->J1[lane];
    const double c = fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    double II3 = 2 * (s->cof[0][lane] + s->cof[4][lane] + s->cof[8][lane]);
    for (int i = 0; i < 9; i++) II3 += s->cof[i][lane] * s->cof[i][lane];
    return 0.5 * a * s->I3[lane] + 0.5 * b * II3 - (a + 2 * b) * J1 + (w->lambda[lane] + a) * c * (J1 - 0.5 * c);
}
#endif
#endif
