/* Channels, sizes and checked decoding of all messages, from their types' descriptions. */
#include "message.h"

#include <stdio.h>
#include <string.h>

enum { FINGERPRINT = 8 };

typedef struct row {
    const char *channel, *type;
    int most, struct_bytes;
    int (*size)(const void *);
    int (*encode)(void *, int, const void *);
    int (*decode)(const void *, int, void *);
    void (*cleanup)(void *);
    bool (*field)(const void *, int, lcm_field_t *);
} row;

/* Wraps the generated functions with pointers of one type. */
#define CODEC(kind, type, name, bytes)                                                                                 \
    static int size_##kind(const void *m) { return tensormass_##type##_t_encoded_size(m); }                            \
    static int encode_##kind(void *b, int n, const void *m) { return tensormass_##type##_t_encode(b, 0, n, m); }       \
    static int decode_##kind(const void *b, int n, void *m) { return tensormass_##type##_t_decode(b, 0, n, m); }       \
    static void cleanup_##kind(void *m) { tensormass_##type##_t_decode_cleanup(m); }                                   \
    static bool field_##kind(const void *m, int i, lcm_field_t *f) {                                                   \
        return tensormass_##type##_t_get_field(m, i, f) == 0;                                                          \
    }
APP_MESSAGES(CODEC)

#define ROW(kind, type, name, bytes)                                                                                   \
    {name,          #type "_t",     bytes,       (int)sizeof(tensormass_##type##_t), size_##kind, encode_##kind,       \
     decode_##kind, cleanup_##kind, field_##kind},
static const row rows[APP_KINDS] = {APP_MESSAGES(ROW)};

static bool each(const row *r) { return r->channel[strlen(r->channel) - 1] == '_'; }

void app_channel_name(app_message_kind kind, int instrument, char name[APP_CHANNEL_CAPACITY]) {
    const row *r = &rows[kind];
    if (each(r))
        snprintf(name, APP_CHANNEL_CAPACITY, "%s%d", r->channel, instrument);
    else
        snprintf(name, APP_CHANNEL_CAPACITY, "%s", r->channel);
}

bool app_channel_find(const char *channel, app_message_kind *kind, int *instrument) {
    for (int k = 0; k < APP_KINDS; k++) {
        const row *r = &rows[k];
        const size_t length = strlen(r->channel);
        if (strncmp(channel, r->channel, length) != 0) continue;
        const int number = channel[length] - '0';
        const bool numbered = number >= 0 && number < APP_INSTRUMENTS && channel[length + 1] == 0;
        if (each(r) ? !numbered : channel[length] != 0) continue;
        *kind = (app_message_kind)k;
        *instrument = each(r) ? number : 0;
        return true;
    }
    return false;
}

const char *app_message_type(app_message_kind kind) { return rows[kind].type; }

/* --- type descriptions --- */

/* Returns the encoded size of an element; 0: a string or nested type. */
static int bytes_of(const lcm_field_t *f) {
    static const int bytes[] = {[LCM_FIELD_INT8_T] = 1,  [LCM_FIELD_INT16_T] = 2, [LCM_FIELD_INT32_T] = 4,
                                [LCM_FIELD_INT64_T] = 8, [LCM_FIELD_BYTE] = 1,    [LCM_FIELD_FLOAT] = 4,
                                [LCM_FIELD_DOUBLE] = 8,  [LCM_FIELD_STRING] = 0,  [LCM_FIELD_BOOLEAN] = 1};
    return (size_t)f->type < sizeof bytes / sizeof *bytes ? bytes[f->type] : 0;
}

bool app_message_has_tag(app_message_kind kind) {
    const app_message none = {0};
    lcm_field_t f, last = {.name = ""};
    for (int i = 0; rows[kind].field(&none, i, &f); i++) last = f;
    return strcmp(last.name, "tag") == 0;
}

static bool of_fixed_size(app_message_kind kind) { return rows[kind].most == 0; }

int app_message_max(app_message_kind kind) {
    static const app_message none;
    return of_fixed_size(kind) ? rows[kind].size(&none) : rows[kind].most;
}

static int64_t integer(const uint8_t *p) {
    return (int32_t)((uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3]);
}

/* Returns the number of elements of a field, by the counts before it; below 0 if invalid. */
static int64_t elements(const lcm_field_t *f, int size) {
    int64_t count = 1;
    for (int d = 0; d < f->num_dim; d++) {
        if (f->dim_size[d] < 0 || (count *= f->dim_size[d]) > size) return -1;
    }
    return count;
}

/* Returns the size of a string; its only zero must be at the end that its length gives. */
static int64_t string_bytes(const uint8_t *at, int64_t left) {
    if (left < 4) return -1;
    const int64_t length = integer(at);
    if (length < 1 || 4 + length > left || memchr(at + 4, 0, (size_t)length) != at + 3 + length) return -1;
    return 4 + length;
}

static bool whole(const row *r, const uint8_t *bytes, int size) {
    app_message counts; /* fields read so far; they include the arrays' lengths */
    lcm_field_t f;
    memset(&counts, 0, (size_t)r->struct_bytes);
    int64_t at = FINGERPRINT;
    for (int i = 0; r->field(&counts, i, &f); i++) {
        const int64_t count = elements(&f, size), each_bytes = bytes_of(&f);
        if (count < 0 || (each_bytes == 0 && f.type != LCM_FIELD_STRING)) return false;
        if (f.type == LCM_FIELD_INT32_T && f.num_dim == 0 && at + 4 <= size)
            *(int32_t *)f.data = (int32_t)integer(bytes + at);
        at += count * each_bytes;
        for (int64_t s = 0; f.type == LCM_FIELD_STRING && s < count; s++) {
            const int64_t taken = at <= size ? string_bytes(bytes + at, size - at) : -1;
            if (taken < 0) return false;
            at += taken;
        }
        if (at > size) return false;
    }
    return at == size;
}

/* --- encoding and decoding --- */

void app_message_empty(app_message_kind kind, app_message *message) {
    static char nothing[] = "";
    lcm_field_t f;
    memset(message, 0, sizeof *message);
    for (int i = 0; rows[kind].field(message, i, &f); i++)
        if (f.type == LCM_FIELD_STRING && f.num_dim == 0) *(char **)f.data = nothing;
}

int app_message_size(app_message_kind kind, const void *message) { return rows[kind].size(message); }

int app_message_encode(app_message_kind kind, void *bytes, int size, const void *message) {
    return rows[kind].encode(bytes, size, message);
}

bool app_message_decode(app_message_kind kind, const void *bytes, int size, void *message) {
    const row *r = &rows[kind];
    if (size < FINGERPRINT || size > app_message_max(kind)) return false;
    if (of_fixed_size(kind) ? size != app_message_max(kind) : !whole(r, bytes, size)) return false;
    return r->decode(bytes, size, message) == size;
}

void app_message_cleanup(app_message_kind kind, void *message) { rows[kind].cleanup(message); }
