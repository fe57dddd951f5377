/* Repeats meshing until the number of tetrahedra, or this machine's load, and the labels' volumes match the request;
 * then optimises once. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/bandwidth.h"
#include "image.h"
#include "step.h"

enum { TETS_MAX = 5 * 1000 * 1000 };

static const double volume_aim = 0.01, count_low = 0.85, count_aim = 0.93;

void image_mesh_free(image_mesh *mesh) {
    free(mesh->tets.vertex_m);
    free(mesh->tets.tet);
    free(mesh->tets.label);
    memset(mesh, 0, sizeof *mesh);
}

/* --- one pass --- */

typedef struct pass {
    const image_api *api;
    const image_options *o;
    label_field *field;
    image_domain domain;
    double *seed_m;
    int expected; /* vertices, for the progress display */
    double relax; /* maximum tetrahedron size of a thin label relative to its thickness */
    bool finish;  /* optimise; takes seconds a pass, so only at the end or when steps are fitted */
} pass;

static bool go_on(void *context, const char *doing, int vertices) {
    const pass *p = context;
    char what[80];
    snprintf(what, sizeof what, "tm-mesh image: %s", doing);
    if (p->o->trial && app_seconds() > p->o->trial_until_s) return false;
    if (!app_is_quiet() && !p->o->trial)
        app_progress(what, fmin(0.99, p->expected ? (double)vertices / p->expected : 0), false);
    return !app_interrupted();
}

/* Sets the size of each label's tetrahedra: as requested, but at most the label's thickness, so that it does not fall
 * apart. A tube of radius r has V/A = r/2; voxel faces have 1.5 times the area of the surface. */
static void set_sizes(const pass *p, double size_m, image_mesh *mesh) {
    const double *s = p->field->spacing_m, voxel_m3 = s[0] * s[1] * s[2];
    mesh->size_m = size_m;
    for (int l = 1; l <= p->field->labels; l++) {
        const double thick_m =
            p->field->face_m2[l] > 0 ? 3 * (double)p->field->voxels[l] * voxel_m3 / p->field->face_m2[l] : size_m;
        const double own_m = p->o->region[l].size_m;
        mesh->edge_m[l] = own_m > 0 ? own_m : fmin(size_m, fmax(p->relax * thick_m, size_m / 3));
        mesh->surface_m[l] = p->o->distance_m > 0 ? p->o->distance_m : mesh->edge_m[l] / 8;
    }
}

static int mesh_once(pass *p, double size_m, image_mesh *mesh) {
    char why[IMAGE_WHY] = "";
    image_mesh fresh = {.passes = mesh->passes + 1};
    set_sizes(p, size_m, &fresh);
    const image_request request = {.labels = p->field->labels,
                                   .edge_m = fresh.edge_m,
                                   .surface_m = fresh.surface_m,
                                   .facet_angle_deg = 25,
                                   .radius_edge = 2,
                                   .lloyd = p->finish && p->o->lloyd,
                                   .perturb = p->finish && p->o->perturb,
                                   .exude = p->finish && p->o->exude,
                                   .sweeps = 20,
                                   .sliver_deg = p->o->sliver_deg,
                                   .go_on = go_on,
                                   .go_on_context = p};
    const image_end end = p->api->mesh(&p->domain, &request, &fresh.tets, why);
    if (!p->o->trial) app_progress("tm-mesh image", 1, true);
    if (end == IMAGE_STOPPED && p->o->trial) return APP_FAILED;
    if (end == IMAGE_STOPPED) return app_interrupted_exit();
    if (end) {
        if (!p->o->trial) app_bad_input(p->o->in, 0, "%s", why);
        return APP_FAILED;
    }
    image_mesh_free(mesh);
    *mesh = fresh;
    p->expected = mesh->tets.vertices * 6 / 5;
    bool good = !p->finish || (image_measure(p->field, mesh) && image_drop_loose(p->field, mesh));
    if (good && p->finish && p->o->improve)
        good = image_improve(&mesh->tets, p->field->labels, label_field_between, p->field);
    if (good && p->finish && p->o->volumes) good = image_fit_volumes(p->field, &mesh->tets);
    if (!good || !image_measure(p->field, mesh)) return command_no_memory(p->o->in);
    if (p->o->budget >= 0 || !mesh->tets.tets) return APP_DONE;
    return step_load(p->o->in, &mesh->tets, p->o->young_Pa, p->o->poisson, p->o->density_kg_m3, &mesh->load);
}

/* --- volumes --- */

static double worst_volume(const label_field *f, const image_mesh *mesh) {
    double worst = 0;
    for (int l = 1; l <= f->labels; l++)
        if (mesh->of[l].image_m3 > 0) worst = fmax(worst, fabs(mesh->of[l].volume_m3 / mesh->of[l].image_m3 - 1));
    return worst;
}

/* Moves each label's surface outward by its missing volume over its area: chords and smoothing cut off convex parts.
 * Across the surface the difference of two labels' strengths grows by 2/(sqrt(2 pi) sigma) per metre. */
static void correct_volumes(const pass *p, const image_mesh *mesh) {
    const double *s = p->field->spacing_m, voxel_m = cbrt(s[0] * s[1] * s[2]);
    for (int l = 1; l <= p->field->labels; l++) {
        const double sigma = (double)p->field->sigma[l];
        const double slope_1_m = 2 / (sqrt(2 * M_PI) * voxel_m * sqrt(sigma * sigma + 0.16));
        const image_result *r = &mesh->of[l];
        if (!(r->area_m2 > 0)) continue;
        const double bias = p->field->bias[l] + slope_1_m * (r->image_m3 - r->volume_m3) / r->area_m2;
        p->field->bias[l] = (float)fmax(-LABEL_BIAS_MAX, fmin(LABEL_BIAS_MAX, bias));
    }
}

/* --- sizes --- */

static double first_size(const pass *p) {
    const double *s = p->field->spacing_m;
    double volume_m3 = 0;
    if (p->o->size_m > 0) return p->o->size_m;
    for (int l = 1; l <= p->field->labels; l++) volume_m3 += (double)p->field->voxels[l] * s[0] * s[1] * s[2];
    return cbrt(9 * volume_m3 / (p->o->budget > 0 ? p->o->budget : 5000));
}

/* Returns the budget used: tetrahedra, or load. */
static double used(const pass *p, const image_mesh *mesh) {
    if (p->o->budget > 0) return mesh->tets.tets / (double)p->o->budget;
    return p->o->budget < 0 ? mesh->load / p->o->budget_load : count_aim;
}

/* Returns the number of tetrahedra in labels of a given size, which the budget cannot change. */
static int own_tets(const pass *p, const image_mesh *mesh) {
    int own = 0;
    for (int l = 1; l <= p->field->labels; l++) own += p->o->region[l].size_m > 0 ? mesh->of[l].tets : 0;
    return own;
}

/* Adjusts sizes until the budget is used, and volumes with them. If larger sizes do not suffice, thin labels'
 * tetrahedra exceed their thickness. */
static int fit(pass *p, int passes, double *size_m, image_mesh *mesh) {
    double before = HUGE_VAL;
    for (int i = 0; i < passes; i++) {
        const int exit = mesh_once(p, *size_m, mesh);
        if (exit) return exit;
        const double part = fmax(0.01, used(p, mesh)), worst = worst_volume(p->field, mesh);
        const bool fits = part >= count_low && part <= 1;
        if ((fits && (worst <= volume_aim || (i >= 3 && worst > 0.8 * before))) || i == passes - 1) break;
        /* number of tetrahedra ~ 1/size^3, load ~ 1/size^4 */
        if (p->o->budget > 0 && own_tets(p, mesh) > count_low * p->o->budget) break;
        if (part > 1 && i >= 6) p->relax *= pow(part / count_aim, 1.0 / 3);
        if (!fits) *size_m *= pow(part / count_aim, p->o->budget < 0 ? 0.25 : 1.0 / 3);
        correct_volumes(p, mesh);
        before = worst;
    }
    return APP_DONE;
}

/* --- complete meshing --- */

/* Sets one seed point in each piece. */
static bool set_domain(pass *p) {
    label_field *f = p->field;
    p->seed_m = malloc((3 * (size_t)f->piece_count + 1) * sizeof *p->seed_m);
    for (int s = 0; p->seed_m && s < f->piece_count; s++)
        memcpy(p->seed_m + 3 * (size_t)s, f->piece[s].seed_m, 3 * sizeof(double));
    p->domain = (image_domain){.label = label_field_at, .context = f, .seeds = f->piece_count, .seed_m = p->seed_m};
    p->domain.march_m = fmin(fmin(f->spacing_m[0], f->spacing_m[1]), f->spacing_m[2]);
    for (int k = 0; k < 3; k++) {
        p->domain.low_m[k] = (f->begin[k] - 1) * f->spacing_m[k];
        p->domain.high_m[k] = (f->begin[k] + f->size[k]) * f->spacing_m[k];
    }
    return p->seed_m != NULL;
}

/* Rejects a size that would make millions of tetrahedra, before the work: it is a mistake. */
static int check_count(const pass *p, double size_m) {
    const double *s = p->field->spacing_m;
    image_mesh sizes = {0};
    double count = 0;
    set_sizes(p, size_m, &sizes);
    for (int l = 1; l <= p->field->labels; l++)
        count += 6 * (double)p->field->voxels[l] * s[0] * s[1] * s[2] / pow(sizes.edge_m[l], 3);
    if (!(count > TETS_MAX)) return APP_DONE;
    if (p->o->trial) return APP_FAILED;
    return app_bad_input(p->o->in, 0, "it would have about %.2g tetrahedra; choose a larger --size, or a --budget",
                         count);
}

/* Reports an exceeded budget; rejects it with --strict, or if two requests contradict each other. */
static int check_budget(const pass *p, const image_mesh *mesh) {
    const image_options *o = p->o;
    const int own = own_tets(p, mesh);
    if (!(o->budget > 0) || mesh->tets.tets <= o->budget) return APP_DONE;
    if (o->trial) return own > count_low * o->budget && o->budget_said ? APP_FAILED : APP_DONE;
    if (own > count_low * o->budget && o->budget_said)
        return app_bad_input(
            o->in, 0,
            "labels with their own size need %d tetrahedra, all labels %d, more than --budget %d; leave out "
            "--budget, or the size",
            own, mesh->tets.tets, o->budget);
    if (o->strict)
        return app_bad_input(o->in, 0, "its labels need at least %d tetrahedra, more than --budget %d", mesh->tets.tets,
                             o->budget);
    app_remark("%s: %d tetrahedra, more than the budget of %d, because its labels need that many\n", o->in,
               mesh->tets.tets, o->budget);
    return APP_DONE;
}

int image_build(const image_api *api, const image_options *o, label_field *field, image_mesh *mesh) {
    pass p = {.api = api, .o = o, .field = field, .relax = 1};
    *mesh = (image_mesh){0};
    if (!set_domain(&p)) return command_no_memory(o->in);
    double size_m = first_size(&p);
    p.finish = o->budget < 0;
    int exit = check_count(&p, size_m);
    if (exit == APP_DONE) exit = fit(&p, o->budget < 0 ? 6 : 10, &size_m, mesh);
    if (exit == APP_DONE && !p.finish) {
        p.finish = true;
        exit = fit(&p, 4, &size_m, mesh);
    }
    if (exit == APP_DONE) exit = check_budget(&p, mesh);
    free(p.seed_m);
    if (exit) image_mesh_free(mesh);
    return exit;
}
