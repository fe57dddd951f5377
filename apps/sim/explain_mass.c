#include "explain_mass.h"
#include "libtensormass/numeric/order.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const double SLIVER = 0.3; /* critical step of a tetrahedron over the median's, above which it is not reported */

/* --- distribution --- */

/* Reports the added mass per region as a share of its own. A vertex counts for the regions of its tetrahedra. */
static void by_region(const sim *s, cJSON *json) {
    const tm_mesh *mesh = s->mesh;
    const double *own = tm_tissue_physical_mass_kg(s->model->tissue), *all = tm_tissue_mass_kg(s->model->tissue);
    const uint8_t *alive = tm_tissue_alive(s->model->tissue);
    double *sum = calloc(2 * (size_t)mesh->region_count, sizeof *sum);
    cJSON *list = cJSON_AddArrayToObject(json, "regions");
    for (int32_t t = 0; sum && t < mesh->tet_count; t++)
        for (int k = 0; k < 4 && alive[t]; k++) {
            const int32_t v = mesh->tet[4 * (int64_t)t + k];
            const double mass = tm_tissue_tet_material(s->model->tissue, t)->density_kg_m3 * mesh->volume_m3[t] / 4;
            sum[2 * mesh->region[t]] += mass;
            sum[2 * mesh->region[t] + 1] += mass / own[v] * (all[v] - own[v]);
        }
    for (int32_t r = 0; sum && r < mesh->region_count; r++) {
        cJSON *row = cJSON_CreateObject();
        cJSON_AddItemToArray(list, row);
        cJSON_AddStringToObject(row, "region", s->file.region_name[r]);
        cJSON_AddNumberToObject(row, "physical_kg", sum[2 * r]);
        cJSON_AddNumberToObject(row, "added_kg", sum[2 * r + 1]);
        if (mesh->region_count > 1 && sum[2 * r + 1] > 0)
            printf("  region %s: %.3g g on %.4g g\n", s->file.region_name[r], 1e3 * sum[2 * r + 1], 1e3 * sum[2 * r]);
    }
    free(sum);
}

/* --- effect --- */

static void frequencies(const sim *s, cJSON *json) {
    double own[3], scaled[3];
    tm_error error = {0};
    uint8_t *fixed = calloc(3, (size_t)s->mesh->vertex_count);
    for (int32_t i = 0; fixed && i < s->fixed_count; i++) fixed[s->fixed_dof[i]] = 1;
    if (fixed && !tm_mass_scaling_frequencies(s->model->tissue, fixed, own, scaled, &error)) {
        printf("  lowest frequencies, along x, y, z: %.3g, %.3g, %.3g Hz; without it %.3g, %.3g, %.3g Hz (estimates "
               "from the shapes under its own weight)\n",
               scaled[0], scaled[1], scaled[2], own[0], own[1], own[2]);
        cJSON_AddItemToObject(json, "frequency_Hz", cJSON_CreateDoubleArray(scaled, 3));
        cJSON_AddItemToObject(json, "own_frequency_Hz", cJSON_CreateDoubleArray(own, 3));
    } else
        puts("  lowest frequencies: none, because the supports leave it free to move");
    free(fixed);
}

/* --- cost of slivers in tissue that is cut --- */

/* Reports the tetrahedron that determines the step if its step is far below the median's. */
static void slivers(const sim *s, cJSON *json) {
    const tm_tissue *tissue = s->model->tissue;
    const uint8_t *alive = tm_tissue_alive(tissue);
    int32_t n = 0, worst = -1;
    double least = INFINITY, *step = malloc(sizeof *step * (size_t)s->mesh->tet_count);
    for (int32_t t = 0; step && t < s->mesh->tet_count; t++) {
        if (!alive[t]) continue;
        step[n] = tm_critical_step_element(tissue, t);
        if (step[n] < least) least = step[n], worst = t;
        n++;
    }
    if (step) num_sort(step, n);
    if (n && least < SLIVER * step[n / 2]) {
        char name[SIM_TET_NAME];
        printf("cut: the step must be stable for each tetrahedron by itself; that of %s is %.2g of the median "
               "(tm-mesh info). A mesh without slivers, or time.mass_scaling, makes the step longer\n"
               "\n",
               sim_tet_name(s, worst, name), least / step[n / 2]);
        cJSON *out = cJSON_AddObjectToObject(json, "slivers");
        cJSON_AddNumberToObject(out, "tetrahedron", (double)s->file.tet_tag[worst]);
        cJSON_AddNumberToObject(out, "of_median", least / step[n / 2]);
    }
    free(step);
}

void explain_mass(const sim *s, cJSON *json) {
    tm_mass_scaling m;
    if (!tm_tissue_mass_scaling(s->model->tissue, &m)) {
        if (s->def.model.tissue.cuttable) slivers(s, json);
        return;
    }
    cJSON *out = cJSON_AddObjectToObject(json, "mass_scaling");
    printf("mass scaling: %.3g %% of the tissue's %.4g g added, at %d of %d vertices", 100 * m.added_kg / m.physical_kg,
           1e3 * m.physical_kg, m.vertices, s->mesh->vertex_count);
    cJSON_AddNumberToObject(out, "physical_kg", m.physical_kg);
    cJSON_AddNumberToObject(out, "added_kg", m.added_kg);
    cJSON_AddNumberToObject(out, "vertices", m.vertices);
    if (m.max_factor_vertex >= 0) {
        const double *x = s->mesh->rest_m + 3 * (int64_t)m.max_factor_vertex;
        printf(", most at (%.4g %.4g %.4g) mm: %.3g times its own", 1e3 * x[0], 1e3 * x[1], 1e3 * x[2], m.max_factor);
        cJSON_AddNumberToObject(out, "max_factor", m.max_factor);
        cJSON_AddItemToObject(out, "most_at_m", cJSON_CreateDoubleArray(x, 3));
    }
    printf("\n");
    by_region(s, out);
    frequencies(s, out);
    printf("\n");
}
