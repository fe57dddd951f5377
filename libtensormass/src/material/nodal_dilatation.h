/* Averaged nodal dilatation of corotated tissue (effect "strain_smoothing"). Each tetrahedron gives its dilatation tr S
 * - 3 of F = R S, so that the average is rotation-invariant. Energy: kappa/2 of the squared average for each domain,
 * minus the energy of the tensors for the average of tr grad u. */
#ifndef TM_NODAL_DILATATION_H
#define TM_NODAL_DILATATION_H

#include "material/strain_smoothing.h"

struct tm_tet_batches;
struct tm_viscous;

typedef struct tm_nodal_dilatation {
    tm_material_field field; /* mesh null: nothing is averaged, all functions do nothing */
    tm_domains own_domains;  /* of tissue that cannot be cut: its domains of vertices */
    int32_t *domain;         /* [4*TM_LANES*batches] of each corner */
    double *quarter_m3;      /* [TM_LANES*batches] contribution of a tetrahedron to each of its four domains */
    int32_t *tet_at, *tet;   /* [domains+1], [4*tet_count] contributors to a domain, ascending */
    const double *bulk_Pa;   /* [region_count] by law */
    const double *max_Pa;    /* [region_count] limit of the tension */
    const double *min_Pa;    /* [region_count] of the pressure, under nonlinear laws; else null */
    /* Of one evaluation at u. Tetrahedra in batches of TM_LANES, as in tm_tet_batches. */
    double *rotation; /* [9*TM_LANES*batches] R; under nonlinear laws the dilatation's derivative by F */
    double *dilatation,
        *linear_dilatation; /* [TM_LANES*batches] tr S - 3 and tr grad u, times the quarter; 0 where removed */
    double *averaged_dilatation, *averaged_linear_dilatation; /* [domains] averages of both */
    double *corotated_Pa, *linear_Pa;                         /* [domains] pressure by the averages, Pa */
} tm_nodal_dilatation;

static inline bool tm_nodal_dilatation_is_on(const tm_nodal_dilatation *s) { return s->field.mesh; }

/* Initialises from the pool; returns false without memory. Does nothing without smoothing. */
bool tm_nodal_dilatation_init(tm_nodal_dilatation *s, tm_pool *pool, const tm_material_field *field, int32_t batches);
/* Initialises another evaluation of the same tissue at another u. */
bool tm_nodal_dilatation_init_evaluation(tm_nodal_dilatation *look, tm_pool *pool, const tm_nodal_dilatation *s,
                                         int32_t batches);
const tm_domains *tm_nodal_dilatation_domains_of(const tm_nodal_dilatation *s);
int32_t tm_nodal_dilatation_domains(const tm_nodal_dilatation *s);

/* force_N += the correction. */
void tm_nodal_dilatation_add(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches, bool plain,
                             const double *u_m, double *force_N);
double tm_nodal_dilatation_energy(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches,
                                  const double *u_m);
/* Returns the energy of all averaged dilatation, not of the correction. */
double tm_nodal_dilatation_total_energy(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches,
                                        const double *u_m);
/* Returns the energy at the pressures of the last evaluation. */
double tm_nodal_dilatation_stored(const tm_nodal_dilatation *s);
/* Returns whether the pressure of domain i changes with its dilatation: it is not at a limit. */
static inline bool tm_nodal_dilatation_grows(const tm_nodal_dilatation *s, int32_t i, int32_t law) {
    const double pressure = s->bulk_Pa[law] * s->averaged_dilatation[i];
    return pressure < s->max_Pa[law] && !(s->min_Pa && pressure < s->min_Pa[law]);
}
/* Averages `dilatation` over the domains [begin, end), and computes pressures of the long-term law and the terms;
 * advances the histories. relaxing null: elastic. */
void tm_nodal_dilatation_average(const tm_nodal_dilatation *s, const struct tm_viscous *relaxing, int32_t begin,
                                 int32_t end);
/* Computes averages and pressures at u. */
void tm_nodal_dilatation_evaluate(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches, bool plain,
                                  const double *u_m);

#endif
