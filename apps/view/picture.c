#include "picture.h"

#include <stdlib.h>
#include <string.h>

bool view_surface_reserve(view_surface *s, int32_t vertices, int32_t triangles) {
    const bool spare = s->vertex_capacity / 8 > vertices + 10000 && s->triangle_capacity / 8 > triangles + 10000;
    if (!spare && vertices <= s->vertex_capacity && triangles <= s->triangle_capacity) return true;
    if (spare) s->vertex_capacity = s->triangle_capacity = 0; /* frees the arrays after a large surface */
    int32_t nv = vertices > s->vertex_capacity ? vertices + vertices / 4 : s->vertex_capacity;
    int32_t nt = triangles > s->triangle_capacity ? triangles + triangles / 4 : s->triangle_capacity;
    uint32_t version = s->version, topology = s->topology;
    view_surface_free(s);
    s->version = version, s->topology = topology;
    s->vertex_m = calloc((size_t)nv * 3 + 1, sizeof *s->vertex_m);
    s->vertex_id = calloc((size_t)nv + 1, sizeof *s->vertex_id);
    s->triangle = calloc((size_t)nt * 3 + 1, sizeof *s->triangle);
    s->kind = calloc((size_t)nt + 1, sizeof *s->kind);
    if (!s->vertex_m || !s->vertex_id || !s->triangle || !s->kind) {
        view_surface_free(s);
        return false;
    }
    s->vertex_capacity = nv, s->triangle_capacity = nt;
    return true;
}

bool view_ties_reserve(view_ties *t, int32_t count) {
    const bool spare = t->capacity / 8 > count + 1000;
    if (!spare && count <= t->capacity) return true;
    free(t->end_m);
    *t = (view_ties){.end_m = malloc((size_t)count * 6 * sizeof *t->end_m + 1)};
    if (t->end_m) t->capacity = count;
    return t->end_m != NULL;
}

void view_picture_free(view_picture *p) {
    view_surface_free(&p->surface);
    free(p->ties.end_m);
    p->ties = (view_ties){0};
}

void view_surface_free(view_surface *s) {
    free(s->vertex_m);
    free(s->vertex_id);
    free(s->triangle);
    free(s->kind);
    memset(s, 0, sizeof *s);
}

void view_trace_add(view_trace *trace, double time_s, const float force_N[VIEW_INSTRUMENTS]) {
    trace->time_s[trace->next] = time_s;
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) trace->force_N[i][trace->next] = force_N[i];
    trace->next = (trace->next + 1) % VIEW_TRACE;
    if (trace->count < VIEW_TRACE) ++trace->count;
}
