/* A run before it is made: its name, and what is set for it. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study.h"

void study_set(study_run *r, const char *format, ...) {
    va_list list;
    if (r->set_count == STUDY_SETS) abort(); /* the tables below are shorter */
    va_start(list, format);
    if (vasprintf(&r->set[r->set_count++], format, list) < 0) abort();
    va_end(list);
}

study_run *study_add(study *t, const char *knob, const char *name) {
    if (t->run_count == STUDY_RUNS) abort();
    study_run *r = &t->run[t->run_count++];
    *r = (study_run){.force_error = NAN, .shape_error = NAN, .change = NAN, .peak_change = NAN};
    snprintf(r->knob, sizeof r->knob, "%s", knob);
    snprintf(r->name, sizeof r->name, "%s", name);
    for (int i = 0; i < t->set_count; i++) study_set(r, "%s", t->set[i]);
    r->edits_from = r->set_count;
    return r;
}

bool study_is_felt(const study_run *r) { return !strcmp(r->knob, "extrapolator") || !strcmp(r->knob, "rate"); }
