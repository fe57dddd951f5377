/* Free components of a tissue and their stiffness matrix. Unconstrained components are found before any factor is
 * tried. */
#include "internal.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "libtensormass/numeric/union_find.h"

/* --- connected components and their rigid-body modes --- */

/* Returns the rank of the rigid motions that the fixed components of one connected component prevent: 6 if it is
 * constrained. Eliminates the Gram matrix of the six motions about its centre, in units of its size, with full
 * pivoting. */
static int rank_of_gram(double g[36]) {
    int rank = 0;
    bool used[6] = {false};
    for (int pass = 0; pass < 6; pass++) {
        int best = -1;
        for (int i = 0; i < 6; i++)
            if (!used[i] && g[7 * i] > 1e-10 && (best < 0 || g[7 * i] > g[7 * best])) best = i;
        if (best < 0) break;
        used[best] = true;
        rank++;
        for (int i = 0; i < 6; i++)
            for (int j = 0; j < 6; j++)
                if (!used[i] && !used[j]) g[6 * i + j] -= g[6 * i + best] * g[6 * best + j] / g[7 * best];
    }
    return rank;
}

typedef struct part {
    double low[3], high[3], gram[36];
    int32_t tets, fixed;
} part;

static void add_fixed(part *p, const double *x, int axis) {
    double scale = 0, motion[6] = {0};
    for (int a = 0; a < 3; a++) scale = fmax(scale, p->high[a] - p->low[a]);
    motion[axis] = 1;
    for (int r = 0; r < 3; r++) { /* rotation about axis r moves component `axis` by (e_r x d)_axis */
        const double d1 = (x[(r + 1) % 3] - 0.5 * (p->low[(r + 1) % 3] + p->high[(r + 1) % 3])) / scale;
        const double d2 = (x[(r + 2) % 3] - 0.5 * (p->low[(r + 2) % 3] + p->high[(r + 2) % 3])) / scale;
        if (axis == (r + 1) % 3) motion[3 + r] = -d2;
        if (axis == (r + 2) % 3) motion[3 + r] = d1;
    }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) p->gram[6 * i + j] += motion[i] * motion[j];
    p->fixed++;
}

static void find_parts(const tm_tissue *tissue, int32_t *parent, part *parts) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const uint8_t *alive = tm_tissue_alive(tissue);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        parent[v] = v;
        for (int a = 0; a < 3; a++) parts[v].low[a] = INFINITY, parts[v].high[a] = -INFINITY;
    }
    for (int32_t t = 0; t < mesh->tet_count; t++)
        for (int i = 1; alive[t] && i < 4; i++) law_join(parent, mesh->tet[4 * t], mesh->tet[4 * t + i]);
    for (int32_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; alive[t] && i < 4; i++) {
            part *p = &parts[law_root(parent, mesh->tet[4 * t + i])];
            const double *x = mesh->rest_m + 3 * (int64_t)mesh->tet[4 * t + i];
            for (int a = 0; a < 3; a++) p->low[a] = fmin(p->low[a], x[a]), p->high[a] = fmax(p->high[a], x[a]);
            if (i == 0) p->tets++;
        }
}

/* Adds the fixed components to their parts. Returns their number, those of vertices without tetrahedra included. */
static int32_t add_all_fixed(const tm_tissue *tissue, const uint8_t *fixed, int32_t *parent, part *parts) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    int32_t total = 0;
    for (int32_t d = 0; d < 3 * mesh->vertex_count; d++)
        if (fixed[d]) {
            part *p = &parts[law_root(parent, d / 3)];
            total++;
            if (p->tets) add_fixed(p, mesh->rest_m + d / 3 * 3, d % 3);
        }
    return total;
}

bool tms_find_loose(const tm_tissue *tissue, const uint8_t *fixed, double *part_kg) {
    const int32_t n = tm_tissue_mesh(tissue)->vertex_count;
    const double *mass = tm_tissue_mass_kg(tissue);
    int32_t *parent = tms_alloc((size_t)n * sizeof *parent);
    part *parts = tms_alloc_zeroed((size_t)n, sizeof *parts);
    const bool good = parent && parts;
    if (good) {
        find_parts(tissue, parent, parts);
        add_all_fixed(tissue, fixed, parent, parts);
        memset(part_kg, 0, (size_t)n * sizeof *part_kg);
        for (int32_t v = 0; v < n; v++) part_kg[law_root(parent, v)] += mass[v];
        for (int32_t v = 0; v < n; v++)
            if (parts[v].tets && rank_of_gram(parts[v].gram) == 6) parts[v].tets = 0;
        for (int32_t v = n - 1; v >= 0; v--) { /* the root of a piece is its first vertex */
            const int32_t root = law_root(parent, v);
            part_kg[v] = parts[root].tets ? part_kg[root] : 0;
        }
    }
    tms_free(parts);
    tms_free(parent);
    return good;
}

tm_status tms_check_constrained(const tm_tissue *tissue, const uint8_t *fixed, tm_error *error) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const int32_t n = mesh->vertex_count;
    int32_t *parent = tms_alloc((size_t)n * sizeof *parent);
    part *parts = tms_alloc_zeroed((size_t)n, sizeof *parts);
    tm_status status = TM_OK;
    if (!parent || !parts) {
        status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory to find detached parts; use a coarser mesh");
        goto done;
    }
    find_parts(tissue, parent, parts);
    const int32_t total = add_all_fixed(tissue, fixed, parent, parts);
    for (int32_t v = 0; v < n; v++) {
        part *p = &parts[v];
        if (!p->tets) continue;
        const int32_t held = p->fixed;
        if (rank_of_gram(p->gram) == 6) continue;
        const int32_t given = tm_mesh_original_vertex(mesh, v);
        if (!total)
            status = tm_fail(error, TM_ERR_SUPPORT, given,
                             "no vertex of the tissue is fixed, so it has no equilibrium; add a support");
        else if (!held)
            status = tm_fail(
                error, TM_ERR_SUPPORT, given,
                "the connected piece of %d tetrahedra with vertex %d has no fixed vertex; support it, or connect it "
                "to the rest of the mesh",
                (int)p->tets, (int)given);
        else
            status = tm_fail(
                error, TM_ERR_SUPPORT, given,
                "the connected piece of %d tetrahedra with vertex %d can move as a rigid body (%d of its components "
                "are fixed); fix all axes of three vertices that are not in one line",
                (int)p->tets, (int)given, (int)held);
        break;
    }
done:
    tms_free(parts);
    tms_free(parent);
    return status;
}

/* --- numbering and assembly --- */

static void number_free(const tm_tissue *tissue, const uint8_t *fixed, tms_system *s) {
    const double *mass = tm_tissue_mass_kg(tissue);
    for (int32_t d = 0; d < 3 * s->vertex_count; d++) {
        s->index[d] = -1;
        if (fixed[d] || !(mass[d / 3] > 0)) continue;
        s->index[d] = s->n;
        s->dof[s->n++] = d;
    }
}

/* Runs the same loop twice: to count, and to fill. */
static int64_t walk_column(const tm_tissue *tissue, const tms_system *s, int32_t column, int32_t *row, double *value) {
    const tm_pair_view pairs = tm_tissue_pairs(tissue);
    const int32_t dof = s->dof[column], vertex = dof / 3, axis = dof % 3;
    double K[9];
    int64_t count = 0;
    if (row) tm_tissue_vertex_tensor(tissue, vertex, K);
    for (int a = axis; a < 3; a++)
        if (s->index[3 * vertex + a] >= 0) {
            if (row) row[count] = s->index[3 * vertex + a], value[count] = K[3 * a + axis];
            count++;
        }
    for (int32_t p = pairs.begin[vertex]; p < pairs.begin[vertex + 1]; p++) { /* lower triangle: in the others'
                                                                               * columns */
        const int32_t other = pairs.ends[2 * (int64_t)p + 1];
        bool read = false;
        for (int a = 0; a < 3; a++) {
            const int32_t at = s->index[3 * other + a];
            if (at < 0) continue;
            if (row && !read) tm_tissue_pair_tensor(tissue, p, K), read = true;
            if (row) row[count] = at, value[count] = K[3 * axis + a];
            count++;
        }
    }
    return count;
}

tm_status tms_system_create(const tm_tissue *tissue, const uint8_t *fixed, tms_system *system, tm_error *error) {
    const tm_status status = tms_check_constrained(tissue, fixed, error);
    return status != TM_OK ? status : tms_system_assemble(tissue, fixed, system, error);
}

tm_status tms_system_assemble(const tm_tissue *tissue, const uint8_t *fixed, tms_system *system, tm_error *error) {
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const int32_t n = mesh->vertex_count;
    tms_system s = {.mesh = mesh, .vertex_count = n};
    s.index = tms_alloc(3 * (size_t)n * sizeof *s.index);
    s.dof = tms_alloc(3 * (size_t)n * sizeof *s.dof);
    s.begin = tms_alloc((3 * (size_t)n + 1) * sizeof *s.begin);
    if (!s.index || !s.dof || !s.begin) goto no_memory;
    number_free(tissue, fixed, &s);
    int64_t count = 0;
    for (int32_t j = 0; j < s.n; j++) {
        s.begin[j] = (int32_t)count;
        count += walk_column(tissue, &s, j, NULL, NULL);
        if (count > INT32_MAX) goto no_memory;
    }
    s.begin[s.n] = (int32_t)count;
    s.row = tms_alloc((size_t)(count ? count : 1) * sizeof *s.row);
    s.value = tms_alloc((size_t)(count ? count : 1) * sizeof *s.value);
    if (!s.row || !s.value) goto no_memory;
    for (int32_t j = 0; j < s.n; j++) walk_column(tissue, &s, j, s.row + s.begin[j], s.value + s.begin[j]);
    *system = s;
    return TM_OK;
no_memory:
    tms_system_destroy(&s);
    return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the stiffness matrix of %d vertices; use a coarser mesh",
                   (int)n);
}

void tms_system_destroy(tms_system *s) {
    tms_free(s->index);
    tms_free(s->dof);
    tms_free(s->begin);
    tms_free(s->row);
    tms_free(s->value);
    memset(s, 0, sizeof *s);
}

int64_t tms_system_bytes(const tms_system *s) {
    return 4 * (6 * (int64_t)s->vertex_count + s->n + 1) + 12 * (int64_t)(s->begin ? s->begin[s->n] : 0);
}

const char *tms_nonlinear_law(const tm_tissue *tissue) {
    const int32_t tets = tm_tissue_mesh(tissue)->tet_count;
    for (int32_t t = 0; t < tets; t++) {
        const tm_law_kind law = (tm_law_kind)tm_tissue_tet_material(tissue, t)->law;
        if (law != TM_LAW_LINEAR) return tm_law_name(law);
    }
    return NULL;
}

tm_status tms_sub_tissue(const tm_tissue *whole, const uint8_t *alive, tm_tissue **tissue, tm_error *error) {
    const tm_mesh *mesh = tm_tissue_mesh(whole);
    tm_material *material = tms_alloc_zeroed((size_t)mesh->region_count, sizeof *material);
    double *fibre = NULL;
    tm_status status = TM_ERR_MEMORY;
    bool any = false;
    if (!material) goto done;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        material[mesh->region[t]] = *tm_tissue_tet_material(whole, t);
        tm_material *m = material + mesh->region[t];
        m->law_constant[TM_LAW_CONSTANTS - 1] = (double)m->law; /* averages still keep laws apart */
        m->law = TM_LAW_LINEAR;
        any |= tm_tissue_tet_fibre(whole, t) != NULL;
    }
    if (any && !(fibre = tms_alloc_zeroed(3 * (size_t)mesh->tet_count, sizeof *fibre))) goto done;
    for (int32_t t = 0; any && t < mesh->tet_count; t++) {
        const double *a = tm_tissue_tet_fibre(whole, t);
        for (int i = 0; i < 3; i++) fibre[3 * t + i] = a ? a[i] : i == 0;
    }
    tm_tissue_def def = tm_tissue_def_default();
    def.mesh = mesh;
    def.material_count = mesh->region_count;
    def.material = material;
    def.fibre = fibre;
    def.alive = alive;
    def.strain_smoothing = tm_tissue_smoothed_shear_share(whole) >= 0;
    def.region_effects = tm_tissue_region_effects(whole);
    if (def.strain_smoothing) def.smoothed_shear_share = tm_tissue_smoothed_shear_share(whole);
    status = tm_tissue_create(&def, tissue, error);
    tms_free(fibre);
    tms_free(material);
    return status;
done:
    tms_free(material);
    return tm_fail(error, status, -1, "no memory for a part of the tissue; use a coarser mesh");
}
