/* Changes of volume that are averaged around vertices (effect "strain_smoothing") of tissue that turns: every
 * tetrahedron's in its own axes, tr S - 3 of F = R S, so that what is averaged knows of no turn. Energy: kappa/2 of the
 * average's square for each domain, less what the tensors store for the average of tr grad u. */
#ifndef TM_NODAL_DILATATION_H
#define TM_NODAL_DILATATION_H

#include "material/strain_smoothing.h"

struct tm_tet_batches;
struct tm_viscous;

typedef struct tm_nodal_dilatation {
    tm_material_field field; /* mesh null: nothing is averaged, and nothing here is to be done */
    tm_domains own_domains;  /* of tissue that cannot be cut: its domains of vertices */
    int32_t *domain;         /* [4*TM_LANES*packs] of each corner */
    double *quarter_m3;      /* [TM_LANES*packs] what a tetrahedron gives to each of its four domains */
    int32_t *tet_at, *tet;   /* [domains+1], [4*tet_count] who gives to a domain, ascending */
    const double *bulk_Pa;   /* [region_count] by law */
    const double *max_Pa;    /* [region_count] tension grows no further than this */
    /* Of one look at u. Tetrahedra in packs of TM_LANES, as in tm_tet_batches. */
    double *rotation; /* [9*TM_LANES*packs] R */
    double *dilatation,
        *linear_dilatation; /* [TM_LANES*packs] tr S - 3 and tr grad u, times the quarter; 0 of the dead */
    double *averaged_dilatation, *averaged_linear_dilatation; /* [domains] averages of both */
    double *corotated_Pa, *linear_Pa;                         /* [domains] pressure by the averages, Pa */
} tm_nodal_dilatation;

static inline bool tm_nodal_dilatation_is_on(const tm_nodal_dilatation *s) { return s->field.mesh; }

/* From the pool; false: no memory. Without smoothing: nothing. */
bool tm_nodal_dilatation_init(tm_nodal_dilatation *s, tm_pool *pool, const tm_material_field *field, int32_t batches);
/* The same tissue's for another look at another u. */
bool tm_nodal_dilatation_init_evaluation(tm_nodal_dilatation *look, tm_pool *pool, const tm_nodal_dilatation *s,
                                         int32_t batches);
const tm_domains *tm_nodal_dilatation_domains_of(const tm_nodal_dilatation *s);
int32_t tm_nodal_dilatation_domains(const tm_nodal_dilatation *s);

/* force_N += the correction. */
void tm_nodal_dilatation_add(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches, bool plain,
                             const double *u_m, double *force_N);
double tm_nodal_dilatation_energy(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches,
                                  const double *u_m);
/* All that is averaged, not the correction. */
double tm_nodal_dilatation_total_energy(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches,
                                        const double *u_m);
/* Averages of `grown` over the domains [begin, end), and their pressures, by what the series leaves and by its terms;
 * the histories go on. relaxing null: elastic. */
void tm_nodal_dilatation_average(const tm_nodal_dilatation *s, const struct tm_viscous *relaxing, int32_t begin,
                                 int32_t end);
/* Averages and pressures at u. */
void tm_nodal_dilatation_evaluate(const tm_nodal_dilatation *s, const struct tm_tet_batches *batches, bool plain,
                                  const double *u_m);

#endif
