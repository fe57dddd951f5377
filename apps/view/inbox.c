#include "inbox.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { LETTERS = 128, TISSUES = 2, MAX_COUNT = 256, LOOK_US = 100000 };
static const char tissue[] = "TISSUE";

struct view_inbox {
    app_link *link;
    pthread_t thread;
    bool started;
    _Atomic bool stop;
    pthread_mutex_t lock;
    pthread_cond_t come;
    view_letter *letter[LETTERS]; /* oldest first */
    int count;
};

static void drop(view_inbox *in, int at) {
    free(in->letter[at]);
    in->count--;
    memmove(in->letter + at, in->letter + at + 1, (size_t)(in->count - at) * sizeof *in->letter);
}

/* Frees space for one more message on this channel. */
static void reserve(view_inbox *in, const char *channel) {
    int tissues = 0, oldest = -1;
    for (int i = in->count - 1; i >= 0; i--)
        if (!strcmp(in->letter[i]->channel, tissue)) ++tissues, oldest = i;
    if (!strcmp(channel, tissue) && tissues >= TISSUES)
        drop(in, oldest);
    else if (in->count == LETTERS)
        drop(in, 0);
}

void view_inbox_store(void *user, const char *channel, int64_t utime, const void *bytes, int size) {
    (void)utime;
    view_inbox *in = user;
    view_letter *letter = malloc(sizeof *letter + (size_t)size);
    if (!letter) return;
    snprintf(letter->channel, sizeof letter->channel, "%s", channel);
    letter->size = size;
    memcpy(letter->data, bytes, (size_t)size);
    pthread_mutex_lock(&in->lock);
    reserve(in, channel);
    in->letter[in->count++] = letter;
    pthread_cond_signal(&in->come);
    pthread_mutex_unlock(&in->lock);
}

static void *receive(void *user) {
    view_inbox *in = user;
    while (!atomic_load(&in->stop))
        if (app_link_receive(in->link, LOOK_US, MAX_COUNT) < 0) nanosleep(&(const struct timespec){0, 100000000}, NULL);
    return NULL;
}

view_inbox *view_inbox_create(void) {
    view_inbox *in = calloc(1, sizeof *in);
    if (!in) return NULL;
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&in->lock, NULL);
    pthread_cond_init(&in->come, &monotonic);
    pthread_condattr_destroy(&monotonic);
    return in;
}

bool view_inbox_start(view_inbox *in, app_link *link) {
    in->link = link;
    in->started = pthread_create(&in->thread, NULL, receive, in) == 0;
    return in->started;
}

view_letter *view_inbox_take(view_inbox *in, int wait_ms) {
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += wait_ms / 1000;
    until.tv_nsec += wait_ms % 1000 * 1000000L;
    if (until.tv_nsec >= 1000000000L) ++until.tv_sec, until.tv_nsec -= 1000000000L;
    view_letter *letter = NULL;
    pthread_mutex_lock(&in->lock);
    while (!in->count && wait_ms > 0 && !pthread_cond_timedwait(&in->come, &in->lock, &until)) {
    }
    if (in->count) {
        letter = in->letter[0];
        in->letter[0] = NULL;
        drop(in, 0);
    }
    pthread_mutex_unlock(&in->lock);
    return letter;
}

void view_inbox_close(view_inbox *in) {
    if (!in) return;
    atomic_store(&in->stop, true);
    if (in->started) pthread_join(in->thread, NULL);
    while (in->count) drop(in, 0);
    pthread_cond_destroy(&in->come);
    pthread_mutex_destroy(&in->lock);
    free(in);
}
