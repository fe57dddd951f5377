/* What was cut along a path, and the same cut again: tetrahedra that a recorded list names, at their times, in a run of
 * another frame rate. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "studies/replay/replay.h"
#include "tensormass/cut.h"

void cut_list_take(cut_list *list, const sim *s, double time_s) {
    int count = list->count + s->cuts.count;
    if (count > list->capacity) {
        list->capacity = 2 * count;
        list->tet = realloc(list->tet, sizeof *list->tet * (size_t)list->capacity);
        list->time_s = realloc(list->time_s, sizeof *list->time_s * (size_t)list->capacity);
        if (!list->tet || !list->time_s) abort();
    }
    for (int i = 0; i < s->cuts.count; i++) {
        list->tet[list->count + i] = s->cuts.tet[i];
        list->time_s[list->count + i] = time_s;
    }
    list->count = count;
}

void cut_list_free(cut_list *list) {
    free(list->tet);
    free(list->time_s);
    memset(list, 0, sizeof *list);
}

bool cut_list_between(const cut_list *list, double from_s, double to_s) {
    for (int i = 0; list && i < list->count; i++)
        if (list->time_s[i] > from_s && list->time_s[i] <= to_s) return true;
    return false;
}

int cut_list_shared(const cut_list *a, const cut_list *b) {
    int shared = 0;
    for (int i = 0; i < a->count; i++)
        for (int j = 0; j < b->count; j++)
            if (a->tet[i] == b->tet[j]) {
                shared++;
                break;
            }
    return shared;
}

/* What is due goes; how long until the next does. */
static int32_t between(void *user, sim *s) {
    cut_replay *r = user;
    const cut_list *list = r->list;
    const double now_s = sim_time_s(s) - r->begin_s + 0.5 * s->dt_s;
    for (; r->next < list->count && list->time_s[r->next] <= now_s; r->next++)
        tm_cut_remove(s->model->tissue, &list->tet[r->next], 1, NULL, 0);
    if (r->next == list->count) return INT32_MAX;
    const double until = ceil((list->time_s[r->next] - now_s) / s->dt_s);
    return until < INT32_MAX ? (until > 1 ? (int32_t)until : 1) : INT32_MAX;
}

void cut_replay_begin(cut_replay *replay, const cut_list *list, sim *s) {
    *replay = (cut_replay){.list = list, .begin_s = HUGE_VAL};
    s->between = between;
    s->between_user = replay;
}
