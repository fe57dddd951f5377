// Reads DICOM-SEG with GDCM: segments, each a stack of frames of bits, become labels on one grid. Format: DICOM PS3.3,
// A.51 (segmentation) and C.8.20. GDCM terminates the process on some truncated files: image_box isolates it.
#include <gdcmAttribute.h>
#include <gdcmReader.h>
#include <gdcmSequenceOfItems.h>
#include <gdcmTrace.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <new>
#include <string>
#include <vector>

#include "module.h"
#include "refusal.h"

namespace {

enum { MAX_VOXELS = 1 << 30 };

typedef gdcm::DataSet Set;

// Returns the items of a sequence; none if it is missing.
std::vector<const Set *> items(const Set &of, uint16_t group, uint16_t element,
                               std::vector<gdcm::SmartPointer<gdcm::SequenceOfItems>> &keep) {
    std::vector<const Set *> out;
    const gdcm::Tag tag(group, element);
    if (!of.FindDataElement(tag)) return out;
    const auto sequence = of.GetDataElement(tag).GetValueAsSQ();
    if (!sequence) return out;
    keep.push_back(sequence);
    for (size_t i = 1; i <= sequence->GetNumberOfItems(); i++) out.push_back(&sequence->GetItem(i).GetNestedDataSet());
    return out;
}

template <uint16_t G, uint16_t E> bool number(const Set &of, double *out, unsigned count = 1) {
    const gdcm::Tag tag(G, E);
    if (!of.FindDataElement(tag) || of.GetDataElement(tag).IsEmpty()) return false;
    gdcm::Attribute<G, E> attribute;
    attribute.SetFromDataSet(of);
    if (attribute.GetNumberOfValues() < count) return false;
    for (unsigned i = 0; i < count; i++) out[i] = double(attribute.GetValues()[i]);
    return true;
}

std::string text(const Set &of, uint16_t group, uint16_t element) {
    const gdcm::Tag tag(group, element);
    const gdcm::ByteValue *bytes = of.FindDataElement(tag) ? of.GetDataElement(tag).GetByteValue() : nullptr;
    std::string out = bytes ? std::string(bytes->GetPointer(), bytes->GetLength()) : "";
    while (!out.empty() && (out.back() == ' ' || out.back() == 0)) out.pop_back();
    return out;
}

struct frame {
    double position_mm[3];
    int segment; // 0: its voxels are labels
    int slice;
};

struct seg {
    std::vector<gdcm::SmartPointer<gdcm::SequenceOfItems>> keep;
    double rows = 0, columns = 0, frames = 0, bits = 0;
    double spacing_mm[3] = {0, 0, 0}, orientation[6] = {0, 0, 0, 0, 0, 0};
    bool labels = false;
    std::vector<frame> frame_of;
};

// Reads spacing and axes, from the shared groups or from each frame; frames must agree.
void take_geometry(seg &s, const Set &group) {
    for (const Set *m : items(group, 0x0028, 0x9110, s.keep)) {
        double in_plane[2], between = 0;
        if (number<0x0028, 0x0030>(*m, in_plane, 2)) s.spacing_mm[0] = in_plane[1], s.spacing_mm[1] = in_plane[0];
        if (number<0x0018, 0x0088>(*m, &between) || number<0x0018, 0x0050>(*m, &between)) s.spacing_mm[2] = between;
    }
    for (const Set *o : items(group, 0x0020, 0x9116, s.keep)) {
        double axes[6];
        if (!number<0x0020, 0x0037>(*o, axes, 6)) continue;
        for (int i = 0; i < 6; i++)
            if ((s.orientation[0] != 0 || s.orientation[1] != 0 || s.orientation[2] != 0) &&
                std::fabs(axes[i] - s.orientation[i]) > 1e-4)
                throw refusal("its frames are not parallel; resample it onto a straight grid");
        memcpy(s.orientation, axes, sizeof axes);
    }
}

void take_frames(seg &s, const Set &all) {
    for (const Set *shared : items(all, 0x5200, 0x9229, s.keep)) take_geometry(s, *shared);
    for (const Set *one : items(all, 0x5200, 0x9230, s.keep)) {
        frame f = {};
        bool placed = false;
        take_geometry(s, *one);
        for (const Set *p : items(*one, 0x0020, 0x9113, s.keep)) placed = number<0x0020, 0x0032>(*p, f.position_mm, 3);
        double segment = 0;
        for (const Set *p : items(*one, 0x0062, 0x000a, s.keep)) number<0x0062, 0x000b>(*p, &segment);
        f.segment = int(segment);
        if (!placed || (!s.labels && f.segment < 1))
            throw refusal("frame %zu has no position or no segment; save it again", s.frame_of.size() + 1);
        s.frame_of.push_back(f);
    }
    if (double(s.frame_of.size()) != s.frames || s.frame_of.empty())
        throw refusal("%zu frames are described and the header counts %.0f, so the file is damaged; copy it again",
                      s.frame_of.size(), s.frames);
}

// Assigns frames to slices: many writers omit empty slices.
void place(seg &s, image_volume *out) {
    const double *o = s.orientation,
                 normal[3] = {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
    std::vector<double> along;
    for (const frame &f : s.frame_of)
        along.push_back(f.position_mm[0] * normal[0] + f.position_mm[1] * normal[1] + f.position_mm[2] * normal[2]);
    const size_t first = size_t(std::min_element(along.begin(), along.end()) - along.begin());
    double most = 0;
    for (size_t i = 0; i < along.size(); i++) {
        const double slice = (along[i] - along[first]) / s.spacing_mm[2];
        if (!(std::fabs(slice - std::round(slice)) < 0.05) || slice > 65535)
            throw refusal("the distance of its frames differs from its header (%.4g mm); resample it", s.spacing_mm[2]);
        s.frame_of[i].slice = int(std::lround(slice));
        most = std::max(most, std::round(slice));
    }
    // If empty slices were omitted, adds one before and one after, so that a label is not cut off there.
    const int margin = s.labels ? 0 : 1;
    for (frame &f : s.frame_of) f.slice += margin;
    out->size[0] = int(s.columns), out->size[1] = int(s.rows), out->size[2] = int(most) + 1 + 2 * margin;
    for (int k = 0; k < 3; k++) {
        out->spacing_m[k] = 1e-3 * s.spacing_mm[k];
        out->origin_m[k] = 1e-3 * (s.frame_of[first].position_mm[k] - margin * normal[k] * s.spacing_mm[2]);
        out->direction[3 * k] = o[k], out->direction[3 * k + 1] = o[3 + k], out->direction[3 * k + 2] = normal[k];
        if (!(s.spacing_mm[k] > 0) || !std::isfinite(s.spacing_mm[k]) || !std::isfinite(out->origin_m[k]))
            throw refusal("it has no spacing or no position; save it again");
        if (out->size[k] < 2) throw refusal("it is one voxel thick along axis %d; a volume needs at least two", k + 1);
    }
    for (int a = 0; a < 3; a++)
        for (int b = 0; b <= a; b++) {
            const double *d = out->direction;
            if (!(std::fabs(d[a] * d[b] + d[3 + a] * d[3 + b] + d[6 + a] * d[6 + b] - (a == b)) < 1e-3))
                throw refusal("its axes are not at right angles; resample it onto a straight grid");
        }
}

void take_voxels(const seg &s, const gdcm::ByteValue &bytes, image_volume *out) {
    const size_t plane = size_t(out->size[0]) * size_t(out->size[1]);
    const auto *data = reinterpret_cast<const unsigned char *>(bytes.GetPointer());
    for (size_t f = 0; f < s.frame_of.size(); f++) {
        uint16_t *to = out->label + plane * size_t(s.frame_of[f].slice);
        const int segment = s.frame_of[f].segment;
        for (size_t i = 0; i < plane; i++) {
            const size_t at = f * plane + i;
            const unsigned value = s.bits == 1   ? data[at / 8] >> (at % 8) & 1u
                                   : s.bits == 8 ? data[at]
                                                 : data[2 * at] | unsigned(data[2 * at + 1]) << 8;
            if (!value) continue;
            const unsigned label = s.labels ? value : unsigned(segment);
            if (to[i] && to[i] != label)
                throw refusal("segments %d and %u overlap; save them as a label map, one label a voxel", int(to[i]),
                              label);
            to[i] = uint16_t(label);
        }
    }
}

void take_names(seg &s, const Set &all, image_volume *out) {
    for (const Set *one : items(all, 0x0062, 0x0002, s.keep)) {
        double value = 0;
        const std::string name = text(*one, 0x0062, 0x0005);
        if (!number<0x0062, 0x0004>(*one, &value) || name.empty() || out->names == IMAGE_NAMES) continue;
        out->name[out->names].label = int(value);
        snprintf(out->name[out->names++].name, sizeof out->name[0].name, "%s", name.c_str());
    }
}

void check_header(seg &s, const Set &all) {
    const std::string kind = text(all, 0x0062, 0x0001);
    if (text(all, 0x0008, 0x0060) != "SEG" || kind.empty())
        throw refusal("it is DICOM, but not a segmentation (its modality is '%.16s'); give a DICOM-SEG file",
                      text(all, 0x0008, 0x0060).c_str());
    s.labels = kind == "LABELMAP";
    if (!s.labels && kind != "BINARY")
        throw refusal("it is a %.16s segmentation, not BINARY or LABELMAP; save it with a threshold", kind.c_str());
    if (!number<0x0028, 0x0010>(all, &s.rows) || !number<0x0028, 0x0011>(all, &s.columns) ||
        !number<0x0028, 0x0008>(all, &s.frames) || !number<0x0028, 0x0100>(all, &s.bits))
        throw refusal("its header has no size; save it again");
    if (s.labels ? s.bits != 8 && s.bits != 16 : s.bits != 1 && s.bits != 8)
        throw refusal("it has %.0f bits a voxel; save BINARY with 1 or 8, or LABELMAP with 8 or 16", s.bits);
}

} // namespace

bool image_is_dicom(const char *path) {
    char head[132] = "";
    std::ifstream file(path, std::ios::binary);
    return file.read(head, sizeof head) && memcmp(head + 128, "DICM", 4) == 0;
}

// Returns whether the file contains all voxels, which come last except for padding: GDCM fills in missing ones.
static bool is_whole(const char *path, size_t length) {
    static const char tag[] = {'\xe0', '\x7f', '\x10', '\x00'};
    std::ifstream file(path, std::ios::binary);
    const std::string all((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    for (size_t at = all.rfind(tag, std::string::npos, sizeof tag); at != std::string::npos;
         at = at ? all.rfind(tag, at - 1, sizeof tag) : std::string::npos) {
        const size_t head = at + 6 <= all.size() && all[at + 4] == 'O' ? 12 : 8; // explicit VR: OB or OW
        if (at + head + length <= all.size()) return true;
    }
    return false;
}

static void read_here(const char *path, image_volume *out) {
    gdcm::Reader reader;
    reader.SetFileName(path);
    if (!reader.Read()) throw refusal("GDCM cannot read it, so the file is truncated or damaged; copy it again");
    const Set &all = reader.GetFile().GetDataSet();
    seg s;
    check_header(s, all);
    take_frames(s, all);
    place(s, out);
    const gdcm::Tag pixels(0x7fe0, 0x0010);
    const gdcm::ByteValue *bytes = all.FindDataElement(pixels) ? all.GetDataElement(pixels).GetByteValue() : nullptr;
    if (!bytes) throw refusal("its voxels are compressed or missing; save it uncompressed (explicit VR little endian)");
    const double wanted = std::ceil(s.rows * s.columns * s.frames * s.bits / 8),
                 voxels = s.rows * s.columns * out->size[2];
    if (!is_whole(path, bytes->GetLength()))
        throw refusal("it ends within its voxels, so the file is truncated; copy it again");
    if (double(size_t(bytes->GetLength())) < wanted)
        throw refusal(
            "it has %.0f bytes of voxels and its header says %.0f, so the file is truncated or damaged; copy it again",
            double(size_t(bytes->GetLength())), wanted);
    if (voxels > MAX_VOXELS)
        throw refusal("it has %.3g voxels; crop or resample it to %.3g at most", voxels, double(MAX_VOXELS));
    snprintf(out->kind, sizeof out->kind, "DICOM-SEG");
    snprintf(out->unit, sizeof out->unit, "mm");
    out->label = (uint16_t *)calloc(size_t(voxels) + 1, sizeof *out->label);
    if (!out->label) throw std::bad_alloc();
    take_voxels(s, *bytes, out);
    take_names(s, all, out);
}

void image_read_dicom(const char *path, image_volume *out) {
    gdcm::Trace::WarningOff();
    gdcm::Trace::ErrorOff();
    gdcm::Trace::DebugOff();
    read_here(path, out);
}
