/* tm-sim --list: lists scenes, models and effects. */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/program_host.h"
#include "run.h"
#include "scene/effects.h"

static int is_scene(const struct dirent *one) {
    size_t length = strlen(one->d_name);
    return length > 5 && !strcmp(one->d_name + length - 5, ".yaml");
}

static void list_scenes(void) {
    char folder[1200], path[1500];
    struct dirent **all;
    int count = app_shared_file("apps/scenes", folder, sizeof folder) ? scandir(folder, &all, is_scene, alphasort) : 0;
    if (count <= 0) return;
    printf("scenes\n");
    for (int i = 0; i < count; i++) {
        app_scene *scene;
        snprintf(path, sizeof path, "%s/%s", folder, all[i]->d_name);
        if (!sim_scene_load(path, NULL, 0, app_program_host(), &scene)) {
            printf("  %s  %s\n", path, scene->title.s);
            app_scene_free(scene);
        }
        free(all[i]);
    }
    free(all);
}

/* Prints each effect's description up to the end of the first sentence. */
static void list_effects(void) {
    printf("models\n  dynamic precomputed hybrid\neffects\n");
    for (int i = 0; i < sim_effect_count; i++) {
        const char *doc = sim_effects[i]->doc, *stop = strchr(doc, '.');
        if (!sim_effects[i]->model)
            printf("  %-12s %.*s\n", sim_effects[i]->name, stop ? (int)(stop - doc) + 1 : (int)strlen(doc), doc);
    }
}

int run_list(void) {
    list_scenes();
    list_effects();
    return APP_DONE;
}
