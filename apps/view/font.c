#include "font.h"

#include <math.h>
#include <string.h>

/* Strokes on a grid: capitals are 9 high, small letters 6; 'a' 'b' 'c' are -1 -2 -3. Each pair of characters is a
 * point; a blank lifts the pen. */
// clang-format off
static const char *const glyph['~' - ' ' + 1] = {
    [' ' - ' '] = "", ['!' - ' '] = "1913 1010", ['"' - ' '] = "0907 2927", ['#' - ' '] = "2029 4049 0363 0666",
    ['$' - ' '] = "684929080625456361402001 393a", ['%' - ' '] = "0069 1918 5150", ['&' - ' '] = "60172939470302203063",
    ['\'' - ' '] = "1917", ['(' - ' '] = "29060320", [')' - ' '] = "09262300", ['*' - ' '] = "1753 5713 3832",
    ['+' - ' '] = "3731 0464", [',' - ' '] = "110b", ['-' - ' '] = "0444", ['.' - ' '] = "1010", ['/' - ' '] = "0069",
    ['0' - ' '] = "294967624020020729", ['1' - ' '] = "173930 1050", ['2' - ' '] = "07294967650060",
    ['3' - ' '] = "08294967664525 456462402001", ['4' - ' '] = "40490363", ['5' - ' '] = "69190526466462402001",
    ['6' - ' '] = "5939050220406263452503", ['7' - ' '] = "096920", ['8' - ' '] = "294967664525060729 2503022040626345",
    ['9' - ' '] = "1030646749290706244466", [':' - ' '] = "1010 1515", [';' - ' '] = "110b 1515", ['<' - ' '] = "570451",
    ['=' - ' '] = "0363 0666", ['>' - ' '] = "075401", ['?' - ' '] = "072949673433 3030", ['@' - ' '] = "53333656536367492907022050",
    ['A' - ' '] = "003960 1353", ['B' - ' '] = "00094968664505 4564614000", ['C' - ' '] = "6849290702204061",
    ['D' - ' '] = "00093967623000", ['E' - ' '] = "69090060 0555", ['F' - ' '] = "690900 0555", ['G' - ' '] = "68492907022040626434",
    ['H' - ' '] = "0900 6960 0565", ['I' - ' '] = "1910", ['J' - ' '] = "4942301002", ['K' - ' '] = "0900 6904 2560",
    ['L' - ' '] = "090060", ['M' - ' '] = "0009346960", ['N' - ' '] = "00096069", ['O' - ' '] = "294967624020020729",
    ['P' - ' '] = "00094968654404", ['Q' - ' '] = "294967624020020729 3361", ['R' - ' '] = "00094968654404 3460",
    ['S' - ' '] = "684929080625456361402001", ['T' - ' '] = "0969 3930", ['U' - ' '] = "090220406269", ['V' - ' '] = "093069",
    ['W' - ' '] = "0910365069", ['X' - ' '] = "0960 0069", ['Y' - ' '] = "093469 3430", ['Z' - ' '] = "09690060",
    ['[' - ' '] = "29090020", ['\\' - ' '] = "0960", [']' - ' '] = "09292000", ['^' - ' '] = "073967", ['_' - ' '] = "0a6a", ['`' - ' '] = "0918",
    ['a' - ' '] = "5650 5446260402204052", ['b' - ' '] = "0900 0416365452301002", ['c' - ' '] = "5536260402203051",
    ['d' - ' '] = "5950 5446260402204052", ['e' - ' '] = "03535446260402204051", ['f' - ' '] = "49392820 0646",
    ['g' - ' '] = "565b4c1c0b 5446260402204052", ['h' - ' '] = "0900 0416365450", ['i' - ' '] = "1610 1818", ['j' - ' '] = "262b1c0c 2828",
    ['k' - ' '] = "0900 5602 1350", ['l' - ' '] = "191120", ['m' - ' '] = "0600 0416263430 3446566460", ['n' - ' '] = "0600 0416365450",
    ['o' - ' '] = "263654523020020426", ['p' - ' '] = "060c 0416365452301002", ['q' - ' '] = "565c 5446260402204052",
    ['r' - ' '] = "0600 04163645", ['s' - ' '] = "554616050413435251401001", ['t' - ' '] = "29213040 0646", ['u' - ' '] = "0602103052 5650",
    ['v' - ' '] = "063066", ['w' - ' '] = "0610355066", ['x' - ' '] = "0650 0056", ['y' - ' '] = "0630 662b0c", ['z' - ' '] = "06560050",
    ['{' - ' '] = "39282615242130", ['|' - ' '] = "191b", ['}' - ' '] = "09181625141100", ['~' - ' '] = "04254465",
};
// clang-format on

static const char *strokes_of(char c) { return glyph[(c >= ' ' && c <= '~' ? c : '?') - ' ']; }

static float coordinate(char c) { return c >= 'a' ? (float)('a' - c - 1) : (float)(c - '0'); }

/* Returns the advance in grid units. Digits have equal width, so that a changing number stays in place. */
static float advance(char c) {
    if (c == ' ') return 4.5f;
    if (c >= '0' && c <= '9') return 8.2f;
    float widest = 0;
    for (const char *s = strokes_of(c); *s; s++) {
        if (*s == ' ') continue;
        widest = fmaxf(widest, coordinate(s[0]));
        s++;
    }
    return widest + 2.2f;
}

float view_text_width(const char *text, float cap_px) {
    float units = 0;
    for (; *text; text++) units += advance(*text);
    return units * cap_px / 9.0f;
}

static void blend(const view_canvas *canvas, int x, int y, view_colour colour, float coverage) {
    if (coverage <= 0) return;
    float a = colour.alpha * fminf(coverage, 1.0f);
    uint8_t *p = canvas->rgb + 3 * ((size_t)y * (size_t)canvas->width + (size_t)x);
    p[0] = (uint8_t)lrintf((float)p[0] + a * ((float)colour.r - (float)p[0]));
    p[1] = (uint8_t)lrintf((float)p[1] + a * ((float)colour.g - (float)p[1]));
    p[2] = (uint8_t)lrintf((float)p[2] + a * ((float)colour.b - (float)p[2]));
}

typedef struct pixel_range {
    int x0, y0, x1, y1;
} pixel_range;

static pixel_range clipped(const view_canvas *canvas, float x0, float y0, float x1, float y1) {
    float w = (float)canvas->width, h = (float)canvas->height;
    return (pixel_range){(int)fminf(fmaxf(floorf(x0), 0), w), (int)fminf(fmaxf(floorf(y0), 0), h),
                         (int)fminf(fmaxf(ceilf(x1), 0), w), (int)fminf(fmaxf(ceilf(y1), 0), h)};
}

static float distance_to_segment(float x, float y, const float s[4]) {
    float dx = s[2] - s[0], dy = s[3] - s[1], length2 = dx * dx + dy * dy;
    float t = length2 > 0 ? ((x - s[0]) * dx + (y - s[1]) * dy) / length2 : 0;
    t = fminf(fmaxf(t, 0), 1);
    return hypotf(x - s[0] - t * dx, y - s[1] - t * dy);
}

void view_line(const view_canvas *canvas, float x0, float y0, float x1, float y1, float width_px, view_colour colour) {
    float s[4] = {x0, y0, x1, y1}, r = width_px / 2 + 1;
    pixel_range range = clipped(canvas, fminf(x0, x1) - r, fminf(y0, y1) - r, fmaxf(x0, x1) + r, fmaxf(y0, y1) + r);
    for (int y = range.y0; y < range.y1; y++)
        for (int x = range.x0; x < range.x1; x++)
            blend(canvas, x, y, colour, width_px / 2 + 0.5f - distance_to_segment((float)x + 0.5f, (float)y + 0.5f, s));
}

void view_box(const view_canvas *canvas, float x0, float y0, float x1, float y1, float corner_px, view_colour colour) {
    float cx = (x0 + x1) / 2, cy = (y0 + y1) / 2, hx = (x1 - x0) / 2 - corner_px, hy = (y1 - y0) / 2 - corner_px;
    pixel_range range = clipped(canvas, x0, y0, x1 + 1, y1 + 1);
    for (int y = range.y0; y < range.y1; y++)
        for (int x = range.x0; x < range.x1; x++) {
            float dx = fmaxf(fabsf((float)x + 0.5f - cx) - hx, 0), dy = fmaxf(fabsf((float)y + 0.5f - cy) - hy, 0);
            blend(canvas, x, y, colour, corner_px + 0.5f - sqrtf(dx * dx + dy * dy));
        }
}

enum { SEGMENTS_MAX = 32 };

/* Computes one glyph's segments in pixels. A pixel's coverage is that of the nearest segment, so that joints are not
 * drawn twice. */
static int segments_of(char c, float x, float y, float scale, float segment[SEGMENTS_MAX][4]) {
    int count = 0;
    const char *s = strokes_of(c);
    while (*s) {
        float px = x + scale * coordinate(s[0]), py = y - scale * coordinate(s[1]);
        for (s += 2; *s && *s != ' '; s += 2) {
            float qx = x + scale * coordinate(s[0]), qy = y - scale * coordinate(s[1]);
            if (count < SEGMENTS_MAX) memcpy(segment[count++], (float[4]){px, py, qx, qy}, sizeof segment[0]);
            px = qx, py = qy;
        }
        if (*s == ' ') ++s;
    }
    return count;
}

void view_text(const view_canvas *canvas, float x_px, float y_px, float cap_px, view_colour colour, const char *text) {
    float scale = cap_px / 9, half = fmaxf(0.62f * scale, 0.55f), segment[SEGMENTS_MAX][4];
    for (; *text; x_px += advance(*text) * scale, ++text) {
        int count = segments_of(*text, x_px, y_px, scale, segment);
        pixel_range range =
            clipped(canvas, x_px - 2 * scale - 1, y_px - 11 * scale, x_px + 8 * scale + 1, y_px + 5 * scale);
        for (int y = range.y0; count && y < range.y1; y++)
            for (int x = range.x0; x < range.x1; x++) {
                float nearest = 1e9f;
                for (int i = 0; i < count; i++)
                    nearest = fminf(nearest, distance_to_segment((float)x + 0.5f, (float)y + 0.5f, segment[i]));
                blend(canvas, x, y, colour, half + 0.5f - nearest);
            }
    }
}
