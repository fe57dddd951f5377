/* UDP packets from a few senders: a delivered message is never longer than its channel allows, and short messages
 * arrive as sent. */
#include "fuzz.h"
#include "receiver_internal.h"

enum { SMALL = 40, LARGE = 3000 };

static app_receiver *r;
static uint32_t sum;

static void take(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    PROMISE(size >= 0 && size <= *(const int *)user);
    PROMISE(strlen(channel) < APP_CHANNEL_NAME);
    for (int i = 0; i < size; i++) sum += ((const uint8_t *)data)[i]; /* readable */
}

static void begin(void) {
    static const int small = SMALL, large = LARGE;
    if (!r) {
        r = calloc(1, sizeof *r);
        r->channel_count = 2;
        r->channel[0] = (app_channel){r->name[0], SMALL, take, (void *)(uintptr_t)&small};
        r->channel[1] = (app_channel){r->name[1], LARGE, take, (void *)(uintptr_t)&large};
        strcpy(r->name[0], "S");
        strcpy(r->name[1], "LARGE");
        r->largest = LARGE;
        for (int i = 0; i < APP_FRAGMENTED; i++) r->fragmented[i].data = malloc(LARGE);
    }
    for (int i = 0; i < APP_FRAGMENTED; i++) r->fragmented[i].used = false;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    fuzz_bytes b = {data, size};
    int64_t now_us = 0;
    begin();
    while (b.left) {
        uint8_t head[4];
        fuzz_take(&b, head, sizeof head);
        const int bytes = head[0] | (head[1] & 15) << 8;
        const struct sockaddr_in from = {.sin_addr.s_addr = head[1] >> 4, .sin_port = head[2] & 1};
        uint8_t *packet = malloc((size_t)bytes + !bytes);
        fuzz_take(&b, packet, (size_t)bytes);
        static const uint8_t magic[4] = {'L', 'C', '0', '2'};
        if (head[2] & 2) /* fuzzing could not guess it */
            for (int i = 0; i < 4 && i < bytes; i++) packet[i] = (uint8_t)(magic[i] + (i == 3 && head[2] & 4));
        now_us += head[3] * 10000;
        app_udpm_packet(r, &from, packet, bytes, now_us);
        free(packet);
    }
    return 0;
}
