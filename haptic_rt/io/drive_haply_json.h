/* Messages of Haply's Inverse Service, versions 3.1 to 3.5 (docs.haply.co, "WebSocket Protocol"): the inventory,
 * states, and the command. No network. */
#ifndef HRT_DRIVE_HAPLY_JSON_H
#define HRT_DRIVE_HAPLY_JSON_H

#include <stdio.h>

#include "drive.h"

enum { HRT_HAPLY_ID = 40, HRT_HAPLY_MESSAGE_MAX = 65536, HRT_HAPLY_COMMAND_MAX = 512 };

typedef struct hrt_haply_device {
    char id[HRT_HAPLY_ID], type[HRT_HAPLY_ID];
    int32_t number;             /* in the inventory, from 0 */
    bool is_3_5;                /* the service speaks 3.5: `vector` and filters; before: `values` */
    double force_gate, damping; /* the service's filters; negative: not told */
} hrt_haply_device;

/* Finds device `number` in the service's first message. Returns false, with `why`, if it is none or lacks that device.
 */
bool hrt_haply_inventory(const char *text, int32_t number, hrt_haply_device *device, char *why, int why_size);
/* Prints a line for each device of the inventory. Returns their number, -1 if the text is no inventory. */
int hrt_haply_print(const char *text, FILE *file);
/* Reads a state. `time_us` is the caller's. Returns false if it lacks the device or its cursor. `trouble`: null, or why
 * the device renders no force; `filters` of the device are updated where the message tells them. */
bool hrt_haply_state(const char *text, hrt_haply_device *device, hrt_drive_state *state, const char **trouble);
/* Writes the command; the first of a connection also switches the service's filters off, since they change the force,
 * and asks for the configuration, which shows whether they are. Returns its length. */
int hrt_haply_command(char text[HRT_HAPLY_COMMAND_MAX], const hrt_haply_device *device, const float force_N[3],
                      bool first);

#endif
