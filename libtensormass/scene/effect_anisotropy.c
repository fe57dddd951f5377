/* Fibre directions, from a file or a rule. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "choices.h"
#include "fibres_image.h"
#include "laplace.h"
#include "sim.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"
typedef struct options {
    app_section here;
    app_text file;
    app_choice axes;
    app_choice rule;
    app_vector direction, point;
    app_text from, to;
    app_integer smooth;
} options;

typedef enum rule { CONSTANT, RADIAL, CIRCULAR, SPHERICAL, LAPLACE } rule;
#define RULES(ROW)                                                                                                     \
    ROW("constant", CONSTANT)                                                                                          \
    ROW("radial", RADIAL) ROW("circular", CIRCULAR) ROW("spherical", SPHERICAL) ROW("laplace", LAPLACE)
APP_CHOICE_CHECK(RULES)
#define AXES(ROW) ROW("image", SIM_FIBRES_IMAGE) ROW("lps", SIM_FIBRES_LPS) ROW("ras", SIM_FIBRES_RAS)
APP_CHOICE_CHECK(AXES)

static const app_field fields[] = {
    {"anisotropy", APP_SECTION, NULL, NULL, 0, 0, offsetof(options, here), 0,
     "fibre directions, which fibred materials need"},
    {"anisotropy.file", APP_PATH, NULL, NULL, 0, 0, offsetof(options, file), 0,
     "instead of a rule: CSV with header `tet,ax,ay,az`, one row a tetrahedron, or `vertex,ax,ay,az`, one "
     "row a vertex, counted from 0 in file order; or a NIfTI image (`.nii`, `.nii.gz`) of 3 numbers a "
     "voxel, the principal direction of diffusion (DTI, its sign is ignored), at the position of a mesh "
     "of `tm-mesh image`. Images need the module of `make image`"},
    {"anisotropy.axes", APP_CHOICE, APP_CHOICE_WORDS(AXES), NULL, 0, 0, offsetof(options, axes), 0,
     "axes of an image's three numbers, required with an image: the image's own axes (`image`: FSL, for "
     "an image stored radiologically), or the patient's left, posterior, superior (`lps`: ITK), or right, "
     "anterior, superior (`ras`: MRtrix)"},
    {"anisotropy.rule", APP_CHOICE, APP_CHOICE_WORDS(RULES), NULL, 0, 0, offsetof(options, rule), 0,
     "`constant`: along `direction`; `radial` and `circular`: away from and around the line through "
     "`point` along `direction`; `spherical`: away from `point`; `laplace`: along the gradient of a "
     "potential between the groups `from` and `to`"},
    {"anisotropy.direction", APP_VECTOR, "none", "[0, 0, 1]", 0, 0, offsetof(options, direction), 0, "any length"},
    {"anisotropy.point", APP_VECTOR, "length", "[0, 0, 0]", 0, 0, offsetof(options, point), 0,
     "a point on the line, or the centre"},
    {"anisotropy.from", APP_TEXT, NULL, NULL, 0, 0, offsetof(options, from), 0,
     "with `laplace`: group of the mesh at which fibres begin"},
    {"anisotropy.to", APP_TEXT, NULL, NULL, 0, 0, offsetof(options, to), 0,
     "with `laplace`: group of the mesh at which fibres end"},
    {"anisotropy.smooth", APP_INTEGER, NULL, "0", 0, 1000, offsetof(options, smooth), 0,
     "number of smoothing passes; each replaces a tetrahedron's fibre by the mean with its neighbours', whose sign is ignored"},
};

static bool is_image(const char *path) {
    const size_t length = strlen(path);
    return (length > 4 && strcmp(path + length - 4, ".nii") == 0) ||
           (length > 7 && strcmp(path + length - 7, ".nii.gz") == 0);
}

static tm_status check(const app_scene *scene, const void *own) {
    const options *o = own;
    if (!o->file.line == !o->rule.line)
        return app_scene_bad(scene, o->here.line, "anisotropy needs either a file or a rule; give one of them");
    const bool image = o->file.line && is_image(o->file.s);
    if (image && !o->axes.line)
        return app_scene_bad(scene, o->file.line,
                             "an image of fibres does not define its axes; give axes: image, lps or ras");
    if (!image && o->axes.line)
        return app_scene_bad(scene, o->axes.line, "axes apply only to an image (.nii, .nii.gz); leave them out");
    const bool laplace = o->rule.line && o->rule.index == LAPLACE;
    if (laplace && (!o->from.line || !o->to.line))
        return app_scene_bad(scene, o->rule.line, "rule laplace needs two groups of the mesh; give from: and to:");
    if (!laplace && (o->from.line || o->to.line))
        return app_scene_bad(scene, o->from.line ? o->from.line : o->to.line,
                             "from and to apply only to rule laplace; write rule: laplace, or leave them out");
    if (laplace && strcmp(o->from.s, o->to.s) == 0)
        return app_scene_bad(scene, o->to.line, "from and to are both '%s'; name another group", o->to.s);
    if (o->rule.line && o->rule.index != SPHERICAL && !laplace && !(vnorm(o->direction.v) > 0))
        return app_scene_bad(scene, o->direction.line, "anisotropy.direction is zero; give a direction");
    return 0;
}

/* Returns any unit vector orthogonal to `axis`, for rules without a direction of their own. */
static void across(const double axis[3], double out[3]) {
    int small = fabs(axis[0]) <= fabs(axis[1]) && fabs(axis[0]) <= fabs(axis[2]) ? 0
                : fabs(axis[1]) <= fabs(axis[2])                                 ? 1
                                                                                 : 2;
    double e[3] = {small == 0, small == 1, small == 2};
    vcross(axis, e, out);
}

static void direction_at(const options *o, const double x[3], double out[3]) {
    double axis[3], length = vnorm(o->direction.v), d[3], along = 0;
    for (int a = 0; a < 3; a++) axis[a] = length > 0 ? o->direction.v[a] / length : a == 2;
    for (int a = 0; a < 3; a++) d[a] = x[a] - o->point.v[a];
    for (int a = 0; a < 3; a++) along += d[a] * axis[a];
    if (o->rule.index == CONSTANT)
        memcpy(out, axis, sizeof axis);
    else if (o->rule.index == SPHERICAL)
        memcpy(out, d, sizeof d);
    else {
        double r[3] = {d[0] - along * axis[0], d[1] - along * axis[1], d[2] - along * axis[2]};
        memcpy(out, r, sizeof r);
        if (o->rule.index == CIRCULAR) {
            out[0] = axis[1] * r[2] - axis[2] * r[1];
            out[1] = axis[2] * r[0] - axis[0] * r[2];
            out[2] = axis[0] * r[1] - axis[1] * r[0];
        }
    }
    if (!(vnorm(out) > 1e-12)) across(axis, out);
    length = vnorm(out);
    for (int a = 0; a < 3; a++) out[a] /= length;
}

static tm_status from_file(sim *s, const options *o) {
    tm_error error = {0};
    struct stat info;
    if (access(o->file.s, R_OK) || stat(o->file.s, &info))
        return app_scene_bad(s->scene, o->file.line, "anisotropy.file: %s: cannot open: %s; check the path", o->file.s,
                             strerror(errno));
    if (S_ISDIR(info.st_mode))
        return app_scene_bad(s->scene, o->file.line, "anisotropy.file: %s is a folder; name the CSV file in it",
                             o->file.s);
    char why[SIM_FIBRES_WHY];
    if (is_image(o->file.s)) {
        if (sim_fibres_from_image(&s->scene->host, s->mesh, o->file.s, (sim_fibre_axes)o->axes.index, s->fibre, why))
            return 0;
        return app_scene_bad(s->scene, o->file.line, "anisotropy.file: %s", why);
    }
    if (!tm_fibres_load_on(o->file.s, s->mesh, s->fibre, &error)) return 0;
    return sim_report_file(s->scene, o->file.line, NULL, 0, &error);
}

/* Applies the rule between two groups; fibres begin at a vertex of both. */
static tm_status from_potential(sim *s, const options *o) {
    const size_t n = (size_t)s->mesh->vertex_count;
    uint8_t *mark = malloc(2 * n);
    tm_error error = {0};
    int32_t count;
    if (!mark) return app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    tm_status rc = sim_select(s, &(app_select){.group = o->from}, o->from.line, mark, &count);
    if (!rc) rc = sim_select(s, &(app_select){.group = o->to}, o->to.line, mark + n, &count);
    if (!rc && sim_laplace(s->mesh, mark, mark + n, s->fibre, &error)) rc = sim_report(s->scene, o->rule.line, &error);
    free(mark);
    return rc;
}

static void from_rule(sim *s, const options *o) {
    for (int32_t t = 0; t < s->mesh->tet_count; t++) {
        double x[3] = {0, 0, 0};
        for (int k = 0; k < 4; k++)
            for (int a = 0; a < 3; a++) x[a] += 0.25 * s->mesh->rest_m[3 * s->mesh->tet[4 * t + k] + a];
        direction_at(o, x, &s->fibre[3 * t]);
    }
}

static tm_status prepare(sim *s, const void *own) {
    const options *o = own;
    s->fibre = malloc(sizeof *s->fibre * 3 * (size_t)s->mesh->tet_count);
    if (!s->fibre) return app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    tm_status rc = 0;
    if (o->file.line)
        rc = from_file(s, o);
    else if (o->rule.index == LAPLACE)
        rc = from_potential(s, o);
    else
        from_rule(s, o);
    if (!rc && !sim_smooth_axes(s->mesh, (int)o->smooth.value, s->fibre))
        rc = app_scene_fail(s->scene, o->here.line, TM_ERR_MEMORY, "out of memory; use a smaller mesh");
    return rc;
}

const sim_effect sim_effect_anisotropy = {
    .name = "anisotropy",
    .doc = "One fibre direction a tetrahedron. It enters the stiffness tensors when the tissue is built, so a "
           "step costs the same with and without.",
    .schema = {fields, sizeof fields / sizeof fields[0], sizeof(options)},
    .part = SIM_PART_FIBRES,
    .check = check,
    .prepare = prepare,
};
