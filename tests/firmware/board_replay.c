/* A board whose bus and link are recordings: reads replay.in, writes replay.out and replay.cost in the working
 * directory. Runs on the emulated board by semihosting and, with port_host.c, on the host. The timer is the port's. */
#include "port.h"
#include "replay.h"

static uint8_t input[REPLAY_TICK_MAX], output[1024];
static replay_bytes events, results;
static int32_t in_file, out_file, cost_file;
static int64_t now_us;
static bool bus_ok = true;
static uint32_t began[2];
static uint32_t cost[2 * FW_DEVICES]; /* instructions of hrt_tick of each device, then of the patch check of each */
static void (*tick_handler)(void);

/* ---- reads the next event if it has this kind and device ---- */

static bool next_is(uint8_t kind, int32_t device) {
    return events.end - events.at >= 2 && events.at[0] == kind && (device < 0 || events.at[1] == device);
}
static void take_head(void) { events.at += 2; }

/* ---- board.h ---- */

/* Main reads a tick's events, runs the background on them and sleeps; the tick's interrupt uses the other events. */
static void read_events(void) {
    uint32_t size;
    if (!semihost_read(in_file, &size, 4)) {
        semihost_close(out_file);
        semihost_close(cost_file);
        port_finish();
    }
    if (size > sizeof input || !semihost_read(in_file, input, size)) fw_board_panic("replay.in is cut off");
    events = (replay_bytes){.at = input, .end = input + size};
    if (next_is(EVENT_BUS, -1)) {
        bus_ok = input[1];
        take_head();
    }
}

void fw_board_start(void (*tick)(void)) {
    tick_handler = tick;
    in_file = semihost_open("replay.in", false);
    out_file = semihost_open("replay.out", true);
    cost_file = semihost_open("replay.cost", true);
    if (in_file < 0 || out_file < 0 || cost_file < 0)
        fw_board_panic("replay.in, replay.out or replay.cost cannot be opened");
    read_events();
    port_start();
}

void port_tick(void) {
    results = (replay_bytes){.at = output, .end = output + sizeof output, .write = true};
    now_us += FW_PERIOD_US;
    tick_handler();
}

void fw_board_sleep(void) {
    port_wait_tick();
    if (results.failed) fw_board_panic("a tick's output is larger than its buffer");
    if (!semihost_write(out_file, output, (uint32_t)(results.at - output)) ||
        !semihost_write(cost_file, cost, sizeof cost))
        fw_board_panic("replay.out cannot be written");
    for (int32_t i = 0; i < 2 * FW_DEVICES; i++) cost[i] = 0;
    read_events();
}

int64_t fw_board_now_us(void) { return now_us; }
void fw_board_watchdog(void) {}
_Noreturn void fw_board_panic(const char *why) { port_panic(why); }

bool fw_can_ok(void) { return bus_ok; }

bool fw_can_receive(hrt_can_frame *frame) {
    if (!next_is(EVENT_FRAME, -1)) return false;
    take_head();
    replay_frame(&events, frame);
    return !events.failed;
}

bool fw_can_send(const hrt_can_frame *frame) {
    hrt_can_frame copy = *frame;
    uint8_t kind = OUT_FRAME;
    replay_u8(&results, &kind);
    replay_frame(&results, &copy);
    return true;
}

void fw_link_receive(int32_t device, fw_news *news, hrt_sample *sample, hrt_patch *patch) {
    if (next_is(EVENT_COMMAND, device)) {
        take_head();
        replay_command(&events, news);
        news->command = true;
    }
    if (next_is(EVENT_PATCH, device)) {
        take_head();
        static hrt_patch unwanted;
        replay_patch(&events, patch ? patch : &unwanted);
        news->patch = patch != NULL;
    }
    if (next_is(EVENT_SAMPLE, device)) {
        take_head();
        replay_sample(&events, sample);
        news->sample = true;
    }
    if (events.failed) fw_board_panic("replay.in has an event cut off");
}

void fw_link_send(int32_t device, const hrt_result *tick) {
    hrt_result copy = *tick;
    uint8_t kind = OUT_RESULT;
    (void)device;
    replay_u8(&results, &kind);
    replay_result(&results, &copy);
}

void fw_measure_begin(int32_t device, fw_span span) {
    (void)device;
    began[span] = port_count();
}
void fw_measure_end(int32_t device, fw_span span) { cost[span * FW_DEVICES + device] = port_since(began[span]); }
