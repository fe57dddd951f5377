#include "explain_numbering.h"

#include <stdio.h>

#include "numbering.h"

void explain_numbering(const sim *s, cJSON *json) {
    app_numbering_figures f;
    if (!app_numbering_measure(s->mesh, &f)) return;
    cJSON *out = cJSON_AddObjectToObject(json, "numbering");
    cJSON_AddNumberToObject(out, "distance", f.distance);
    cJSON_AddNumberToObject(out, "renumbered", f.renumbered);
    cJSON_AddBoolToObject(out, "poor", f.poor);
    char where[300];
    app_scene_where(s->scene, s->scene->mesh.line, where, sizeof where);
    if (f.poor)
        printf("%s: the mesh's numbers jump: the two vertices of an edge are %.0f apart on average, tm-mesh renumber "
               "would make it %.0f and steps quicker\n\n",
               where, f.distance, f.renumbered);
}
