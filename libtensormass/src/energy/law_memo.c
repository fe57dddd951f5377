#include "energy/law_memo.h"

#include <string.h>

void tm_law_memo_init(tm_law_memo *memo, tm_pool *pool, const tm_mesh *mesh) {
    const int64_t n = 3 * (int64_t)mesh->vertex_count;
    *memo = (tm_law_memo){.bytes = n * (int64_t)sizeof(double)};
    for (int i = 0; i < TM_LAW_MEMO; i++)
        memo->at[i].u_m = TM_ALLOC(pool, double, n), memo->at[i].force_N = TM_ALLOC(pool, double, n);
}

void tm_law_memo_forget(tm_law_memo *memo) {
    for (int i = 0; i < TM_LAW_MEMO; i++) memo->at[i].known = false;
}

const double *tm_law_memo_get(tm_law_memo *memo, const tm_world *world, const double *u_m, double *energy_J) {
    const tm_nonlinear *law = world->nonlinear;
    if (!memo->bytes) { /* the law came after the account */
        *energy_J = law->energy(law->self, u_m);
        law->force(law->self, u_m, law->scratch_N);
        return law->scratch_N;
    }
    if (memo->law != law || memo->revision != world->tissue->surface.revision) tm_law_memo_forget(memo);
    memo->law = law, memo->revision = world->tissue->surface.revision;
    int32_t i = 0;
    while (i < TM_LAW_MEMO && !(memo->at[i].known && !memcmp(memo->at[i].u_m, u_m, (size_t)memo->bytes))) i++;
    if (i == TM_LAW_MEMO) {
        i = memo->next;
        memcpy(memo->at[i].u_m, u_m, (size_t)memo->bytes);
        memo->at[i].energy_J = law->energy(law->self, u_m);
        law->force(law->self, u_m, memo->at[i].force_N);
        memo->at[i].known = true;
        memo->next = (i + 1) % TM_LAW_MEMO;
    }
    *energy_J = memo->at[i].energy_J;
    return memo->at[i].force_N;
}
