/* haptic-rt's command line. */
#ifndef HRT_SETTINGS_H
#define HRT_SETTINGS_H

#include "command.h"
#include "node.h"

typedef struct hrt_settings {
    hrt_common common;
    hrt_node_config node; /* with the instrument and the parameters of `common` */
    const char *samples_path, *record_path;
    double auto_reset_s; /* 0: never */
    bool replay, idle_states;
} hrt_settings;

/* Defaults, then what was typed. -1: go on; else the exit code. */
int hrt_settings_read(hrt_settings *settings, int argc, char **argv);

#endif
