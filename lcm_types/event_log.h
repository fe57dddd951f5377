/* Reads an LCM log (the format of lcm-logger and tm-sim --record) that may be damaged or malicious. Memory grows with
 * the data present, not with announced sizes. liblcm does the writing. */
#ifndef TM_EVENT_LOG_H
#define TM_EVENT_LOG_H

#include <stdbool.h>
#include <stdint.h>

enum { APP_LOG_CHANNEL = 64, APP_LOG_EVENT_MAX = 1 << 28 };

typedef struct app_log_event {
    int64_t timestamp; /* time of logging, us */
    char channel[APP_LOG_CHANNEL];
    const uint8_t *data;
    int size;
} app_log_event;

typedef struct app_log app_log;

/* Opens a log. Returns null if it cannot be read. */
app_log *app_log_open(const char *path);
/* Returns the next complete event, valid until the next call; null at the end. Skips invalid data and events beyond the
 * bounds above. */
const app_log_event *app_log_next(app_log *log);
/* Returns whether data were skipped or the file ends within an event. */
bool app_log_damaged(const app_log *log);
/* Rewinds the log to its beginning. */
bool app_log_rewind(app_log *log);
void app_log_close(app_log *log); /* null: no effect */

#endif
