/* Live messages, received in a separate thread, so that a slow picture loses no small message. Keeps two tissue
 * messages and one second of all messages. */
#ifndef VIEW_INBOX_H
#define VIEW_INBOX_H

#include <stdint.h>

#include "link.h"

typedef struct view_inbox view_inbox;

typedef struct view_letter {
    char channel[APP_CHANNEL_CAPACITY];
    int size;
    uint8_t data[];
} view_letter;

view_inbox *view_inbox_create(void);
/* Stores a message; for app_link_def.keep, with the inbox as `user`. */
void view_inbox_store(void *user, const char *channel, int64_t utime, const void *bytes, int size);
/* Begins to receive from a link, which must outlive the inbox. Returns false if no thread can be started. */
bool view_inbox_start(view_inbox *inbox, app_link *link);
/* Returns the oldest message, which the caller frees. Waits at most `wait_ms`; null: none came. */
view_letter *view_inbox_take(view_inbox *inbox, int wait_ms);
void view_inbox_close(view_inbox *inbox); /* null: does nothing */

#endif
