/* Links: faults of network, clock, simulation or device. A hand presses a spring wall through the real node, codec and
 * virtual device on a virtual clock; a line between wall and node loses, delays, duplicates and reorders messages. In
 * all cases the force at the motors stays finite and within the device's limit, and ends at the right value. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "device/device.h"
#include "io/node.h"
#include "stability.h"

enum { TICK_US = 2000, FRAME_US = 34000, LINE_MAX = 64, SENT_MAX = 64 };

typedef struct line_def {
    double loss; /* share of samples lost */
    int burst;   /* successive samples lost, each time one is */
    int64_t delay_us, jitter_us;
    bool doubled, reordered;
    uint32_t first_seq;
    double kill_s, restart_s; /* simulation absent between; 0: never */
    bool two_sims;
    double wall_N_m;
    void (*spoil)(tensormass_force_sample_t *sample, int64_t n); /* null: correct samples */
    double silent_s, babble_s; /* times: device unplugged; a babbling node on the bus; 0: never */
    double clock_back_s;       /* the caller's clock steps back by 50 ms at this time */
    const hrt_keyframe *hand;  /* null: the default press */
    int hand_count;
    double noise_counts;
    hrt_extrapolator extrapolator;
    double seconds;
} line_def;

static const hrt_keyframe press[] = {
    {.time_s = 0.0, .joint = {0, 0, 0.10, 0, 0}},         {.time_s = 1.0, .joint = {0, 0, 0.10, 0, 0}},
    {.time_s = 2.0, .joint = {0.02, 0, 0.116, 0, 0}},     {.time_s = 2.6, .joint = {0.02, 0.03, 0.116, 0, 0}},
    {.time_s = 3.2, .joint = {-0.02, 0.03, 0.104, 0, 0}}, {.time_s = 4.0, .joint = {0, 0, 0.118, 0, 0}},
    {.time_s = 6.0, .joint = {0, 0, 0.118, 0, 0}}};
static const hrt_keyframe still[] = {{.time_s = 0, .joint = {0, 0, 0.10, 0, 0}},
                                     {.time_s = 1, .joint = {0, 0, 0.10, 0, 0}},
                                     {.time_s = 1.5, .joint = {0, 0, 0.112, 0, 0}}};
static const hrt_keyframe reverse[] = {{.time_s = 0, .joint = {0, 0, 0.10, 0, 0}},
                                       {.time_s = 1, .joint = {0, 0, 0.106, 0, 0}},
                                       {.time_s = 1.2, .joint = {0, 0, 0.118, 0, 0}},
                                       {.time_s = 1.4, .joint = {0, 0, 0.106, 0, 0}}};

typedef struct link_run {
    const line_def *def;
    hrt_loopback loopback;
    hrt_bus node_bus, device_bus, babbler;
    hrt_node node;
    hrt_device device;
    struct pending {
        int64_t due_us;
        tensormass_force_sample_t sample;
    } line[LINE_MAX];
    int in_line;
    int64_t session, frames;
    uint32_t seq;
    uint64_t random;
    int losing;
    /* measured */
    double peak_N, peak_true_N, sum_sq, last_N, quiet_s;
    int64_t compared;
    double limit_N;
    bool finite, engaged, faulted;
    hrt_fault fault;
} link_run;

static const double WALL_M = 0.105;

/* Computes the wall's force along -z, with slight lateral compliance so that all axes are used. */
static void wall(const line_def *def, const double tip[3], double force[3], double stiffness[9]) {
    double depth = tip[2] - WALL_M;
    memset(force, 0, 3 * sizeof *force);
    memset(stiffness, 0, 9 * sizeof *stiffness);
    if (depth <= 0) return;
    force[2] = -def->wall_N_m * depth;
    force[0] = -0.2 * def->wall_N_m * tip[0], force[1] = -0.2 * def->wall_N_m * tip[1];
    stiffness[8] = -def->wall_N_m, stiffness[0] = stiffness[4] = -0.2 * def->wall_N_m;
}

static bool lost(link_run *r) {
    if (r->losing > 0) return r->losing--, true;
    if (0.5 * (1 + random_unit(&r->random)) >= r->def->loss) return false;
    r->losing = r->def->burst > 1 ? r->def->burst - 1 : 0;
    return true;
}

/* Runs one frame of the simulation: samples the tool, sends the samples that the line passes. */
static void simulate(link_run *r, int64_t now_us, const tensormass_tool_state_t *tool, int64_t session,
                     double stiffer) {
    tensormass_force_sample_t s = {.utime = now_us,
                                   .session = session,
                                   .tool_session = tool->session,
                                   .tool_utime = tool->utime,
                                   .seq = (int32_t)r->seq++,
                                   .stiffness_kind = 2};
    memcpy(s.tip_m, tool->tip_m, sizeof s.tip_m);
    wall(r->def, s.tip_m, s.force_N, s.stiffness_N_m);
    for (int i = 0; i < 3; i++) s.force_N[i] *= stiffer;
    if (r->def->spoil) r->def->spoil(&s, r->frames);
    r->frames++;
    if (lost(r)) return;
    int64_t due =
        now_us + r->def->delay_us + (int64_t)(0.5 * (1 + random_unit(&r->random)) * (double)r->def->jitter_us);
    if (r->def->reordered && r->frames % 3 == 0) due += FRAME_US + FRAME_US / 2;
    for (int copy = 0; copy <= r->def->doubled && r->in_line < LINE_MAX; copy++)
        r->line[r->in_line++] = (struct pending){due + copy * TICK_US, s};
}

static void deliver(link_run *r, int64_t now_us) {
    int kept = 0;
    for (int i = 0; i < r->in_line; i++) {
        if (r->line[i].due_us <= now_us)
            hrt_node_post_sample(&r->node, &r->line[i].sample);
        else
            r->line[kept++] = r->line[i];
    }
    r->in_line = kept;
}

static void judge(link_run *r, double time_s, outcome *o) {
    const float *f = r->node.result.force_N;
    double size = sqrt((double)f[0] * f[0] + (double)f[1] * f[1] + (double)f[2] * f[2]), truth[3], ignored[9], tip[3],
           error = 0, size_true = 0;
    for (int i = 0; i < 3; i++) tip[i] = r->node.result.tip_m[i];
    wall(r->def, tip, truth, ignored);
    for (int i = 0; i < 3; i++) error += (f[i] - truth[i]) * (f[i] - truth[i]), size_true += truth[i] * truth[i];
    r->finite = r->finite && isfinite(size);
    r->peak_N = fmax(r->peak_N, size), r->peak_true_N = fmax(r->peak_true_N, sqrt(size_true));
    if (r->node.result.state == HRT_ENGAGED && r->node.result.gain >= 1)
        r->sum_sq += error, r->compared++, r->engaged = true;
    if (r->node.result.state == HRT_FAULT && !r->faulted) r->faulted = true, r->fault = r->node.result.fault;
    if (size > 1e-3) r->quiet_s = time_s;
    r->last_N = size;
    if ((int64_t)(time_s * 500) % 10 == 0) series_add(o, time_s, size);
}

static bool set_up(link_run *r, const line_def *def) {
    memset(r, 0, sizeof *r);
    r->def = def, r->session = 100, r->seq = def->first_seq, r->random = 5, r->finite = true;
    hrt_loopback_init(&r->loopback);
    if (!hrt_bus_open_loopback(&r->node_bus, &r->loopback) || !hrt_bus_open_loopback(&r->device_bus, &r->loopback) ||
        !hrt_bus_open_loopback(&r->babbler, &r->loopback))
        return false;
    hrt_node_config node = hrt_node_config_default(0);
    node.pose_known = true, node.extrapolator = def->extrapolator, node.passivity = true;
    r->limit_N = node.params.force_max_N;
    hrt_node_init(&r->node, &node, &r->node_bus);
    hrt_device_config device = hrt_device_config_default(0);
    device.hand.key = def->hand ? def->hand : press,
    device.hand.key_count = def->hand ? def->hand_count : (int)(sizeof press / sizeof *press);
    device.seed = 11, device.noise_counts = def->noise_counts;
    hrt_device_init(&r->device, &device, &r->device_bus);
    return true;
}

static void babble(link_run *r) {
    /* Random identifiers and bytes: foreign frames, and forged own ones with wrong checksums. */
    for (int i = 0; i < 20; i++) {
        hrt_can_frame unread, frame = {.id = (uint32_t)(0x7ff * 0.5 * (1 + random_unit(&r->random))), .length = 8};
        for (int b = 0; b < 8; b++) frame.data[b] = (uint8_t)(255 * 0.5 * (1 + random_unit(&r->random)));
        hrt_bus_send(&r->babbler, &frame);
        while (hrt_bus_receive(&r->babbler, &unread) == 1) {
        }
    }
}

static void run_line(const line_def *def, link_run *r, outcome *o) {
    tensormass_tool_state_t tool = {0};
    o->x_name = "s", o->y_name = "force N";
    if (!set_up(r, def)) return;
    int64_t back_us = 0;
    for (int64_t t = 0; t < (int64_t)(def->seconds * 1e6); t += TICK_US) {
        double time_s = 1e-6 * (double)t;
        bool sim_gone = def->kill_s > 0 && time_s >= def->kill_s && !(def->restart_s > 0 && time_s >= def->restart_s);
        if (def->restart_s > 0 && time_s >= def->restart_s && r->session == 100) r->session = 200, r->seq = 0;
        if (def->clock_back_s > 0 && time_s >= def->clock_back_s) back_us = 50000;
        int64_t now = 1000000 + t - back_us;
        if (def->silent_s <= 0 || time_s < def->silent_s) hrt_device_step(&r->device, now);
        if (def->babble_s > 0 && time_s >= def->babble_s) babble(r);
        deliver(r, now);
        hrt_node_tick(&r->node, now, &tool);
        if (t % FRAME_US < TICK_US && !sim_gone) {
            simulate(r, now, &tool, r->session, 1);
            if (def->two_sims) simulate(r, now, &tool, 300, 3);
        }
        judge(r, time_s, o);
    }
}

/* Sets the figure to the maximum force over the device's limit and reports the loss of accuracy. */
static void verdict_of(const link_run *r, outcome *o) {
    double rms = r->compared ? sqrt(r->sum_sq / (double)r->compared) / r->peak_true_N : 0;
    char end[160];
    snprintf(end, sizeof end, r->faulted ? "fault '%s', latched" : "ended %s",
             r->faulted ? hrt_fault_text(r->fault) : hrt_state_name(r->node.result.state));
    if (!r->finite)
        broken(o, "a force was not finite");
    else if (!r->engaged)
        broken(o, "never engaged (%s)", end);
    else {
        tensormass_controller_status_t status;
        hrt_node_status(&r->node, &status);
        stable(
            o, r->peak_N / r->limit_N,
            "peak %.2f N of %.1f, RMS error %.1f %% of peak while engaged, samples: %lld rejected, %lld late, %lld lost; %s",
            r->peak_N, r->limit_N, 100 * rms, (long long)status.samples_rejected, (long long)status.samples_late,
            (long long)status.samples_lost, end);
    }
}

/* --- lines --- */

static void zero(tensormass_force_sample_t *s, int64_t n) {
    if (n % 3 == 1) memset(s->force_N, 0, sizeof s->force_N);
}
static void tiny(tensormass_force_sample_t *s, int64_t n) {
    for (int i = 0; i < 3 && n % 3 == 1; i++) s->force_N[i] = 1e-310, s->tip_m[i] *= 1 + 1e-12;
}
static void huge(tensormass_force_sample_t *s, int64_t n) {
    for (int i = 0; i < 3 && n % 3 == 1; i++) s->force_N[i] = i == 1 ? -1e30 : 1e30;
}
static void large(tensormass_force_sample_t *s, int64_t n) {
    for (int i = 0; i < 9 && n % 3 == 1; i++) s->stiffness_N_m[i] = 1e7, s->force_N[i % 3] = 50 * (n % 2 ? 1 : -1);
}
static void not_a_number(tensormass_force_sample_t *s, int64_t n) {
    if (n % 3 == 1) s->force_N[n % 3] = NAN, s->stiffness_N_m[n % 9] = INFINITY;
}
static void anything(tensormass_force_sample_t *s, int64_t n) {
    /* Every byte of the message may take any value. */
    uint64_t seed = (uint64_t)n * 2654435761u + 17;
    if (n < 40 || n % 2) return;
    unsigned char *byte = (unsigned char *)s;
    for (size_t i = 0; i < sizeof *s; i += 1 + (size_t)(3 + 3 * random_unit(&seed)))
        byte[i] = (unsigned char)(127 * (1 + random_unit(&seed)));
}
enum {
    HAND_STILL,
    HAND_REVERSES,
    HAND_ONE_COUNT,
    FORCE_ZERO,
    FORCE_TINY,
    FORCE_LARGE,
    FORCE_HUGE,
    FORCE_NAN,
    FORCE_ANYTHING,
    WALL_STIFF,
    LOSS_10,
    LOSS_30,
    LOSS_50,
    LOSS_BURSTS,
    DOUBLED,
    REORDERED,
    DELAY_50,
    DELAY_500,
    CLOCK_BACK,
    SEQ_WRAPS,
    SIM_KILLED,
    SIM_RESTARTED,
    TWO_SIMS,
    DEVICE_SILENT,
    DEVICE_BABBLES
};
static const line_def lines[] = {[HAND_STILL] = {.hand = still, .hand_count = 3},
                                 [HAND_REVERSES] = {.hand = reverse, .hand_count = 4, .seconds = 4},
                                 [HAND_ONE_COUNT] = {.hand = still, .hand_count = 3, .noise_counts = 0.6},
                                 [FORCE_ZERO] = {.spoil = zero},
                                 [FORCE_TINY] = {.spoil = tiny},
                                 [FORCE_LARGE] = {.spoil = large},
                                 [FORCE_HUGE] = {.spoil = huge},
                                 [FORCE_NAN] = {.spoil = not_a_number},
                                 [FORCE_ANYTHING] = {.spoil = anything},
                                 [WALL_STIFF] = {.wall_N_m = 5000},
                                 [LOSS_10] = {.loss = 0.1},
                                 [LOSS_30] = {.loss = 0.3},
                                 [LOSS_50] = {.loss = 0.5},
                                 [LOSS_BURSTS] = {.loss = 0.1, .burst = 8},
                                 [DOUBLED] = {.doubled = true},
                                 [REORDERED] = {.reordered = true, .jitter_us = 20000},
                                 [DELAY_50] = {.delay_us = 50000},
                                 [DELAY_500] = {.delay_us = 500000},
                                 [CLOCK_BACK] = {.clock_back_s = 2.5, .seconds = 5},
                                 [SEQ_WRAPS] = {.first_seq = UINT32_MAX - 60},
                                 [SIM_KILLED] = {.kill_s = 2.5, .seconds = 4},
                                 [SIM_RESTARTED] = {.kill_s = 2.5, .restart_s = 3.5},
                                 [TWO_SIMS] = {.two_sims = true},
                                 [DEVICE_SILENT] = {.silent_s = 2.5, .seconds = 4},
                                 [DEVICE_BABBLES] = {.babble_s = 1.5}};

/* Returns the default line: 300 N/m for six seconds. */
static line_def line_of(double which, hrt_extrapolator extrapolator) {
    line_def def = lines[(int)which];
    if (!(def.wall_N_m > 0)) def.wall_N_m = 300;
    if (!(def.seconds > 0)) def.seconds = 6;
    def.extrapolator = extrapolator;
    return def;
}

/* Runs every extrapolator in turn; the figure is the worst force. */
static void every_extrapolator(bool quick, double which, outcome *o) {
    static link_run r;
    outcome kept = {0};
    double worst = -1;
    (void)quick;
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
        outcome one = {0};
        const line_def def = line_of(which, (hrt_extrapolator)x);
        run_line(&def, &r, &one);
        verdict_of(&r, &one);
        if (one.verdict != STABLE) {
            *o = one;
            return;
        }
        if (one.figure > worst) {
            worst = one.figure, kept = one;
            snprintf(kept.text, sizeof kept.text, "worst of all extrapolators is %s: %s",
                     hrt_extrapolator_name(def.extrapolator), one.text);
        }
    }
    *o = kept;
}

/* The force must vanish within 150 ms after the last valid sample, without a fault of the controller. */
static void judge_kill(const link_run *r, outcome *o) {
    const double late_ms = 1e3 * (r->quiet_s - r->def->kill_s);
    if (r->def->restart_s > 0) {
        if (r->last_N < 0.1 || r->node.result.state != HRT_ENGAGED)
            broken(o, "the restarted simulation was not taken up again");
    } else if (late_ms > 150)
        broken(o, "force was still rendered %.0f ms after the simulation was killed", late_ms);
    else
        snprintf(o->text + strlen(o->text), sizeof o->text - strlen(o->text),
                 ", zero force %.0f ms after the last frame", late_ms);
}

/* Runs `tangent` only. */
static void once(bool quick, double which, outcome *o) {
    static link_run r;
    static line_def def;
    tensormass_controller_status_t status;
    (void)quick;
    def = line_of(which, HRT_TANGENT);
    run_line(&def, &r, o);
    /* A sample this late is stale on arrival: zero force is the correct result. */
    if (def.delay_us > 200000 && r.finite && !r.engaged) {
        stable(o, r.peak_N / r.limit_N,
               "every sample is older than the stale limit: the controller never engages, peak force %.2g N", r.peak_N);
        return;
    }
    verdict_of(&r, o);
    if (o->verdict != STABLE) return;
    hrt_node_status(&r.node, &status);
    if (def.first_seq && status.samples_lost + status.samples_late > 0)
        broken(o, "samples counted as lost or late when seq wrapped");
    if (def.kill_s > 0) judge_kill(&r, o);
    if (def.silent_s > 0 && (r.quiet_s > def.silent_s + 0.02 || r.node.result.state == HRT_ENGAGED))
        broken(o, "force for %.3f s after the device fell silent, ended %s", r.quiet_s - def.silent_s,
               hrt_state_name(r.node.result.state));
}

#define LINK "link"
#define OVER "peak force over the limit"
const hard_case cases_link[] = {
    {LINK, "hand-still", "the hand stands still in contact, every extrapolator", STABLE, 1, OVER, every_extrapolator,
     HAND_STILL},
    {LINK, "hand-reverses", "the hand reverses at 0.1 m/s, every extrapolator", STABLE, 1, OVER, every_extrapolator,
     HAND_REVERSES},
    {LINK, "hand-one-count", "encoders jitter by one count, every extrapolator", STABLE, 1, OVER, every_extrapolator,
     HAND_ONE_COUNT},
    {LINK, "force-zero", "every third sample says zero", STABLE, 1, OVER, every_extrapolator, FORCE_ZERO},
    {LINK, "force-tiny", "every third sample is subnormal", STABLE, 1, OVER, every_extrapolator, FORCE_TINY},
    {LINK, "force-large", "every third sample is 50 N with a stiffness of 1e7 N/m", STABLE, 1, OVER, every_extrapolator,
     FORCE_LARGE},
    {LINK, "force-huge", "every third sample is 1e30 N", STABLE, 1, OVER, every_extrapolator, FORCE_HUGE},
    {LINK, "force-nan", "every third sample holds NaN and infinity", STABLE, 1, OVER, every_extrapolator, FORCE_NAN},
    {LINK, "force-anything", "random bytes in half of the samples", STABLE, 1, OVER, every_extrapolator,
     FORCE_ANYTHING},
    {LINK, "wall-stiff", "a wall of 5 kN/m, beyond what the device can render", STABLE, 1, OVER, every_extrapolator,
     WALL_STIFF},
    {LINK, "loss-10", "10 % of the samples lost", STABLE, 1, OVER, every_extrapolator, LOSS_10},
    {LINK, "loss-30", "30 % lost", STABLE, 1, OVER, every_extrapolator, LOSS_30},
    {LINK, "loss-50", "50 % lost", STABLE, 1, OVER, every_extrapolator, LOSS_50},
    {LINK, "loss-bursts", "bursts of eight lost in a row", STABLE, 1, OVER, every_extrapolator, LOSS_BURSTS},
    {LINK, "doubled", "every sample twice", STABLE, 1, OVER, every_extrapolator, DOUBLED},
    {LINK, "reordered", "samples overtake each other", STABLE, 1, OVER, every_extrapolator, REORDERED},
    {LINK, "delay-50", "50 ms late", STABLE, 1, OVER, once, DELAY_50},
    {LINK, "delay-500", "500 ms late", STABLE, 1, OVER, once, DELAY_500},
    {LINK, "clock-back", "the caller's clock steps back by 50 ms", STABLE, 1, OVER, once, CLOCK_BACK},
    {LINK, "seq-wraps", "seq wraps from 2^32-1 to 0", STABLE, 1, OVER, once, SEQ_WRAPS},
    {LINK, "sim-killed", "the simulation is killed in contact", STABLE, 1, OVER, once, SIM_KILLED},
    {LINK, "sim-restarted", "killed, and restarted a second later", STABLE, 1, OVER, once, SIM_RESTARTED},
    {LINK, "two-sims", "two simulations on one channel, one three times stiffer", STABLE, 1, OVER, every_extrapolator,
     TWO_SIMS},
    {LINK, "device-silent", "the device falls silent in contact", STABLE, 1, OVER, once, DEVICE_SILENT},
    {LINK, "device-babbles", "ten thousand random frames a second on the bus", STABLE, 1, OVER, once, DEVICE_BABBLES},
};
const int cases_link_count = sizeof cases_link / sizeof *cases_link;
