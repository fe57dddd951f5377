/* Posts force samples from a CSV file. */
#include "samples.h"

bool hrt_samples_read(hrt_samples *s, const char *path) {
    static const char *const force[3] = {"fx_N", "fy_N", "fz_N"}, *const tip[3] = {"px_m", "py_m", "pz_m"};
    static const char *const stiffness[9] = {"kxx", "kxy", "kxz", "kyx", "kyy", "kyz", "kzx", "kzy", "kzz"};
    if (!hrt_table_read(path, &s->table)) return false;
    bool good = hrt_table_need(&s->table, path, "time_s", &s->time);
    for (int i = 0; good && i < 3; i++) good = hrt_table_need(&s->table, path, force[i], &s->force[i]);
    s->instrument = hrt_table_column(&s->table, "instrument");
    for (int i = 0; i < 3; i++) s->tip[i] = hrt_table_column(&s->table, tip[i]);
    for (int i = 0; i < 9; i++) s->stiffness[i] = hrt_table_column(&s->table, stiffness[i]);
    s->next = 0;
    s->seq = 0;
    s->start_us = 0;
    if (!good) hrt_table_free(&s->table);
    return good;
}

static void post(hrt_samples *s, const double *row, hrt_node *node, const tensormass_tool_state_t *tool) {
    tensormass_force_sample_t sample = hrt_node_sample_for(tool, ++s->seq);
    for (int i = 0; i < 3; i++) {
        sample.force_N[i] = row[s->force[i]];
        if (s->tip[i] >= 0) sample.tip_m[i] = row[s->tip[i]];
    }
    if (s->stiffness[0] >= 0) {
        sample.stiffness_kind = 1;
        for (int i = 0; i < 9; i++) sample.stiffness_N_m[i] = s->stiffness[i] >= 0 ? row[s->stiffness[i]] : 0.0;
    }
    hrt_node_post_sample(node, &sample);
}

bool hrt_samples_feed(hrt_samples *s, hrt_node *node, const tensormass_tool_state_t *tool, int64_t now_us) {
    if (s->start_us == 0) {
        if (tool->state != HRT_IDLE) return true;
        s->start_us = now_us;
    }
    while (s->next < s->table.rows) {
        const double *row = &s->table.value[s->next * s->table.fields];
        if (row[s->time] > 1.0e-6 * (double)(now_us - s->start_us)) return true;
        s->next++;
        if (s->instrument < 0 || (int32_t)row[s->instrument] == tool->instrument) post(s, row, node, tool);
    }
    return false;
}
