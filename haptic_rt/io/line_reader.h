/* A text file line by line, each whole or refused: what is cut in two would be read as something else. `#` begins a
 * comment. */
#ifndef HRT_LINES_H
#define HRT_LINES_H

#include <stdbool.h>
#include <stdio.h>

enum { HRT_LINE_MAX = 65536 };

typedef struct hrt_lines {
    const char *path;
    FILE *file;
    int number; /* of the line that is in `text` */
    bool good;
    char text[HRT_LINE_MAX];
} hrt_lines;

/* False with a message on stderr. */
bool hrt_lines_open(hrt_lines *lines, const char *path);
/* The next line without its comment, to be changed as the caller likes. Null at the end, and, after a message that
 * clears `good`, when a line is too long or holds a zero byte. */
char *hrt_lines_next(hrt_lines *lines);
void hrt_lines_close(hrt_lines *lines);

#endif
