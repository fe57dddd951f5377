/* The shape that forces make, the rows that it has, and what they do. */
#include "local_eval.h"

#include <string.h>

/* out += f times the displacements of all slots by that force: a row of the block, which is symmetric and lies in
 * memory as it is read. */
void tms_local_spread(const tms_local *l, int32_t component, double f, double *restrict out) {
    tms_add_times(f, l->block + (int64_t)component * 3 * l->capacity, 3 * l->high, out);
}

void tms_local_response(const tms_local *l, const int32_t *slot, int32_t count, const double *f, bool by_slot,
                        double *out) {
    memset(out, 0, 24 * (size_t)l->high);
    for (int32_t j = 0; j < 3 * count; j++) {
        const int32_t d = 3 * slot[j / 3] + j % 3;
        const double force = by_slot ? f[d] : f[j];
        if (force != 0) tms_local_spread(l, d, force, out);
    }
}

void tms_local_shape(tms_local *l) {
    tms_local_response(l, l->use, l->use_count, l->f, true, l->du);
    for (int32_t i = 0; i < 3 * l->use_count; i++) {
        const int32_t s = l->use[i / 3];
        const int64_t d = 3 * (int64_t)l->vertex[s] + i % 3;
        l->u_m[d] = l->base_m[d] + l->du[3 * s + i % 3];
    }
}

static void add_row(const tms_local *l, tms_look *look, const tm_contact_row *row) {
    const tms_tool *tool = &l->tool[row->instrument];
    double on_tool[3], at_tip[3];
    look->capped[row->instrument] |= row->lambda_N >= l->def.force_cap_N;
    for (int c = 0; c < 3; c++) on_tool[c] = -row->lambda_N * row->normal[c];
    tm_tip_force(tool->def.trocar_m, tool->pose.tip_m, row->point_m, on_tool, at_tip);
    for (int c = 0; c < 3; c++)
        look->force_N[row->instrument][c] += at_tip[c], look->resultant_N[row->instrument][c] += on_tool[c];
    for (int k = 0; k < 3; k++)
        for (int c = 0; c < 3; c++) look->fc[3 * l->slot_of[row->vertex[k]] + c] -= row->weight[k] * on_tool[c];
}

void tms_local_sum(const tms_local *l, tms_look *look) {
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) look->fc[3 * l->use[i] + c] = 0;
    memset(look->force_N, 0, sizeof look->force_N);
    memset(look->resultant_N, 0, sizeof look->resultant_N);
    memset(look->capped, 0, sizeof look->capped);
    for (int32_t i = 0; i < look->count; i++) add_row(l, look, &look->row[i]);
}

void tms_local_look(tms_local *l, tms_look *look, double margin) {
    int32_t first = 0;
    look->count = 0;
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_tool *tool = &l->tool[t];
        int32_t last = first;
        while (last < l->before_count && l->before[last].instrument == t) last++;
        if (tool->given) {
            const int32_t room = l->def.max_rows - look->count, rows = last - first < room ? last - first : room;
            memcpy(look->row + look->count, l->before + first, (size_t)rows * sizeof *look->row);
            look->count += rows;
        } else if (tool->near) {
            bool overflowed = false;
            const int32_t found = tm_contact_search_rows(
                tool->search, l->mesh->rest_m, l->u_m, &tool->capsule, margin * tool->def.radius_m, l->before + first,
                last - first, look->row + look->count, l->def.max_rows - look->count, &overflowed);
            tool->overflowed |= overflowed;
            const int32_t end = look->count + found;
            for (int32_t i = look->count; i < end; i++) {
                if (tms_local_in_jaws(l, &look->row[i]) || (l->passes && l->passes(l->self, &look->row[i]))) continue;
                tm_contact_row *row = &look->row[look->count++];
                *row = look->row[i];
                row->lambda_N = tm_skin_reaction(l->def.skin_compliance_m_N / row->share, tool->def.radius_m,
                                                 row->gap_m, 0, l->def.force_cap_N);
            }
        }
        first = last;
    }
    tms_local_sum(l, look);
    if (l->rub) tms_local_rub(l, look);
}
