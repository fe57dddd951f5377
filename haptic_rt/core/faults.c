/* Names and texts of states and faults; latches the first fault. */
#include "internal.h"

static const char *const state_name[HRT_STATE_COUNT] = {"boot", "self_test", "idle", "engaged", "stale", "fault"};

static const struct {
    const char *name, *text;
} fault_row[HRT_FAULT_COUNT] = {
    [HRT_FAULT_NONE] = {"none", "No fault."},
    [HRT_FAULT_PARAMETER] = {"parameter", "A parameter is outside its range; repair the profile and start again."},
    [HRT_FAULT_DEVICE_SILENT] =
        {"device_silent",
         "The device stopped sending its encoders while in use; check its cable and power, then reset."},
    [HRT_FAULT_DEVICE_REPORTED] = {"device_reported",
                                   "The device reports a fault; clear it on the device, then reset."},
    [HRT_FAULT_DEVICE_RESTARTED] = {"device_restarted",
                                    "The device restarted while in use; check that the hand is free, then reset."},
    [HRT_FAULT_BUS_OFF] = {"bus_off",
                           "The CAN controller left the bus; check wiring, termination and bit rate, then reset."},
    [HRT_FAULT_ENCODER_RANGE] =
        {"encoder_range",
         "An encoder reads outside the workspace; calibrate the device or repair the profile, then reset."},
    [HRT_FAULT_ENCODER_JUMP] = {"encoder_jump", "An encoder moved faster than possible; check its cable, then reset."},
    [HRT_FAULT_ENCODER_STUCK] =
        {"encoder_stuck",
         "An encoder did not move while the torque on its joint changed much; check encoder and motor, then reset."},
    [HRT_FAULT_CLOCK] = {"clock", "The clock went backwards; use a monotonic clock, then reset."},
    [HRT_FAULT_TICK_LATE] = {"tick_late",
                             "The control loop was stopped too long; free a processor for it, then reset."},
    [HRT_FAULT_SELF_TEST] =
        {"self_test", "The self test was not passed in time; check that the device sends without pause, then reset."},
    [HRT_FAULT_INTERNAL] = {"internal",
                            "A force that is not a number was computed; keep the recording and report it, then reset."},
    [HRT_FAULT_BUS_CONFLICT] = {"bus_conflict",
                                "Another controller commands this device on the same bus; end it, then reset."},
};

const char *hrt_state_name(hrt_state state) {
    return (int)state >= 0 && state < HRT_STATE_COUNT ? state_name[state] : "unknown";
}

const char *hrt_fault_name(hrt_fault fault) {
    return (int)fault >= 0 && fault < HRT_FAULT_COUNT ? fault_row[fault].name : "unknown";
}

const char *hrt_fault_text(hrt_fault fault) {
    return (int)fault >= 0 && fault < HRT_FAULT_COUNT ? fault_row[fault].text : "Unknown fault.";
}

void hrt_latch(hrt_controller *c, int64_t now_us, hrt_fault fault, int32_t detail) {
    if (c->state == HRT_FAULT) return;
    c->fault = fault;
    c->fault_detail = detail;
    c->state = HRT_FAULT;
    c->state_since_us = now_us;
}
