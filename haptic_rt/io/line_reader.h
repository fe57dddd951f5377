/* Reads a text file line by line. A line that does not fit is an error: its parts would be misread as lines. `#` begins
 * a comment. */
#ifndef HRT_LINES_H
#define HRT_LINES_H

#include <stdbool.h>
#include <stdio.h>

enum { HRT_LINE_MAX = 65536 };

typedef struct hrt_lines {
    const char *path;
    FILE *file;
    int number; /* number of the line in `text` */
    bool good;
    char text[HRT_LINE_MAX];
} hrt_lines;

/* Opens a file. Returns false after a message on stderr. */
bool hrt_lines_open(hrt_lines *lines, const char *path);
/* Returns the next line without its comment; the caller may modify it. Returns null at the end. Also returns null,
 * after a message and with `good` cleared, if a line is too long or holds a zero byte. */
char *hrt_lines_next(hrt_lines *lines);
void hrt_lines_close(hrt_lines *lines);

#endif
