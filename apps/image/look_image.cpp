// Checks headers of MetaImage, NRRD and NIfTI. DICOM has no header with counts before its data: only the child's limits
// bound GDCM.
#include <zlib.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "look.h"
#include "refusal.h"

namespace {

enum { HEADER_MAX = 1 << 20, LINE_BYTES_MAX = 1000, PAIR_MAX = 1 << 18, DIMENSIONS_MAX = 16 };

const double VOXELS_MAX = 1 << 30, PACKED_MAX = 1032; // largest compression ratio of deflate

bool ends(const std::string &path, const char *ending) {
    const size_t n = strlen(ending);
    return path.size() >= n && path.compare(path.size() - n, n, ending) == 0;
}

std::string trimmed(const std::string &s) {
    const size_t from = s.find_first_not_of(" \t"), to = s.find_last_not_of(" \t");
    return from == std::string::npos ? "" : s.substr(from, to - from + 1);
}

// Reads an integer of a header; throws if it is not one, or out of range.
double whole(const char *key, const std::string &text, double least, double most) {
    char *end;
    const double value = strtod(text.c_str(), &end);
    if (end == text.c_str() || trimmed(end) != "" || !(value >= least) || !(value <= most) ||
        value != std::floor(value))
        throw refusal(
            "its header has %s %.40s, which is not a whole number from %.0f to %.0f, so the file is damaged; save it again",
            key, text.c_str(), least, most);
    return value;
}

// Returns the product of integers separated by blanks, one per dimension.
double product(const char *key, const std::string &text, double count) {
    std::istringstream words(text);
    std::string word;
    double all = 1;
    int found = 0;
    for (; words >> word; found++) all *= whole(key, word, 1, VOXELS_MAX);
    if (found != count)
        throw refusal("its header has %d numbers as %s and %.0f dimensions, so the file is damaged; save it again",
                      found, key, count);
    return all;
}

// Checks the name of a separate file of voxels: one plain name. Libraries pass lists and patterns of names to printf.
void check_data_file(const std::string &name) {
    if (name.empty() || name.find('%') != std::string::npos || name.compare(0, 4, "LIST") == 0)
        throw refusal("its voxels are in several files ('%.40s'); save the image as one file", name.c_str());
}

double voxel_bytes(const std::string &type) {
    static const struct {
        const char *name;
        double bytes;
    } known[] = {{"MET_CHAR", 1},      {"MET_UCHAR", 1},      {"MET_SHORT", 2}, {"MET_USHORT", 2},
                 {"MET_INT", 4},       {"MET_UINT", 4},       {"MET_LONG", 8},  {"MET_ULONG", 8},
                 {"MET_LONG_LONG", 8}, {"MET_ULONG_LONG", 8}, {"MET_FLOAT", 4}, {"MET_DOUBLE", 8}};
    for (const auto &k : known)
        if (type == k.name) return k.bytes;
    throw refusal("its header has ElementType %.40s; save labels as MET_UCHAR, MET_SHORT or MET_USHORT", type.c_str());
}

struct meta {
    double dimensions = 0, voxels = 0, bytes = 1, channels = 1;
    std::string size;
};

void take_meta(const std::string &key, const std::string &value, double file_bytes, meta *m) {
    if (key == "NDims") m->dimensions = whole("NDims", value, 1, 10);
    if (key == "DimSize") m->size = value;
    if (key == "ElementType") m->bytes = voxel_bytes(value);
    if (key == "ElementNumberOfChannels") m->channels = whole("ElementNumberOfChannels", value, 1, 1000);
    if (key == "HeaderSize") whole("HeaderSize", value, -1, file_bytes);
    if (key == "CompressedDataSize") whole("CompressedDataSize", value, 0, 1e12);
    if (key == "ElementDataFile" && value != "LOCAL") check_data_file(value);
}

// Checks lines of key = value, up to ElementDataFile.
double check_meta(const char *path, double file_bytes) {
    look_lines lines(path, HEADER_MAX, LINE_BYTES_MAX);
    meta m;
    std::string line;
    while (lines.next(&line)) {
        const size_t equals = line.find('=');
        if (equals == std::string::npos)
            throw refusal("line %d of its header is not 'key = value', so the file is damaged; save it again",
                          lines.number);
        const std::string key = trimmed(line.substr(0, equals)), value = trimmed(line.substr(equals + 1));
        if (key.size() > 80)
            throw refusal("line %d of its header has no key, so the file is damaged; save it again", lines.number);
        take_meta(key, value, file_bytes, &m);
        if (key != "ElementDataFile") continue;
        if (!(m.dimensions > 0)) throw refusal("its header has no NDims, so the file is damaged; save it again");
        return product("DimSize", m.size, m.dimensions) * m.bytes * m.channels;
    }
    throw refusal("its header has no ElementDataFile, so the file is truncated or damaged; copy it again");
}

struct nrrd {
    double dimensions = 0, voxels = 0;
    bool sized = false;
};

void take_nrrd(const std::string &key, const std::string &value, double file_bytes, nrrd *n) {
    if (key == "dimension") n->dimensions = whole("dimension", value, 1, DIMENSIONS_MAX);
    if (key == "sizes") {
        if (!(n->dimensions > 0)) throw refusal("its header has 'sizes' before 'dimension'; save it again");
        n->voxels = product("sizes", value, n->dimensions);
        n->sized = true;
    }
    if (key == "line skip" || key == "lineskip") whole("line skip", value, 0, file_bytes);
    if (key == "byte skip" || key == "byteskip") whole("byte skip", value, -1, file_bytes);
    if (key == "data file" || key == "datafile") check_data_file(value);
}

// Checks fields "key: value" and pairs "key:=value" up to an empty line or the end (.nhdr). NrrdIO copies the values of
// fields into buffers, those of pairs not.
double check_nrrd(const char *path, double file_bytes) {
    look_lines lines(path, HEADER_MAX, PAIR_MAX);
    nrrd n;
    std::string line;
    while (lines.next(&line) && !line.empty()) {
        const size_t colon = line.find(':');
        const bool pair = colon != std::string::npos && line.compare(colon, 2, ":=") == 0, comment = line[0] == '#';
        if (comment || pair) continue;
        if (line.size() > LINE_BYTES_MAX)
            throw refusal("line %d of its header has more than %d characters, so the file is damaged; save it again",
                          lines.number, int(LINE_BYTES_MAX));
        if (lines.number == 1) continue;
        if (colon == std::string::npos || line.compare(colon, 2, ": ") != 0)
            throw refusal("line %d of its header is not 'key: value', so the file is damaged; save it again",
                          lines.number);
        take_nrrd(line.substr(0, colon), trimmed(line.substr(colon + 1)), file_bytes, &n);
    }
    if (!n.sized)
        throw refusal("its header has no 'dimension' and 'sizes', so the file is truncated or damaged; copy it again");
    return n.voxels * 8;
}

// Checks the first 348 bytes, compressed or not, in either byte order.
double check_nifti(const char *path) {
    unsigned char header[348];
    gzFile file = gzopen(path, "rb");
    const int got = file ? gzread(file, header, sizeof header) : 0;
    if (file) gzclose(file);
    if (got != int(sizeof header)) throw refusal("it ends within its header, so the file is truncated; copy it again");
    const auto at16 = [&](int at, bool turned) {
        return int16_t(turned ? header[at] << 8 | header[at + 1] : header[at + 1] << 8 | header[at]);
    };
    const auto at32 = [&](int at, bool turned) {
        uint32_t value = 0;
        for (int k = 0; k < 4; k++) value |= uint32_t(header[at + k]) << 8 * (turned ? 3 - k : k);
        return value;
    };
    const bool turned = at32(0, false) != 348;
    if (at32(0, turned) != 348 || at16(40, turned) < 1 || at16(40, turned) > 7)
        throw refusal("its header is not that of a NIfTI image, so the file is damaged; save it again");
    double voxels = 1;
    for (int k = 1; k <= at16(40, turned); k++) {
        if (at16(40 + 2 * k, turned) < 1)
            throw refusal("its header has %d voxels along axis %d, so the file is damaged; save it again",
                          at16(40 + 2 * k, turned), k);
        voxels *= at16(40 + 2 * k, turned);
    }
    float offset;
    const uint32_t bits = at32(108, turned);
    memcpy(&offset, &bits, sizeof offset);
    if (!(offset >= 0 && offset < 1e9f))
        throw refusal("its header says that voxels begin at byte %g, so the file is damaged; save it again",
                      double(offset));
    return voxels * std::fmax(1, at16(72, turned) / 8);
}

} // namespace

double check_image(const char *path) {
    const double file_bytes = look_file_bytes(path, "NIfTI, NRRD, MetaImage or DICOM-SEG");
    const std::string name = path;
    const bool apart = ends(name, ".mhd") || ends(name, ".nhdr") || ends(name, ".hdr") || ends(name, ".img");
    double bytes = PACKED_MAX * file_bytes;
    look_lines first(path, 4, 4);
    if (first.text == "NRRD")
        bytes = check_nrrd(path, file_bytes);
    else if (ends(name, ".mha") || ends(name, ".mhd"))
        bytes = check_meta(path, file_bytes);
    else if (ends(name, ".nii") || ends(name, ".nii.gz") || ends(name, ".hdr"))
        bytes = check_nifti(path);
    return std::fmin(apart ? HUGE_VAL : PACKED_MAX * file_bytes, std::fmin(bytes, 8 * VOXELS_MAX));
}
