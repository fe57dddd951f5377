/* Manifold repair: tetrahedra that a cut leaves hanging by an edge or a vertex are removed too, so that the surface
 * stays a manifold.
 *
 * Around an edge the active tetrahedra must form one fan. Around a vertex they must be joined by faces, and their
 * outline (on a small sphere about the vertex) must be one closed line or none. A closed fan with two outlines is two
 * surfaces that touch in a point; it is cut open along its shortest path. Every repair removes tetrahedra, so it ends.
 * Ties go to the fan with the lowest tetrahedron.
 *
 * Condensed tetrahedra of a hybrid model are counted and stay: a fan of them is kept before any other, and a closed fan
 * is cut open next to it. Where two such fans meet in a vertex or an edge, with no removable tetrahedra left, the
 * surface stays pinched. */
#include "tissue/cut_work.h"

/* Labels star[0..n) by fan, over neighbours that `joined` allows; returns the number of fans. Work space: stack. */
typedef bool (*joined)(const tm_mesh *mesh, int32_t tet, int face, int32_t hinge);

/* A face has the vertex unless it is opposite. */
static bool face_has_vertex(const tm_mesh *mesh, int32_t tet, int face, int32_t vertex) {
    return mesh->tet[4 * (int64_t)tet + face] != vertex;
}

static bool face_has_edge(const tm_mesh *mesh, int32_t tet, int face, int32_t edge) {
    const int32_t opposite = mesh->tet[4 * (int64_t)tet + face];
    return opposite != mesh->edge[2 * edge] && opposite != mesh->edge[2 * edge + 1];
}

static int32_t collect(tm_tissue *tissue, const int32_t *tet, int32_t count) {
    tm_cut_work *w = tissue->cut;
    int32_t n = 0;
    w->fan_call++;
    for (int32_t i = 0; i < count; i++) {
        if (!tm_cut_is_there(tissue, tet[i])) continue;
        w->fan_stamp[tet[i]] = w->fan_call;
        w->fan_of[tet[i]] = n;
        w->fan[n] = -1;
        w->star[n++] = tet[i];
    }
    return n;
}

static int32_t label_fans(const tm_tissue *tissue, int32_t n, joined hinge_joins, int32_t hinge) {
    const tm_cut_work *w = tissue->cut;
    int32_t fans = 0;
    for (int32_t first = 0; first < n; first++) {
        if (w->fan[first] >= 0) continue;
        int32_t height = 0;
        w->stack[height++] = first;
        w->fan[first] = fans;
        while (height > 0) {
            const int32_t tet = w->star[w->stack[--height]];
            for (int f = 0; f < 4; f++) {
                const int32_t other = tissue->mesh->tet_neighbour[4 * (int64_t)tet + f];
                if (other < 0 || w->fan_stamp[other] != w->fan_call || w->fan[w->fan_of[other]] >= 0) continue;
                if (!hinge_joins(tissue->mesh, tet, f, hinge)) continue;
                w->fan[w->fan_of[other]] = fans;
                w->stack[height++] = w->fan_of[other];
            }
        }
        fans++;
    }
    return fans;
}

static bool is_bound(const tm_tissue *tissue, int32_t n, int32_t fan) {
    const tm_cut_work *w = tissue->cut;
    for (int32_t i = 0; i < n && tissue->condensed; i++)
        if (w->fan[i] == fan && !tissue->alive[w->star[i]]) return true;
    return false;
}

static void keep_largest_fan(tm_tissue *tissue, int32_t n, int32_t fans) {
    const tm_cut_work *w = tissue->cut;
    int32_t best = 0, most = 0;
    bool bound = false; /* if some fans cannot be removed, all of those stay */
    for (int32_t fan = 0; fan < fans; fan++) {
        int32_t size = 0;
        for (int32_t i = 0; i < n; i++) size += w->fan[i] == fan;
        bound |= is_bound(tissue, n, fan);
        if (size > most) {
            most = size;
            best = fan;
        }
    }
    for (int32_t fan = 0; fan < fans; fan++) {
        if (bound ? is_bound(tissue, n, fan) : fan == best) continue;
        for (int32_t i = 0; i < n; i++)
            if (w->fan[i] == fan) tm_cut_kill(tissue, w->star[i]);
    }
}

/* Counts fans of an edge by their seams first: nearly always there is one. */
static void check_edge(tm_tissue *tissue, int32_t edge) {
    const tm_mesh *mesh = tissue->mesh;
    if (tissue->cut->edge_alive[edge] < 2) return;
    const int32_t begin = mesh->edge_tet_begin[edge];
    const int32_t n = collect(tissue, mesh->edge_tet + begin, mesh->edge_tet_begin[edge + 1] - begin);
    int32_t seams = 0;
    for (int32_t i = 0; i < n; i++)
        for (int f = 0; f < 4; f++) {
            const int32_t other = mesh->tet_neighbour[4 * (int64_t)tissue->cut->star[i] + f];
            seams += other >= 0 && tm_cut_is_there(tissue, other) && face_has_edge(mesh, tissue->cut->star[i], f, edge);
        }
    if (n - seams / 2 <= 1) return;
    const int32_t fans = label_fans(tissue, n, face_has_edge, edge);
    if (fans > 1) keep_largest_fan(tissue, n, fans);
}

/* --- closed fans around a vertex --- */

static int32_t collect_rim(tm_tissue *tissue, int32_t n, int32_t vertex) {
    tm_cut_work *w = tissue->cut;
    int32_t rim = 0;
    for (int32_t i = 0; i < n; i++)
        for (int f = 0; f < 4; f++) {
            const int32_t other = tissue->mesh->tet_neighbour[4 * (int64_t)w->star[i] + f];
            if (!face_has_vertex(tissue->mesh, w->star[i], f, vertex) || (other >= 0 && tm_cut_is_there(tissue, other)))
                continue;
            w->rim_tet[rim] = i;
            w->rim_face[rim] = f;
            w->rim_loop[rim] = rim;
            rim++;
        }
    return rim;
}

static bool share_edge_at(const tm_tissue *tissue, int32_t a, int32_t b, int32_t vertex) {
    const tm_cut_work *w = tissue->cut;
    const int32_t *p = tissue->mesh->tet + 4 * (int64_t)w->star[w->rim_tet[a]],
                  *q = tissue->mesh->tet + 4 * (int64_t)w->star[w->rim_tet[b]];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int32_t x = p[tm_face_vertex[w->rim_face[a]][i]];
            if (x != vertex && x == q[tm_face_vertex[w->rim_face[b]][j]]) return true;
        }
    return false;
}

/* Gives connected outer faces around the vertex the lowest number of their outline. */
static void label_loops(tm_tissue *tissue, int32_t rim, int32_t vertex) {
    int32_t *loop = tissue->cut->rim_loop;
    for (bool changed = true; changed;) {
        changed = false;
        for (int32_t a = 0; a < rim; a++)
            for (int32_t b = 0; b < rim; b++)
                if (loop[b] > loop[a] && share_edge_at(tissue, a, b, vertex)) {
                    loop[b] = loop[a];
                    changed = true;
                }
    }
}

static bool on_loop(const tm_cut_work *w, int32_t rim, int32_t place, bool first) {
    for (int32_t i = 0; i < rim; i++)
        if (w->rim_tet[i] == place && (w->rim_loop[i] == 0) == first) return true;
    return false;
}

/* Removes the shortest chain of tetrahedra from the first outline to any other; all of them if there is none. */
static void open_fan(tm_tissue *tissue, int32_t n, int32_t vertex) {
    tm_cut_work *w = tissue->cut;
    const int32_t rim = collect_rim(tissue, n, vertex);
    label_loops(tissue, rim, vertex);
    int32_t begin = 0, end = 0, last = -1;
    int32_t *from = w->fan; /* index that the search came from, -2: not yet seen */
    for (int32_t i = 0; i < n; i++) from[i] = tissue->alive[w->star[i]] && on_loop(w, rim, i, true) ? -1 : -2;
    for (int32_t i = 0; i < n; i++)
        if (from[i] == -1) w->stack[end++] = i;
    while (begin < end && last < 0) {
        const int32_t place = w->stack[begin++], tet = w->star[place];
        if (on_loop(w, rim, place, false)) last = place;
        for (int f = 0; f < 4 && last < 0; f++) {
            const int32_t other = tissue->mesh->tet_neighbour[4 * (int64_t)tet + f];
            if (other < 0 || !tissue->alive[other] || !face_has_vertex(tissue->mesh, tet, f, vertex)) continue;
            if (from[w->fan_of[other]] != -2) continue;
            from[w->fan_of[other]] = place;
            w->stack[end++] = w->fan_of[other];
        }
    }
    for (int32_t i = 0; i < n && last < 0 && !tissue->condensed; i++) tm_cut_kill(tissue, w->star[i]);
    for (; last >= 0; last = from[last]) tm_cut_kill(tissue, w->star[last]);
}

/* Returns whether there is one closed outline: Euler's V - E + F of the star's section is 1. `seams` are inner faces at
 * the vertex. */
static bool is_disc(const tm_tissue *tissue, int32_t n, int32_t seams, int32_t vertex) {
    const tm_mesh *mesh = tissue->mesh;
    int32_t edges = 0;
    for (int32_t i = mesh->vertex_edge_begin[vertex]; i < mesh->vertex_edge_begin[vertex + 1]; i++)
        edges += tissue->cut->edge_alive[mesh->vertex_edge[i]] > 0;
    return edges - 2 * n + seams == 1;
}

static void check_vertex(tm_tissue *tissue, int32_t vertex) {
    const tm_mesh *mesh = tissue->mesh;
    const int32_t begin = mesh->vertex_tet_begin[vertex];
    const int32_t n = collect(tissue, mesh->vertex_tet + begin, mesh->vertex_tet_begin[vertex + 1] - begin);
    if (n < 2) return;
    int32_t seams = 0;
    for (int32_t i = 0; i < n; i++)
        for (int f = 0; f < 4; f++) {
            const int32_t other = mesh->tet_neighbour[4 * (int64_t)tissue->cut->star[i] + f];
            seams +=
                other >= 0 && tm_cut_is_there(tissue, other) && face_has_vertex(mesh, tissue->cut->star[i], f, vertex);
        }
    seams /= 2;
    if (2 * seams == 3 * n) return; /* closed all around */
    const int32_t fans = label_fans(tissue, n, face_has_vertex, vertex), before = tissue->alive_count;
    if (fans == 1 && is_disc(tissue, n, seams, vertex)) return;
    if (fans > 1)
        keep_largest_fan(tissue, n, fans);
    else
        open_fan(tissue, n, vertex);
    if (tissue->alive_count == before) return;             /* pinched by condensed tetrahedra */
    tm_cut_queue_push(&tissue->cut->vertex_check, vertex); /* the rest may be a closed fan, or have one more hole */
}

/* --- tetrahedra that can stay after all --- */

/* Returns whether a tetrahedron touches present ones in shared faces only; any other shared edge or vertex would be a
 * hinge. Vertices and edges of a shared face are shared with it. So only the vertex opposite a single face, and the
 * edge opposite the one between two faces, can touch. */
static bool can_stay(const tm_tissue *tissue, int32_t tet) {
    const tm_mesh *mesh = tissue->mesh;
    int sides = 0, side[4] = {0};
    for (int f = 0; f < 4; f++) {
        const int32_t other = mesh->tet_neighbour[4 * (int64_t)tet + f];
        if (other >= 0 && tm_cut_is_there(tissue, other)) side[sides++] = f;
    }
    if (sides == 1) return tissue->cut->vertex_alive[mesh->tet[4 * (int64_t)tet + side[0]]] == 0;
    if (sides == 2)
        return tissue->cut->edge_alive[mesh->tet_edge[6 * (int64_t)tet + tm_cut_edge_between[side[0]][side[1]]]] == 0;
    return sides > 2;
}

static void put_back(tm_tissue *tissue, int32_t tet) {
    tm_cut_work *w = tissue->cut;
    tissue->alive[tet] = 1;
    tissue->alive_count++;
    for (int e = 0; e < 6; e++) w->edge_alive[tissue->mesh->tet_edge[6 * (int64_t)tet + e]]++;
    for (int i = 0; i < 4; i++) w->vertex_alive[tissue->mesh->tet[4 * (int64_t)tet + i]]++;
}

/* Restores tetrahedra whose removal has become unnecessary: repair handles one edge or vertex at a time, and later
 * removals may replace earlier ones. Tries the last first, because it hung on earlier ones; a restored one may support
 * the next. */
enum { PASSES = 16 };
static void spare(tm_tissue *tissue, int32_t asked) {
    tm_cut_list *gone = &tissue->cut->tet;
    bool more = gone->count > asked;
    for (int pass = 0; pass < PASSES && more; pass++) {
        more = false;
        for (int32_t i = gone->count - 1; i >= asked; i--) {
            if (tissue->alive[gone->item[i]] || !can_stay(tissue, gone->item[i])) continue;
            put_back(tissue, gone->item[i]);
            more = true;
        }
    }
    int32_t left = asked;
    for (int32_t i = asked; i < gone->count; i++)
        if (!tissue->alive[gone->item[i]]) gone->item[left++] = gone->item[i];
    gone->count = left;
}

static void repair(tm_tissue *tissue) {
    tm_cut_work *w = tissue->cut;
    for (;;) {
        /* Edges first: the outlines around a vertex presume repaired edges. */
        if (w->edge_check.count > 0)
            check_edge(tissue, tm_cut_queue_pop(&w->edge_check));
        else if (w->vertex_check.count > 0)
            check_vertex(tissue, tm_cut_queue_pop(&w->vertex_check));
        else
            return;
    }
}

void tm_cut_repair(tm_tissue *tissue) {
    const int32_t asked = tissue->cut->tet.count;
    repair(tissue);
    spare(tissue, asked);
}
