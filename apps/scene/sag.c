/* Tests supports: computes the linear sag of an organ under its own weight, and adds supports if it is too large. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "organ.h"
#include "tensormass/world.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

/* Largest admissible sag as a share of the organ's size; half the side of a box that is added as a support. */
enum { ENOUGH = 8 }; /* vertices that suffice to hold a connected component */
static const double sag_share = 0.2, box_share = 1.0 / 12;

typedef struct hanging {
    const organ *o;
    tm_world *world;
    uint8_t *held;    /* [vertex_count] */
    double sag_m;     /* largest displacement of any vertex */
    int32_t farthest; /* the lowest vertex among those displaced nearly as far */
} hanging;

static void look(hanging *h) {
    const tm_mesh *m = h->o->mesh;
    const double *u = tm_world_state(h->world)->u_m;
    double lowest_m = INFINITY;
    h->sag_m = 0;
    for (int32_t v = 0; v < m->vertex_count; v++) h->sag_m = fmax(h->sag_m, vnorm(u + 3 * v));
    for (int32_t v = 0; v < m->vertex_count; v++) {
        const double height_m = vdot(m->rest_m + 3 * v, h->o->up);
        if (h->held[v] || vnorm(u + 3 * v) < 0.6 * h->sag_m || height_m >= lowest_m) continue;
        lowest_m = height_m, h->farthest = v;
    }
}

/* Stops once the sag is too large: conjugate gradients from zero only increase the displacement. */
static bool still_holds(void *user, int64_t step, double residual) {
    (void)step, (void)residual;
    hanging *h = user;
    look(h);
    return h->sag_m <= sag_share * h->o->size_m && !app_interrupted();
}

static tm_status hold(hanging *h, tm_error *error) {
    const tm_mesh *m = h->o->mesh;
    tm_support_def def = tm_support_def_default();
    int32_t *dof = malloc(3 * (size_t)m->vertex_count * sizeof *dof);
    double *zero = calloc(3 * (size_t)m->vertex_count, sizeof *zero);
    memset(h->held, 0, (size_t)m->vertex_count);
    organ_mark_held(h->o, h->held);
    for (int32_t v = 0; v < m->vertex_count && dof; v++)
        for (int a = 0; a < 3 && h->held[v]; a++) dof[def.count++] = 3 * v + a;
    def.dof = dof, def.value_m = zero;
    const tm_status status = dof && zero ? tm_stage_support(h->world, &def, error)
                                         : tm_fail(error, TM_ERR_MEMORY, -1, "no memory; use a coarser mesh");
    free(dof);
    free(zero);
    return status;
}

/* Computes h->sag_m and h->farthest with the present supports. */
static tm_status hang(hanging *h, tm_tissue *tissue, tm_error *error) {
    const double g = 9.81, *up = h->o->up, weight[3] = {-g * up[0], -g * up[1], -g * up[2]};
    tm_world_def def = tm_world_def_default();
    tm_settle_def settle = tm_settle_def_default();
    def.tissue = tissue;
    settle.tolerance = 1e-3, settle.max_steps = 20000, settle.progress = still_holds, settle.user = h;
    tm_status status = tm_world_create(&def, &h->world, error);
    if (!status) status = tm_stage_gravity(h->world, weight, error);
    if (!status) status = hold(h, error);
    if (!status) status = tm_world_settle(h->world, &settle, NULL, error);
    if (!status) look(h);
    if (status == TM_ERR_SUPPORT && error->entity >= 0) /* a connected component without support */
        status = TM_OK, h->sag_m = INFINITY, h->farthest = (int32_t)error->entity;
    if (status == TM_ERR_CONVERGENCE) status = TM_OK;
    tm_world_destroy(h->world);
    h->world = NULL;
    return status;
}

static bool add_box(organ *o, int32_t vertex) {
    if (o->supports == SUPPORTS_MAX) return false;
    organ_support *s = &o->support[o->supports++];
    *s = (organ_support){.kind = SUPPORT_BOX, .name = "held here, too", .added = true};
    const double *middle = o->mesh->rest_m + 3 * (int64_t)vertex;
    for (double half_m = box_share * o->size_m; s->count < ENOUGH && half_m < 0.3 * o->size_m; half_m *= 1.3) {
        for (int a = 0; a < 3; a++) s->low_m[a] = middle[a] - half_m, s->high_m[a] = middle[a] + half_m;
        s->count = 0;
        for (int32_t v = 0; v < o->mesh->vertex_count; v++)
            s->count += organ_holds(s, o->mesh->rest_m + 3 * (int64_t)v);
    }
    return true;
}

int organ_hang(const char *path, organ *o) {
    tm_error error = {0};
    tm_tissue *tissue = NULL;
    hanging h = {.o = o, .held = malloc((size_t)o->mesh->vertex_count)};
    tm_status status =
        h.held ? organ_tissue(o, false, &tissue, &error) : tm_fail(&error, TM_ERR_MEMORY, -1, "no memory");
    do {
        if (!status) status = hang(&h, tissue, &error);
        o->sag_m = h.sag_m, o->hangs = h.sag_m <= sag_share * o->size_m;
    } while (!status && !o->hangs && !app_interrupted() && add_box(o, h.farthest));
    tm_tissue_destroy(tissue);
    free(h.held);
    return status ? app_report(path, 0, &error) : app_interrupted() ? app_interrupted_exit() : 0;
}
