// Our own look at a file's header before a library reads it: every count and length within bounds, and held against the
// file's size. What is wrong is thrown (refusal.h).
#ifndef IMAGE_LOOK_H
#define IMAGE_LOOK_H

#include <cstddef>
#include <string>

// Bytes that the contents take in memory, at most: of an image its voxels, of a surface its points and faces.
double check_image(const char *path);
double check_surface(const char *path);

// Size of the file at `path`; throws if it cannot be opened or is no file.
double look_file_bytes(const char *path, const char *wanted);

// Lines of a header, each no longer than `longest`, up to `most` bytes in all.
class look_lines {
  public:
    look_lines(const char *path, size_t most, size_t longest);
    // False at the end of what was read. Lines end with \n or \r\n.
    bool next(std::string *line);
    int number = 0;   // of the last line
    size_t at = 0;    // where the next one begins in the file
    std::string text; // all that was read

  private:
    const size_t longest;
};

#endif
