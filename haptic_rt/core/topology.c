/* Computes edges, triangles around vertices and smoothness of a patch: once on reception, outside the tick. */
#include "internal.h"

#include "contact_law/feature.h"

/* Returns the number of edge ab; adds it, directed as in its first triangle, if new. HRT_PATCH_EDGES: at capacity. */
static uint8_t find_edge(hrt_patch_topology *t, uint8_t a, uint8_t b) {
    for (uint8_t e = 0; e < t->edge_count; e++) {
        const uint8_t *ends = t->edge_vertex[e];
        if ((ends[0] == a && ends[1] == b) || (ends[0] == b && ends[1] == a)) return e;
    }
    if (t->edge_count == HRT_PATCH_EDGES) return HRT_PATCH_EDGES;
    const uint8_t e = t->edge_count++;
    t->edge_vertex[e][0] = a;
    t->edge_vertex[e][1] = b;
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
            if (t->edge_face[e][0] == HRT_NO_FACE)
                t->edge_face[e][0] = (uint8_t)f;
            else if (t->edge_face[e][1] == HRT_NO_FACE)
                t->edge_face[e][1] = (uint8_t)f;
        }
    return true;
}

static void build_fans(hrt_patch *patch) {
    hrt_patch_topology *t = &patch->topology;
    uint8_t faces = 0;
    for (int32_t v = 0; v < patch->vertex_count; v++) {
        t->fan_begin[v] = faces;
        for (int32_t c = 0; c < 3 * patch->triangle_count; c++)
            if (patch->triangle[c] == v) t->fan_face[faces++] = (uint8_t)(c / 3);
    }
    t->fan_begin[patch->vertex_count] = faces;
    t->boundary = 0;
    for (int32_t e = 0; e < t->edge_count; e++)
        if (t->edge_face[e][1] == HRT_NO_FACE) t->boundary |= 1u << t->edge_vertex[e][0] | 1u << t->edge_vertex[e][1];
}

static void rest_normal(const hrt_patch *patch, int32_t f, float normal[3]) {
    const uint8_t *corner = &patch->triangle[HRT_XYZ * f];
    float a[3], b[3];
    vsub(&patch->rest_m[HRT_XYZ * corner[1]], &patch->rest_m[HRT_XYZ * corner[0]], a);
    vsub(&patch->rest_m[HRT_XYZ * corner[2]], &patch->rest_m[HRT_XYZ * corner[0]], b);
    vcross(a, b, normal);
    const float size = vnorm(normal);
    vscale(size > 0.0f ? 1.0f / size : 0.0f, normal, normal);
}

/* Returns the vertices that two triangles share, one bit each. */
static uint32_t common(const hrt_patch *patch, int32_t f, int32_t g) {
    uint32_t of[2] = {0, 0};
    for (int j = 0; j < 3; j++) {
        of[0] |= 1u << patch->triangle[3 * f + j];
        of[1] |= 1u << patch->triangle[3 * g + j];
    }
    return of[0] & of[1];
}

bool hrt_patch_topology_build(hrt_patch *patch) {
    float normal[HRT_PATCH_MAX_TRIANGLES][3];
    if (!build_edges(patch)) return false;
    build_fans(patch);
    uint8_t *smooth = patch->topology.smooth;
    patch->topology.creased = 0;
    for (int32_t f = 0; f < patch->triangle_count; f++) {
        rest_normal(patch, f, normal[f]);
        for (int32_t g = 0; g < f; g++) {
            const float part = law_smooth(vdot(normal[f], normal[g]));
            *smooth++ = (uint8_t)(255.0f * part + 0.5f);
            if (part < 1.0f) patch->topology.creased |= common(patch, f, g);
        }
    }
    return true;
}
