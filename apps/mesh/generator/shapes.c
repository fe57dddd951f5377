/* Four shapes: a block, a cylinder with rotating fibres, a liver with two lobes, and its gallbladder. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "generator.h"

static void centre_of(const growing *m, const int *vertex, int count, double c[3]) {
    for (int k = 0; k < 3; k++) {
        c[k] = 0;
        for (int i = 0; i < count; i++) c[k] += m->vertex[3 * (size_t)vertex[i] + (size_t)k] / count;
    }
}

static _Noreturn void no_memory(void) {
    fprintf(stderr, "no memory; choose a smaller number of tetrahedra\n");
    exit(1);
}

static void need_surface(growing *m) {
    if (growing_find_surface(m)) return;
    if (m->no_memory) no_memory();
    fprintf(stderr, "the surface is not a closed manifold; choose another number of tetrahedra\n");
    exit(1);
}

static void set_fibre(growing *m, int t, const double d[3]) {
    double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int k = 0; k < 3; k++) m->fibre[3 * (size_t)t + (size_t)k] = d[k] / length;
}

static void allocate_fibres(growing *m) {
    m->fibre = malloc(3 * (size_t)m->tet_count * sizeof *m->fibre);
    if (!m->fibre) no_memory();
}

/* ---- block: 100 x 100 x 50 mm, each brick cut into six around its diagonal (Kuhn) ---- */

void make_block(growing *m, int tets) {
    static const int order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    const double size[3] = {0.1, 0.1, 0.05};
    int n[3] = {2, 2, 1};
    while (6 * n[0] * n[1] * n[2] < tets) {
        n[0]++;
        n[1] = n[0];
        n[2] = (n[0] + 1) / 2;
    }
    for (int k = 0; k <= n[2]; k++)
        for (int j = 0; j <= n[1]; j++)
            for (int i = 0; i <= n[0]; i++)
                growing_add_vertex(m, (double[3]){size[0] * i / n[0], size[1] * j / n[1], size[2] * k / n[2]});
    const int stride[3] = {1, n[0] + 1, (n[0] + 1) * (n[1] + 1)};
    for (int k = 0; k < n[2]; k++)
        for (int j = 0; j < n[1]; j++)
            for (int i = 0; i < n[0]; i++)
                for (int o = 0; o < 6; o++) {
                    int v[4] = {i * stride[0] + j * stride[1] + k * stride[2]};
                    for (int s = 0; s < 3; s++) v[s + 1] = v[s] + stride[order[o][s]];
                    growing_add_tet(m, v[0], v[1], v[2], v[3]);
                }
    need_surface(m);
    static const char *const names[6] = {"x_min", "x_max", "y_min", "y_max", "z_min", "z_max"};
    m->region_names = 1;
    m->region_name[0] = "tissue";
    m->face_names = 6;
    for (int g = 0; g < 6; g++) m->face_name[g] = names[g];
    for (int f = 0; f < m->face_count; f++) {
        double normal[3];
        growing_face_normal(m, m->face + 3 * f, normal);
        for (int k = 0; k < 3; k++)
            if (fabs(normal[k]) > 0.5) m->face_group[f] = 2 * k + (normal[k] > 0);
    }
}

/* ---- cylinder: 120 mm long, 30 mm radius, along x; rings of 6, 12, 18 ... points; fibre angle 30 degrees at the
 * surface ---- */

static const double cylinder_length_m = 0.12, cylinder_radius_m = 0.03;

static int ring_point(int ring, int i) { return ring == 0 ? 0 : 1 + 3 * ring * (ring - 1) + i % (6 * ring); }

/* Fills the 6 rings^2 triangles of a disk. */
static int disk_triangles(int rings, int *out) {
    int n = 0;
    for (int r = 1; r <= rings; r++)
        for (int sector = 0; sector < 6; sector++)
            for (int i = 0; i < r; i++) {
                int a = ring_point(r, sector * r + i), b = ring_point(r, sector * r + i + 1);
                int c = ring_point(r - 1, sector * (r - 1) + i), d = ring_point(r - 1, sector * (r - 1) + i + 1);
                memcpy(out + 3 * n++, (int[3]){a, b, c}, 3 * sizeof *out);
                if (i + 1 < r) memcpy(out + 3 * n++, (int[3]){c, b, d}, 3 * sizeof *out);
            }
    return n;
}

/* Extrudes a triangle to a prism. Diagonals start at lower-numbered corners, so that neighbours agree. */
static void extrude(growing *m, const int triangle[3], int bottom, int top) {
    int v[3] = {triangle[0], triangle[1], triangle[2]};
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < 2; i++)
            if (v[i] > v[i + 1]) {
                int spare = v[i];
                v[i] = v[i + 1];
                v[i + 1] = spare;
            }
    growing_add_tet(m, bottom + v[0], top + v[0], top + v[1], top + v[2]);
    growing_add_tet(m, bottom + v[0], bottom + v[1], top + v[1], top + v[2]);
    growing_add_tet(m, bottom + v[0], bottom + v[1], bottom + v[2], top + v[2]);
}

void make_cylinder(growing *m, int tets) {
    int rings = 1, layers = 1;
    for (; 18 * rings * rings * layers < tets; rings++) layers = 4 * (rings + 1);
    if (rings > 1 && 18 * (rings - 1) * (rings - 1) * layers >= tets) rings--;
    while (18 * rings * rings * (layers - 1) >= tets) layers--;
    int points = 1 + 3 * rings * (rings + 1);
    for (int l = 0; l <= layers; l++)
        for (int r = 0; r <= rings; r++)
            for (int i = 0; i < (r ? 6 * r : 1); i++) {
                double angle = r ? 2 * M_PI * i / (6 * r) : 0, radius = cylinder_radius_m * r / rings;
                growing_add_vertex(
                    m, (double[3]){cylinder_length_m * l / layers, radius * cos(angle), radius * sin(angle)});
            }
    int *triangle = malloc(18 * (size_t)(rings * rings) * sizeof *triangle);
    if (!triangle) no_memory();
    int triangles = disk_triangles(rings, triangle);
    for (int l = 0; l < layers; l++)
        for (int t = 0; t < triangles; t++) extrude(m, triangle + 3 * t, l * points, (l + 1) * points);
    free(triangle);
    need_surface(m);
    m->region_names = 1;
    m->region_name[0] = "muscle";
    m->face_names = 3;
    m->face_name[0] = "side";
    m->face_name[1] = "end_0";
    m->face_name[2] = "end_1";
    for (int f = 0; f < m->face_count; f++) {
        double normal[3];
        growing_face_normal(m, m->face + 3 * f, normal);
        m->face_group[f] = fabs(normal[0]) < 0.5 ? 0 : normal[0] < 0 ? 1 : 2;
    }
    allocate_fibres(m);
    for (int t = 0; t < m->tet_count; t++) {
        double c[3], slope = tan(M_PI / 6) / cylinder_radius_m;
        centre_of(m, m->tet + 4 * t, 4, c);
        set_fibre(m, t, (double[3]){1, -slope * c[2], slope * c[1]});
    }
}

/* ---- liver: x to the left lobe, y to the back, z up; 0.21 x 0.13 x 0.10 m ---- */

/* Returns the approximate distance to an ellipsoid, negative inside. */
static double ellipsoid(const double p[3], double cx, double cy, double cz, double rx, double ry, double rz) {
    double u[3] = {(p[0] - cx) / rx, (p[1] - cy) / ry, (p[2] - cz) / rz}, w[3] = {u[0] / rx, u[1] / ry, u[2] / rz};
    double k0 = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), k1 = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    return k0 * (k0 - 1) / (k1 + 1e-9);
}

/* Returns the smaller of two distances, with the edge between them rounded over `k`. */
static double join(double a, double b, double k) {
    double h = k - fabs(a - b);
    return (a < b ? a : b) - (h > 0 ? h * h / (4 * k) : 0);
}

static double carve(double body, double tool, double k) { return -join(-body, tool, k); }

static const double hilum[3] = {0.012, 0.01, -0.060};        /* entry of the vessels: fibres diverge from it */
static const double cava_y_m = 0.062, cava_radius_m = 0.016; /* groove of the vena cava, along z, at x = 0.005 */
static const double cava_x_m = 0.005;

static double gall_bladder(const double p[3]) { return ellipsoid(p, -0.024, -0.046, -0.037, 0.018, 0.036, 0.019); }

static double liver(const void *shape, const double p[3]) {
    (void)shape;
    double right = ellipsoid(p, -0.038, 0.004, -0.012, 0.067, 0.064, 0.064);
    double left = ellipsoid(p, 0.048, -0.012, 0.016, 0.066, 0.046, 0.030);
    double body = join(right, left, 0.050);
    double underside =
        (-p[2] - 0.040 + 0.42 * p[0] + 0.10 * p[1]) / 1.09; /* distance above the visceral plane is negative */
    body = carve(body, -underside, 0.030);
    body = carve(body, ellipsoid(p, 0.062, 0.015, -0.048, 0.055, 0.060, 0.042), 0.020);  /* stomach's impression */
    body = carve(body, ellipsoid(p, 0.012, -0.068, -0.006, 0.013, 0.028, 0.040), 0.022); /* notch between the lobes */
    double dx = p[0] - cava_x_m, dy = p[1] - cava_y_m;
    body = carve(body, sqrt(dx * dx + dy * dy) - cava_radius_m, 0.012);
    body = carve(body, gall_bladder(p), 0.014);
    return -body;
}

/* Moves p to the surface of a distance by Newton steps along the gradient. */
static void onto(double (*distance)(const void *shape, const double p[3]), const void *shape, double p[3]) {
    for (int turn = 0; turn < 4; turn++) {
        double g[3], value = distance(shape, p), step = 1e-6;
        for (int k = 0; k < 3; k++) {
            double a[3] = {p[0], p[1], p[2]}, b[3] = {p[0], p[1], p[2]};
            a[k] -= step;
            b[k] += step;
            g[k] = (distance(shape, b) - distance(shape, a)) / (2 * step);
        }
        double square = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
        for (int k = 0; k < 3; k++) p[k] -= value * g[k] / (square + 1e-12);
    }
}

static void onto_liver(const void *shape, double p[3]) { onto(liver, shape, p); }

static void name_liver(growing *m) {
    m->region_names = 2;
    m->region_name[0] = "parenchyma";
    m->region_name[1] = "gallbladder_bed";
    for (int t = 0; t < m->tet_count; t++) {
        double c[3];
        centre_of(m, m->tet + 4 * t, 4, c);
        m->region[t] = gall_bladder(c) < 0.012;
    }
    static const char *const names[4] = {"free_surface", "vena_cava", "ligament", "gallbladder_fossa"};
    m->face_names = 4;
    for (int g = 0; g < 4; g++) m->face_name[g] = names[g];
    for (int f = 0; f < m->face_count; f++) {
        double c[3], n[3], dx, dy;
        centre_of(m, m->face + 3 * f, 3, c);
        growing_face_normal(m, m->face + 3 * f, n);
        dx = c[0] - cava_x_m;
        dy = c[1] - cava_y_m;
        if (sqrt(dx * dx + dy * dy) < cava_radius_m + 0.008)
            m->face_group[f] = 1;
        else if (c[1] > 0.015 && c[0] > -0.075 && c[0] < 0.06 && n[2] > 0.35)
            m->face_group[f] = 2; /* coronary ligament: the dome's back, under the diaphragm */
        else if (gall_bladder(c) < 0.006)
            m->face_group[f] = 3;
    }
}

void make_liver(growing *m, int tets) {
    const growing_solid organ = {liver, onto_liver, NULL, {-0.115, -0.075, -0.065}, {0.115, 0.085, 0.065}};
    double cell = cbrt(12 * 0.00105 / tets) * 1.15;
    for (;; cell *= 0.99) {
        growing_free(m);
        growing_fill(m, &organ, cell);
        if (m->no_memory) no_memory();
        if (m->tet_count >= tets && growing_find_surface(m)) break;
    }
    growing_improve(m, &organ, NULL, 60);
    need_surface(m);
    name_liver(m);
    allocate_fibres(m);
    for (int t = 0; t < m->tet_count; t++) {
        double c[3];
        centre_of(m, m->tet + 4 * t, 4, c);
        set_fibre(m, t, (double[3]){c[0] - hilum[0], c[1] - hilum[1], c[2] - hilum[2]});
    }
}

/* ---- gallbladder: in the dent of the liver, with a gap of 2 mm to it; its fundus sticks out in front ---- */

static double gallbladder(const void *shape, const double p[3]) {
    (void)shape;
    return -ellipsoid(p, -0.024, -0.046, -0.039, 0.0155, 0.034, 0.0165);
}

static void onto_gallbladder(const void *shape, double p[3]) { onto(gallbladder, shape, p); }

void make_gallbladder(growing *m, int tets) {
    const growing_solid organ = {
        gallbladder, onto_gallbladder, NULL, {-0.045, -0.085, -0.06}, {-0.005, -0.005, -0.015}};
    double cell = cbrt(12 * 0.000036 / tets) * 1.15;
    for (;; cell *= 0.99) {
        growing_free(m);
        growing_fill(m, &organ, cell);
        if (m->no_memory) no_memory();
        if (m->tet_count >= tets && growing_find_surface(m)) break;
    }
    growing_improve(m, &organ, NULL, 60);
    need_surface(m);
    static const char *const names[4] = {"serosa", "bed", "fundus", "neck"};
    m->region_names = 1;
    m->region_name[0] = "wall";
    m->face_names = 4;
    for (int g = 0; g < 4; g++) m->face_name[g] = names[g];
    for (int f = 0; f < m->face_count; f++) {
        double c[3];
        centre_of(m, m->face + 3 * f, 3, c);
        m->face_group[f] = c[1] < -0.068 ? 2 : c[1] > -0.020 ? 3 : gall_bladder(c) < 0 && c[2] > -0.039 ? 1 : 0;
    }
    allocate_fibres(m);
    for (int t = 0; t < m->tet_count; t++) set_fibre(m, t, (double[3]){0, 1, 0});
}
