/* Messages within this process, on a clock that the caller sets: for lockstep. A seed determines the network
 * impairments. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "link_internal.h"

enum { LINKS = 8, LETTERS = 4096 };

typedef struct letter {
    struct letter *next;
    int64_t due_us;
    char channel[APP_CHANNEL_CAPACITY];
    int size;
    uint8_t bytes[];
} letter;

typedef struct queue_link {
    app_link link;
    app_queue *queue;
    app_impairments impairments;
    letter *first, *last;
    int letters;
    /* time and delivery of the messages sent now */
    int64_t instant_us, due_us;
    bool lost;
} queue_link;

struct app_queue {
    int64_t now_us;
    queue_link *link[LINKS];
    int links;
};

app_queue *app_queue_create(int64_t now_us) {
    app_queue *queue = calloc(1, sizeof *queue);
    if (queue) queue->now_us = now_us;
    return queue;
}

void app_queue_destroy(app_queue *queue) { free(queue); }

void app_queue_set_clock(app_queue *queue, int64_t now_us) { queue->now_us = now_us; }

static double next_random(uint64_t *state) {
    uint64_t z = *state += 0x9e3779b97f4a7c15ull;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

/* Draws delay and loss, once per instant. */
static void draw(queue_link *to, int64_t now_us) {
    const app_impairments *m = &to->impairments;
    if (to->instant_us == now_us) return;
    to->instant_us = now_us;
    const double late_s = m->random ? m->latency_s + next_random(m->random) * m->jitter_s : m->latency_s;
    to->lost = m->random && next_random(m->random) < m->loss;
    to->due_us = now_us + llround(late_s * 1e6);
    if (to->last && to->last->due_us > to->due_us) to->due_us = to->last->due_us; /* no overtaking */
}

static bool deliver(queue_link *to, int64_t now_us, const char *channel, const void *bytes, int size) {
    if (!app_link_hears(&to->link, channel)) return true;
    draw(to, now_us);
    if (to->lost || to->letters == LETTERS) return true;
    letter *l = malloc(sizeof *l + (size_t)size);
    if (!l) return false;
    *l = (letter){.due_us = to->due_us, .size = size};
    memcpy(l->channel, channel, strlen(channel) + 1);
    memcpy(l->bytes, bytes, (size_t)size);
    if (to->last)
        to->last->next = l;
    else
        to->first = l;
    to->last = l;
    to->letters++;
    return true;
}

static bool queue_send(app_link *link, const char *channel, int64_t utime, const void *bytes, int size) {
    (void)utime;
    app_queue *q = ((queue_link *)link)->queue;
    bool good = true;
    for (int i = 0; i < q->links; i++)
        if (&q->link[i]->link != link) good = deliver(q->link[i], q->now_us, channel, bytes, size) && good;
    return good;
}

static bool queue_wanted(const app_link *link, const char *channel) {
    const app_queue *q = ((const queue_link *)link)->queue;
    for (int i = 0; i < q->links; i++)
        if (&q->link[i]->link != link && app_link_hears(&q->link[i]->link, channel)) return true;
    return false;
}

static letter *unlink_first(queue_link *q) {
    letter *l = q->first;
    q->first = l->next;
    if (!q->first) q->last = NULL;
    q->letters--;
    return l;
}

static int queue_receive(app_link *link, int64_t wait_us, int most) {
    (void)wait_us;
    queue_link *q = (queue_link *)link;
    int count = 0;
    for (; count < most && q->first && q->first->due_us <= q->queue->now_us; count++) {
        letter *l = unlink_first(q);
        app_link_came(link, l->channel, q->queue->now_us, l->bytes, l->size);
        free(l);
    }
    return count;
}

static int64_t queue_now_us(const app_link *link) { return ((const queue_link *)link)->queue->now_us; }

static bool queue_close(app_link *link) {
    queue_link *l = (queue_link *)link;
    app_queue *q = l->queue;
    int kept = 0;
    for (int i = 0; i < q->links; i++)
        if (q->link[i] != l) q->link[kept++] = q->link[i];
    q->links = kept;
    while (l->first) free(unlink_first(l));
    app_link_free(link);
    return true;
}

static const app_link_driver driver = {queue_send, queue_receive, queue_now_us, queue_wanted, NULL, queue_close};

app_link *app_link_join(app_queue *queue, const app_link_def *def, const app_impairments *impairments) {
    if (queue->links == LINKS) return NULL;
    queue_link *l = (queue_link *)app_link_new(sizeof *l, &driver, def);
    if (!l) return NULL;
    l->queue = queue;
    if (impairments) l->impairments = *impairments;
    l->instant_us = INT64_MIN;
    queue->link[queue->links++] = l;
    return &l->link;
}
