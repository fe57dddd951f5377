/* Live messages, received in a thread of their own, so that a picture that takes its time loses none of the small ones.
 * A viewer wants the newest: of tissues two are kept, of everything together what a second brings. */
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
/* For app_link_def.keep; `user` is the inbox. */
void view_inbox_store(void *user, const char *channel, int64_t utime, const void *bytes, int size);
/* Begins to receive from a link that keeps; the link outlives the inbox. False: there is no thread to be had. */
bool view_inbox_start(view_inbox *inbox, app_link *link);
/* The oldest letter, which is the caller's to free; waits at most so long; null: none came. */
view_letter *view_inbox_take(view_inbox *inbox, int wait_ms);
void view_inbox_close(view_inbox *inbox); /* null: nothing */

#endif
