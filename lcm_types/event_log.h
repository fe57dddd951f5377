/* Reading an LCM log (the format of lcm-logger and tm-sim --record) that may be damaged, or made to harm: memory grows
 * with what is really there, never with what is announced. Writing is liblcm's. */
#ifndef TM_EVENT_LOG_H
#define TM_EVENT_LOG_H

#include <stdbool.h>
#include <stdint.h>

enum { APP_LOG_CHANNEL = 64, APP_LOG_EVENT_MAX = 1 << 28 };

typedef struct app_log_event {
    int64_t timestamp; /* us */
    char channel[APP_LOG_CHANNEL];
    const uint8_t *data;
    int size;
} app_log_event;

typedef struct app_log app_log;

/* Null when it cannot be read. */
app_log *app_log_open(const char *path);
/* The next whole event, valid until the next call; null at the end. What is no event, or none that fits within the
 * bounds above, is passed over. */
const app_log_event *app_log_next(app_log *log);
/* Something was passed over, or the file ends within an event. */
bool app_log_damaged(const app_log *log);
/* Back to the beginning. */
bool app_log_rewind(app_log *log);
void app_log_close(app_log *log); /* null: nothing */

#endif
