/* Reads VTK's XML files of one piece: .vtu and .vtp; text, base64 or raw; plain or zlib. Format:
 * https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html */
#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "inflate.h"
#include "vtk_cells.h"

/* A range of the file. */
typedef struct span {
    const char *at, *end;
} span;

typedef struct reader {
    span piece, appended; /* after the _ */
    bool big_endian, wide, packed, base64;
    tm_io_vtk *v;
} reader;

typedef struct type {
    const char *name;
    int bytes;
    enum { WHOLE, NATURAL, REAL } kind;
} type;
static const type types[] = {{"Int8", 1, WHOLE},   {"UInt8", 1, NATURAL},  {"Int16", 2, WHOLE}, {"UInt16", 2, NATURAL},
                             {"Int32", 4, WHOLE},  {"UInt32", 4, NATURAL}, {"Int64", 8, WHOLE}, {"UInt64", 8, NATURAL},
                             {"Float32", 4, REAL}, {"Float64", 8, REAL}};

/* --- XML --- */

/* Finds the first element <NAME ...> in `in` and sets `tag` to its attributes. Returns the text after it; null if there
 * is none. */
static const char *element(span in, const char *name, span *tag) {
    char word[40];
    const int length = snprintf(word, sizeof word, "<%s", name);
    for (const char *at = in.at; (at = tm_io_find(at, in.end, word, (size_t)length)); at += length) {
        const char *after = at + length, *close = memchr(after, '>', (size_t)(in.end - after));
        if (!close) return NULL;
        if (!isspace((unsigned char)*after) && *after != '>' && *after != '/') continue;
        *tag = (span){after, close};
        return close + 1;
    }
    return NULL;
}

/* Finds the text between <NAME ...> and </NAME>. */
static bool inside(span in, const char *name, span *tag, span *out) {
    char word[40];
    const int length = snprintf(word, sizeof word, "</%s>", name);
    out->at = element(in, name, tag);
    if (!out->at) return false;
    out->end = tag->end[-1] == '/' ? out->at : tm_io_find(out->at, in.end, word, (size_t)length);
    return out->end != NULL;
}

static void unescape(char *text) {
    static const struct {
        const char *name, is;
    } known[] = {{"&lt;", '<'}, {"&gt;", '>'}, {"&amp;", '&'}, {"&quot;", '"'}, {"&apos;", '\''}};
    char *to = text;
    for (const char *from = text; *from;) {
        size_t k = 0, length = 0;
        while (k < 5 && strncmp(from, known[k].name, length = strlen(known[k].name)) != 0) k++;
        *to++ = k < 5 ? known[k].is : *from;
        from += k < 5 ? length : 1;
    }
    *to = 0;
}

/* Reads NAME="VALUE" of a tag. Returns false if it is missing. */
static bool attribute(span tag, const char *name, char *value, size_t size) {
    const size_t length = strlen(name);
    for (const char *at = tag.at; (at = tm_io_find(at, tag.end, name, length)); at += length) {
        const char *from = at + length, quote = from + 1 < tag.end ? from[1] : 0;
        if (!isspace((unsigned char)at[-1]) || *from != '=' || (quote != '"' && quote != '\'')) continue;
        const char *stop = memchr(from + 2, quote, (size_t)(tag.end - from - 2));
        if (!stop) return false;
        const size_t n = (size_t)(stop - from - 2) < size - 1 ? (size_t)(stop - from - 2) : size - 1;
        memcpy(value, from + 2, n);
        value[n] = 0;
        unescape(value);
        return true;
    }
    return false;
}

/* Returns a count in a tag; 0 if it is missing. */
static int64_t count_of(span tag, const char *name) {
    char text[32];
    return attribute(tag, name, text, sizeof text) ? strtoll(text, NULL, 10) : 0;
}

/* --- bytes --- */

/* Reads `count` bytes from `from` on, in base64 or raw. Padding may occur in between, from parts that were written
 * separately. Returns false if there are fewer. */
static bool take(bool base64, span from, uint8_t *to, size_t count) {
    if (!base64) {
        if ((size_t)(from.end - from.at) < count) return false;
        memcpy(to, from.at, count);
        return true;
    }
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    uint32_t held = 0;
    int digits = 0, pads = 0;
    for (const char *at = from.at; count && at < from.end; at++) {
        const char *digit = *at ? strchr(letters, *at) : NULL;
        if (isspace((unsigned char)*at)) continue;
        if (!digit && *at != '=') return false;
        held = held << 6 | (digit ? (uint32_t)(digit - letters) : 0);
        pads += !digit;
        if (++digits < 4) continue;
        for (int i = 0; i < 3 - pads && count; i++, count--) *to++ = (uint8_t)(held >> (16 - 8 * i));
        held = 0, digits = 0, pads = 0;
    }
    return count == 0;
}

static double value_of(const reader *r, const uint8_t *at, const type *t) {
    uint64_t bits = 0;
    for (int i = 0; i < t->bytes; i++) bits = bits << 8 | at[r->big_endian ? i : t->bytes - 1 - i];
    if (t->kind == NATURAL) return (double)bits;
    if (t->kind == WHOLE) return (double)((int64_t)(bits << (64 - 8 * t->bytes)) >> (64 - 8 * t->bytes));
    double d;
    float f;
    const uint32_t half = (uint32_t)bits;
    memcpy(&d, &bits, sizeof d);
    memcpy(&f, &half, sizeof f);
    return t->bytes == 8 ? d : (double)f;
}

static size_t header_at(const reader *r, const uint8_t *bytes, int64_t i) {
    const type *t = &types[r->wide ? 7 : 5];
    const double value = value_of(r, bytes + i * t->bytes, t);
    return value < 1e15 ? (size_t)value : (size_t)1e15;
}

/* Decompresses blocks. Their header: number, size, size of the last one, compressed size of each. */
static tm_status unpack(const reader *r, bool base64, span from, uint8_t **out, size_t *size) {
    const size_t word = r->wide ? 8 : 4, most = (size_t)(from.end - from.at);
    uint8_t first[24];
    if (!take(base64, from, first, 3 * word)) return tm_io_vtk_bad(r->v, "an array is truncated");
    const size_t blocks = header_at(r, first, 0), whole = header_at(r, first, 1), last = header_at(r, first, 2);
    if (blocks > most / word || whole > 1100 * most || last > whole)
        return tm_io_vtk_bad(r->v, "an array is truncated");
    const size_t head = (3 + blocks) * word;
    *size = blocks ? (blocks - (last > 0)) * whole + last : 0;
    if (*size > 1100 * most) return tm_io_vtk_bad(r->v, "an array is truncated");
    uint8_t *packed = malloc(most + 1);
    *out = malloc(*size + 1);
    tm_status status = packed && *out ? TM_OK : tm_io_vtk_no_memory(r->v);
    if (!status && !take(base64, from, packed, head)) status = tm_io_vtk_bad(r->v, "an array is truncated");
    size_t used = head;
    for (size_t b = 0; b < blocks && !status; b++) {
        const size_t more = header_at(r, packed, 3 + (int64_t)b);
        used = more > most - used ? most + 1 : used + more;
        if (used > most) status = tm_io_vtk_bad(r->v, "an array is truncated");
    }
    if (!status && !take(base64, from, packed, used)) status = tm_io_vtk_bad(r->v, "an array is truncated");
    size_t at = head, to = 0;
    for (size_t b = 0; b < blocks && !status; b++) {
        const size_t more = header_at(r, packed, 3 + (int64_t)b), gives = b + 1 == blocks && last ? last : whole;
        if (!tm_io_inflate(packed + at, more, *out + to, gives))
            status = tm_io_vtk_bad(r->v, "a compressed array is damaged");
        at += more, to += gives;
    }
    free(packed);
    return status;
}

static tm_status plain(const reader *r, bool base64, span from, uint8_t **out, size_t *size) {
    const size_t word = r->wide ? 8 : 4;
    uint8_t head[8];
    if (!take(base64, from, head, word)) return tm_io_vtk_bad(r->v, "an array is truncated");
    *size = header_at(r, head, 0);
    if (*size > (size_t)(from.end - from.at)) return tm_io_vtk_bad(r->v, "an array is truncated");
    uint8_t *both = *out = malloc(word + *size + 1);
    if (!both) return tm_io_vtk_no_memory(r->v);
    if (!take(base64, from, both, word + *size)) return tm_io_vtk_bad(r->v, "an array is truncated");
    memmove(both, both + word, *size);
    return TM_OK;
}

/* --- arrays --- */

static tm_status text_values(const reader *r, span from, int64_t expected, double *out) {
    const char *at = from.at;
    for (int64_t i = 0; i < expected; i++) {
        char *stop;
        while (at < from.end && isspace((unsigned char)*at)) at++;
        out[i] = at < from.end ? strtod(at, &stop) : 0;
        if (at >= from.end || stop == at) return tm_io_vtk_bad(r->v, "an array of text is truncated");
        at = stop;
    }
    return TM_OK;
}

/* Reads the `expected` values of the array that `tag` describes and `body` may hold; malloced. */
static tm_status values(const reader *r, span tag, span body, int64_t expected, double **out) {
    char kind[16] = "", format[16] = "";
    const type *t = NULL;
    uint8_t *bytes = NULL;
    size_t size = 0;
    attribute(tag, "type", kind, sizeof kind);
    attribute(tag, "format", format, sizeof format);
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (strcmp(types[i].name, kind) == 0) t = &types[i];
    const bool text = strcmp(format, "ascii") == 0, appended = strcmp(format, "appended") == 0;
    if (!t || (!text && !appended && strcmp(format, "binary")))
        return tm_fail(r->v->error, TM_ERR_FILE, -1,
                       "an array has type '%s' and format '%s', which cannot be read; save it again", kind, format);
    const int64_t offset = count_of(tag, "offset"),
                  room = appended ? r->appended.end - r->appended.at : body.end - body.at;
    if (expected > 1100 * (room + 1) || offset < 0 || (appended && (!r->appended.at || offset > room)))
        return tm_io_vtk_bad(r->v, "an array is truncated");
    const span from = appended ? (span){r->appended.at + offset, r->appended.end} : body;
    const bool base64 = !appended || r->base64;
    if (!(*out = malloc(((size_t)expected + 1) * sizeof **out))) return tm_io_vtk_no_memory(r->v);
    if (text) return text_values(r, from, expected, *out);
    tm_status status = r->packed ? unpack(r, base64, from, &bytes, &size) : plain(r, base64, from, &bytes, &size);
    if (!status && size < (size_t)expected * (size_t)t->bytes) status = tm_io_vtk_bad(r->v, "an array is too short");
    for (int64_t i = 0; i < expected && !status; i++) (*out)[i] = value_of(r, bytes + i * t->bytes, t);
    free(bytes);
    return status;
}

/* Reads the array with this name in a section of the piece (null: the first), as integers or not. */
static tm_status section_values(const reader *r, const char *section, const char *name, int64_t expected,
                                double **out) {
    span tag, part, body, array;
    char called[80] = "";
    if (inside(r->piece, section, &tag, &part))
        for (body = part; inside(body, "DataArray", &array, &part); body.at = part.end) {
            attribute(array, "Name", called, sizeof called);
            if (name && strcmp(called, name)) continue;
            return values(r, array, part, expected, out);
        }
    return tm_fail(r->v->error, TM_ERR_FILE, -1, "the array '%s' is missing in its %s; save it again",
                   name ? name : "Points", section);
}

static tm_status whole_values(const reader *r, const char *section, const char *name, int64_t expected, int64_t **out) {
    double *value = NULL;
    tm_status status = section_values(r, section, name, expected, &value);
    if (!status && !(*out = malloc(((size_t)expected + 2) * sizeof **out))) status = tm_io_vtk_no_memory(r->v);
    for (int64_t i = 0; i < expected && !status; i++) (*out)[i] = fabs(value[i]) < 9e15 ? (int64_t)value[i] : -1;
    free(value);
    return status;
}

/* --- the mesh --- */

/* Reads the ends of cells, as in the file, after a leading 0. */
static tm_status read_cells(const reader *r, const char *section) {
    tm_io_vtk *v = r->v;
    const int64_t cells = v->cells;
    v->cells = 0;
    tm_status status = whole_values(r, section, "offsets", cells, &v->offset);
    if (status) return status;
    memmove(v->offset + 1, v->offset, (size_t)cells * sizeof *v->offset);
    v->offset[0] = 0;
    const int64_t corners = v->offset[cells];
    if (corners < 0 || corners > INT32_MAX) return tm_io_vtk_bad(v, "its offsets are not ascending");
    status = whole_values(r, section, "connectivity", corners, &v->corner);
    if (!status) v->cells = cells;
    return status ? status : tm_io_vtk_check(v, corners);
}

/* Reads <!-- region 0: NAME -->, as written by tm-mesh. */
static tm_status read_names(const reader *r, span file) {
    static const char word[] = "<!-- region ";
    for (const char *at = file.at; (at = tm_io_find(at, r->piece.at, word, sizeof word - 1)); at++) {
        long long region;
        int length = 0;
        char name[64] = "";
        if (sscanf(at, "<!-- region %lld: %n", &region, &length) < 1 || !length) continue;
        const char *stop = tm_io_find(at, r->piece.at, " -->", 4);
        const size_t n = stop && stop > at + length ? (size_t)(stop - at) - (size_t)length : 0;
        memcpy(name, at + length, n < 63 ? n : 63);
        if (!tm_io_vtk_name(r->v, region, name)) return tm_io_vtk_no_memory(r->v);
    }
    return TM_OK;
}

static tm_status read_groups(const reader *r) {
    tm_status status = TM_OK;
    span tag, part, body, array;
    char called[80];
    if (!inside(r->piece, "PointData", &tag, &part)) return TM_OK;
    for (body = part; !status && inside(body, "DataArray", &array, &part); body.at = part.end) {
        double *value = NULL;
        if (!attribute(array, "Name", called, sizeof called) || strncmp(called, "group:", 6)) continue;
        status = values(r, array, part, r->v->points, &value);
        uint8_t *in = status ? NULL : tm_io_vtk_group_add(r->v, called + 6);
        if (!status && !in) status = tm_io_vtk_no_memory(r->v);
        for (int64_t p = 0; p < r->v->points && !status; p++) in[p] = value[p] != 0;
        free(value);
    }
    return status;
}

static bool has_region(const reader *r) {
    span tag, part;
    return inside(r->piece, "CellData", &tag, &part) && tm_io_find(part.at, part.end, "Name=\"region\"", 13);
}

static tm_status open_file(reader *r, span file, const char *dataset) {
    span tag = {0}, piece_tag, other;
    char text[64] = "";
    const char *body = element(file, "VTKFile", &tag);
    if (!body) return tm_io_vtk_bad(r->v, "it has no <VTKFile> element");
    attribute(tag, "type", text, sizeof text);
    if (strcmp(text, dataset))
        return tm_fail(r->v->error, TM_ERR_MESH, -1, "it contains '%s', not %s; save one of these", text, dataset);
    r->big_endian = attribute(tag, "byte_order", text, sizeof text) && strcmp(text, "BigEndian") == 0;
    r->wide = attribute(tag, "header_type", text, sizeof text) && strcmp(text, "UInt64") == 0;
    r->packed = attribute(tag, "compressor", text, sizeof text) && *text;
    if (r->packed && strcmp(text, "vtkZLibDataCompressor"))
        return tm_fail(r->v->error, TM_ERR_FILE, -1, "it is compressed by %s; save it with zlib, or uncompressed",
                       text);
    const char *data = element((span){body, file.end}, "AppendedData", &tag);
    const span before = {body, data ? tag.at : file.end};
    if (data) {
        r->base64 = attribute(tag, "encoding", text, sizeof text) && strcmp(text, "base64") == 0;
        while (data < file.end && isspace((unsigned char)*data)) data++;
        if (data >= file.end || *data != '_') return tm_io_vtk_bad(r->v, "its appended data does not begin with _");
        const char *stop = r->base64 ? memchr(data, '<', (size_t)(file.end - data)) : NULL;
        r->appended = (span){data + 1, stop ? stop : file.end};
    }
    if (!inside(before, "Piece", &piece_tag, &r->piece)) return tm_io_vtk_bad(r->v, "the file is truncated");
    if (element((span){r->piece.end, before.end}, "Piece", &other))
        return tm_fail(r->v->error, TM_ERR_MESH, -1, "it has several pieces; save it as one (ParaView: Merge Blocks)");
    r->v->points = count_of(piece_tag, "NumberOfPoints");
    const bool surface = strcmp(dataset, "PolyData") == 0;
    r->v->cells = count_of(piece_tag, surface ? "NumberOfPolys" : "NumberOfCells");
    if (r->v->points < 0 || r->v->cells < 0 || r->v->points > INT32_MAX / 4 || r->v->cells > INT32_MAX / 4)
        return tm_io_vtk_bad(r->v, "its counts are not numbers");
    if (surface && count_of(piece_tag, "NumberOfStrips"))
        return tm_io_vtk_bad(r->v, "triangle strips cannot be read; save triangles (ParaView: Triangulate)");
    return TM_OK;
}

tm_status tm_io_vtk_read_xml(tm_io_text *text, const char *dataset, tm_io_vtk *v) {
    reader r = {.v = v};
    const span file = {text->at, text->end};
    v->error = text->error;
    tm_status status = open_file(&r, file, dataset);
    if (status) return status;
    const bool surface = strcmp(dataset, "PolyData") == 0;
    status = section_values(&r, "Points", NULL, 3 * v->points, &v->point);
    if (!status) status = read_cells(&r, surface ? "Polys" : "Cells");
    if (status || surface) return status;
    status = whole_values(&r, "Cells", "types", v->cells, &v->cell_type);
    if (!status && has_region(&r)) status = whole_values(&r, "CellData", "region", v->cells, &v->region);
    if (!status && v->region) status = read_names(&r, file);
    return status ? status : read_groups(&r);
}
