/* A scene file in a program of one's own: read it, say what is wrong with it, move its first instrument by hand and
 * print the force. The program of docs/scene-guide.md:
 *     press SCENE.yaml [PATH=VALUE...] */
#include <stdio.h>
#include <tensormass_scene.h>

/* "scene.yaml:12: warning: what; what to do" */
static void print(void *user, const tm_diagnostic *diagnostic) {
    char text[1000];
    tm_diagnostic_format(diagnostic, text, sizeof text);
    fprintf(user, "%s\n", text);
}

int main(int count, char **word) {
    tm_diagnostics told = {.on_diagnostic = print, .user = stderr};
    tm_scene_def def = tm_scene_def_default();
    tm_scene *scene = NULL;
    if (count < 2) {
        fprintf(stderr, "usage: press SCENE.yaml [PATH=VALUE...]\n");
        return 2;
    }
    def.file = word[1];
    def.set = (const char *const *)(word + 2);
    def.set_count = count - 2;
    def.diagnostics = &told;
    if (tm_scene_open(&def, &scene) != TM_OK) {
        tm_diagnostics_clear(&told);
        return 1;
    }

    const tm_scene_info about = tm_scene_get_info(scene);
    printf("%s: %s, %d tetrahedra, %d substeps of %.0f us\n", about.title, about.model, about.tet_count, about.substeps,
           1e6 * about.dt_s);
    double most_N = 0;
    tm_status status = TM_OK;
    for (int frame = 0; frame < 20 && about.instrument_count && status == TM_OK; frame++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        for (int i = 0; i < about.instrument_count; i++) to[i] = tm_scene_pose(scene, i);
        to[0].tip_m[2] -= 1e-3; /* down by a millimetre a frame */
        status = tm_scene_step(scene, to);
        const tm_tool_reaction reaction = tm_scene_reaction(scene, 0);
        if (reaction.force_N[2] > most_N) most_N = reaction.force_N[2];
    }
    printf("at most %.3f N up; state %016llx\n", most_N, (unsigned long long)tm_scene_hash(scene));
    tm_scene_close(scene);
    tm_diagnostics_clear(&told);
    return status != TM_OK || tm_memory_in_use() != 0;
}
