/* tm-sim --hands: the scene's scripted hands as CSV, which tm-device plays when every program runs on its own. */
#include <stdio.h>

#include "run.h"

static int write_hand(const sim *s, int i, const app_hand *hand, const char *path) {
    run_file file = {0};
    int rc = run_file_begin(&file, path);
    if (rc) return rc;
    fputs("time_s,pitch_rad,yaw_rad,insertion_m,roll_rad,grip,active\n", file.stream);
    if (!hand) {
        fputs("0", file.stream);
        for (int j = 0; j < SIM_JOINTS; ++j) fprintf(file.stream, ",%.17g", s->start_joint[i][j]);
        fputs(",0\n", file.stream);
    }
    for (int k = 0; hand && k < hand->path.count; ++k) {
        const app_waypoint *w = (const app_waypoint *)hand->path.item + k;
        double joint[SIM_JOINTS];
        sim_scene_joints(s, i, &w->pose, joint);
        fprintf(file.stream, "%.17g", w->time.si);
        for (int j = 0; j < SIM_JOINTS; ++j) fprintf(file.stream, ",%.17g", joint[j]);
        fprintf(file.stream, ",%d\n", w->active.on);
    }
    return run_file_end(&file, true);
}

int run_hands(sim *s, const run_options *o) {
    for (int i = 0; i < s->instrument_count; ++i) {
        char path[1024];
        snprintf(path, sizeof path, "%.1000s%d.csv", o->hands, i);
        int rc = write_hand(s, i, sim_hand(s, i), path);
        if (rc) return rc;
    }
    return 0;
}
