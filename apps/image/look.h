// Checks a file's header before a library reads it: every count and length must be within bounds and fit the file's
// size. Throws what is wrong (refusal.h).
#ifndef IMAGE_LOOK_H
#define IMAGE_LOOK_H

#include <cstddef>
#include <string>

// Return an upper bound of the contents' memory, bytes: of an image its voxels, of a surface its points and faces.
double check_image(const char *path);
double check_surface(const char *path);

// Returns the size of the file at `path`; throws if it cannot be opened or is not a regular file.
double look_file_bytes(const char *path, const char *wanted);

// Lines of a header, each no longer than `longest`, up to `most` bytes in all.
class look_lines {
  public:
    look_lines(const char *path, size_t most, size_t longest);
    // Reads the next line; returns false at the end. Lines end with \n or \r\n.
    bool next(std::string *line);
    int number = 0;   // of the last line
    size_t at = 0;    // file offset of the next line
    std::string text; // all bytes read

  private:
    const size_t longest;
};

#endif
