/* Converts an image's mesh to a file's mesh, and reports on it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "json_file.h"
#include "step.h"

static const double volume_told = 0.02; /* share of a label's volume; a larger difference is a warning */

/* --- the file's mesh --- */

/* Transforms grid to world; LPS to RAS negates the first two axes. */
static void to_world(const image_options *o, const image_volume *v, const double p[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = v->origin_m[i];
        for (int k = 0; k < 3; k++) out[i] += v->direction[3 * i + k] * p[k];
        if (o->ras && i < 2) out[i] = -out[i];
    }
}

static bool is_mirrored(const image_volume *v) {
    const double *d = v->direction;
    return d[0] * (d[4] * d[8] - d[5] * d[7]) - d[1] * (d[3] * d[8] - d[5] * d[6]) +
               d[2] * (d[3] * d[7] - d[4] * d[6]) <
           0;
}

/* Marks the vertices on a label's outer faces that are also in `outer` (null: all). Label 0: all outer faces of the
 * mesh, each of which belongs to one label. */
static bool mark_surface(const image_tets *m, int label, const uint8_t *outer, uint8_t *mark) {
    int *face = NULL;
    const int faces = image_faces(m, label, &face);
    for (int f = 0; f < faces; f++) {
        const int *v = face + 3 * (size_t)f;
        for (int k = 0; k < 3; k++) mark[v[k]] = !outer || outer[v[k]];
    }
    free(face);
    return faces >= 0;
}

static int32_t add_group(tm_mesh_file *out, const char *name, const uint8_t *mark) {
    int32_t at = out->group_begin[out->group_count];
    for (int32_t v = 0; v < out->vertex_count; v++)
        if (mark[v]) out->group_vertex[at++] = v;
    snprintf(out->group_name[out->group_count++], sizeof *out->group_name, "%s", name);
    return out->group_begin[out->group_count] = at;
}

static bool add_groups(const image_options *o, const label_field *field, const image_tets *m, const int *number,
                       tm_mesh_file *out) {
    uint8_t *outer = calloc((size_t)m->vertices + 1, 1), *mark = calloc((size_t)m->vertices + 1, 1);
    bool good = outer && mark && mark_surface(m, 0, NULL, outer);
    out->group_count = 0;
    if (good) add_group(out, "surface", outer);
    for (int l = 1; l <= field->labels && good; l++) {
        if (number[l] < 0) continue;
        char name[64];
        memset(mark, 0, (size_t)m->vertices);
        good = mark_surface(m, l, outer, mark);
        snprintf(name, sizeof name, "%.55s_outer", o->region[l].name);
        if (good) add_group(out, name, mark);
    }
    free(outer);
    free(mark);
    return good;
}

bool image_to_file(const image_options *o, const image_volume *volume, const label_field *field, const image_mesh *mesh,
                   tm_mesh_file *out) {
    const image_tets *m = &mesh->tets;
    const bool mirrored = is_mirrored(volume);
    int number[LABEL_MAX + 1], regions = 0; /* a label that vanished is no region */
    for (int l = 1; l <= field->labels; l++) number[l] = mesh->of[l].tets > 0 ? regions++ : -1;
    *out = (tm_mesh_file){
        .vertex_count = m->vertices, .tet_count = m->tets, .region_count = regions, .group_count = regions + 1};
    if (!tm_mesh_file_allocate(out, m->vertices * (regions + 1))) return false;
    for (int v = 0; v < m->vertices; v++) {
        to_world(o, volume, m->vertex_m + 3 * (size_t)v, out->vertex_m + 3 * (size_t)v);
        out->vertex_tag[v] = v + 1;
    }
    for (int t = 0; t < m->tets; t++) {
        int32_t *to = out->tet + 4 * (size_t)t;
        memcpy(to, m->tet + 4 * (size_t)t, 4 * sizeof *to);
        if (mirrored) to[0] = m->tet[4 * (size_t)t + 1], to[1] = m->tet[4 * (size_t)t];
        out->region[t] = number[m->label[t]];
        out->tet_tag[t] = t + 1;
    }
    for (int l = 1; l <= field->labels; l++)
        if (number[l] >= 0) snprintf(out->region_name[number[l]], sizeof *out->region_name, "%s", o->region[l].name);
    return add_groups(o, field, m, number, out);
}

/* --- messages --- */

typedef struct findings {
    step_figures step;
    double dihedral_deg, middle_mm[3]; /* of the worst tetrahedron; of the one that sets the cut step */
    int32_t dihedral_tet;
} findings;

static void find(const tm_mesh *built, const tm_mesh_file *file, findings *out) {
    out->dihedral_deg = 180;
    for (int32_t t = 0; t < built->tet_count; t++) {
        const double angle = tm_mesh_tet_quality(built, t).min_dihedral_rad * 180 / M_PI;
        if (angle >= out->dihedral_deg) continue;
        out->dihedral_deg = angle;
        out->dihedral_tet = t;
    }
    for (int k = 0; k < 12; k++)
        out->middle_mm[k % 3] += 250 * file->vertex_m[3 * file->tet[4 * (size_t)out->step.cut_tet + k / 3] + k % 3];
}

static void print_labels(const image_options *o, const label_field *field, const image_mesh *m) {
    printf("%-20s %6s %8s %8s %12s %12s %8s %14s %8s\n", "region", "label", "edge mm", "tets", "image cm3", "mesh cm3",
           "differ", "Hausdorff mm", "mean mm");
    for (int l = 1; l <= field->labels; l++) {
        const image_result *r = &m->of[l];
        const double differ = 100 * (r->volume_m3 / r->image_m3 - 1);
        printf("%-20s %6d %8.3g %8d %12.5g %12.5g %7.2f%% %14.3g %8.2g\n", o->region[l].name, o->region[l].value,
               1e3 * m->edge_m[l], r->tets, 1e6 * r->image_m3, 1e6 * r->volume_m3, fabs(differ) < 0.005 ? 0 : differ,
               1e3 * r->hausdorff_m, 1e3 * r->mean_m);
    }
}

/* Warns of lost detail. Surfaces move only as far as tetrahedra allow; a lost part is compensated elsewhere, so that
 * the surface there is far from the image's. */
static void warn_of_losses(const image_options *o, const label_field *field, const image_mesh *m) {
    const double *s = field->spacing_m;
    for (int l = 1; l <= field->labels; l++) {
        const image_result *r = &m->of[l];
        const double differ = r->volume_m3 / r->image_m3 - 1;
        if (fabs(differ) > volume_told && r->pieces)
            app_remark("%s: warning: label %d ('%s') has %.0f %% %s volume than in the image%s\n", o->in,
                       o->region[l].value, o->region[l].name, 100 * fabs(differ), differ < 0 ? "less" : "more",
                       o->volumes ? ", because its tetrahedra are too coarse"
                                  : ", because --optimise leaves out volumes");
        if (r->hausdorff_m > fmax(m->edge_m[l], 2 * cbrt(s[0] * s[1] * s[2])))
            app_remark("%s: warning: the surface of label %d ('%s') is up to %.2g mm from the image's (mean %.2g mm), "
                       "because a part was lost or filled\n",
                       o->in, o->region[l].value, o->region[l].name, 1e3 * r->hausdorff_m, 1e3 * r->mean_m);
    }
}

static void print(const image_options *o, const image_volume *v, const label_field *field, const image_mesh *m,
                  const tm_mesh_file *file, const findings *f) {
    const int32_t *c = file->tet + 4 * (size_t)f->step.cut_tet;
    printf("%s: %d x %d x %d voxels of %.4g x %.4g x %.4g mm\n", o->in, v->size[0], v->size[1], v->size[2],
           1e3 * v->spacing_m[0], 1e3 * v->spacing_m[1], 1e3 * v->spacing_m[2]);
    printf("%s: %d tetrahedra, %d vertices, in %s, %d passes\n", o->out, file->tet_count, file->vertex_count,
           o->ras ? "RAS" : "LPS", m->passes);
    print_labels(o, field, m);
    printf("worst dihedral angle: %.3g degrees, tetrahedron %d in '%s'\n", f->dihedral_deg, f->dihedral_tet + 1,
           file->region_name[file->region[f->dihedral_tet]]);
    printf("critical step: %.4g ms uncut, %.4g ms with cutting (E %g Pa, nu %g, %g kg/m3), set by tetrahedron "
           "%d (vertices %d %d %d %d) in '%s' at %.4g %.4g %.4g mm; median %.4g ms, ratio %.2f; with cutting "
           "%.0f substeps in a frame of 1/30 s\n",
           1e3 * f->step.guaranteed_s, 1e3 * f->step.cut_s, o->young_Pa, o->poisson, o->density_kg_m3,
           f->step.cut_tet + 1, c[0] + 1, c[1] + 1, c[2] + 1, c[3] + 1,
           file->region_name[file->region[f->step.cut_tet]], f->middle_mm[0], f->middle_mm[1], f->middle_mm[2],
           1e3 * f->step.median_s, f->step.cut_s / f->step.median_s, ceil(1 / (30 * f->step.cut_s)));
    if (m->load > 0) printf("real time: %.2f of one core of this machine, %.2f requested\n", m->load, o->budget_load);
}

static cJSON *to_json(const image_options *o, const image_volume *v, const label_field *field, const image_mesh *m,
                      const tm_mesh_file *file, const findings *f) {
    cJSON *root = cJSON_CreateObject(), *regions = cJSON_AddArrayToObject(root, "regions");
    cJSON_AddStringToObject(root, "image", o->in);
    cJSON_AddStringToObject(root, "space", o->ras ? "RAS" : "LPS");
    cJSON_AddItemToObject(root, "voxels", cJSON_CreateIntArray(v->size, 3));
    cJSON_AddItemToObject(root, "spacing_m", cJSON_CreateDoubleArray(v->spacing_m, 3));
    cJSON_AddNumberToObject(root, "tets", file->tet_count);
    cJSON_AddNumberToObject(root, "vertices", file->vertex_count);
    cJSON_AddNumberToObject(root, "passes", m->passes);
    cJSON_AddNumberToObject(root, "specks", (double)field->specks);
    for (int l = 1; l <= field->labels; l++) {
        const image_result *r = &m->of[l];
        cJSON *one = cJSON_CreateObject();
        cJSON_AddStringToObject(one, "name", o->region[l].name);
        cJSON_AddNumberToObject(one, "label", o->region[l].value);
        cJSON_AddNumberToObject(one, "edge_m", m->edge_m[l]);
        cJSON_AddNumberToObject(one, "tets", r->tets);
        cJSON_AddNumberToObject(one, "pieces", r->pieces);
        cJSON_AddNumberToObject(one, "image_volume_m3", r->image_m3);
        cJSON_AddNumberToObject(one, "volume_m3", r->volume_m3);
        cJSON_AddNumberToObject(one, "hausdorff_m", r->hausdorff_m);
        cJSON_AddNumberToObject(one, "mean_distance_m", r->mean_m);
        cJSON_AddItemToArray(regions, one);
    }
    cJSON_AddNumberToObject(root, "smallest_dihedral_deg", f->dihedral_deg);
    cJSON *step = cJSON_AddObjectToObject(root, "critical_step");
    cJSON_AddNumberToObject(step, "guaranteed_s", f->step.guaranteed_s);
    cJSON_AddNumberToObject(step, "cut_s", f->step.cut_s);
    cJSON_AddNumberToObject(step, "cut_tet", f->step.cut_tet + 1);
    cJSON_AddNumberToObject(step, "median_s", f->step.median_s);
    if (m->load > 0) cJSON_AddNumberToObject(root, "load", m->load);
    return root;
}

int image_report(const image_options *o, const image_volume *volume, const label_field *field, const image_mesh *mesh,
                 const tm_mesh_file *file) {
    tm_mesh *built = NULL;
    tm_error error = {0};
    findings f = {0};
    tm_status status = tm_mesh_file_build(file, &built, &error);
    if (!status) status = step_measure(built, o->young_Pa, o->poisson, o->density_kg_m3, &f.step, &error);
    if (!status) {
        find(built, file, &f);
        status = app_mesh_write(file, o->out, &error);
    }
    if (!status && o->json) {
        cJSON *root = to_json(o, volume, field, mesh, file, &f);
        status = app_json_write(o->json, root, &error);
        cJSON_Delete(root);
    }
    tm_mesh_destroy(built);
    if (status) return app_report(NULL, 0, &error);
    warn_of_losses(o, field, mesh);
    if (!app_is_quiet()) print(o, volume, field, mesh, file, &f);
    return APP_DONE;
}
