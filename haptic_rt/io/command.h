/* Command-line options shared by haptic-rt and tm-device: bus, instrument, profile, messages, loop, statistics. */
#ifndef HRT_COMMAND_H
#define HRT_COMMAND_H

#include <getopt.h>

#include "hrt.h"
#include "network_peer.h"

typedef struct hrt_common {
    const char *bus, *bus_option; /* address, and the option that gave it */
    const char *url, *key_path, *json;
    int32_t instrument;
    hrt_params params;            /* parameters of the device */
    bool params_read;             /* --profile or --set has changed them */
    bool typed;                   /* --device-type was given */
    bool drive;                   /* the address is that of a drive (drive.h) */
    bool joints;                  /* and that drives the motors of joints */
    int rate, rate_max, priority; /* Hz; rate_max: of the address */
    double duration_s;            /* 0: no limit */
    bool stats, no_key;
} hrt_common;

enum { HRT_RATE_MIN = 100, HRT_RATE_MAX = 4000 };

/* Option codes; a program's own start at HRT_OPTION_OWN. */
enum {
    HRT_OPTION_BUS = 1,
    HRT_OPTION_DEVICE, /* a program with drives: the same address */
    HRT_OPTION_INSTRUMENT,
    HRT_OPTION_DEVICE_TYPE,
    HRT_OPTION_PROFILE,
    HRT_OPTION_SET,
    HRT_OPTION_PARAMS,
    HRT_OPTION_URL,
    HRT_OPTION_KEY,
    HRT_OPTION_NO_KEY,
    HRT_OPTION_RATE,
    HRT_OPTION_DURATION,
    HRT_OPTION_PRIORITY,
    HRT_OPTION_STATS,
    HRT_OPTION_JSON,
    HRT_OPTION_QUIET,
    HRT_OPTION_VERSION,
    HRT_OPTION_HELP = 'h',
    HRT_OPTION_OWN = 256
};
/* Rows of a getopt_long table; "url" is the old name of "lcm-url". */
#define HRT_COMMON_OPTIONS                                                                                             \
    {"bus", 1, 0, HRT_OPTION_BUS}, {"instrument", 1, 0, HRT_OPTION_INSTRUMENT},                                        \
        {"device-type", 1, 0, HRT_OPTION_DEVICE_TYPE}, {"profile", 1, 0, HRT_OPTION_PROFILE},                          \
        {"set", 1, 0, HRT_OPTION_SET}, {"params", 0, 0, HRT_OPTION_PARAMS}, {"lcm-url", 1, 0, HRT_OPTION_URL},         \
        {"url", 1, 0, HRT_OPTION_URL}, {"key", 1, 0, HRT_OPTION_KEY}, {"no-key", 0, 0, HRT_OPTION_NO_KEY},             \
        {"rate", 1, 0, HRT_OPTION_RATE}, {"duration", 1, 0, HRT_OPTION_DURATION},                                      \
        {"priority", 1, 0, HRT_OPTION_PRIORITY}, {"stats", 0, 0, HRT_OPTION_STATS}, {"json", 1, 0, HRT_OPTION_JSON},   \
        {"quiet", 0, 0, HRT_OPTION_QUIET}, {"help", 0, 0, HRT_OPTION_HELP}, {                                          \
        "version", 0, 0, HRT_OPTION_VERSION                                                                            \
    }

typedef struct hrt_command_line {
    const char *program;
    void (*usage)(void);
    const struct option *option; /* HRT_COMMON_OPTIONS, the program's own, and a row of zeros */
    /* Handles one of the program's own options. Returns -1 to continue, else the exit code, after a message if the
     * option is invalid. */
    int (*take)(void *user, int option, const char *text);
    void *user;
    /* Returns the device of a drive's address, and its largest rate; null if it is none. Null: there are no drives. */
    const char *(*drive_device)(const char *address, bool *joints, int *rate_max);
} hrt_command_line;

/* Reads the command line into `common`, which holds the defaults. Returns -1 to continue, else the exit code. */
int hrt_command_read(const hrt_command_line *line, hrt_common *common, int argc, char **argv);
/* Returns the URL of the messages: the option, else LCM_DEFAULT_URL, else APP_LINK_URL. */
const char *hrt_common_url(const hrt_common *common);
/* Joins the network at that URL, with the key that the options select. Returns 0 or the exit code. `key` must outlive
 * the link. */
int hrt_common_join(const hrt_common *common, hrt_peer_def *def, app_key *key, hrt_live **live);

#endif
