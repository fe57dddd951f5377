// Error in a file, as one line, thrown by a reader.
#ifndef IMAGE_REFUSAL_H
#define IMAGE_REFUSAL_H

#include <cstdarg>
#include <cstdio>
#include <exception>

#include "image_api.h"

struct refusal : std::exception {
    char text[IMAGE_WHY];
    explicit __attribute__((format(printf, 2, 3))) refusal(const char *format, ...) {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(text, sizeof text, format, arguments);
        va_end(arguments);
        for (char *at = text; *at; at++) // text may come from the file
            if ((unsigned char)*at < ' ' || *at == 127) *at = '?';
    }
    const char *what() const noexcept override { return text; }
};

#endif
