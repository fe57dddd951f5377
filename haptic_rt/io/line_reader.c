/* Reads a text file line by line, and limits the length of a line. */
#include "line_reader.h"

#include <errno.h>
#include <string.h>

#include "app.h"

bool hrt_lines_open(hrt_lines *l, const char *path) {
    l->path = path;
    l->number = 0;
    l->good = true;
    l->file = fopen(path, "r");
    if (!l->file) app_bad_input(path, 0, "cannot be read (%s); name an existing file", strerror(errno));
    return l->file != NULL;
}

char *hrt_lines_next(hrt_lines *l) {
    if (!l->good || !fgets(l->text, sizeof l->text, l->file)) return NULL;
    l->number++;
    const size_t length = strlen(l->text);
    if ((length == 0 || l->text[length - 1] != '\n') && !feof(l->file)) {
        app_bad_input(l->path, l->number,
                      "longer than %d characters, or a zero byte in it; write shorter lines of text", HRT_LINE_MAX - 2);
        l->good = false;
        return NULL;
    }
    l->text[strcspn(l->text, "#")] = 0;
    return l->text;
}

void hrt_lines_close(hrt_lines *l) {
    fclose(l->file);
    l->file = NULL;
}
