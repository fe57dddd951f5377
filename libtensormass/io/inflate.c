/* Decompresses zlib streams: RFC 1950 and 1951. */
#include "inflate.h"

#include <string.h>

enum { LONGEST = 15, LITERALS = 288, DISTANCES = 30, LENGTHS = 29, END_OF_BLOCK = 256 };

typedef struct input {
    const uint8_t *at, *end;
    uint32_t held; /* bits not consumed yet, the next one lowest */
    int count;
    bool over; /* more bits were requested than available */
} input;

typedef struct output {
    uint8_t *begin, *at, *end;
} output;

/* Symbols in the order of their codes, and the number of codes of each length. */
typedef struct code {
    uint16_t count[LONGEST + 1], symbol[LITERALS];
} code;

static uint32_t bits(input *in, int n) {
    while (in->count < n) {
        if (in->at == in->end) {
            in->over = true;
            return 0;
        }
        in->held |= (uint32_t)*in->at++ << in->count;
        in->count += 8;
    }
    const uint32_t value = in->held & ((1u << n) - 1);
    in->held >>= n;
    in->count -= n;
    return value;
}

/* Returns false if the lengths need more codes than exist. */
static bool make_code(code *c, const uint8_t *length, int symbols) {
    uint16_t place[LONGEST + 2] = {0};
    memset(c, 0, sizeof *c);
    for (int s = 0; s < symbols; s++) c->count[length[s]]++;
    c->count[0] = 0;
    int left = 1;
    for (int l = 1; l <= LONGEST; l++) {
        left = 2 * left - c->count[l];
        if (left < 0) return false;
        place[l + 1] = (uint16_t)(place[l] + c->count[l]);
    }
    for (int s = 0; s < symbols; s++)
        if (length[s]) c->symbol[place[length[s]]++] = (uint16_t)s;
    return true;
}

/* Returns the next symbol; -1 for an unknown code. */
static int symbol(input *in, const code *c) {
    int value = 0, first = 0, index = 0;
    for (int l = 1; l <= LONGEST; l++) {
        value = 2 * value + (int)bits(in, 1);
        first *= 2;
        if (value - first < c->count[l]) return c->symbol[index + value - first];
        index += c->count[l];
        first += c->count[l];
    }
    return -1;
}

static bool copy_stored(input *in, output *out) {
    in->held = 0, in->count = 0; /* to the next byte: fewer than 8 bits are ever buffered here */
    if (in->end - in->at < 4) return false;
    const size_t size = (size_t)in->at[0] | (size_t)in->at[1] << 8,
                 not_size = (size_t)in->at[2] | (size_t)in->at[3] << 8;
    in->at += 4;
    if ((size ^ not_size) != 0xffff || (size_t)(in->end - in->at) < size || (size_t)(out->end - out->at) < size)
        return false;
    memcpy(out->at, in->at, size);
    in->at += size;
    out->at += size;
    return true;
}

/* Decodes lengths 3 to 258, distances 1 to 32768: groups of 4, or 2, share a number of extra bits. */
static int length_of(input *in, int s) {
    if (s == 28) return 258;
    const int extra = s < 8 ? 0 : s / 4 - 1;
    return 3 + (s < 8 ? s : (4 + s % 4) << extra) + (int)bits(in, extra);
}
static int distance_of(input *in, int s) {
    const int extra = s < 4 ? 0 : s / 2 - 1;
    return 1 + (s < 4 ? s : (2 + s % 2) << extra) + (int)bits(in, extra);
}

static bool copy_coded(input *in, output *out, const code *literal, const code *distance) {
    for (;;) {
        const int s = symbol(in, literal);
        if (s < 0 || in->over || s >= END_OF_BLOCK + 1 + LENGTHS) return false;
        if (s == END_OF_BLOCK) return true;
        if (s < END_OF_BLOCK) {
            if (out->at == out->end) return false;
            *out->at++ = (uint8_t)s;
            continue;
        }
        const int length = length_of(in, s - END_OF_BLOCK - 1), d = symbol(in, distance);
        if (d < 0 || d >= DISTANCES) return false;
        const int back = distance_of(in, d);
        if (in->over || back > out->at - out->begin || length > out->end - out->at) return false;
        for (int i = 0; i < length; i++, out->at++) *out->at = out->at[-back]; /* may overlap */
    }
}

static bool read_codes(input *in, code *literal, code *distance) {
    static const uint8_t order[19] = {16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
    uint8_t length[LITERALS + 32] = {0};
    const int literals = 257 + (int)bits(in, 5), distances = 1 + (int)bits(in, 5), count = 4 + (int)bits(in, 4);
    for (int i = 0; i < count; i++) length[order[i]] = (uint8_t)bits(in, 3);
    if (literals > 286 || distances > DISTANCES || !make_code(literal, length, 19)) return false;
    memset(length, 0, sizeof length);
    for (int i = 0; i < literals + distances;) {
        const int s = symbol(in, literal);
        if (s < 0 || in->over || (s == 16 && !i)) return false;
        const int times = s < 16    ? 1
                          : s == 16 ? 3 + (int)bits(in, 2)
                          : s == 17 ? 3 + (int)bits(in, 3)
                                    : 11 + (int)bits(in, 7);
        if (i + times > literals + distances) return false;
        memset(length + i, s < 16 ? s : s == 16 ? length[i - 1] : 0, (size_t)times);
        i += times;
    }
    return make_code(literal, length, literals) && make_code(distance, length + literals, distances);
}

static void fixed_codes(code *literal, code *distance) {
    uint8_t length[LITERALS];
    for (int s = 0; s < LITERALS; s++) length[s] = s < 144 ? 8 : s < 256 ? 9 : s < 280 ? 7 : 8;
    make_code(literal, length, LITERALS);
    memset(length, 5, DISTANCES);
    make_code(distance, length, DISTANCES);
}

static uint32_t adler32(const uint8_t *at, size_t size) {
    uint32_t a = 1, b = 0;
    for (size_t i = 0; i < size; i++) {
        a = (a + at[i]) % 65521;
        b = (b + a) % 65521;
    }
    return b << 16 | a;
}

bool tm_io_inflate(const uint8_t *in_bytes, size_t in_size, uint8_t *out_bytes, size_t out_size) {
    input in = {.at = in_bytes, .end = in_bytes + in_size};
    output out = {out_bytes, out_bytes, out_bytes + out_size};
    code literal, distance;
    if (in_size < 2 || (in_bytes[0] & 15) != 8 || (in_bytes[0] * 256 + in_bytes[1]) % 31 || in_bytes[1] & 32)
        return false;
    in.at += 2;
    for (bool last = false; !last;) {
        last = bits(&in, 1);
        const uint32_t kind = bits(&in, 2);
        bool good = !in.over && kind < 3;
        if (good && kind == 1) fixed_codes(&literal, &distance);
        if (good && kind == 2) good = read_codes(&in, &literal, &distance);
        if (good) good = kind ? copy_coded(&in, &out, &literal, &distance) : copy_stored(&in, &out);
        if (!good) return false;
    }
    if (out.at != out.end || in.end - in.at < 4) return false;
    const uint32_t told = (uint32_t)in.at[0] << 24 | (uint32_t)in.at[1] << 16 | (uint32_t)in.at[2] << 8 | in.at[3];
    return told == adler32(out_bytes, out_size);
}
