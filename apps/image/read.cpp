// Reads label images, and vector images of NIfTI, with ITK's readers of NIfTI, NRRD and MetaImage (DICOM-SEG:
// dicom.cpp). Each reader runs in a child process with limits (box.h), after a check of the header (look.h).
#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <sys/stat.h>
#include <zlib.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <iostream>
#include <limits>
#include <memory>
#include <new>
#include <string>

#include "box.h"
#include "look.h"
#include "module.h"
#include "refusal.h"

namespace {

enum { MAX_VOXELS = 1 << 30 };

itk::ImageIOBase::Pointer reader_of(const char *path) {
    const itk::ImageIOBase::Pointer all[] = {itk::NiftiImageIO::New().GetPointer(),
                                             itk::NrrdImageIO::New().GetPointer(),
                                             itk::MetaImageIO::New().GetPointer()};
    for (const auto &io : all)
        if (io->CanReadFile(path)) {
            io->SetFileName(path);
            return io;
        }
    throw refusal(
        "unknown type of image; give NIfTI (.nii .nii.gz), NRRD (.nrrd .nhdr), MetaImage (.mha .mhd) or DICOM-SEG (.dcm)");
}

std::string dictionary(const itk::ImageIOBase &io, const std::string &key) {
    std::string value;
    itk::ExposeMetaData(io.GetMetaDataDictionary(), key, value);
    return value;
}

// Returns NRRD's "space units", which ITK drops: "mm" "mm" "mm".
std::string nrrd_unit(const char *path) {
    std::ifstream file(path, std::ios::binary);
    std::string line;
    for (int i = 0; i < 1000 && std::getline(file, line) && line.size() > 1; i++)
        if (line.compare(0, 12, "space units:") == 0) {
            const size_t from = line.find('"'), to = line.find('"', from + 1);
            if (from != std::string::npos && to != std::string::npos) return line.substr(from + 1, to - from - 1);
        }
    return "";
}

double metres_of(const std::string &unit) {
    static const struct {
        const char *name;
        double metres;
    } known[] = {{"m", 1},     {"meter", 1},     {"mm", 1e-3}, {"millimeter", 1e-3},
                 {"um", 1e-6}, {"micron", 1e-6}, {"cm", 1e-2}};
    for (const auto &k : known)
        if (unit == k.name) return k.metres;
    throw refusal("its unit of length is '%.20s'; write it in mm", unit.c_str());
}

// Sets spacing, origin and axes in metres.
void take_place(const itk::ImageIOBase &io, const char *path, double unit_m, image_volume *out) {
    const bool nifti = std::string(io.GetNameOfClass()) == "NiftiImageIO";
    std::string unit = nifti ? dictionary(io, "xyzt_units") : "";
    if (nifti) {
        const int code = atoi(unit.c_str()) & 7;
        unit = code == 1 ? "m" : code == 2 ? "mm" : code == 3 ? "um" : "";
    } else if (std::string(io.GetNameOfClass()) == "NrrdImageIO")
        unit = nrrd_unit(path);
    else
        unit = "mm"; // MetaImage's only unit
    snprintf(out->unit, sizeof out->unit, "%s", unit.c_str());
    const double metres = !unit.empty() ? metres_of(unit) : unit_m > 0 ? unit_m : 1e-3;
    double product = 1;
    for (unsigned k = 0; k < 3; k++) {
        // ITK converts the spacing of NIfTI to millimetres, but not the origin.
        out->spacing_m[k] = io.GetSpacing(k) * (nifti && !unit.empty() ? 1e-3 : metres);
        out->origin_m[k] = io.GetOrigin(k) * metres;
        for (unsigned i = 0; i < 3; i++) out->direction[3 * i + k] = io.GetDirection(k)[i];
        product *= out->spacing_m[k];
        if (!std::isfinite(out->spacing_m[k]) || !(out->spacing_m[k] > 0) || !std::isfinite(out->origin_m[k]))
            throw refusal("its spacing or origin is not a length; save the image again");
    }
    const double *d = out->direction;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b <= a; b++)
            if (!(std::fabs(d[a] * d[b] + d[3 + a] * d[3 + b] + d[6 + a] * d[6 + b] - (a == b)) < 1e-3))
                throw refusal("its axes are not at right angles; resample it onto a straight grid");
}

void check_shape(const itk::ImageIOBase &io, image_volume *out) {
    unsigned dims = io.GetNumberOfDimensions();
    while (dims > 3 && io.GetDimensions(dims - 1) == 1) dims--;
    if (dims > 3)
        throw refusal(
            "it has %u dimensions; give one label image of three (if segments of a .seg.nrrd overlap, save it as a label map)",
            dims);
    if (dims < 3) throw refusal("it has %u dimensions; give a volume of three", dims);
    for (unsigned k = 0; k < 3; k++) {
        if (io.GetDimensions(k) < 2)
            throw refusal("it is one voxel thick along axis %u; a volume needs at least two", k + 1);
        if (io.GetDimensions(k) > MAX_VOXELS)
            throw refusal("it has %zu voxels along axis %u; crop it", (size_t)io.GetDimensions(k), k + 1);
        out->size[k] = (int)io.GetDimensions(k);
    }
    if (io.GetNumberOfComponents() != 1)
        throw refusal("it has %u numbers a voxel; give a label image, which has one", io.GetNumberOfComponents());
    const auto type = io.GetComponentType();
    if (type == itk::IOComponentEnum::FLOAT || type == itk::IOComponentEnum::DOUBLE)
        throw refusal(
            "its voxels are %s, not labels; save the segmentation as whole numbers (uint8 or uint16, no slope)",
            itk::ImageIOBase::GetComponentTypeAsString(type).c_str());
}

// Rejects sizes that the file's bytes cannot contain, whatever the header states. Deflate compresses by 1032 at most.
void check_size(const itk::ImageIOBase &io, const char *path, const image_volume &out) {
    const double voxels = double(out.size[0]) * out.size[1] * out.size[2],
                 bytes = voxels * double(io.GetComponentSize());
    if (voxels > MAX_VOXELS)
        throw refusal("it has %.3g voxels; crop or resample it to %.3g at most", voxels, double(MAX_VOXELS));
    struct stat info;
    const char *dot = strrchr(path, '.');
    const bool apart = dot && (!strcmp(dot, ".mhd") || !strcmp(dot, ".nhdr") || !strcmp(dot, ".hdr"));
    if (!apart && stat(path, &info) == 0 && bytes > 1032.0 * double(info.st_size))
        throw refusal(
            "its header says %.3g MB of voxels and the file has %.3g MB, so it is truncated or damaged; copy it again",
            1e-6 * bytes, 1e-6 * double(info.st_size));
}

// Counts the bytes of a NIfTI first, because ITK fills a truncated one with zeros (zlib reads uncompressed files too).
void check_nifti_end(const itk::ImageIOBase &io, const char *path, double bytes) {
    const std::string magic = dictionary(io, "vox_offset");
    const double expected = bytes + atof(magic.c_str());
    const char *dot = strrchr(path, '.');
    if (dot && (!strcmp(dot, ".hdr") || !strcmp(dot, ".img"))) return;
    gzFile file = gzopen(path, "rb");
    double seen = 0;
    char part[1 << 16];
    int got = 0;
    while (file && (got = gzread(file, part, sizeof part)) > 0) seen += got;
    const bool whole = file && got == 0 && gzclose(file) == Z_OK;
    if (file && got != 0) gzclose(file);
    if (!whole || seen < expected)
        throw refusal(
            "it has %.0f bytes of the %.0f that its header says, so the file is truncated or damaged; copy it again",
            seen, expected);
}

// Reads voxels. MetaImage leaves unread ones unchanged: two readings into different contents must agree. It also
// prints to stderr.
void read_voxels(itk::ImageIOBase &io, const char *path, char *bytes, size_t size) {
    std::streambuf *const said = std::cerr.rdbuf(nullptr);
    try {
        if (std::string(io.GetNameOfClass()) == "NiftiImageIO") check_nifti_end(io, path, double(size));
        memset(bytes, 0, size);
        io.Read(bytes);
        if (std::string(io.GetNameOfClass()) == "MetaImageIO") {
            const std::unique_ptr<char[]> again(new char[size]);
            memset(again.get(), 0x55, size);
            io.Read(again.get());
            if (memcmp(bytes, again.get(), size) != 0)
                throw refusal("it ends before its last voxel, so the file is truncated or damaged; copy it again");
        }
    } catch (...) {
        std::cerr.rdbuf(said);
        throw;
    }
    std::cerr.rdbuf(said);
}

template <typename T> void take(const void *from, size_t count, uint16_t *to) {
    const T *value = static_cast<const T *>(from);
    for (size_t i = 0; i < count; i++) {
        if (value[i] < T(0) || (std::numeric_limits<T>::max() > T(100) && double(value[i]) > 65535))
            throw refusal("it has label %.0f; use labels 0 (nothing) to 65535", double(value[i]));
        to[i] = static_cast<uint16_t>(value[i]);
    }
}

void take_labels(const itk::ImageIOBase &io, const void *from, size_t count, uint16_t *to) {
    typedef itk::IOComponentEnum type;
    switch (io.GetComponentType()) {
    case type::UCHAR: return take<unsigned char>(from, count, to);
    case type::CHAR: return take<signed char>(from, count, to);
    case type::USHORT: return take<unsigned short>(from, count, to);
    case type::SHORT: return take<short>(from, count, to);
    case type::UINT: return take<unsigned>(from, count, to);
    case type::INT: return take<int>(from, count, to);
    case type::ULONG: return take<unsigned long>(from, count, to);
    case type::LONG: return take<long>(from, count, to);
    case type::ULONGLONG: return take<unsigned long long>(from, count, to);
    case type::LONGLONG: return take<long long>(from, count, to);
    default: throw refusal("its voxels have an unknown type; save the segmentation as uint8 or uint16");
    }
}

// Reads the names that 3D Slicer writes into NRRD as "Segment0_Name" and "Segment0_LabelValue".
void take_names(const itk::ImageIOBase &io, image_volume *out) {
    for (int i = 0; i < IMAGE_NAMES; i++) {
        const std::string key = "Segment" + std::to_string(i), value = dictionary(io, key + "_LabelValue"),
                          name = dictionary(io, key + "_Name");
        if (value.empty() || name.empty()) break;
        out->name[out->names].label = atoi(value.c_str());
        snprintf(out->name[out->names++].name, sizeof out->name[0].name, "%s", name.c_str());
    }
}

itk::ImageIORegion whole(const itk::ImageIOBase &io) {
    itk::ImageIORegion region(io.GetNumberOfDimensions());
    for (unsigned k = 0; k < io.GetNumberOfDimensions(); k++) {
        region.SetIndex(k, 0);
        region.SetSize(k, io.GetDimensions(k));
    }
    return region;
}

// Checks that coordinates are bounded as those of meshes, and that voxels are not extremely elongated.
void check_place(const image_volume &v) {
    const double *s = v.spacing_m, least = std::fmin(s[0], std::fmin(s[1], s[2])),
                 longest = std::fmax(s[0], std::fmax(s[1], s[2]));
    if (!(least > 1e-9) || !(longest < 1000 * least))
        throw refusal("its voxels have %.3g x %.3g x %.3g mm; correct its spacing", 1e3 * s[0], 1e3 * s[1], 1e3 * s[2]);
    for (int i = 0; i < 3; i++) {
        double most = std::fabs(v.origin_m[i]);
        for (int k = 0; k < 3; k++) most += std::fabs(v.direction[3 * i + k]) * v.spacing_m[k] * v.size[k];
        if (!(most < 1e6)) throw refusal("it extends beyond 1000 km; correct its spacing, origin or unit");
    }
}

void read_whole(const char *path, double unit_m, image_volume *out) {
    if (image_is_dicom(path)) {
        image_read_dicom(path, out);
        return check_place(*out);
    }
    const itk::ImageIOBase::Pointer io = reader_of(path);
    io->ReadImageInformation();
    snprintf(out->kind, sizeof out->kind, "%s", io->GetNameOfClass());
    check_shape(*io, out);
    take_place(*io, path, unit_m, out);
    check_size(*io, path, *out);
    check_place(*out);
    take_names(*io, out);
    const size_t count = (size_t)out->size[0] * (size_t)out->size[1] * (size_t)out->size[2];
    io->SetIORegion(whole(*io));
    const std::unique_ptr<char[]> bytes(new char[count * io->GetComponentSize()]);
    read_voxels(*io, path, bytes.get(), count * io->GetComponentSize());
    out->label = (uint16_t *)malloc((count + 1) * sizeof *out->label);
    if (!out->label) throw std::bad_alloc();
    take_labels(*io, bytes.get(), count, out->label);
}

// Returns whether a voxel has three numbers: NIfTI's fifth axis, which ITK converts to components, or the fourth.
bool has_components(const itk::ImageIOBase &io) {
    const unsigned dims = io.GetNumberOfDimensions();
    const bool fifth = dims == 3 && io.GetNumberOfComponents() == 3;
    if (!fifth && !(dims == 4 && io.GetNumberOfComponents() == 1 && io.GetDimensions(3) == 3))
        throw refusal(
            "it has %u dimensions of %u number%s a voxel; give fibres as an image of 3 numbers a voxel (a fourth axis of 3, or vectors)",
            dims, io.GetNumberOfComponents(), io.GetNumberOfComponents() == 1 ? "" : "s");
    return fifth;
}

template <typename T> void take_vectors(const char *bytes, size_t voxels, bool components, float *to) {
    const T *value = reinterpret_cast<const T *>(bytes);
    for (size_t i = 0; i < voxels; i++)
        for (size_t k = 0; k < 3; k++) {
            const double one = double(value[components ? 3 * i + k : k * voxels + i]);
            if (!std::isfinite(one) || std::fabs(one) > 1e12)
                throw refusal("voxel %zu has no finite vector; write 0 0 0 where there is none", i);
            to[3 * i + k] = float(one);
        }
}

void read_whole_vectors(const char *path, image_vectors *out) {
    const itk::ImageIOBase::Pointer io = reader_of(path);
    if (std::string(io->GetNameOfClass()) != "NiftiImageIO")
        throw refusal("fibres can be read only from NIfTI; convert it");
    io->ReadImageInformation();
    const bool components = has_components(*io), wide = io->GetComponentType() == itk::IOComponentEnum::DOUBLE;
    if (!wide && io->GetComponentType() != itk::IOComponentEnum::FLOAT)
        throw refusal("its numbers are not float32 or float64; save directions as one of these");
    image_volume place = {};
    for (unsigned k = 0; k < 3; k++) {
        if (io->GetDimensions(k) < 1 || io->GetDimensions(k) > MAX_VOXELS / 8)
            throw refusal("it has %zu voxels along axis %u; crop it", (size_t)io->GetDimensions(k), k + 1);
        place.size[k] = out->size[k] = (int)io->GetDimensions(k);
    }
    take_place(*io, path, 0, &place);
    check_size(*io, path, place);
    memcpy(out->spacing_m, place.spacing_m, sizeof out->spacing_m);
    memcpy(out->origin_m, place.origin_m, sizeof out->origin_m);
    memcpy(out->direction, place.direction, sizeof out->direction);
    io->SetIORegion(whole(*io));
    const size_t voxels = (size_t)out->size[0] * (size_t)out->size[1] * (size_t)out->size[2];
    const size_t size = 3 * voxels * io->GetComponentSize();
    const std::unique_ptr<char[]> bytes(new char[size]);
    read_voxels(*io, path, bytes.get(), size);
    out->vector = (float *)malloc((3 * voxels + 1) * sizeof *out->vector);
    if (!out->vector) throw std::bad_alloc();
    if (wide)
        take_vectors<double>(bytes.get(), voxels, components, out->vector);
    else
        take_vectors<float>(bytes.get(), voxels, components, out->vector);
}

// Copies the last line of a message: it contains the cause in ITK's messages of several lines.
void last_line(const char *text, char why[IMAGE_WHY]) {
    std::string all(text), last;
    size_t end = all.find_last_not_of(" \n\r\t");
    all.resize(end == std::string::npos ? 0 : end + 1);
    size_t line = all.rfind('\n');
    last = line == std::string::npos ? all : all.substr(line + 1);
    if (last.find("orthonormal") != std::string::npos)
        snprintf(why, IMAGE_WHY, "its axes are not at right angles (in a NIfTI by sform, mm); resample it");
    else
        snprintf(why, IMAGE_WHY, "ITK cannot read it: %.300s, so the file is truncated or damaged; save it again",
                 last.c_str());
}

// Runs `act` and converts an exception to an outcome and one line.
template <typename Act> image_end guarded(const Act &act, char why[IMAGE_WHY]) {
    itk::Object::GlobalWarningDisplayOff(); // errors arrive as exceptions
    try {
        act();
    } catch (const refusal &e) {
        snprintf(why, IMAGE_WHY, "%s", e.what());
        return IMAGE_BAD_INPUT;
    } catch (const std::bad_alloc &) {
        snprintf(why, IMAGE_WHY, "no memory for its voxels; crop or resample it");
        return IMAGE_NO_MEMORY;
    } catch (const std::exception &e) {
        last_line(e.what(), why);
        return IMAGE_BAD_INPUT;
    }
    return IMAGE_DONE;
}

} // namespace

// Returns limits for reading `bytes` bytes: processor time 5 s + 1 s per 5 MB, memory 600 MB + 10 times the bytes.
static box_limits limits_of(const char *path, double bytes) {
    return {image_is_dicom(path) ? "GDCM" : "ITK", 5 + std::ceil(bytes / 5e6), 6e8 + 10 * bytes, true};
}

image_end image_read(const char *path, double unit_m, image_volume *out, char why[IMAGE_WHY]) {
    *out = image_volume();
    double bytes = 0;
    const image_end looked = guarded([&] { bytes = check_image(path); }, why);
    if (looked != IMAGE_DONE) return looked;
    const auto voxels = [out] { return double(out->size[0]) * out->size[1] * out->size[2]; };
    return image_box(
        limits_of(path, bytes), why, [=](char *said) { return guarded([=] { read_whole(path, unit_m, out); }, said); },
        [=](box_pipe &to) {
            to.put(out, sizeof *out);
            to.put(out->label, size_t(voxels()) * sizeof *out->label);
        },
        [=](box_pipe &from) {
            const bool good = from.take(out, sizeof *out) && out->names >= 0 && out->names <= IMAGE_NAMES;
            uint16_t *label = good ? (uint16_t *)from.take_array(voxels(), sizeof *label, MAX_VOXELS) : nullptr;
            if (!label) *out = image_volume();
            out->label = label;
            return label != nullptr;
        });
}

image_end image_read_vectors(const char *path, image_vectors *out, char why[IMAGE_WHY]) {
    *out = image_vectors();
    double bytes = 0;
    const image_end looked = guarded([&] { bytes = check_image(path); }, why);
    if (looked != IMAGE_DONE) return looked;
    const auto numbers = [out] { return 3.0 * out->size[0] * out->size[1] * out->size[2]; };
    return image_box(
        limits_of(path, bytes), why, [=](char *said) { return guarded([=] { read_whole_vectors(path, out); }, said); },
        [=](box_pipe &to) {
            to.put(out, sizeof *out);
            to.put(out->vector, size_t(numbers()) * sizeof *out->vector);
        },
        [=](box_pipe &from) {
            float *vector = from.take(out, sizeof *out)
                                ? (float *)from.take_array(numbers(), sizeof *vector, 3.0 * MAX_VOXELS)
                                : nullptr;
            if (!vector) *out = image_vectors();
            out->vector = vector;
            return vector != nullptr;
        });
}
