/* Constraint blocks that share the tissue's vertices with contact, and the driver that sweeps them all. */
#include "contact/contact_internal.h"

tm_constraint_block *tm_contact_rows_block(tm_contact *contact) {
    tm_constraint_block *block = contact->block + contact->block_count - 1;
    while (block > contact->block && block->self != contact) block--;
    return block;
}

void tm_contact_add_block(tm_contact *contact, const tm_constraint_block *block) {
    const tm_constraint_block *rows = tm_contact_rows_block(contact);
    tm_constraint_block *to = contact->block + contact->block_count++;
    for (; to > rows; to--) to[0] = to[-1];
    *to = *block;
}

void tm_contact_add_block_behind(tm_contact *contact, const tm_constraint_block *block) {
    contact->block[contact->block_count++] = *block;
}

void tm_contact_remove_block(tm_contact *contact, const void *self) {
    int32_t left = 0;
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].self != self) contact->block[left++] = contact->block[b];
    contact->block_count = left;
}

/* Records the time of each block for its own stage. */
static void charge(tm_world *world, const tm_constraint_block *block, int32_t contact) {
    if (world->timing) tm_profile_enter(world, block->owner ? tm_world_stage_index(world, block->owner) : contact);
}

void tm_contact_constrain(tm_contact *contact, tm_world *world) {
    const int32_t mine = world->profiled;
    const tm_constraint_block *const end = contact->block + contact->block_count;
    for (int32_t sweep = 0; sweep < contact->def.sweeps; sweep++)
        for (const tm_constraint_block *block = contact->block; block < end; block++) {
            if (!block->sweep) continue;
            charge(world, block, mine);
            block->sweep(block->self, world, sweep);
        }
    for (const tm_constraint_block *block = contact->block; block < end; block++) {
        if (!block->finish) continue;
        charge(world, block, mine);
        block->finish(block->self, world);
    }
    if (world->timing) tm_profile_enter(world, mine);
}

static bool is_held(const tm_constraint_block *block, const tm_contact_row *row) {
    for (int j = 0; j < 3; j++)
        if (row->weight[j] > 0 && !block->is_grasped(block->self, row->instrument, row->vertex[j])) return false;
    return true;
}

bool tm_row_is_grasped(const tm_contact *contact, const tm_contact_row *row) {
    bool fixed = false;
    for (int32_t b = 0; b < contact->block_count && !fixed; b++)
        fixed = contact->block[b].is_grasped && is_held(contact->block + b, row);
    return fixed;
}

void tm_contact_push_vertex(tm_contact *contact, int32_t vertex, const double force_N[3]) {
    tm_world *world = contact->world;
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].push && contact->block[b].push(contact->block[b].self, world, vertex, force_N)) return;
    for (int c = 0; c < 3; c++)
        if (!contact->fixed[3 * vertex + c])
            world->state.u_next_m[3 * vertex + c] += world->mobility_s2_kg[vertex] * force_N[c];
}

bool tm_contact_hold_back_blocks(tm_contact *contact, int32_t instrument) {
    bool held_back = false;
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].hold_back)
            held_back |= contact->block[b].hold_back(contact->block[b].self, contact->world, instrument);
    return held_back;
}

double tm_contact_lost_J(const tm_contact *contact) {
    double sum = 0;
    for (int32_t b = 0; b < contact->block_count; b++)
        for (int32_t t = 0; contact->block[b].lost && t < contact->tool_count; t++)
            sum += contact->block[b].lost(contact->block[b].self, contact->world, t);
    return sum;
}

int32_t tm_contact_grasped(const tm_contact *contact, int32_t instrument, const int32_t **vertex,
                           const double **target_m, double *compliance_m_N) {
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].grasped)
            return contact->block[b].grasped(contact->block[b].self, instrument, vertex, target_m, compliance_m_N);
    return 0;
}

tm_jaw_load tm_contact_load(const tm_contact *contact, int32_t instrument) {
    tm_jaw_load load = {0};
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].load) contact->block[b].load(contact->block[b].self, instrument, &load);
    return load;
}

int32_t tm_contact_admit(const tm_contact *contact, int32_t instrument, tm_contact_row *row, int32_t count) {
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].admit) count = contact->block[b].admit(contact->block[b].self, instrument, row, count);
    return count;
}
