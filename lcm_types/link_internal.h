/* Internal functions of links, shared by the drivers. */
#ifndef TM_LINK_INTERNAL_H
#define TM_LINK_INTERNAL_H

#include "link.h"

typedef struct app_link_driver {
    bool (*send)(app_link *link, const char *channel, int64_t utime, const void *bytes, int size);
    int (*receive)(app_link *link, int64_t wait_us, int most);
    int64_t (*now_us)(const app_link *link);
    bool (*wanted)(const app_link *link, const char *channel); /* null: always */
    app_packet_counts (*packets)(const app_link *link);        /* null: there are none */
    bool (*close)(app_link *link);                             /* frees the driver's data and the link */
} app_link_driver;

/* Base of each driver's own struct; its first member. */
struct app_link {
    const app_link_driver *driver;
    app_link_def def;
    app_topic topic[APP_TOPICS_MAX];
    app_key key;
    app_link_counts counts;
    uint8_t *buffer;
    int capacity;
};

/* Creates a link of `bytes` (the driver's struct), zero except for the contents of `def`. Returns null if memory is
 * exhausted. */
app_link *app_link_new(size_t bytes, const app_link_driver *driver, const app_link_def *def);
void app_link_free(app_link *link);
/* Passes received bytes to app_link_give, or stores them. */
void app_link_came(app_link *link, const char *channel, int64_t utime, const void *bytes, int size);
/* Returns whether the link listens to this channel. */
bool app_link_hears(const app_link *link, const char *channel);

#endif
