/* A peer on the network: one receiving and one sending thread. */
#include "network_peer.h"

#include <pthread.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "clock.h"

enum { UNREAD = 4, LOOK_US = 100000, MAX_COUNT = 256 };

/* Passes the newest message from the loop's thread to the sending one. Each owns a slot; the third is exchanged between
 * them. */
typedef struct letterbox {
    _Atomic uint32_t between; /* slot number, | UNREAD */
    uint32_t write, read;
} letterbox;

struct hrt_live {
    hrt_peer peer;
    pthread_t receiving, sending;
    bool receives, sends;
    _Atomic bool stop;
    sem_t wake;
    letterbox tool_box, status_box;
    struct posted_tool {
        tensormass_tool_state_t tool;
        int64_t at_ns;
    } tool[3];
    tensormass_controller_status_t status[3]; /* its texts are constants of the core */
    hrt_live_sent sent;
    _Atomic int64_t skipped;
};

static uint32_t post(letterbox *box) { /* returns true if the previous one was not read */
    const uint32_t old = atomic_exchange(&box->between, box->write | UNREAD);
    box->write = old & 3u;
    return old & UNREAD;
}

static bool collect(letterbox *box) {
    if ((atomic_load(&box->between) & UNREAD) == 0) return false;
    box->read = atomic_exchange(&box->between, box->read) & 3u;
    return true;
}

static void *receive(void *user) {
    hrt_live *live = user;
    while (!atomic_load(&live->stop))
        if (app_link_receive(live->peer.link, LOOK_US, MAX_COUNT) < 0)
            nanosleep(&(const struct timespec){0, 1000 * LOOK_US}, NULL);
    return NULL;
}

static void send_tool(hrt_live *live) {
    const struct posted_tool *posted = &live->tool[live->tool_box.read];
    hrt_peer_send_tool(&live->peer, &posted->tool);
    hrt_histogram_add(&live->sent.lay, app_monotonic_ns() - posted->at_ns);
    live->sent.tools++;
}

static void *send_all(void *user) {
    hrt_live *live = user;
    while (!atomic_load(&live->stop)) {
        if (sem_wait(&live->wake) != 0) continue;
        if (collect(&live->tool_box)) send_tool(live);
        if (collect(&live->status_box)) hrt_peer_send_status(&live->peer, &live->status[live->status_box.read]);
    }
    return NULL;
}

void hrt_live_send_tool(hrt_live *live, const tensormass_tool_state_t *tool) {
    struct posted_tool *slot = &live->tool[live->tool_box.write];
    slot->tool = *tool;
    slot->at_ns = app_monotonic_ns();
    if (post(&live->tool_box)) atomic_fetch_add(&live->skipped, 1);
    sem_post(&live->wake);
}

void hrt_live_send_status(hrt_live *live, const tensormass_controller_status_t *status) {
    live->status[live->status_box.write] = *status;
    post(&live->status_box);
    sem_post(&live->wake);
}

void hrt_live_close(hrt_live *live, hrt_live_sent *sent) {
    atomic_store(&live->stop, true);
    sem_post(&live->wake);
    if (live->receives) pthread_join(live->receiving, NULL);
    if (live->sends) pthread_join(live->sending, NULL);
    if (sent) {
        *sent = live->sent;
        sent->skipped = atomic_load(&live->skipped);
    }
    app_link_close(live->peer.link);
    sem_destroy(&live->wake);
    free(live);
}

hrt_live *hrt_live_open(app_network_opener *network, const char *url, const hrt_peer_def *def, char *why,
                        int why_size) {
    hrt_live *live = calloc(1, sizeof *live);
    app_topic topic[HRT_PEER_TOPICS];
    snprintf(why, (size_t)why_size, "no memory for messages; close other programs");
    if (!live) return NULL;
    live->tool_box = live->status_box = (letterbox){.between = 0, .write = 1, .read = 2};
    sem_init(&live->wake, 0, 0);
    hrt_peer_init(&live->peer, def);
    const app_link_def link = {.topic = topic, .topics = hrt_peer_topics(&live->peer, topic), .key = def->key};
    live->peer.link = network(url, &link, why, why_size);
    live->sends = live->peer.link && def->node && pthread_create(&live->sending, NULL, send_all, live) == 0;
    live->receives =
        live->peer.link && (live->sends || !def->node) && pthread_create(&live->receiving, NULL, receive, live) == 0;
    if (live->receives) return live;
    hrt_live_close(live, NULL);
    return NULL;
}

hrt_live_refused hrt_live_refusals(hrt_live *live) {
    const app_link_counts *c = app_link_counted(live->peer.link);
    return (hrt_live_refused){.malformed = atomic_load(&c->malformed),
                              .forged = atomic_load(&c->forged),
                              .commands = atomic_load(&live->peer.refused),
                              .packets = app_link_packets(live->peer.link)};
}
