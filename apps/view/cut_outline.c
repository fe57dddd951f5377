#include "cut_outline.h"

#include <stdlib.h>
#include <string.h>

static int by_key(const void *a, const void *b) {
    const view_side *p = a, *q = b;
    if (p->key != q->key) return p->key < q->key ? -1 : 1;
    return p->triangle != q->triangle ? (p->triangle < q->triangle ? -1 : 1) : p->local - q->local;
}

view_side *view_sides_sorted(const uint32_t *index, int32_t triangle_count) {
    view_side *sides = malloc(((size_t)triangle_count * 3 + 1) * sizeof *sides);
    if (!sides) return NULL;
    for (int32_t t = 0; t < triangle_count; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t a = index[3 * t + i], b = index[3 * t + (i + 1) % 3];
            sides[3 * t + i] = (view_side){a < b ? a << 32 | b : b << 32 | a, t, i};
        }
    qsort(sides, (size_t)triangle_count * 3, sizeof *sides, by_key);
    return sides;
}

#define LAW_REAL float
#include "libtensormass/numeric/vec.h"

static const float BULGE = 0.2f; /* maximum offset of a segment's middle, as a share of its length */

void view_rim_free(view_rim *rim) {
    free(rim->vertex);
    free(rim->point);
    for (int i = 0; i < VIEW_RIM_LEVELS; i++) {
        free(rim->piece[i]);
        free(rim->first[i]);
        free(rim->next[i]);
    }
    free(rim->at);
    memset(rim, 0, sizeof *rim);
}

/* --- segments --- */

static bool is_opened(const view_surface *s, int32_t triangle) { return s->kind[triangle] & 1; }

static int32_t point_of(view_rim *rim, int32_t vertex) {
    if (rim->point[vertex] < 0) {
        rim->vertex[rim->point_count[0]] = vertex;
        rim->point[vertex] = rim->point_count[0]++;
    }
    return rim->point[vertex];
}

/* Finds edges that one triangle of the wall and one of the outer surface share. */
static void find_pieces(view_rim *rim, const view_surface *s, const view_side *sides, int32_t side_count) {
    for (int32_t i = 0, end; i < side_count; i = end) {
        end = view_sides_end(sides, side_count, i);
        const int32_t begin = s->between_count;
        if (end - i != 2 || is_opened(s, begin + sides[i].triangle) == is_opened(s, begin + sides[i + 1].triangle))
            continue;
        rim->piece[0][rim->piece_count[0]++] = (view_rim_piece){
            point_of(rim, (int32_t)(sides[i].key >> 32)), point_of(rim, (int32_t)(sides[i].key & 0xffffffffu)), -1, -1};
    }
}

/* Returns the far end of the other segment at a point, or the point itself if there is none or more than one. */
static int32_t beyond(const int32_t (*met)[3], int32_t point, int32_t from) {
    return met[point][0] != 2 ? point : met[point][1] == from ? met[point][2] : met[point][1];
}

/* Fills `before`, `after` and the lists of a level. */
static bool link(view_rim *rim, int level) {
    const int32_t points = rim->point_count[level], pieces = rim->piece_count[level];
    int32_t(*met)[3] = calloc((size_t)points + 1, sizeof *met); /* segments at a point, and the first two's far ends */
    rim->first[level] = malloc(((size_t)points + 1) * sizeof(int32_t));
    rim->next[level] = malloc(((size_t)pieces + 1) * sizeof(int32_t));
    const bool good = met && rim->first[level] && rim->next[level];
    for (int32_t i = 0; good && i < points; i++) rim->first[level][i] = -1;
    for (int32_t i = 0; good && i < pieces; i++) {
        const view_rim_piece *p = &rim->piece[level][i];
        const int32_t end[2] = {p->from, p->to};
        for (int e = 0; e < 2; e++) {
            int32_t *at = met[end[e]];
            if (at[0] < 2) at[1 + at[0]] = end[!e];
            at[0]++;
        }
        rim->next[level][i] = rim->first[level][p->from];
        rim->first[level][p->from] = i;
    }
    for (int32_t i = 0; good && i < pieces; i++) {
        view_rim_piece *p = &rim->piece[level][i];
        p->before = beyond((const int32_t(*)[3])met, p->from, p->to);
        p->after = beyond((const int32_t(*)[3])met, p->to, p->from);
    }
    free(met);
    return good;
}

/* Splits every segment in two. */
static bool split(view_rim *rim, int level) {
    const int32_t pieces = rim->piece_count[level];
    rim->piece[level + 1] = malloc((2 * (size_t)pieces + 1) * sizeof *rim->piece[0]);
    for (int32_t i = 0; rim->piece[level + 1] && i < pieces; i++) {
        const view_rim_piece *p = &rim->piece[level][i];
        const int32_t middle = rim->point_count[level] + i;
        rim->piece[level + 1][2 * i] = (view_rim_piece){p->from, middle, -1, -1};
        rim->piece[level + 1][2 * i + 1] = (view_rim_piece){middle, p->to, -1, -1};
    }
    rim->piece_count[level + 1] = 2 * pieces;
    return rim->piece[level + 1] != NULL;
}

bool view_rim_take(view_rim *rim, const view_surface *s, int levels) {
    bool cut = false;
    view_rim_free(rim);
    for (int32_t t = s->between_count; t < s->triangle_count; t++) cut = cut || is_opened(s, t);
    if (!cut || s->planed || !levels) return true;
    const int32_t triangles = s->triangle_count - s->between_count;
    view_side *sides = view_sides_sorted((const uint32_t *)s->triangle + 3 * (size_t)s->between_count, triangles);
    rim->vertex = malloc(((size_t)s->vertex_count + 1) * sizeof *rim->vertex);
    rim->point = malloc(((size_t)s->vertex_count + 1) * sizeof *rim->point);
    rim->piece[0] = malloc((3 * (size_t)triangles + 1) * sizeof *rim->piece[0]);
    bool good = sides && rim->vertex && rim->point && rim->piece[0];
    for (int32_t v = 0; good && v < s->vertex_count; v++) rim->point[v] = -1;
    if (good) find_pieces(rim, s, sides, 3 * triangles);
    for (int i = 0; i < levels && good; i++) {
        rim->point_count[i + 1] = rim->point_count[i] + rim->piece_count[i];
        good = link(rim, i) && (i + 1 == levels || split(rim, i));
    }
    if (good) good = (rim->at = malloc((3 * (size_t)rim->point_count[levels] + 1) * sizeof *rim->at)) != NULL;
    free(sides);
    if (!good) view_rim_free(rim);
    return good;
}

int32_t view_rim_middle(const view_rim *rim, int level, int32_t a, int32_t b) {
    if (a < 0 || b < 0) return -1;
    for (int turn = 0; turn < 2; turn++) {
        const int32_t from = turn ? b : a, to = turn ? a : b;
        for (int32_t i = rim->first[level][from]; i >= 0; i = rim->next[level][i])
            if (rim->piece[level][i].to == to) return rim->point_count[level] + i;
    }
    return -1;
}

/* --- positions --- */

/* Computes the middle on the cubic through four successive points (Dyn, Levin and Gregory, "A 4-point interpolatory
 * subdivision scheme for curve design", 1987). */
static void lay_middle(const view_rim_piece *p, const float *at, float out[3]) {
    float bulge[3], along[3];
    vsub(at + 3 * p->to, at + 3 * p->from, along);
    for (int k = 0; k < 3; k++)
        bulge[k] = (at[3 * p->from + k] + at[3 * p->to + k] - at[3 * p->before + k] - at[3 * p->after + k]) / 16;
    const float most = BULGE * vnorm(along), length = vnorm(bulge);
    if (length > most) vscale(most / length, bulge, bulge);
    for (int k = 0; k < 3; k++) out[k] = (at[3 * p->from + k] + at[3 * p->to + k]) / 2 + bulge[k];
}

void view_rim_lay(view_rim *rim, int levels, const float *place) {
    for (int32_t i = 0; i < rim->point_count[0]; i++) vset(place + 3 * rim->vertex[i], rim->at + 3 * i);
    for (int l = 0; l < levels; l++)
        for (int32_t i = 0; i < rim->piece_count[l]; i++)
            lay_middle(&rim->piece[l][i], rim->at, rim->at + 3 * (rim->point_count[l] + i));
}
