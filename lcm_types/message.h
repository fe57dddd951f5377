/* Table of all messages. A new message needs its .lcm file and a row here. Size limit, tag and completeness follow from
 * its type's description. */
#ifndef TM_MESSAGE_H
#define TM_MESSAGE_H

#include <stdbool.h>
#include <stdint.h>

#include "lcm_types/tensormass.h"

/* Columns: APP_KIND; type (tensormass_TYPE_t); channel, followed by the instrument's number if it ends with _. Last:
 * maximum size in bytes of types with strings or variable arrays. */
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

/* Memory for any decoded message. */
#define APP_STRUCT_OF(kind, type, channel, bytes) tensormass_##type##_t kind;
typedef union app_message {
    APP_MESSAGES(APP_STRUCT_OF)
} app_message;

enum { APP_CHANNEL_CAPACITY = 32, APP_INSTRUMENTS = 2 };

/* Writes the channel of a kind; `instrument` is ignored if the kind has one channel. */
void app_channel_name(app_message_kind kind, int instrument, char name[APP_CHANNEL_CAPACITY]);
/* Finds the kind of a channel. Returns false for an unknown channel. The instrument is 0 if the kind has one channel.
 */
bool app_channel_find(const char *channel, app_message_kind *kind, int *instrument);
/* Returns the type's name, as "force_sample_t". */
const char *app_message_type(app_message_kind kind);
/* Returns whether the last field, `tag`, holds an authentication code (auth.h). */
bool app_message_has_tag(app_message_kind kind);
/* Returns the maximum size of a message of this kind, bytes. */
int app_message_max(app_message_kind kind);

/* Clears a message, with empty texts (the generated encoder takes no null). Do not pass it to app_message_cleanup. */
void app_message_empty(app_message_kind kind, app_message *message);
/* Returns the encoded size, bytes; `message` is the generated struct of its kind. */
int app_message_size(app_message_kind kind, const void *message);
/* Encodes a message. Returns its size in bytes, below 0 if it does not fit. */
int app_message_encode(app_message_kind kind, void *bytes, int size, const void *message);
/* Decodes one complete message; pass it to app_message_cleanup afterwards. Generated decoders trust the lengths inside,
 * so the type's description is used to check them first. */
bool app_message_decode(app_message_kind kind, const void *bytes, int size, void *message);
void app_message_cleanup(app_message_kind kind, void *message);

#endif
