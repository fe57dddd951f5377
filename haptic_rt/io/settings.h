/* Command line of haptic-rt. */
#ifndef HRT_SETTINGS_H
#define HRT_SETTINGS_H

#include "command.h"
#include "drive_table.h"
#include "node.h"

typedef struct hrt_settings {
    hrt_common common;
    hrt_node_config node; /* instrument and parameters as in `common` */
    const char *samples_path, *record_path;
    double auto_reset_s; /* 0: never */
    bool replay, idle_states;
    hrt_workspace workspace; /* of a drive */
    bool setup;              /* push test instead of a simulation */
} hrt_settings;

/* Sets the defaults, then reads the command line. Returns -1 to continue, else the exit code. */
int hrt_settings_read(hrt_settings *settings, int argc, char **argv);

#endif
