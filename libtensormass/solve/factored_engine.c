/* The factor of the tissue as it was at some time, columns of its compliance for the vertices that matter, and what was
 * cut since. Everything here runs in one thread at a time and touches nothing of the simulation's but what never
 * changes (mesh, materials, fibres). */
#include "factored.h"

#include <stdlib.h>
#include <string.h>

/* A little inertia, K + sigma M: a piece that hangs on nothing gets an enormous compliance (which no patch takes)
 * instead of stopping the factor, and one that is held loses sigma / omega_1^2 of it, 1e-8 at 16 Hz. */
#define SIGMA_1_S2 1e-4

/* A new factor is best made while nothing is cut: after so many calls without a cut, if so many vertices are touched.
 */
enum { CALM = 25, WORTH_IT = 32 };

typedef struct slot {
    int32_t vertex; /* -1: free */
    int64_t wanted_at;
} slot;

struct tms_engine {
    const tm_tissue *tissue; /* mesh, materials, fibres */
    int32_t vertex_count, tet_count;
    uint8_t *fixed;       /* [3*vertex_count] */
    uint8_t *base, *gone; /* [tet_count] alive in the factor; cut since, at the last wish */
    tms_system system;
    tms_solver *solver;
    tms_work *work;
    bool ready;  /* there is a factor */
    bool broken; /* there can be none: no memory, or a mechanism */
    slot slot[TMS_SLOTS];
    int32_t *slot_of; /* [vertex_count] -1: none */
    double *G;        /* [3*TMS_SLOTS][3*TMS_SLOTS] compliance of the factor's tissue among the slots */
    int64_t clock;
    int32_t calm;                                         /* calls since the last cut */
    int32_t touched_count, touched[TMS_TOUCHED_VERTICES]; /* vertices of `gone` */
    bool middle_known;
    double *D, *M; /* [3*touched][3*touched] */
};

enum { WIDTH = 3 * TMS_SLOTS, MIDDLE = 3 * TMS_TOUCHED_VERTICES };

tms_engine *tms_engine_create(const tm_tissue *tissue, const uint8_t *fixed) {
    tms_engine *e = tm_allocate(sizeof *e);
    if (!e) return NULL;
    memset(e, 0, sizeof *e);
    const tm_mesh *mesh = tm_tissue_mesh(tissue);
    const size_t tets = (size_t)mesh->tet_count, vertices = (size_t)mesh->vertex_count;
    e->tissue = tissue;
    e->vertex_count = mesh->vertex_count;
    e->tet_count = mesh->tet_count;
    e->fixed = tm_allocate(3 * vertices);
    e->base = tm_allocate(tets);
    e->gone = tm_allocate(tets);
    e->slot_of = tm_allocate(vertices * sizeof *e->slot_of);
    e->G = tm_allocate(sizeof(double) * WIDTH * WIDTH);
    e->D = tm_allocate(sizeof(double) * MIDDLE * MIDDLE);
    e->M = tm_allocate(sizeof(double) * MIDDLE * MIDDLE);
    if (!e->fixed || !e->base || !e->gone || !e->slot_of || !e->G || !e->D || !e->M) {
        tms_engine_destroy(e);
        return NULL;
    }
    memcpy(e->fixed, fixed, 3 * vertices);
    memset(e->G, 0, sizeof(double) * WIDTH * WIDTH);
    return e;
}

static void drop_factor(tms_engine *e) {
    tms_work_destroy(e->work);
    tms_solver_destroy(e->solver);
    tms_system_destroy(&e->system);
    e->work = NULL;
    e->solver = NULL;
    e->ready = false;
}

void tms_engine_destroy(tms_engine *e) {
    if (!e) return;
    const size_t tets = (size_t)e->tet_count, vertices = (size_t)e->vertex_count;
    drop_factor(e);
    tm_release(e->fixed, 3 * vertices);
    tm_release(e->base, tets);
    tm_release(e->gone, tets);
    tm_release(e->slot_of, vertices * sizeof *e->slot_of);
    tm_release(e->G, sizeof(double) * WIDTH * WIDTH);
    tm_release(e->D, sizeof(double) * MIDDLE * MIDDLE);
    tm_release(e->M, sizeof(double) * MIDDLE * MIDDLE);
    tm_release(e, sizeof *e);
}

int64_t tms_engine_bytes(const tms_engine *e) {
    return (int64_t)sizeof *e + 2 * (int64_t)e->tet_count + 7 * (int64_t)e->vertex_count +
           (int64_t)sizeof(double) * (WIDTH * WIDTH + 2 * MIDDLE * MIDDLE) +
           (e->solver ? tms_solver_bytes(e->solver) : 0);
}

/* --- the factor --- */

static bool factorise(tms_engine *e, const uint8_t *alive) {
    tm_tissue *tissue = NULL;
    tm_solve_report report = {0};
    tm_solve_def def = tm_solve_def_default();
    def.threads = 1;
    drop_factor(e);
    memcpy(e->base, alive, (size_t)e->tet_count);
    bool good = tms_sub_tissue(e->tissue, alive, &tissue, NULL) == TM_OK &&
                tms_system_assemble(tissue, e->fixed, &e->system, NULL) == TM_OK;
    const double *mass = good ? tm_tissue_mass_kg(tissue) : NULL;
    for (int32_t j = 0; good && j < e->system.n; j++) /* rows ascend: a column's first entry is its diagonal */
        e->system.value[e->system.begin[j]] += SIGMA_1_S2 * mass[e->system.dof[j] / 3];
    tm_tissue_destroy(tissue);
    good = good && tms_solver_create(&e->system, &def, 0, 0, &e->solver, &report, NULL) == TM_OK &&
           (e->work = tms_work_create(e->solver, TMS_BLOCK)) != NULL;
    for (int32_t v = 0; v < e->vertex_count; v++) e->slot_of[v] = -1;
    for (int32_t i = 0; i < TMS_SLOTS; i++) e->slot[i] = (slot){.vertex = -1};
    e->touched_count = 0;
    e->middle_known = true;
    e->ready = good;
    return good;
}

/* --- what was cut since --- */

/* Notes vertices of a tetrahedron. False: too many. */
static bool touch(const tm_mesh *mesh, int32_t tet, int32_t *list, int32_t *count) {
    for (int i = 0; i < 4; i++) {
        const int32_t v = mesh->tet[4 * (int64_t)tet + i];
        bool known = false;
        for (int32_t k = 0; k < *count && !known; k++) known = list[k] == v;
        if (known) continue;
        if (*count == TMS_TOUCHED_VERTICES) return false;
        list[(*count)++] = v;
    }
    return true;
}

/* Vertices whose blocks change when a tetrahedron goes: its own; smoothed, all around these. */
static bool touch_around(const tms_engine *e, int32_t tet, int32_t *list, int32_t *count) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    if (tm_tissue_volume_shear(e->tissue) < 0) return touch(mesh, tet, list, count);
    for (int i = 0; i < 4; i++) {
        const int32_t v = mesh->tet[4 * (int64_t)tet + i];
        for (int32_t j = mesh->vertex_tet_begin[v]; j < mesh->vertex_tet_begin[v + 1]; j++)
            if (e->base[mesh->vertex_tet[j]] && !touch(mesh, mesh->vertex_tet[j], list, count)) return false;
    }
    return true;
}

/* False: too much, something came back, or now is the time: a new factor is called for. */
static bool follow_cuts(tms_engine *e, const uint8_t *alive) {
    int32_t count = 0, list[TMS_TOUCHED_VERTICES];
    bool changed = false;
    for (int32_t t = 0; t < e->tet_count; t++) {
        if (alive[t] && !e->base[t]) return false;
        const uint8_t gone = e->base[t] && !alive[t];
        changed = changed || gone != e->gone[t];
        e->gone[t] = gone;
        if (gone && !touch_around(e, t, list, &count)) return false;
    }
    e->calm = changed ? 0 : e->calm + 1;
    if (!changed) return e->calm != CALM || e->touched_count < WORTH_IT;
    e->touched_count = count;
    memcpy(e->touched, list, sizeof *list * (size_t)count);
    e->middle_known = false;
    return true;
}

/* D += sign K among the touched vertices of the tissue of these tetrahedra. */
static bool add_stiffness(tms_engine *e, const uint8_t *alive, double sign) {
    tm_tissue *part = NULL;
    const int32_t width = 3 * e->touched_count;
    if (tms_sub_tissue(e->tissue, alive, &part, NULL) != TM_OK) return false;
    const tm_pair_view pairs = tm_tissue_pairs(part);
    for (int32_t a = 0; a < e->touched_count; a++) {
        const int32_t v = e->touched[a];
        double K[9];
        tm_tissue_vertex_tensor(part, v, K);
        for (int k = 0; k < 9; k++) e->D[(3 * a + k / 3) * width + 3 * a + k % 3] += sign * K[k];
        for (int32_t p = pairs.begin[v]; p < pairs.begin[v + 1]; p++) {
            int32_t b = 0;
            while (b < e->touched_count && e->touched[b] != pairs.ends[2 * (int64_t)p + 1]) b++;
            if (b == e->touched_count) continue; /* then the cut changed nothing between them */
            tm_tissue_pair_tensor(part, p, K);
            for (int k = 0; k < 9; k++) {
                e->D[(3 * a + k / 3) * width + 3 * b + k % 3] += sign * K[k];
                e->D[(3 * b + k % 3) * width + 3 * a + k / 3] += sign * K[k];
            }
        }
    }
    tm_tissue_destroy(part);
    return true;
}

/* Smoothed: what is averaged with a cut tetrahedron lies among those that share a vertex with one. `around`
 * [tet_count] := these, without the cut ones unless `before`. */
static void mark_around(const tms_engine *e, bool before, uint8_t *around) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    memset(around, 0, (size_t)e->tet_count);
    for (int32_t t = 0; t < e->tet_count; t++)
        for (int i = 0; e->gone[t] && i < 4; i++) {
            const int32_t v = mesh->tet[4 * (int64_t)t + i];
            for (int32_t j = mesh->vertex_tet_begin[v]; j < mesh->vertex_tet_begin[v + 1]; j++) {
                const int32_t near = mesh->vertex_tet[j];
                around[near] = e->base[near] && (before || !e->gone[near]);
            }
        }
}

/* A vertex that lost all its tetrahedra keeps its own block, which holds it where it is and touches nobody. */
static void keep_lonely(tms_engine *e) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    const int32_t width = 3 * e->touched_count;
    for (int32_t a = 0; a < e->touched_count; a++) {
        const int32_t v = e->touched[a];
        bool alone = true;
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int32_t t = mesh->vertex_tet[i];
            alone = alone && (!e->base[t] || e->gone[t]);
        }
        for (int k = 0; alone && k < 9; k++) e->D[(3 * a + k / 3) * width + 3 * a + k % 3] = 0;
    }
}

/* The stiffness that left with the cut tetrahedra. */
static bool cut_stiffness(tms_engine *e) {
    const int32_t width = 3 * e->touched_count;
    memset(e->D, 0, sizeof(double) * (size_t)width * (size_t)width);
    bool good;
    if (tm_tissue_volume_shear(e->tissue) < 0) {
        good = add_stiffness(e, e->gone, 1);
    } else {
        uint8_t *around = tm_allocate((size_t)e->tet_count);
        good = around != NULL;
        for (int before = 1; good && before >= 0; before--) {
            mark_around(e, before, around);
            good = add_stiffness(e, around, before ? 1 : -1);
        }
        tm_release(around, (size_t)e->tet_count);
    }
    if (good) keep_lonely(e);
    return good;
}

/* --- columns --- */

/* A slot for a vertex: a free one, or the one that nobody has wanted for the longest; -1: all are needed now. */
static int32_t claim(tms_engine *e, int32_t vertex) {
    int32_t best = -1;
    for (int32_t i = 0; i < TMS_SLOTS; i++)
        if (e->slot[i].wanted_at < e->clock && (best < 0 || e->slot[i].wanted_at < e->slot[best].wanted_at)) best = i;
    if (best < 0) return -1;
    if (e->slot[best].vertex >= 0) e->slot_of[e->slot[best].vertex] = -1;
    e->slot[best] = (slot){.vertex = vertex, .wanted_at = e->clock};
    return best;
}

/* Columns of at most TMS_BLOCK/3 vertices that have none; prescribed components have zeros. */
static bool solve_columns(tms_engine *e, const int32_t *vertex, int32_t count) {
    const int32_t n = e->system.n;
    int32_t at[TMS_BLOCK / 3];
    double *b = tms_work_rhs(e->work);
    memset(b, 0, sizeof(double) * (size_t)n * TMS_BLOCK);
    for (int32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t row = e->system.index[3 * vertex[i] + c];
            if (row >= 0) b[(int64_t)(3 * i + c) * n + row] = 1;
        }
    const double *x = tms_work_solve(e->work);
    if (!x) return false;
    for (int32_t i = 0; i < count; i++)
        if ((at[i] = claim(e, vertex[i])) < 0) return false;
    for (int32_t i = 0; i < count; i++) e->slot_of[vertex[i]] = at[i];
    for (int32_t i = 0; i < count; i++)
        for (int32_t k = 0; k < TMS_SLOTS; k++)
            for (int m = 0; m < 9 && e->slot[k].vertex >= 0; m++) {
                const int32_t row = e->system.index[3 * e->slot[k].vertex + m / 3];
                const double value = row < 0 ? 0 : x[(int64_t)(3 * i + m % 3) * n + row];
                e->G[(int64_t)(3 * k + m / 3) * WIDTH + 3 * at[i] + m % 3] = value;
                e->G[(int64_t)(3 * at[i] + m % 3) * WIDTH + 3 * k + m / 3] = value;
            }
    return true;
}

static void mark(tms_engine *e, const int32_t *vertex, int32_t count) {
    for (int32_t i = 0; i < count; i++)
        if (e->slot_of[vertex[i]] >= 0) e->slot[e->slot_of[vertex[i]]].wanted_at = e->clock;
}

/* The next vertices without a column, most urgent first: all touched ones, then the instruments' in turn. */
static int32_t lacking(const tms_engine *e, const tms_wish *wish, int32_t vertex[TMS_BLOCK / 3]) {
    int32_t count = 0;
    for (int32_t i = 0; i < e->touched_count && count < TMS_BLOCK / 3; i++)
        if (e->slot_of[e->touched[i]] < 0) vertex[count++] = e->touched[i];
    for (int32_t i = 0; i < TM_COMPLIANCE_WANTS && count < TMS_BLOCK / 3; i++)
        for (int t = 0; t < TM_MAX_INSTRUMENTS && count < TMS_BLOCK / 3; t++) {
            const int32_t v = i < wish->count[t] ? wish->vertex[t][i] : -1;
            bool listed = v < 0 || e->slot_of[v] >= 0;
            for (int32_t k = 0; k < count && !listed; k++) listed = vertex[k] == v;
            if (!listed) vertex[count++] = v;
        }
    return count;
}

/* --- a piece --- */

static bool write_piece(tms_engine *e, const tms_wish *wish, tms_piece *piece) {
    int32_t count = 0, wanted[3 * TMS_PIECE_VERTICES], touched[MIDDLE];
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++)
        for (int32_t i = 0; i < wish->count[t]; i++)
            if (e->slot_of[wish->vertex[t][i]] >= 0) piece->vertex[count++] = wish->vertex[t][i];
    qsort(piece->vertex, (size_t)count, sizeof *piece->vertex, tms_ascending);
    int32_t unique = 0;
    for (int32_t i = 0; i < count; i++)
        if (i == 0 || piece->vertex[i] != piece->vertex[i - 1]) piece->vertex[unique++] = piece->vertex[i];
    for (int32_t i = 0; i < 3 * unique; i++) wanted[i] = 3 * e->slot_of[piece->vertex[i / 3]] + i % 3;
    for (int32_t i = 0; i < 3 * e->touched_count; i++) touched[i] = 3 * e->slot_of[e->touched[i / 3]] + i % 3;
    if (unique == 0) return false;
    if (!e->middle_known && e->touched_count > 0) {
        if (!cut_stiffness(e) || !tms_update_middle(e->G, WIDTH, touched, 3 * e->touched_count, e->D, e->M))
            return false;
        e->middle_known = true;
    }
    piece->is =
        (tm_compliance){.revision = wish->revision, .count = unique, .vertex = piece->vertex, .C_m_N = piece->C_m_N};
    return tms_update_piece(e->G, WIDTH, wanted, 3 * unique, touched, 3 * e->touched_count, e->M, piece->C_m_N);
}

bool tms_engine_serve(tms_engine *e, const tms_wish *wish, tms_piece *piece, bool *more) {
    int32_t vertex[TMS_BLOCK / 3];
    *more = false;
    if (e->broken) return false;
    e->clock++;
    if (!e->ready || !follow_cuts(e, wish->alive)) {
        memset(e->gone, 0, (size_t)e->tet_count);
        e->broken = !factorise(e, wish->alive);
        *more = !e->broken;
        return false;
    }
    mark(e, e->touched, e->touched_count);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) mark(e, wish->vertex[t], wish->count[t]);
    const int32_t count = lacking(e, wish, vertex);
    if (count > 0 && !solve_columns(e, vertex, count)) return false;
    *more = lacking(e, wish, vertex) > 0;
    for (int32_t i = 0; i < e->touched_count; i++)
        if (e->slot_of[e->touched[i]] < 0) return false;
    return write_piece(e, wish, piece);
}
