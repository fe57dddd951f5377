/* Edges, fans and smoothness of a patch: computed once when it comes, outside the tick. */
#include "internal.h"

/* Normals of the undeformed surface blend fully across folds up to 40 degrees and not at all from 70 (docs/contact.md). */
static const float SMOOTH_COSINE = 0.766f, CREASE_COSINE = 0.342f;

/* Its number, made if need be; HRT_PATCH_EDGES: no room. */
static uint8_t find_edge(hrt_patch_topology *t, uint8_t a, uint8_t b) {
    const uint8_t low = a < b ? a : b, high = a < b ? b : a;
    for (uint8_t e = 0; e < t->edge_count; e++)
        if (t->edge_vertex[e][0] == low && t->edge_vertex[e][1] == high) return e;
    if (t->edge_count == HRT_PATCH_EDGES) return HRT_PATCH_EDGES;
    const uint8_t e = t->edge_count++;
    t->edge_vertex[e][0] = low;
    t->edge_vertex[e][1] = high;
    t->edge_face[e][0] = t->edge_face[e][1] = HRT_NO_FACE;
    return e;
}

static bool build_edges(hrt_patch *patch) {
    hrt_patch_topology *t = &patch->topology;
    t->edge_count = 0;
    for (int32_t f = 0; f < patch->triangle_count; f++)
        for (int j = 0; j < 3; j++) {
            const uint8_t e = find_edge(t, patch->triangle[3 * f + j], patch->triangle[3 * f + (j + 1) % 3]);
            if (e == HRT_PATCH_EDGES) return false;
            t->face_edge[f][j] = e;
            if (t->edge_face[e][0] == HRT_NO_FACE) t->edge_face[e][0] = (uint8_t)f;
            else if (t->edge_face[e][1] == HRT_NO_FACE) t->edge_face[e][1] = (uint8_t)f;
        }
    return true;
}

static void build_fans(hrt_patch *patch) {
    hrt_patch_topology *t = &patch->topology;
    uint8_t faces = 0, spokes = 0;
    const uint8_t vertices = (uint8_t)patch->vertex_count, triangles = (uint8_t)patch->triangle_count;
    for (uint8_t v = 0; v < vertices; v++) {
        t->fan_begin[v] = faces;
        t->spoke_begin[v] = spokes;
        t->border[v] = 0;
        for (uint8_t f = 0; f < triangles; f++)
            for (int j = 0; j < 3; j++)
                if (patch->triangle[3 * f + j] == v) t->fan_face[faces++] = f;
        for (uint8_t e = 0; e < t->edge_count; e++)
            if (t->edge_vertex[e][0] == v || t->edge_vertex[e][1] == v) {
                t->spoke_edge[spokes++] = e;
                if (t->edge_face[e][1] == HRT_NO_FACE) t->border[v] = 1;
            }
    }
    t->fan_begin[patch->vertex_count] = faces;
    t->spoke_begin[patch->vertex_count] = spokes;
}

static void rest_normal(const hrt_patch *patch, int32_t f, float normal[3]) {
    const uint8_t *corner = &patch->triangle[HRT_XYZ * f];
    float a[3], b[3];
    hrt_sub(&patch->rest_m[HRT_XYZ * corner[1]], &patch->rest_m[HRT_XYZ * corner[0]], a);
    hrt_sub(&patch->rest_m[HRT_XYZ * corner[2]], &patch->rest_m[HRT_XYZ * corner[0]], b);
    hrt_cross(a, b, normal);
    const float size = hrt_length(normal);
    hrt_scale(normal, size > 0.0f ? 1.0f / size : 0.0f);
}

bool hrt_patch_topology_build(hrt_patch *patch) {
    float normal[HRT_PATCH_MAX_TRIANGLES][3];
    if (!build_edges(patch)) return false;
    build_fans(patch);
    for (int32_t f = 0; f < patch->triangle_count; f++) rest_normal(patch, f, normal[f]);
    for (int32_t f = 0; f < patch->triangle_count; f++)
        for (int32_t g = 0; g < patch->triangle_count; g++) {
            const float part = hrt_clamp((hrt_dot(normal[f], normal[g]) - CREASE_COSINE) / (SMOOTH_COSINE - CREASE_COSINE), 0.0f, 1.0f);
            patch->topology.smooth[f][g] = (uint8_t)(255.0f * part * part * (3.0f - 2.0f * part) + 0.5f);
        }
    return true;
}
