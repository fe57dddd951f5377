/* The choice as a scene: its name, its file, what is said of it, and the simulation that it makes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study.h"

void study_choice_names(const study *t, char *text, size_t size) {
    const study_choice *c = &t->choice;
    snprintf(text, size, "%s", t->run[c->mesh_run].name);
    for (int e = 0; e < c->extra_count; e++) {
        const size_t used = strlen(text);
        snprintf(text + used, size - used, "; %s", t->run[c->extra[e]].name);
    }
    const size_t used = strlen(text);
    const study_run *felt = &t->run[c->felt_run];
    if (c->felt_run)
        snprintf(text + used, size - used, "; extrapolator %s, haptics.rate %.4g Hz",
                 hrt_extrapolator_name((hrt_extrapolator)felt->law), study_rate_Hz(t, felt));
}

static bool is_quiet(const char *set) {
    return !strcmp(set, "haptics") || !strcmp(set, "recording") || !strcmp(set, "rendering");
}

static int gather_edits(const study *t, char **edit) {
    const study_choice *c = &t->choice;
    int n = 0;
    for (int i = 0; i < t->set_count; i++)
        if (!is_quiet(t->set[i])) edit[n++] = t->set[i];
    const study_run *mesh = &t->run[c->mesh_run];
    for (int i = mesh->edits_from; i < mesh->set_count; i++) edit[n++] = mesh->set[i];
    for (int e = 0; e < c->extra_count; e++)
        for (int i = t->run[c->extra[e]].edits_from; i < t->run[c->extra[e]].set_count; i++)
            edit[n++] = t->run[c->extra[e]].set[i];
    const study_run *felt = &t->run[c->felt_run];
    for (int i = felt->edits_from; i < felt->set_count && c->felt_run; i++) edit[n++] = felt->set[i];
    return n;
}

static int write_scene(study *t) {
    const study_choice *c = &t->choice;
    const study_run *own = &t->run[0];
    char setting[400], doubt[100], path[120], reason[400], hand[500] = "", evidence[3500], *edit[7 * STUDY_SETS];
    study_choice_names(t, setting, sizeof setting);
    study_path_words(t, path, sizeof path);
    snprintf(doubt, sizeof doubt, "what the mesh leaves out is not known: no finer one was run");
    if (isfinite(t->truth.uncertainty))
        snprintf(doubt, sizeof doubt, "the truth itself is uncertain by %.2g %%", 100 * t->truth.uncertainty);
    if (c->felt_run)
        study_rate_reason(t, reason, sizeof reason), snprintf(hand, sizeof hand, "#   samples    %s\n", reason);
    snprintf(evidence, sizeof evidence,
             "# Recommended by tm-accuracy for %.3g processors, from %s%s.\n"
             "#   setting    %s\n"
             "#   force      %.2g %% RMS off the study's truth along %s (the scene as it is: %.2g %%);\n"
             "#              %s%s\n"
             "%s"
             "#   price      %.3g ms a frame of %.3g ms; 95th percentile: %.2g of a processor (as it is: %.2g)\n"
             "#   evidence   %s; what holds is what was run on that machine\n",
             t->budget, t->file, c->fits ? "" : " (nothing measured fits that; this is the cheapest)", setting,
             100 * c->error, path, 100 * own->force_error,
             t->truth.extrapolated || c->error > STUDY_ALIKE ? "" : "that truth is this very run; ", doubt, hand,
             1e3 * c->cost_s, 1e3 * c->frame_s, c->share, own->cpu_p95_s / own->frame_s, t->json);
    return study_write_yaml(t, c->file, edit, gather_edits(t, edit), evidence);
}

void study_say(const study *t) {
    const study_choice *c = &t->choice;
    char setting[400], path[120], verdict[500], reason[400];
    study_rate_reason(t, reason, sizeof reason);
    study_path_words(t, path, sizeof path);
    study_choice_names(t, setting, sizeof setting);
    study_verdict(c, verdict, sizeof verdict);
    printf("\nRecommended for %.3g processors: %s\n  %s\n", t->budget, setting, c->file);
    if (*reason) printf("  force samples: %s\n", reason);
    if (t->worse)
        printf("  %d setting%s came out worse than predicted, and had to be the best as it came out\n", t->worse,
               t->worse > 1 ? "s" : "");
    if (c->untried) puts("  the scene as it is: the limit left no time to try anything else; raise --limit");
    printf("  promised along %s, as the table's errors are: force %.2f %% off (predicted %.2f %%), %.1f %% of a "
           "processor%s\n",
           path, 100 * c->error, 100 * c->predicted, 100 * c->share,
           c->fits ? "" : " - MORE THAN THE BUDGET: nothing measured fits it");
    printf(
        "  held %d frames: force %.2f %% off, %.1f %% of a processor; %.1f %% of the frames took more processor time "
        "than the budget; %d came late by the wall clock%s\n  %s\n",
        c->held_frames, 100 * c->held_error, 100 * c->held_share, 100 * c->held.over, c->held_late,
        c->real_time ? "" : " (too many)", verdict);
}

/* The choice of now, as it was written; null: it cannot be. */
static sim *build_written(const study *t, char *why, size_t size) {
    char *set[STUDY_SETS];
    int count = 0;
    const study_choice *c = &t->choice;
    for (int i = 0; i < t->set_count; i++) /* what no study runs with */
        if (is_quiet(t->set[i]) && !(c->felt_run && !strcmp(t->set[i], "haptics"))) set[count++] = t->set[i];
    sim *s = study_build(c->file, set, count, why, size);
    for (int i = 0; s && i < s->instrument_count && c->felt_run; i++)
        s->wants[i] = c->sends < s->can_send ? c->sends : s->can_send;
    return s;
}

sim *study_build_again(study *t) {
    char why[400];
    return build_written(t, why, sizeof why);
}

/* Written, and built; null: that, or `rc`. */
sim *study_build_choice(study *t, char *why, size_t size, int *rc) {
    *rc = write_scene(t);
    return *rc || app_interrupted() ? NULL : build_written(t, why, size);
}
