#include "look.h"

#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "refusal.h"

double look_file_bytes(const char *path, const char *wanted) {
    struct stat info;
    if (stat(path, &info) != 0) throw refusal("cannot open: %s; check the path", strerror(errno));
    if (!S_ISREG(info.st_mode)) throw refusal("not a regular file; give a %s file", wanted);
    return double(info.st_size);
}

look_lines::look_lines(const char *path, size_t most, size_t longest_line) : longest(longest_line) {
    std::ifstream file(path, std::ios::binary);
    text.resize(most);
    file.read(&text[0], std::streamsize(most));
    text.resize(size_t(file.gcount()));
}

bool look_lines::next(std::string *line) {
    if (at >= text.size()) return false;
    const size_t end = text.find('\n', at), stop = end == std::string::npos ? text.size() : end;
    number++;
    if (stop - at > longest)
        throw refusal("line %d of its header has more than %zu characters, so the file is damaged; save it again",
                      number, longest);
    line->assign(text, at, stop - at);
    if (!line->empty() && line->back() == '\r') line->pop_back();
    at = stop + 1;
    return true;
}
