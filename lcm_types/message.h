/* Every message there is. A new one is its .lcm file and a row here; everything else (how long it may be, whether it is
 * sealed, whether what came is whole) is read from its type's description. */
#ifndef TM_MESSAGE_H
#define TM_MESSAGE_H

#include <stdbool.h>
#include <stdint.h>

#include "lcm_types/tensormass.h"

/* APP_KIND, its type (tensormass_TYPE_t), its channel (which the number of the instrument follows if it ends with _),
 * and, of types that hold strings or arrays of any length, the most bytes that one may have. */
#define APP_MESSAGES(ROW)                                                                                              \
    ROW(TOOL, tool_state, "TOOL_", 0)                                                                                  \
    ROW(FORCE, force_sample, "FORCE_", 0)                                                                              \
    ROW(PATCH, contact_patch, "PATCH_", 0)                                                                             \
    ROW(TRUTH, force_sample, "TRUTH_", 0)                                                                              \
    ROW(TISSUE, tissue, "TISSUE", 32 << 20)                                                                            \
    ROW(CUT, cut_event, "CUT", 32 << 20)                                                                               \
    ROW(SIM_STATUS, sim_status, "SIM_STATUS", 4096)                                                                    \
    ROW(CONTROLLER, controller_status, "CONTROLLER_", 4096)                                                            \
    ROW(COMMAND, controller_command, "CONTROLLER_COMMAND_", 4096)                                                      \
    ROW(HAND, hand_command, "HAND_", 0)

#define APP_KIND_OF(kind, type, channel, bytes) APP_##kind,
typedef enum app_message_kind { APP_MESSAGES(APP_KIND_OF) APP_KINDS } app_message_kind;

/* Room for any of them, decoded. */
#define APP_STRUCT_OF(kind, type, channel, bytes) tensormass_##type##_t kind;
typedef union app_message {
    APP_MESSAGES(APP_STRUCT_OF)
} app_message;

enum { APP_CHANNEL_CAPACITY = 32, APP_INSTRUMENTS = 2 };

/* The channel of a kind; `instrument` is passed over where the kind has one channel. */
void app_channel_name(app_message_kind kind, int instrument, char name[APP_CHANNEL_CAPACITY]);
/* False: no channel of ours. Of a kind with one channel the instrument is 0. */
bool app_channel_find(const char *channel, app_message_kind *kind, int *instrument);
/* "force_sample_t" */
const char *app_message_type(app_message_kind kind);
/* Does the last field, `tag`, hold an authentication code (auth.h)? */
bool app_message_has_tag(app_message_kind kind);
/* No message of this kind is longer. */
int app_message_max(app_message_kind kind);

/* All zero, with empty texts (the generated encoder takes no null); not for app_message_cleanup. */
void app_message_empty(app_message_kind kind, app_message *message);
/* `message` is the generated struct of its kind. */
int app_message_size(app_message_kind kind, const void *message);
/* How many bytes it took; below 0: it did not fit. */
int app_message_encode(app_message_kind kind, void *bytes, int size, const void *message);
/* True: these bytes are one whole message, now in `message`, to be given to app_message_cleanup. Generated decoders
 * believe the lengths inside; here they are walked first, by the type's description. */
bool app_message_decode(app_message_kind kind, const void *bytes, int size, void *message);
void app_message_cleanup(app_message_kind kind, void *message);

#endif
