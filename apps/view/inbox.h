/* Live messages, received in a thread of their own, so that a picture that takes its time loses none of the small ones.
 * A viewer wants the newest: of tissues two are kept, of everything together what a second brings. */
#ifndef VIEW_INBOX_H
#define VIEW_INBOX_H

#include <stdint.h>

#include "receiver.h"

typedef struct view_inbox view_inbox;

typedef struct view_letter {
    char channel[APP_CHANNEL_NAME];
    int size;
    uint8_t data[];
} view_letter;

/* Null, with `why`, when the URL cannot be opened. */
view_inbox *view_inbox_open(const char *url, char *why, int why_size);
/* The oldest letter, which is the caller's to free; waits at most so long; null: none came. */
view_letter *view_inbox_take(view_inbox *inbox, int wait_ms);
void view_inbox_close(view_inbox *inbox); /* null: nothing */

#endif
