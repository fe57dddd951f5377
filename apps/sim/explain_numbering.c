#include "explain_numbering.h"

#include <stdio.h>

void explain_numbering(const sim *s, cJSON *json) {
    tm_numbering_stats f;
    if (!tm_mesh_numbering_measure(s->mesh, &f)) return;
    cJSON *out = cJSON_AddObjectToObject(json, "numbering");
    cJSON_AddNumberToObject(out, "distance", f.distance);
    cJSON_AddNumberToObject(out, "renumbered", f.renumbered);
    cJSON_AddBoolToObject(out, "poor", f.should_renumber);
    cJSON_AddBoolToObject(out, "inside", s->mesh->original_vertex != NULL);
    char where[300];
    app_scene_where(s->scene, app_mesh_line(s->scene), where, sizeof where);
    if (s->mesh->original_vertex)
        printf("%s: large bandwidth: the numbers of an edge's two vertices differ by %.0f on average; renumbered "
               "internally, by %.0f\n"
               "\n",
               where, f.distance, f.renumbered);
    else if (f.should_renumber)
        printf("%s: large bandwidth: the numbers of an edge's two vertices differ by %.0f on average; without "
               "tissue.renumber: no it would be %.0f, and steps faster\n"
               "\n",
               where, f.distance, f.renumbered);
}
