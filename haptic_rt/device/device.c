/* The virtual device. Joints are independent masses with friction. The motors and a hand act on them; the hand is a
 * spring and a damper to its target. */
#include "device.h"

#include "motion/kinematics.h"

#include <math.h>
#include <string.h>

enum { BEAT_US = 50000, STEP_US = 250, CATCH_UP_US = 50000, CORRUPT_MAX = 10, FRAMES_PER_STEP = 64, LATE = 64 };
static const double PI = 3.14159265358979323846;

hrt_device_config hrt_device_config_of(const hrt_device_type *device, int32_t instrument) {
    const hrt_twin *twin = hrt_twin_of(device);
    hrt_device_config c = {.instrument = instrument,
                           .roll_grip_rate = 60.0,
                           .watchdog_us = 20000.0,
                           .period_us = 2000.0,
                           .session = 1,
                           .hand = {.tremor_hz = 9.0}};
    for (int j = 0; j < HRT_MOTORS; j++) {
        c.inertia[j] = twin->inertia[j];
        c.viscous[j] = twin->viscous[j];
        c.coulomb[j] = twin->coulomb[j];
        c.hand_stiffness[j] = twin->hand_stiffness[j];
        c.hand_damping[j] = twin->hand_damping[j];
    }
    for (int j = 0; j < HRT_JOINTS; j++) c.rest[j] = twin->rest[j];
    c.turning = twin->turning;
    hrt_params_of_device(&c.profile, device);
    return c;
}

hrt_device_config hrt_device_config_default(int32_t instrument) {
    return hrt_device_config_of(hrt_device_types[0], instrument);
}

void hrt_device_init(hrt_device *device, const hrt_device_config *config, hrt_bus *bus) {
    memset(device, 0, sizeof *device);
    device->config = *config;
    device->bus = bus;
    device->random = config->seed ? config->seed : 1;
    for (int j = 0; j < HRT_JOINTS; j++)
        device->joint[j] = device->target[j] = config->hand.key ? config->hand.key[0].joint[j] : config->rest[j];
    if (config->profile.device->tilts)
        hrt_handle_init(&device->handle, config->profile.device, &device->joint[HRT_TILT]);
}

void hrt_device_hand(hrt_device *device, const double joint[HRT_JOINTS], bool active) {
    device->external = true;
    device->external_active = active;
    memcpy(device->external_target, joint, sizeof device->external_target);
}

/* ---------------------------------------------------------------------------------------------- the hand */

static void want(hrt_device *d, double time_s) {
    const hrt_hand_script *hand = &d->config.hand;
    double target[HRT_JOINTS];
    d->active = false;
    if (d->external) {
        memcpy(target, d->external_target, sizeof target);
        d->active = d->external_active;
        hrt_hand_tremble(hand, d->config.profile.device, time_s, target);
    } else
        hrt_hand_target(hand, d->config.profile.device, d->config.rest, time_s, target, &d->active);
    memcpy(d->target, target, sizeof target);
}

/* ---------------------------------------------------------------------------------------------- motion */

static double shrink(double x, double by) { return x > by ? x - by : x < -by ? x + by : 0.0; }

static bool turns(const hrt_device *d) {
    return d->config.profile.device->tilts && d->config.turning.inertia_kg_m2 > 0.0;
}

/* Moves from the tip to the handle's point (sign -1) or back: the slides hold the tip. */
static void swing(const hrt_device *d, double sign, double joint[HRT_JOINTS]) {
    double by_m[3];
    if (!turns(d) || !(d->arm_m > 0.0)) return;
    hrt_handle_swing(&d->handle, &joint[HRT_TILT], d->arm_m, by_m);
    for (int i = 0; i < 3; i++) joint[i] += sign * by_m[i];
}

static void turn_handle(hrt_device *d, const double before[HRT_JOINTS], double dt_s) {
    const double most = (double)d->config.profile.joint_max[HRT_TILT];
    double tilt[2];
    hrt_handle_turn(&d->handle, &d->config.turning, d->handle_Nm, &before[HRT_TILT], &d->target[HRT_TILT], most, dt_s,
                    tilt);
    for (int i = 0; i < 2; i++) {
        d->velocity[HRT_TILT + i] = (tilt[i] - d->joint[HRT_TILT + i]) / dt_s;
        d->joint[HRT_TILT + i] = tilt[i];
    }
}

/* Moves the joints by a step. Of a device whose handle turns, the slides are moved as its handle's point. */
static void move(hrt_device *d, double dt_s) {
    const hrt_device_config *c = &d->config;
    double before[HRT_JOINTS], target[HRT_JOINTS];
    memcpy(before, d->target, sizeof before);
    want(d, 1.0e-6 * ((double)(d->now_us - d->start_us) - c->start_us));
    const hrt_device_type *type = c->profile.device;
    memcpy(target, d->target, sizeof target);
    swing(d, -1.0, before);
    swing(d, -1.0, target);
    swing(d, -1.0, d->joint);
    for (int j = 0; j < type->joints; j++) {
        if (j >= HRT_TILT && turns(d)) break;
        if (j < type->motors) {
            const double wanted_rate = (target[j] - before[j]) / dt_s;
            const double push =
                d->torque[j] + c->hand_stiffness[j] * (target[j] - d->joint[j]) + c->hand_damping[j] * wanted_rate;
            const double damping = c->hand_damping[j] + c->viscous[j];
            /* Viscous damping is implicit; Coulomb friction is limited to the force that stops the joint within the
             * step. */
            const double v = (d->velocity[j] + dt_s * push / c->inertia[j]) / (1.0 + dt_s * damping / c->inertia[j]);
            d->velocity[j] = shrink(v, dt_s * c->coulomb[j] / c->inertia[j]);
        } else
            d->velocity[j] = (target[j] - d->joint[j]) * fmin(c->roll_grip_rate, 1.0 / dt_s);
        d->joint[j] += dt_s * d->velocity[j];
        const double low = (double)c->profile.joint_min[j], high = (double)c->profile.joint_max[j];
        if (d->joint[j] < low || d->joint[j] > high) {
            d->joint[j] = fmin(fmax(d->joint[j], low), high);
            d->velocity[j] = 0.0;
        }
    }
    if (turns(d)) turn_handle(d, before, dt_s);
    swing(d, 1.0, d->joint);
}

/* Lets the commands act whose delay has passed. */
static void act_late(hrt_device *d) {
    while (d->late_count > 0 && d->late[0].due_us <= d->now_us) {
        memcpy(d->torque, d->late[0].torque, sizeof d->torque);
        memcpy(d->handle_Nm, d->late[0].handle_Nm, sizeof d->handle_Nm);
        memmove(d->late, d->late + 1, sizeof d->late[0] * (size_t)--d->late_count);
    }
}

/* ---------------------------------------------------------------------------------------------- frames */

static void motors_off(hrt_device *d) {
    d->motors_on = false;
    d->late_count = 0;
    for (int j = 0; j < HRT_MOTORS; j++) d->torque[j] = 0.0;
    for (int i = 0; i < 3; i++) d->handle_Nm[i] = 0.0;
}

static void send_message(hrt_device *d, hrt_can_message *m) {
    hrt_can_frame frame;
    m->instrument = d->config.instrument;
    if (hrt_can_pack(m, &frame)) hrt_bus_send(d->bus, &frame);
}

static void fail(hrt_device *d, hrt_device_fault fault) {
    motors_off(d);
    if (d->fault != HRT_DEVICE_FINE) return;
    d->fault = fault;
    hrt_can_message m = {.kind = HRT_CAN_DEVICE_FAULT, .fault = (uint8_t)fault};
    send_message(d, &m);
}

/* Keeps a torque at the handle until its command. The first shows that the slides hold the tip, an arm beyond. */
static void take_handle(hrt_device *d, const hrt_can_message *m) {
    double size2 = 0.0;
    const double most = (double)d->config.profile.handle_torque_max_Nm;
    for (int i = 0; i < 3; i++) size2 += (double)m->handle_Nm[i] * (double)m->handle_Nm[i];
    const double share = size2 > most * most ? most / sqrt(size2) : 1.0;
    for (int i = 0; i < 3; i++) d->handle_sent_Nm[i] = share * (double)m->handle_Nm[i];
    d->handle_counter = m->counter;
    d->handle_waits = true;
    d->arm_m = (double)d->config.profile.arm_m;
}

static void take_command(hrt_device *d, const hrt_can_message *m) {
    const uint8_t step = (uint8_t)((m->counter - d->command_counter) & 0x7F);
    d->corrupt_in_a_row = 0;
    const bool silent =
        (double)(d->heard_us - d->command_us) > d->config.watchdog_us; /* then another controller may start */
    if (d->command_counter_known && (step == 0 || (step >= LATE && !silent))) {
        d->can.repeated++; /* a repeated or overtaken command does not feed the watchdog */
        return;
    }
    if (d->command_counter_known && step > 1 && step < LATE) d->can.lost += step - 1u;
    d->command_counter_known = true;
    d->command_counter = m->counter;
    d->command_us = d->heard_us;
    d->commands++;
    if (!m->motors_on) {
        motors_off(d);
        if (d->fault == HRT_DEVICE_WATCHDOG || d->fault == HRT_DEVICE_BUS_OFF) d->fault = HRT_DEVICE_FINE;
        return;
    }
    if (d->fault != HRT_DEVICE_FINE) return;
    d->motors_on = true;
    double *into = d->torque, *turn = d->handle_Nm;
    if (d->config.delay_us > 0.0 && d->late_count < HRT_DEVICE_LATE) {
        d->late[d->late_count].due_us = d->heard_us + (int64_t)d->config.delay_us;
        turn = d->late[d->late_count].handle_Nm;
        into = d->late[d->late_count++].torque;
    }
    const bool whole = d->handle_waits && d->handle_counter == m->counter;
    for (int i = 0; i < 3; i++) turn[i] = whole ? d->handle_sent_Nm[i] : 0.0;
    d->handle_waits = false;
    for (int j = 0; j < HRT_MOTORS; j++) {
        const double most = (double)d->config.profile.torque_max[j];
        const double torque = (double)m->torque[j] / (double)hrt_can_torque_scale(d->config.profile.device, j);
        into[j] = fmin(fmax(torque, -most), most);
    }
}

static void take_frames(hrt_device *d) {
    hrt_can_frame frame;
    hrt_can_message m;
    for (int i = 0; i < FRAMES_PER_STEP && hrt_bus_receive(d->bus, &frame) > 0; i++) {
        hrt_can_unpack(&frame, &m);
        const bool ours = m.instrument == d->config.instrument;
        switch (m.kind) {
        case HRT_CAN_FOREIGN: d->can.foreign++; break;
        case HRT_CAN_ERROR_FRAME: d->can.error++; break;
        case HRT_CAN_CORRUPT:
            d->can.corrupt++;
            if (ours && ++d->corrupt_in_a_row >= CORRUPT_MAX) fail(d, HRT_DEVICE_BAD_COMMAND);
            break;
        case HRT_CAN_COMMAND:
            if (ours) take_command(d, &m);
            break;
        case HRT_CAN_HANDLE:
            if (ours) take_handle(d, &m);
            break;
        case HRT_CAN_RESET:
            if (!ours) break;
            d->fault = HRT_DEVICE_FINE;
            d->corrupt_in_a_row = 0;
            motors_off(d);
            break;
        case HRT_CAN_ENCODER_A:
        case HRT_CAN_ENCODER_B:
        case HRT_CAN_ENCODER_C:
        case HRT_CAN_DEVICE_BEAT:
        case HRT_CAN_DEVICE_FAULT:
        case HRT_CAN_CONTROLLER_BEAT: break;
        }
    }
    if (hrt_bus_state_now(d->bus) >= HRT_BUS_OFF) {
        if (d->motors_on) fail(d, HRT_DEVICE_BUS_OFF);
        d->can.bus_off++;
        hrt_bus_recover(d->bus, d->heard_us);
    }
}

static double uniform(hrt_device *d) {
    d->random ^= d->random << 13;
    d->random ^= d->random >> 7;
    d->random ^= d->random << 17;
    return (double)(d->random >> 11) * 0x1.0p-53;
}

static int32_t encoder(hrt_device *d, int j) {
    double counts = hrt_count_of_joint64(&d->config.profile, j, d->joint[j]);
    if (d->config.noise_counts > 0.0)
        counts += d->config.noise_counts * sqrt(-2.0 * log(uniform(d) + 1.0e-300)) * cos(2.0 * PI * uniform(d));
    return (int32_t)lrint(counts);
}

static void send_tilt(hrt_device *d) {
    hrt_can_message c = {.kind = HRT_CAN_ENCODER_C, .counter = d->encoder_counter};
    for (int j = 0; j < 2; j++) c.tilt[j] = encoder(d, HRT_TILT + j);
    send_message(d, &c);
}

static void send_frames(hrt_device *d, int64_t now_us) {
    if (!d->unplugged && (double)(now_us - d->sent_us) >= d->config.period_us) {
        hrt_can_message a = {.kind = HRT_CAN_ENCODER_A, .counter = ++d->encoder_counter};
        hrt_can_message b = {.kind = HRT_CAN_ENCODER_B, .counter = d->encoder_counter, .pedal = d->active};
        const int joints = d->config.profile.device->joints;
        for (int j = 0; j < joints && j < HRT_CAN_JOINTS; j++) a.count[j] = b.count[j] = encoder(d, j);
        send_message(d, &a);
        if (d->config.profile.device->tilts) send_tilt(d);
        send_message(d, &b);
        /* Keeps the period; after a stall restarts it rather than catching up. */
        const int64_t period = (int64_t)d->config.period_us;
        d->sent_us = now_us - d->sent_us < 2 * period ? d->sent_us + period : now_us;
    }
    if (d->unplugged || (d->beat_us != 0 && now_us - d->beat_us < BEAT_US)) return;
    hrt_can_message beat = {.kind = HRT_CAN_DEVICE_BEAT,
                            .counter = d->beat_counter++,
                            .state = d->fault != HRT_DEVICE_FINE ? 2
                                     : d->motors_on              ? 1
                                                                 : 0,
                            .fault = (uint8_t)d->fault,
                            .session = d->config.session,
                            .gaps = (uint16_t)d->can.lost};
    send_message(d, &beat);
    d->beat_us = now_us;
}

void hrt_device_step(hrt_device *d, int64_t now_us) {
    if (!d->started) {
        d->started = true;
        d->start_us = d->now_us = d->command_us = now_us;
        d->sent_us = now_us - (int64_t)d->config.period_us;
    }
    d->heard_us = now_us;
    if (!d->unplugged) take_frames(d);
    if (now_us - d->now_us > CATCH_UP_US) d->now_us = now_us - CATCH_UP_US;
    while (d->now_us < now_us) {
        const int64_t step = now_us - d->now_us < STEP_US ? now_us - d->now_us : STEP_US;
        d->now_us += step;
        if (d->motors_on && (double)(d->now_us - d->command_us) > d->config.watchdog_us) fail(d, HRT_DEVICE_WATCHDOG);
        act_late(d);
        move(d, 1.0e-6 * (double)step);
    }
    send_frames(d, now_us);
}
