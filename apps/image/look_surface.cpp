// Checks headers of PLY and OFF: counts must fit the file, and elements must have names. OBJ has no header.
#include <strings.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "look.h"
#include "refusal.h"

namespace {

enum { HEADER_MAX = 1 << 16, LINE_BYTES_MAX = 1000, ELEMENTS_MAX = 20, PROPERTIES_MAX = 200, OFF_LINES = 100 };

[[noreturn]] void lies() {
    throw refusal("its header counts more than the file contains, so it is truncated; save it again");
}

double count_of(const std::string &word, double file_bytes) {
    char *end;
    const double count = strtod(word.c_str(), &end);
    if (word.empty() || *end || !(count >= 0) || count != std::floor(count))
        throw refusal("its header counts '%.40s', so the file is damaged; save it again", word.c_str());
    if (count > file_bytes) lies();
    return count;
}

bool is_ply_number(const std::string &type) {
    static const char *const known[] = {"char", "uchar", "short", "ushort", "int",   "uint",   "float",   "double",
                                        "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"};
    for (const char *k : known)
        if (type == k) return true;
    return false;
}

// Checks a property: it follows an element and has a type of PLY's.
void take_property(std::istringstream &words, int elements, int *properties) {
    std::string type, count, item, name;
    words >> type;
    if (type == "list") words >> count >> item;
    words >> name;
    if (!elements) throw refusal("its header has a property before any element, so the file is damaged; save it again");
    if (++*properties > PROPERTIES_MAX || name.empty() || (type != "list" && !is_ply_number(type)) ||
        (type == "list" && (!is_ply_number(count) || !is_ply_number(item))))
        throw refusal("its header has a property of unknown type ('%.40s'); save the surface again", type.c_str());
}

void check_ply(const char *path, double file_bytes) {
    look_lines lines(path, HEADER_MAX, LINE_BYTES_MAX);
    std::string line;
    int elements = 0, properties = 0;
    bool vertices = false, faces = false;
    if (!lines.next(&line) || line != "ply")
        throw refusal("its first line is not 'ply', so it is not a PLY file; correct its file name extension");
    while (lines.next(&line)) {
        std::istringstream words(line);
        std::string word, name, count;
        words >> word;
        if (word == "end_header") {
            if (!vertices || !faces)
                throw refusal("its header has no %s; save the surface again",
                              vertices ? "element face" : "element vertex");
            return;
        }
        if (word == "property") take_property(words, elements, &properties);
        if (word != "element") continue;
        words >> name >> count;
        if (++elements > ELEMENTS_MAX)
            throw refusal("its header has more than %d elements; save it again", int(ELEMENTS_MAX));
        count_of(count, file_bytes);
        vertices |= name == "vertex";
        faces |= name == "face";
    }
    throw refusal("its header has no end_header, so the file is truncated or damaged; save it again");
}

// Checks OFF and its three counts, between comments and empty lines. CGAL checks the counts of binary files.
void check_off(const char *path, double file_bytes) {
    look_lines lines(path, HEADER_MAX, HEADER_MAX);
    std::string line;
    for (int i = 0; i < OFF_LINES && lines.next(&line); i++) {
        std::istringstream words(line.substr(0, line.find('#')));
        std::string word;
        if (!(words >> word)) continue;
        if (word.find("OFF") != std::string::npos && !(words >> word)) continue;
        if (word == "BINARY") return;
        do count_of(word, file_bytes);
        while (words >> word);
        return;
    }
}

} // namespace

double check_surface(const char *path) {
    const double file_bytes = look_file_bytes(path, "surface");
    const char *dot = strrchr(path, '.');
    if (dot && !strcasecmp(dot, ".ply")) check_ply(path, file_bytes);
    if (dot && !strcasecmp(dot, ".off")) check_off(path, file_bytes);
    return 40 * file_bytes;
}
