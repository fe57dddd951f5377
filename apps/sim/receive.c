#include "receive.h"

static app_verdict take_tool(void *user, int instrument, int64_t utime, const void *message) {
    (void)utime;
    sim_ears *ears = user;
    const tensormass_tool_state_t *m = message;
    if (ears->sealed && m->sim_session == 0) return APP_LEFT; /* it has not received ours yet */
    if (ears->sealed &&
        (m->sim_session != ears->session || !app_replay_fresh(&ears->tools[instrument], m->session, (uint32_t)m->seq)))
        return APP_FORGED;
    ears->listener.tool(ears->listener.user, instrument, m);
    return APP_TAKEN;
}

static app_verdict take_controller(void *user, int instrument, int64_t utime, const void *message) {
    (void)utime;
    sim_ears *ears = user;
    const tensormass_controller_status_t *m = message;
    if (ears->sealed && !app_replay_fresh(&ears->statuses[instrument], m->session, (uint32_t)m->seq)) return APP_FORGED;
    ears->listener.controller(ears->listener.user, instrument, m);
    return APP_TAKEN;
}

int sim_ears_topics(sim_ears *ears, int instruments, app_topic topic[SIM_TOPICS]) {
    int count = 0;
    for (int i = 0; i < instruments; i++) {
        topic[count++] = (app_topic){APP_TOOL, i, take_tool, ears};
        topic[count++] = (app_topic){APP_CONTROLLER, i, take_controller, ears};
    }
    return count;
}
